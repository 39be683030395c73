"""Block memories of the accelerator on a family of FPGAs, counted off the memories of the elaborated design:
nothing here is a formula that could drift from the hardware."""

from collections.abc import Iterator, Sequence

from amaranth.hdl import Fragment, MemoryInstance, Shape

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.top.accelerator import Accelerator

FEW_BITS, FEW_WORDS = 68, 64
"""Most bits per block memory with which a memory still becomes flip-flops, unless the design requests block
memories; most words of a ROM that becomes LUTs."""
SELECTED_BITS = 123
"""Bits that are selected between rows of blocks, at whose cost Yosys takes one block more on an iCE40; found by
synthesising 48 sizes."""


def _accelerator(config: AcceleratorConfig) -> Accelerator:
    # Neither the shifts of the normaliser nor the filling of the memories changes their sizes; presets have no
    # shifts before quantising.
    return Accelerator(
        config.replace(
            feature_shift=config.features.feature_shift or (0,) * len(config.feature_units), loadable=True
        )
    )


def block_memories(config: AcceleratorConfig, family: str, shapes: Sequence[tuple[int, int]]) -> int:
    """Block memories of the accelerator on a family of FPGAs: each memory, once for every port that reads it,
    cut into blocks of the shape (words, bits) that needs fewest. Memories with another implementation,
    memories with few words, and constant columns of a ROM need none."""
    total = 0
    for bits, words, readers, requests in _blocks(Fragment.get(_accelerator(config), family)):
        needed = min(_needed(bits, words, *shape, shared=family == "ice40") for shape in shapes)[1]
        total += readers * needed if requests or bits * words > FEW_BITS * needed else 0
    return total


def _needed(bits: int, words: int, depth: int, width: int, shared: bool) -> tuple[float, int]:
    """(what Yosys makes least, blocks) of a memory in blocks of one shape. shared: a block that writes single bits
    may hold some of two rows."""
    rows = -(-words // depth)
    blocks = -(-rows * bits // width) if shared else rows * -(-bits // width)
    return blocks + shared * bits * (rows - 1) / SELECTED_BITS, blocks


def _blocks(fragment: Fragment) -> Iterator[tuple[int, int, int, bool]]:
    """(bits of a word, words, ports that read, whether the design requests a block memory) of each memory
    that block memories may hold."""
    if isinstance(fragment, MemoryInstance):
        data, style = fragment._data, fragment._attrs.get("ram_style", "auto")
        bits = Shape.cast(data.shape).width
        if not fragment._write_ports:
            words, stuck = data.init._raw, (1 << data.depth) - 1
            columns = [sum((word >> bit & 1) << n for n, word in enumerate(words)) for bit in range(bits)]
            bits = 0 if data.depth <= FEW_WORDS else sum(column not in (0, stuck) for column in columns)
        if style in ("block", "auto"):
            yield bits, data.depth, len(fragment._read_ports), style == "block"
    for inner, _, _ in fragment.subfragments:
        yield from _blocks(inner)
