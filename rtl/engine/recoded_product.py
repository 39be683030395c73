"""Multiply and add as one sum of few addends, with radix-4 digits (docs/specification.md, section 4)."""

from amaranth.hdl import Cat, Const, Value


def sum_with_product(base: Value, a: Value, b: Value) -> Value:
    """``base + a * b`` of signed values.

    The shorter one is a sum of digits -2..2 times powers of 4 (A. D. Booth, 1951; O. L. MacSorley, 1961), so there are
    half as many addends as bits. A digit 0 leaves the sum unchanged, and small numbers of either sign begin
    with such digits. On a chip this takes less energy than a product whose upper bits toggle with the sign.
    Parts with multipliers have no use for it.

    The addend of digit d is ``|d| a``; if d is negative, it is inverted and 1 is added. The sign bit's weight
    is negative: inverting the bit makes the weight positive, at the cost of a constant that is subtracted.
    The added ones sit in bits where the next addend is 0.
    """
    b, a = sorted((b, a), key=len)
    width = len(a) + 1
    padded = Cat(Const(0, 1), b, b[-1])
    total, below, negatives = base, Cat(), 0
    for place in range(0, len(b), 2):
        low, middle, high = padded[place], padded[place + 1], padded[place + 2]
        once, twice = low ^ middle, (high & ~middle & ~low) | (~high & middle & low)
        negative = high & ~(middle & low)
        size = Cat(a, a[-1]) & once.replicate(width) | Cat(Const(0, 1), a) & twice.replicate(width)
        addend = size ^ negative.replicate(width)
        total = total + Cat(below, addend[:-1], ~addend[-1])
        below = Cat(Const(0, place), negative, Const(0, 1))
        negatives -= 1 << place + width - 1
    constant = Const(negatives)
    # The constant is 0 below the lowest sign bit. The last one lies there, so one addend holds both.
    return total + (constant | below)
