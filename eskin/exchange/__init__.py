"""Networks from and to other tools: PyTorch and ONNX files, plain C."""
