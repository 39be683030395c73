"""The cells as programs: rows on the lanes, element-wise operations, and their dependences
(docs/specification.md, section 5)."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

from eskin.golden.core import AcceleratorConfig


@dataclass(frozen=True)
class RowBlock:
    """Rows of one gate (or of the dense layer) that are computed alike.

    Parameters
    ----------
    name:
        Unique in the program.
    terms:
        (weight matrix, state-memory region) pairs added up in one dot product.
    dest:
        ``sigmoid`` (gate memory), ``tanh`` or ``value`` (T memory), ``partial`` (addend memory) or ``logit``.
    region:
        Region of the gate or T memory; for ``partial`` the block that picks the sum up.
    bias:
        Array of the integer model that holds the rows' bias codes; empty when the addend is a partial sum.
    narrowing:
        The narrowing whose rounding half is added to the bias: ``sigmoid``, ``tanh``, ``value`` or ``logit``.
    carried:
        The rows' sums, as wide as the accumulator, go on over the steps of a touch: the addend is the bias at
        its first step and the sum of the step before at the others.
    """

    name: str
    terms: tuple[tuple[str, str], ...]
    dest: str
    region: str = ""
    bias: str = ""
    narrowing: str = ""
    carried: bool = False


@dataclass(frozen=True)
class ElementOp:
    """One kind of element-wise operation, done for every index i of a vector on the element-wise lane.

    Each term is a product ``a * b``: a = ``S.region[i]`` (state memory), ``T.region[i]`` (T memory),
    ``S.h-T.n`` (their difference) or ``X`` (the centred window sums); b = a region of the gate memory,
    ``one``, ``zero`` or ``scale``. ``add`` names a T region added at product scale. Result: narrowed by
    gate_frac, to the feature format for ``feature`` operations, else to the state format.

    Parameters
    ----------
    name:
        Unique in the program.
    terms:
        One or two (a, b) pairs; two terms take two cycles and are rounded once.
    state:
        Region of the state memory that gets the result; empty for none.
    activated:
        Region of the T memory that gets the tanh of the result; empty for none.
    add:
        T region added to the first term at product scale; empty for none.
    between:
        The result lies between two values of the state format, because a gate is 0..1: it is a share of one
        value, or a blend of two. It never saturates, and no hardware is built for that.
    """

    name: str
    terms: tuple[tuple[str, str], ...]
    state: str = ""
    activated: str = ""
    add: str = ""
    between: bool = False


@dataclass(frozen=True)
class CellProgram:
    """A cell as data: rows before the features arrive, rows after, element-wise operations, regions of the
    memories.

    Rows read the new state if every block it is made from comes before them, otherwise the state of the previous
    step. Element-wise operations read the old state. Region ``x`` holds the features; ``cleared`` regions are
    zeroed before a touch. ``hidden`` names the region of the hidden state; empty if there is none.
    """

    before: tuple[RowBlock, ...]
    after: tuple[RowBlock, ...]
    elements: tuple[ElementOp, ...]
    state_regions: tuple[str, ...]
    gate_regions: tuple[str, ...]
    t_regions: tuple[str, ...]
    cleared: tuple[str, ...] = ("h",)
    hidden: str = "h"


NORMALISE = ElementOp("normalise", (("X", "scale"),), state="x")


DENSE = RowBlock("dense", (("V", "h"),), "logit", bias="b_y", narrowing="logit")


def _gate_in_two_parts(gate: str, kind: str) -> tuple[RowBlock, RowBlock]:
    """U h + b before the features, + W x after."""
    return (
        RowBlock(f"{gate}_before", ((f"U_{gate}", "h"),), "partial", gate, f"b_{gate}", kind),
        RowBlock(gate, ((f"W_{gate}", "x"),), kind, gate),
    )


def gru_reset_before() -> CellProgram:
    """z, r = s(W x + U h + b); n = tanh(W x + U (r h) + b); h' = n + z (h - n)."""
    z_before, z = _gate_in_two_parts("z", "sigmoid")
    r_before, r = _gate_in_two_parts("r", "sigmoid")
    n = RowBlock("n", (("W_n", "x"), ("U_n", "rh")), "tanh", "n", "b_n", "tanh")
    reset = ElementOp("reset", (("S.h", "r"),), state="rh", between=True)
    # z h + (1 - z) n as n + z (h - n): one multiplication, and exact before the rounding
    blend = ElementOp("blend", (("S.h-T.n", "z"),), state="h", add="n", between=True)
    return CellProgram(
        (r_before, z_before),
        (r, z, n, DENSE),
        (NORMALISE, reset, blend),
        ("h", "x", "rh"),
        ("z", "r"),
        ("n",),
    )


