"""A product in digits of 4 is the product, whatever it is added to."""

from amaranth.hdl import Module, Signal, signed

from eskin.rtl.engine.recoded_product import sum_with_product
from formal.proof import Bug, free, proof, prove


@proof(
    "a sum with a product in digits of 4 is the sum with the product",
    depth=1,
    reduced="operands of 6 and 6 bits, sums of 14; of 2 and 5, sums of 9, where the last digit's one and "
    "the constant do not fit together",
    quick=True,
    bugs=(
        Bug("a digit 2 is lost", "(~high & middle & low)", "0"),
        Bug(
            "the one goes to the wrong place",
            "ones[number - 1], Const(0, 1)",
            "Const(0, 1), ones[number - 1]",
        ),
        Bug("the constant of the signs is half", "1 << place + width - 1", "1 << place + width - 2"),
    ),
)
def is_the_product(m: Module) -> None:
    for number, (a_bits, b_bits, bits) in enumerate(((6, 6, 14), (2, 5, 9))):
        a, b = Signal(signed(a_bits), name=f"a_{number}"), Signal(signed(b_bits), name=f"b_{number}")
        base, total = (
            Signal(signed(bits), name=f"base_{number}"),
            Signal(signed(bits), name=f"total_{number}"),
        )
        free(a, b, base)
        m.d.comb += total.eq(base + a * b)
        prove(sum_with_product(base, a, b, bits).as_signed() == total, f"of {a_bits} and {b_bits} bits")
