"""Comparisons with constants that cost few gates."""

from amaranth.hdl import Cat, Const, Mux, Signal, Value


def reaches(counter: Signal, bound: int) -> Value:
    """``counter == bound`` for a counter that comes from below: only the bits that ``bound`` sets need a
    look."""
    return Cat(bit for k, bit in enumerate(counter) if bound >> k & 1).all()


def exceeds(value: Value, bound: int) -> Value:
    """``value > bound`` for a constant, by gates.

    On an FPGA this takes about a third of the cells of a comparator's two carry chains.
    """
    value = Value.cast(value)
    if value.shape().signed:  # offset binary
        value, bound = Cat(value[:-1], ~value[-1]), bound + (1 << len(value) - 1)
    if bound < 0:
        return Const(1, 1)
    if bound >= 1 << len(value):  # a threshold beyond anything that the value reaches
        return Const(0, 1)
    result = Const(0, 1)
    for k, bit in enumerate(value):  # the highest bit that differs decides
        result = bit & result if bound >> k & 1 else bit | result
    return result


def greater(value: Value, other: Value) -> Value:
    """``value > other`` of few bits without signs, by gates."""
    result = Const(0, 1)
    for k in range(max(len(value), len(other))):
        mine, its = (operand[k] if k < len(operand) else Const(0, 1) for operand in (value, other))
        result = Mux(mine ^ its, mine, result)
    return result
