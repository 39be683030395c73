"""run.json, as `eskin run` writes it and the report reads it."""

from collections.abc import Mapping, Sequence

from eskin.golden.core import Result
from eskin.study.energy import Power
from eskin.training.evaluate import HeldBack
from eskin.training.record import Disturbed, Findings


class Lengths(Result):
    """Frames of a recording."""

    min: int
    median: float
    max: int


class Data(Result):
    """The recordings. classes: recordings of each; groups: values of each; sha256: of the content."""

    source: str
    recordings: int
    frames: int
    taxels: int
    unit: str = ""
    sample_rate_hz: float
    sha256: str
    classes: Mapping[str, int]
    groups: Mapping[str, int]
    lengths: Lengths


class Configuration(Result):
    """The configuration, and why it was chosen."""

    name: str
    reasons: Sequence[str]


class OnLanes(Result):
    """The network on a number of lanes. latency_s: from the last sample or pixel to the decision."""

    lanes: int
    latency_s: float
    cells: int


class PartNeed(Result):
    """What a part needs.

    board: an example. fits: it holds the design. cells, block_memories: logic cells and block memories, onset to decision.
    bytes: program and constants of the C export, by the compiler if there is one. constant_bytes: its tables. operations:
    of a touch, multiplications and one addition for each sample. latency_s: from the last sample to the decision, at the
    board's clock. average_w: with one touch a second, clock always on.
    """

    part: str
    board: str | None = None
    fits: bool | None = None
    cells: int | None = None
    block_memories: int | None = None
    bytes: int | None = None
    constant_bytes: int | None = None
    operations: int | None = None
    latency_s: float | None = None
    average_w: float | None = None


class Check(Result):
    """A check behind exit status 0."""

    name: str
    held: bool
    detail: str


class Timing(Result):
    """A stage; cached: an earlier run had finished it."""

    stage: str
    wall_s: float
    cached: bool


class Run(Findings, Disturbed):
    """run.json. code: hash of the code that made it. test: of recordings held back. cosimulated: numbers of recordings.
    lowest_clock_hz: None if no clock meets every budget. Of images: ``images``, and cycles of each layer with the pool
    behind it."""

    name: str | None = None
    code: str = ""
    data: Data
    configuration: Configuration
    lanes: Sequence[OnLanes] = []
    parts: Sequence[PartNeed] = []
    test: HeldBack | None = None
    cosimulated: Sequence[int]
    checks: Sequence[Check]
    passed: bool
    timings: Sequence[Timing]
    wall_s: float
    average_w: float = 0.0
    power: Power | None = None
    lowest_clock_hz: float | None = None
    images: bool = False
    layer_cycles: Mapping[str, int] = {}
