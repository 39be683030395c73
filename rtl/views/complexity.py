"""What an accelerator costs against the number of taxels and of classes: cycles, multiplies, weight bits, and
memory bits by memory.

Cycles and weights are read off the program, memory bits off the memories of the elaborated design: nothing
here is a formula that could drift from the hardware.
"""

import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from amaranth.hdl import Fragment, MemoryInstance, Shape

from eskin.golden.core import AcceleratorConfig, Record
from eskin.golden.core.config import MOST_INPUTS
from eskin.rtl.program.schedule import schedule
from eskin.rtl.top.accelerator import Accelerator
from eskin.rtl.views.schedule_view import cell_name, lanes_name, resized, save_figure, summary, write_csv

TAXELS = (4, 8, 16, 32, 48, 64, 96, 128, 160)
CLASSES = (2, 3, 4, 6, 8, 12, 16, 24, 32)

MEMORIES = (
    ("weights", ("engine.weights_",)),
    ("addends", ("engine.addends.",)),
    ("program", ("engine.sequencer.", "engine.program")),
    ("activation tables", ("engine.activation.", "engine.narrowing.activation.")),
    ("state, gates, T", ("engine.state_memory", "engine.coefficients.", "engine.t_memory", "engine.data")),
    ("waiting windows", ("engine.windows",)),
    ("pre-trigger ring", ("front_end.pretrigger_ring.",)),
    ("feature expander", ("front_end.feature_expander.",)),
    ("window averager", ("front_end.window_averager.",)),
    ("means", ("front_end.normaliser.",)),
    ("onset detector", ("front_end.onset_detector.",)),
    ("classifier", ("classifier.",)),
)
"""What each memory of the design counts as, by the beginning of its path. The compact engine's one data
memory holds addends and waiting windows too."""


def memories(config: AcceleratorConfig) -> dict[str, tuple[int, int]]:
    """(bits of a word, words) of every memory of the accelerator, by its path in the design."""
    return dict(_walk(Fragment.get(_accelerator(config), None), ()))


def _accelerator(config: AcceleratorConfig) -> Accelerator:
    # Neither the shifts of the normaliser nor who fills the memories changes their sizes; presets have no
    # shifts before quantising.
    return Accelerator(
        config.replace(
            feature_shift=config.features.feature_shift or (0,) * len(config.feature_units), loadable=True
        )
    )


