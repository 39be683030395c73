"""The definition of a proof, and the few words in which properties are written.

A property file (``formal/<block>.py``) has functions that take an `amaranth.hdl.Module`, put the block into
it as it is, leave the block's inputs free, and name its assumptions on them and the properties of the block. `proof`
registers such a function. All properties look at one clock edge at a time; what they need of the past is kept
in registers of the harness. The reset input is low from the first cycle on.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Literal, TypeVar

from amaranth.asserts import AnyConst, AnySeq
from amaranth.hdl import (
    Assert,
    Assume,
    Elaboratable,
    Fragment,
    Module,
    ResetInserter,
    Signal,
    Value,
    ValueLike,
)
from amaranth.lib import stream, wiring

Block = TypeVar("Block", bound=wiring.Component)
Method = Literal["induction", "gate induction", "bounded", "any state"]
"""Methods. k-induction proves for every cycle of every run, with words, or gate by gate with a SAT solver if
words take too long; bounded: the first ``depth`` cycles after reset; any state: ``depth`` cycles after a
state that only the assumptions restrict, so for every later cycle of every run too (with a SAT solver, gate
by gate)."""


@dataclass(frozen=True)
class Bug:
    """A fault seeded into the design's text, which the proof must find.

    Parameters
    ----------
    name:
        The fault, in words.
    old, new:
        In ``file`` ``old`` is replaced by ``new``; it must be there.
    eager:
        Look for it only where senders and receivers never pause, which makes a deep search quick.
    file:
        From the project's folder on; the block's own where it is not given.
    """

    name: str
    old: str
    new: str
    eager: bool = False
    file: str = ""


@dataclass(frozen=True)
class Proof:
    """One row of the table.

    Parameters
    ----------
    block, name:
        File of `formal/` without its suffix, and the function's name.
    claim:
        The claim, one line.
    build:
        Fills a module with the design and its properties.
    method, depth:
        Induction: length of the induction step, as many first cycles are the base. Bounded, any state:
        cycles.
    reduced:
        Difference of the configuration from a real one; "none" and the preset if there is none.
    bugs:
        Each must make the proof fail.
    quick:
        Part of ``make test`` too.
    """

    block: str
    name: str
    claim: str
    build: Callable[[Module], None]
    method: Method
    depth: int
    reduced: str
    bugs: tuple[Bug, ...] = field(default=())
    quick: bool = False

    @property
    def title(self) -> str:
        """``block.name``."""
        return f"{self.block}.{self.name}"


PROOFS: dict[str, Proof] = {}
"""Proofs of the property files imported so far, by title."""


def proof(
    claim: str,
    *,
    bugs: tuple[Bug, ...],
    depth: int,
    reduced: str,
    method: Method = "induction",
    quick: bool = False,
):
    """Register the decorated function as a proof; see `Proof`."""

    def register(build: Callable[[Module], None]) -> Callable[[Module], None]:
        _, folder, block = build.__module__.split(".")
        own = tuple(replace(bug, file=bug.file or f"rtl/{folder}/{block}.py") for bug in bugs)
        row = Proof(block, build.__name__, claim, build, method, depth, reduced, own, quick)
        PROOFS[row.title] = row
        return build

    return register


# ---------------------------------------------------------------------- words

EAGER = False
"""Set by formal/run.py for a bug that is ``eager``."""
HARNESS: Module = None  # type: ignore[assignment]  # an unused module would be warned of
"""Harness of the proof under way, set by formal/run.py; all words refer to it."""


def free(*signals: Value, m: Module | None = None) -> None:
    """Drive signals with any value at all, another in every cycle; in another module of the harness, that one
    is ``m``."""
    for signal in signals:
        value = Value.cast(signal)
        (m or HARNESS).d.comb += value.eq(AnySeq(value.shape()))


def any_number(shape, name: str) -> Signal:
    """Any value, the same in every cycle."""
    signal = Signal(shape, name=name)
    HARNESS.d.comb += Value.cast(signal).eq(AnyConst(Value.cast(signal).shape()))
    return signal


def assume(condition, name: str = "") -> None:
    """The environment keeps to ``condition`` in every cycle."""
    HARNESS.d.comb += Assume(condition)


def prove(condition, name: str) -> None:
    """``condition`` holds in every cycle; ``name`` appears where it does not."""
    HARNESS.d.comb += Assert(condition, name)


def before(value, name: str) -> Signal:
    """``value`` one cycle ago; 0 in the first."""
    value = Value.cast(value)
    register = Signal(value.shape(), name=name)
    HARNESS.d.sync += register.eq(value)
    return register


def less_is_to_go(left: Value, unless: ValueLike = 0) -> None:
    """``left`` decreases in every cycle, so the count comes to an end."""
    prove(~before(1, "running") | unless | (left < before(left, "left_before")), "less is to go")


def keeps_its_beat(port: stream.Interface, name: str, state=prove) -> None:
    """The stream rule: an offer stays, with the same payload, until it is taken. ``state`` is `prove` or
    `assume`."""
    was = before(port.valid & ~port.ready, f"{name}_stalled")
    payload = before(port.payload, f"{name}_payload")
    state(
        ~was | (port.valid & (Value.cast(port.payload) == payload)), f"{name}: offered beat stays until taken"
    )


def free_source(port: stream.Interface) -> None:
    """A sender that keeps to the stream rule and sends anything at any time."""
    free(port.valid, port.payload)
    keeps_its_beat(port, "i", assume)
    if EAGER:
        assume(port.valid)


def free_sink(port: stream.Interface) -> None:
    """A receiver that takes a beat or does not."""
    free(port.ready)
    if EAGER:
        assume(port.ready)


# ---------------------------------------------------------------------- the block


class _Elaborated(Elaboratable):
    def __init__(self, fragment: Fragment) -> None:
        self._fragment = fragment

    def elaborate(self, platform):
        return self._fragment


def placed(block: Block, name: str = "dut", reset: Signal | None = None) -> Block:
    """``block``, put into the harness as submodule ``name``, with its ``reset`` where one is given. It
    is elaborated here, so the signals of its inside that it has as attributes are there."""
    inner: Elaboratable = _Elaborated(Fragment.get(block, None))
    HARNESS.submodules[name] = inner if reset is None else ResetInserter(reset)(inner)
    return block


def placed_free(block: Block, name: str = "dut", *, but: tuple[str, ...] = ()) -> Block:
    """`placed`, with any values at all inputs of it, except its members of the names ``but``."""
    for (port, *_), member, value in block.signature.flatten(block):
        if member.flow is wiring.In and port not in but:
            free(value)
    return placed(block, name)


def registers(name: str = "dut") -> list[Signal]:
    """Every register of the submodule and its parts, in a fixed order."""
    found: dict[int, Signal] = {}

    def collect(part: Fragment) -> None:
        for domain, statements in part.statements.items():
            if domain != "comb":
                for statement in statements:
                    found.update({id(signal): signal for signal in statement._lhs_signals()})
        for inner, _, _ in part.subfragments:
            collect(inner)

    collect(getattr(HARNESS.submodules, name).elaborate(None))
    return list(found.values())
