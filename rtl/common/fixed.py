"""Fixed point in hardware: shapes of formats, and the narrowings of docs/specification.md section 1 as
combinational expressions.

Amaranth truncates silently on assignment, so every narrowing in ``rtl/`` goes through ``saturate``,
``narrow`` or ``clip``. Values grow as the language grows them (no overflow inside an expression); right
shifts are floor.
"""

from amaranth.hdl import Cat, Const, Module, Mux, Shape, Signal, Value, signed, unsigned

from eskin.golden.core import QFormat


def shape_of(fmt: QFormat) -> Shape:
    """The hardware shape of a code of ``fmt``."""
    return signed(fmt.width) if fmt.signed else unsigned(fmt.width)


def saturate(value: Value, fmt: QFormat) -> Value:
    """SAT: ``value`` (any integer expression) held within ``fmt``; the result has ``shape_of(fmt)``.

    Overflow is read off the bits above the result, which must all equal its sign: no comparator is built.
    """
    value, target = Value.cast(value), shape_of(fmt)
    source = value.shape()
    if not source.signed:
        value, source = Cat(value, Const(0, 1)).as_signed(), signed(source.width + 1)
    if fmt.signed and source.width <= fmt.width:
        return _cast(value, target)
    if source.width <= fmt.width:  # unsigned result that only a negative value overflows
        return _cast(Mux(value[-1], 0, value.as_unsigned()), target)
    negative = value[-1]
    above = value[fmt.width - 1 if fmt.signed else fmt.width :]
    fits = (above == 0) | ((above == (1 << len(above)) - 1) if fmt.signed else Const(0, 1))
    limit = (
        Cat((~negative).replicate(fmt.width - 1), negative)
        if fmt.signed
        else (~negative).replicate(fmt.width)
    )
    return _cast(Mux(fits, value[: fmt.width], limit), target)


def not_all_equal(bits: Value) -> Value:
    """High unless all bits are the same. Neighbouring bits are compared, four per LUT, so the result is
    early."""
    bits = Value.cast(bits).as_unsigned()
    return (bits[:-1] ^ bits[1:]).any()


def round_half_up(value: Value, shift: int) -> Value:
    """RND: ``floor((value + 2**(shift-1)) / 2**shift)``; ``shift`` >= 0, 0 is the identity."""
    value = Value.cast(value)
    return (value + (1 << shift - 1)) >> shift if shift else value


def narrow(value: Value, shift: int, fmt: QFormat) -> Value:
    """The narrowing that all of the datapath uses: RND by ``shift`` bits, then SAT into ``fmt``."""
    return saturate(round_half_up(value, shift), fmt)


def wrapping_increment(index: Signal, count: int) -> Value:
    """``index + 1`` modulo ``count``, for an index below it.

    Up to four bits are made of gates: on an FPGA that takes one cell less than a carry chain.
    """
    bits = len(index)
    more = (
        Cat(bit ^ (index[:k].all() if k else 1) for k, bit in enumerate(index))
        if bits <= 4
        else (index + 1)[:bits]
    )
    return more if count == 1 << bits else Mux(index == count - 1, 0, more)


def clip(value: Value, bound: int) -> Value:
    """Signed ``value`` held within ``+-bound`` (bound >= 1): two comparators, for bounds that are no
    format's."""
    value = Value.cast(value)
    width = bound.bit_length() + 1
    return Mux(
        value > bound,
        Const(bound, signed(width)),
        Mux(value < -bound, Const(-bound, signed(width)), _cast(value, signed(width))),
    )


def biased_magnitude(complement: Value, knee: int) -> Value:
    """``|d| + 2**knee`` of a number given as its complement ~d."""
    is_negative = ~complement[-1]
    return ((complement ^ ~is_negative.replicate(len(complement))) + is_negative) + (1 << knee)


def logarithm(m: Module, companded: Signal, biased: Signal, knee: int, fraction: int) -> None:
    """Drive the unsigned ``companded`` with ``(e - knee) * 2**F + floor(2**F * b / 2**e) - 2**F``.

    b is ``biased``, ``2**e`` the largest power of two in it, and F is ``fraction``.
    """
    for exponent in range(knee, len(biased)):  # the last that holds a one wins
        below = biased[:exponent]
        chosen = (
            below[exponent - fraction :]
            if exponent >= fraction
            else Cat(Const(0, fraction - exponent), below)
        )
        with m.If(biased[exponent]):
            m.d.comb += companded.eq(Cat(chosen, Const(exponent - knee, len(biased))))


def _cast(value: Value, shape: Shape) -> Value:
    """The low bits of ``value``, extended if short, read as ``shape``."""
    missing = shape.width - len(value)
    bits = Cat(value, value[-1].replicate(missing)) if missing > 0 else value[: shape.width]
    return bits.as_signed() if shape.signed else bits.as_unsigned()