def block_memories(config: AcceleratorConfig, family: str, shapes: Sequence[tuple[int, int]]) -> int:
    """Block memories of the accelerator on a family of FPGAs: each memory, once for every port that reads it,
    cut into blocks of the shape (words, bits) that needs fewest. Memories that are asked to be made of
    something else, or hold so few words that they are, and columns of a ROM that never change need none."""
    total = 0
    for bits, words, readers, requests in _blocks(Fragment.get(_accelerator(config), family)):
        needed = min(-(-words // depth) * -(-bits // width) for depth, width in shapes)
        total += readers * needed if requests or bits * words > FEW_BITS * needed else 0
    return total


FEW_BITS, FEW_WORDS = 68, 64
"""A memory of so many bits for each block that it would take is made of flip-flops where nothing asks for
more, a ROM of so many words of LUTs."""


def _blocks(fragment: Fragment) -> Iterator[tuple[int, int, int, bool]]:
    """(bits of a word, words, ports that read, a block memory is asked for) of each memory that block
    memories may hold."""
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


def _walk(fragment: Fragment, path: tuple[str, ...]) -> Iterator[tuple[str, tuple[int, int]]]:
    if isinstance(fragment, MemoryInstance):
        yield ".".join(path), (Shape.cast(fragment._data.shape).width, fragment._data.depth)
    for inner, name, _ in fragment.subfragments:
        yield from _walk(inner, (*path, str(name)))


def memory_bits(config: AcceleratorConfig) -> dict[str, int]:
    """Bits by the names of ``MEMORIES``, 0 for what the design has not; a memory that none of them covers
    counts under its own path."""
    bits = {name: 0 for name, _ in MEMORIES}
    for path, (width, words) in memories(config).items():
        name = next((name for name, beginnings in MEMORIES if path.startswith(beginnings)), path)
        bits[name] = bits.get(name, 0) + width * words
    return bits


def cost(config: AcceleratorConfig) -> Record:
    """The cost of one configuration: sizes, ``step_cycles``, ``decision_cycles`` (from the features on),
    ``ideal_cycles``, ``multiplies``, ``weight_bits`` (the network's weights alone, without the unused places
    of idle lanes) and ``memory_bits``."""
    plan = schedule(config)
    figures = summary(plan)
    columns = ("taxels", "hidden", "classes", "lanes", *list(SHOWN.values())[2:6])
    bits = memory_bits(config)
    return {
        **{key: figures[key] for key in columns},
        "weight_bits": config.sets * plan.weights * config.weight_bits,
        "memory_bits": bits,
        "memory_bits_total": sum(bits.values()),
    }


def complexity(
    config: AcceleratorConfig, progress: Callable[[str, int, int], None] | None = None
) -> dict[str, list[Record]]:
    """`cost` against ``TAXELS`` (classes as in ``config``) and against ``CLASSES`` (taxels as in
    ``config``)."""
    some = [taxels for taxels in TAXELS if taxels * config.kinds <= MOST_INPUTS]
    sweeps = {
        "taxels": [(taxels, config.classes) for taxels in some],
        "classes": [(config.sensor.taxels, classes) for classes in CLASSES],
    }
    points = [point for sweep in sweeps.values() for point in sweep]
    # cycles and bits do not depend on the clock; a slow one could not take the largest arrays' frames
    config = config.replace(clock_hz=config.hardware.clock_hz * max(TAXELS))
    costs = {}
    for number, (taxels, classes) in enumerate(points):
        costs[taxels, classes] = cost(
            resized(config, taxels=taxels, hidden=config.network.hidden, classes=classes)
        )
        if progress:
            progress("configurations", number + 1, len(points))
    return {name: [costs[point] for point in sweep] for name, sweep in sweeps.items()}


SHOWN = {
    "taxels": "taxels",
    "classes": "classes",
    "cycles a step": "step_cycles",
    "features to decision": "decision_cycles",
    "ideal": "ideal_cycles",
    "multiplies": "multiplies",
    "weight bits": "weight_bits",
    "memory bits": "memory_bits_total",
}
"""Heading of each column, and its figure of a `cost`."""
COLUMNS = tuple(SHOWN)


def cells(point: Record) -> tuple[str, ...]:
    """A `cost` as words, by ``COLUMNS``."""
    return tuple(str(point[key]) for key in SHOWN.values())


def flat_rows(sweeps: dict[str, list[Record]]) -> list[Record]:
    """Rows for a CSV: the sweep's name, then each figure, a column a memory."""
    return [
        {"against": name}
        | {key: value for key, value in point.items() if key != "memory_bits"}
        | {f"{memory} bits": bits for memory, bits in point["memory_bits"].items()}
        for name, sweep in sweeps.items()
        for point in sweep
    ]


CURVES = {
    "cycles": {"step_cycles": "step", "decision_cycles": "features to decision", "ideal_cycles": "ideal"},
    "multiplies and weight bits": {"weight_bits": "weight bits", "multiplies": "multiplies a step"},
}
"""Figures of a `cost` in each of the first two charts of a row."""


def chart(config: AcceleratorConfig, sweeps: dict[str, list[Record]]):
    """A matplotlib Figure: a row a sweep; cycles, multiplies with weight bits, memory bits by memory."""
    from matplotlib import colormaps
    from matplotlib.figure import Figure  # slow to import, and only a picture needs it

    figure = Figure(figsize=(14, 7.6), layout="constrained")
    middle = f" {config.network.hidden} hidden," if config.recurrent else ""
    cell = cell_name(config.network.cell, config.network.reset)
    figure.suptitle(f"{cell},{middle} {lanes_name(config)}", fontsize=12)
    panels = figure.subplots(2, 3)
    for (name, sweep), (*curves, bars) in zip(sweeps.items(), panels, strict=True):
        sizes = [point[name] for point in sweep]
        fixed = "classes" if name == "taxels" else "taxels"
        for axes, (title, keys) in zip(curves, CURVES.items(), strict=True):
            for key, label in keys.items():
                axes.plot(sizes, [point[key] for point in sweep], ".--"[key == "ideal_cycles" :], label=label)
            axes.set_ylim(bottom=0)
            axes.set_title(f"{title} against {name} ({sweep[0][fixed]} {fixed})", fontsize=10)
        bars.set_prop_cycle(color=colormaps["tab20"](range(20)))
        base = [0.0] * len(sweep)
        for memory in sweep[0]["memory_bits"]:
            kilobits = [point["memory_bits"][memory] / 1000 for point in sweep]
            if any(kilobits):
                bars.bar(range(len(sweep)), kilobits, bottom=base, label=memory)
                base = [low + high for low, high in zip(base, kilobits, strict=True)]
        bars.set_xticks(range(len(sweep)), sizes)
        bars.set_title(f"memory against {name}, thousand bits", fontsize=10)
        for axes in (*curves, bars):
            axes.set_xlabel(name)
            axes.spines[["top", "right"]].set_visible(False)
        for axes in curves:
            axes.legend(fontsize=8, frameon=False, loc="upper left")
        bars.legend(fontsize=8, frameon=False, reverse=True, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def files(config: AcceleratorConfig, sweeps: dict[str, list[Record]]) -> dict[str, Callable[[Path], None]]:
    """The files of `complexity` by name, each as what writes it to a path."""
    picture = chart(config, sweeps)
    return {
        "complexity.svg": save_figure(picture, "svg"),
        "complexity.png": save_figure(picture, "png"),
        "complexity.csv": lambda path: write_csv(flat_rows(sweeps), path),
        "complexity.json": lambda path: path.write_text(json.dumps(sweeps, indent=2) + "\n"),
    }
