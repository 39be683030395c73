"""A product and what it is added to as one sum of few addends: the second factor in digits of 4 (docs/specification.md, section 4)."""

from __future__ import annotations

from amaranth.hdl import Cat, Const, Value


def sum_with_product(base: Value, a: Value, b: Value, bits: int) -> Value:
    """``base + a * b`` modulo ``2 ** bits``, for signed values.

    ``b`` is a sum of digits -2..2 times powers of 4 (A. D. Booth, 1951; O. L. MacSorley, 1961): half as many addends as bits. A digit 0,
    as small numbers of either sign have them on top, changes nothing in the sum. On a chip that takes less energy than a product whose
    upper bits follow the sign; parts with multipliers have no use for it.

    An addend of digit d is ``|d| a``, inverted where d is negative, and 1 more. Its sign's weight is negative: with the sign turned over it
    is positive, and a constant less. The ones stand where the following addends are 0.
    """
    width = len(a) + 1
    padded = Cat(Const(0, 1), b, b[-1])
    rows, ones = [], []
    negatives = 0
    for place in range(0, len(b), 2):
        low, middle, high = padded[place], padded[place + 1], padded[place + 2]
        once, twice = low ^ middle, (high & ~middle & ~low) | (~high & middle & low)
        negative = high & ~(middle & low)
        size = Cat(a, a[-1]) & once.replicate(width) | Cat(Const(0, 1), a) & twice.replicate(width)
        addend = size ^ negative.replicate(width)
        rows.append((place, Cat(addend[:-1], ~addend[-1])))
        ones.append(negative)
        negatives -= 1 << place + width - 1
    total = base
    for number, (place, addend) in enumerate(rows):
        below = Cat(Const(0, place - 2), ones[number - 1], Const(0, 1)) if number else Const(0, 0)
        total = total + Cat(below, addend)[:bits]
    last, constant = rows[-1][0], Const(negatives, bits)
    last_one = Cat(Const(0, last), ones[-1])
    # (The constant is 0 up to the lowest sign, behind which the last one mostly stands: one addend for both.)
    return (total + (constant | last_one) if width - 1 > last else total + constant + last_one)[:bits]
