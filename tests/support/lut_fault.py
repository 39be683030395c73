"""A fault in a netlist that a co-simulation must see."""

import random
import re

LUT_INIT = {"ice40": "LUT_INIT", "ecp5": "INIT"}
LUT_PINS = {"ice40": ("I0", "I1", "I2", "I3"), "ecp5": ("A", "B", "C", "D")}
"""Inputs of a look-up table, the least significant of its bit's number first."""
PARITIES = {
    sum((mask & address).bit_count() % 2 << address for address in range(16)) ^ inverted
    for mask in range(16)
    if mask.bit_count() > 1
    for inverted in (0, 0xFFFF)
}
"""Contents of a table that is a parity of two inputs or more, or its complement."""


def flip_lut_bit(verilog: str, family: str, seed: int, within: str = "") -> str:
    """The netlist with one bit of one look-up table inverted: a fault that a co-simulation must see.

    Parameters
    ----------
    seed:
        Chooses table and bit among tables that are a parity of two inputs or more, such as an adder's sum:
        there every input pattern occurs. Of other tables many bits are never read. A Gowin part adds in cells of
        its own: one of them subtracts instead, or adds.
    within:
        Beginning of the cell's name, such as a block's.
    """
    choice = random.Random(seed)
    if family == "gowin":
        adders = re.finditer(rf"\.ALU_MODE\(32'sd(\d)\)\n  \) \\?{re.escape(within)}", verilog)
        mode = choice.choice(list(adders))
        return f"{verilog[: mode.start(1)]}{int(mode[1] != '1')}{verilog[mode.end(1) :]}"
    cell = re.compile(rf"\.{LUT_INIT[family]}\(16'h([0-9a-f]{{4}})\)\n  \) \\?{re.escape(within)}")
    place = choice.choice([place for place in cell.finditer(verilog) if int(place[1], 16) in PARITIES])
    pins = dict(re.findall(r"\.(\w+)\(([^()]*)\)", verilog[place.end() : verilog.index(";", place.end())]))
    # a pin that is tied to a constant keeps half of the bits from ever being read
    tied = {k: int(pins[pin][-1]) for k, pin in enumerate(LUT_PINS[family]) if pins[pin] in ("1'h0", "1'h1")}
    read = [bit for bit in range(16) if all(bit >> k & 1 == level for k, level in tied.items())]
    changed = int(place[1], 16) ^ 1 << choice.choice(read)
    return f"{verilog[: place.start(1)]}{changed:04x}{verilog[place.end(1) :]}"