def gru_reset_after() -> CellProgram:
    """z, r as above; n = tanh(r (U h + bh) + (W x + b)); h' = n + z (h - n)."""
    z_before, z = _gate_in_two_parts("z", "sigmoid")
    r_before, r = _gate_in_two_parts("r", "sigmoid")
    hn = RowBlock("hn", (("U_n", "h"),), "value", "hn", "bh_n", "value")
    wx = RowBlock("wx", (("W_n", "x"),), "value", "wx", "b_n", "value")
    reset = ElementOp("reset", (("T.hn", "r"), ("T.wx", "one")), activated="n")
    blend = ElementOp("blend", (("S.h-T.n", "z"),), state="h", add="n", between=True)
    return CellProgram(
        (r_before, z_before, hn),
        (r, wx, z, DENSE),
        (NORMALISE, reset, blend),
        ("h", "x"),
        ("z", "r"),
        ("n", "hn", "wx"),
    )


def lstm() -> CellProgram:
    """i, f, o = s(.); g = tanh(.); c' = f c + i g; h' = o tanh(c')."""
    parts = [_gate_in_two_parts(gate, "tanh" if gate == "g" else "sigmoid") for gate in "ifgo"]
    cell = ElementOp("cell", (("S.c", "f"), ("T.g", "i")), state="c", activated="tc")
    hidden = ElementOp("hidden", (("T.tc", "o"),), state="h", between=True)
    return CellProgram(
        tuple(before for before, _ in parts),
        (*(after for _, after in parts), DENSE),
        (NORMALISE, cell, hidden),
        ("h", "x", "c"),
        ("i", "f", "o"),
        ("g", "tc"),
        cleared=("h", "c"),
    )


def linear() -> CellProgram:
    """l_k = l_(k-1) + V_k x_k, from the bias on."""
    return CellProgram(
        (),
        (replace(DENSE, terms=(("V", "x"),), carried=True),),
        (NORMALISE,),
        ("x",),
        (),
        (),
        cleared=(),
        hidden="",
    )


def in_one_phase(program: CellProgram) -> CellProgram:
    """``program`` without partial sums: each gate's rows in one dot product, all after the features.

    The addend memory then holds constants only, which saves the way back into it; the decision comes later by
    phase A.
    """
    partials = {block.region: block for block in program.before if block.dest == "partial"}
    after = []
    for block in program.after:
        if not block.bias:
            before = partials[block.region]
            terms = (*before.terms, *block.terms)
            block = replace(block, terms=terms, bias=before.bias, narrowing=before.narrowing)
        after.append(block)
    first = tuple(block for block in program.before if block.dest != "partial")
    return replace(program, before=(), after=(*first, *after))


CELLS: dict[tuple[str, str], Callable[[], CellProgram]] = {
    ("gru", "before"): gru_reset_before,
    ("gru", "after"): gru_reset_after,
    ("lstm", "before"): lstm,
    ("lstm", "after"): lstm,
    ("linear", "before"): linear,
    ("linear", "after"): linear,
}
"""Program of each (cell, reset); only a GRU has a reset gate."""


def cell_program(config: AcceleratorConfig) -> CellProgram:
    """The program of the configured cell. DSP lanes, which save logic cells, have no partial sums, nor has
    ``one_phase``."""
    program, hardware = CELLS[config.network.cell, config.network.reset](), config.hardware
    return in_one_phase(program) if hardware.lane_type == "dsp" or hardware.one_phase else program


def row_count(config: AcceleratorConfig, block: RowBlock) -> int:
    """Rows of a block."""
    return config.classes if block.dest == "logit" else config.network.hidden


@lru_cache(maxsize=64)
def makers(program: CellProgram) -> dict[str, set[str]]:
    """For each state region, the blocks whose rows its new value is made from, over any number of
    element-wise operations.

    These operations read old values of the state memory.
    """
    blocks = {}
    for region in {op.state for op in program.elements if op.state}:
        regions, visited = [region], set()
        while regions:
            name = regions.pop()
            visited.add(name)
            for op in program.elements:
                if name == (op.state if name == region else op.activated):
                    reads = {part[2:] for a, _ in op.terms for part in a.split("-") if part.startswith("T.")}
                    regions += (reads | {b for _, b in op.terms} | {op.add}) - visited - {""}
        blocks[region] = {
            block.name for block in (*program.before, *program.after) if block.region in visited
        }
    return blocks


@lru_cache(maxsize=1024)
def reads_new_state(program: CellProgram, block: RowBlock, region: str) -> bool:
    """True when ``block`` reads the value of the state region that this step writes: all it is made from
    comes before the block."""
    names = [rows.name for rows in (*program.before, *program.after)]
    made_from = makers(program).get(region)
    return made_from is not None and made_from <= set(names[: names.index(block.name)])
