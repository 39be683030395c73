"""Networks from and to other tools: PyTorch and ONNX files, plain C.

onnxruntime reports each opened model to its vendor unless this variable is set before the import.
A user's model is nobody else's business.
"""

import os

os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
