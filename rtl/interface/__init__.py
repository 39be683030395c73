"""Converters in front of the chain, touch position and stimulator behind it; docs/specification.md section
12."""
