"""The port by which the host writes memories."""

from __future__ import annotations

from amaranth.lib import wiring
from amaranth.lib.wiring import Out


def load_signature() -> wiring.Signature:
    """``select`` (memory_map.Memory), 16-bit ``data`` to word ``address`` where ``enable``; seen from the host."""
    return wiring.Signature({"select": Out(7), "address": Out(16), "data": Out(16), "enable": Out(1)})
