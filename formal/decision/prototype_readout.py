"""Teaching: an upset of a code's address is flagged and prevents writes."""

from amaranth.hdl import Cat, Module

from eskin.golden.core import PRESETS
from eskin.rtl.decision.prototype_readout import PrototypeReadout
from formal.proof import Bug, placed_free, proof, prove, registers

RULE = {"prototypes": 1, "taught": 2, "state_code_bits": 3, "state_code_shift": 12}
CONFIG = (
    PRESETS["thesis"]
    .replace(taxels=4, steps=2, feature_shift=(4,), cell="linear", class_names=("a", "b"), checksum=True)
    .with_readout(readout="prototypes", **RULE)
)


@proof(
    "whatever the registers hold, one whose parity is wrong is flagged in that cycle, and no code is written",
    depth=1,
    method="any state",
    reduced="2 classes, 2 steps of a linear cell, 1 prototype and 2 taught places a class, 3 bits",
    quick=True,
    bugs=(
        Bug("codes are written all the same", "(body & target)) & sound", "(body & target))"),
        Bug("numbers of touches are not looked at", "guards.append(guard)", "guards.append(Const(0, 1))"),
        Bug("the last of the registers is not looked at", "Cat(guards).any()", "Cat(guards[:-1]).any()"),
    ),
)
def no_upset_goes_unseen(m: Module) -> None:
    dut = placed_free(PrototypeReadout(CONFIG))
    values = {register.name: register for register in registers()}
    counts = [name for name in values if name.startswith("count_") and not name.endswith("_parity")]
    for names in (
        *([name] for name in ("address", "unit", "slot", "label", "place", "chosen", "state")),
        counts,
    ):
        wrong = Cat(part for name in names for part in (values[name], values[f"{name}_parity"])).xor()
        prove(~wrong | dut.wrong, f"{names[0]} is flagged")
        prove(~wrong | ~dut.written, f"{names[0]} keeps codes from being written")
