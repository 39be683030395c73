"""Converters in front of the chain, touch position and stimulator behind it; docs/specification_interfaces.md section
12."""
