"""Ports of every converter's controller beside its pins (docs/specification_interfaces.md section 12)."""

from amaranth.hdl import unsigned
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from eskin.golden.core import ConverterFault
from eskin.rtl.common import outputs, struct

FAULT_BITS = len(ConverterFault)


def converter_ports(taxels: int, code_bits: int) -> dict[str, wiring.Member]:
    """Ports of every converter beside its pins.

    start : In(1)
        Begin a frame; only while not ``busy``.
    busy : Out(1)
        A frame is being read.
    away : Out(1)
        The converter is being set up: a ``start`` begins no frame. Some need it all the same, to keep their
        time.
    put : Out(struct: valid, place, code)
        A code and the taxel that it belongs to, in any order of taxels; ``valid`` for the single cycle in which it must be
        taken.
    finished : Out(1)
        One cycle, after the last code: the frame is over; ``fault`` (`ConverterFault` bits) is what was wrong
        with it. While ``away``: setting up has failed and restarts.
    """
    ports = {**outputs("busy", "away", "finished"), "fault": Out(FAULT_BITS)}
    put = struct("valid", place=range(taxels), code=unsigned(code_bits))
    return {"start": In(1), "put": Out(put)} | ports
