"""Networks from and to other tools: PyTorch and ONNX files, plain C.

onnxruntime reports the models that it opens to its maker, unless this variable is set before it is imported.
A user's model is nobody else's business.
"""

import os

os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
