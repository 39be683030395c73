"""Verilog of a process's cells from their functions in the Liberty file, for simulation: no delays, and states
that begin at random."""

from collections.abc import Iterable

from eskin.golden.core import template
from eskin.rtl.asic.liberty import Cell
from eskin.rtl.asic.synthesis import macro_verilog


def expression(function: str) -> str:
    """A Liberty function in Verilog's operators."""
    return function.replace("*", "&").replace("+", "|").replace("!", "~")


def model(cell: Cell) -> str:
    """The module of a cell."""
    if cell.kind == "memory":
        return macro_verilog(cell, random=True)
    pins = {name: pin for name, pin in cell.pins.items() if pin.direction in ("input", "output")}
    return template(__file__, "cell.v", expression=expression).render(cell=cell, pins=pins)


def models(cells: Iterable[Cell]) -> str:
    """Modules of all ``cells``."""
    return "".join(model(cell) for cell in cells)
