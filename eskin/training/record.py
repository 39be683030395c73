"""training.json, and the figures that run.json has of it."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import ConfigDict, Field

from eskin.golden.core import AcceleratorConfig, Record, Result
from eskin.golden.model.model import TRAINING_FILE


# ---------------------------------------------------------------------- the choice
class FrontEnd(Result):
    """A front end: fields of a configuration, as far as its others use them."""

    name: str
    rest: str
    rest_frames: int = 0
    onset: str
    onset_threshold: int = 0
    onset_hits: int = 1
    onset_span: int = 1
    clip: int = 0
    fault_frames: int = 0
    scan_every: int = 1
    window_mode: str = "free"
    hop: int
    window: int
    steps: int
    feature_kinds: list[str]
    activity_rule: str = ""
    activity_block: int = 1
    feature_scale: str
    inputs: int


class FrontEndRow(FrontEnd):
    """A front end as a linear classifier judges it. missed: recordings without a touch. behind: accuracy less than the
    accuracy of the best, with the standard error of the paired difference; level: no more than that."""

    accuracy: float
    standard_error: float
    missed: int
    behind: float
    behind_error: float
    level: bool
    energy_touch_j: float


class Screening(Result):
    """How front ends were judged. split: groups left out; split_from: why these. level_alone: accuracy of a classifier
    that sees the level of the first frames alone."""

    split: Sequence[str]
    split_from: str
    folds: int
    recordings_looked_at: int
    recordings: int
    judged_by: str
    tie: str
    level_alone: float
    wall_s: float


class FrontEndRows(Screening):
    """``front_end``. rivals: best first."""

    chosen: FrontEndRow
    rivals: Sequence[FrontEndRow]


class Network(Result):
    """A network in words. hidden: 0 where the cell has no units; recipe: its training; robust: under disturbance.
    trees, depth: 0 for other cells."""

    cell: str
    hidden: int
    recipe: str
    robust: bool = False
    trees: int = 0
    depth: int = 0

    @classmethod
    def of(cls, config: AcceleratorConfig, recipe: str = "linear") -> Self:
        """The network of a configuration."""
        sizes: Record = (
            {"trees": config.forest.trees, "depth": config.forest.depth} if config.is_forest else {}
        )
        hidden = config.network.hidden if config.recurrent else 0
        return cls(cell=config.network.cell, hidden=hidden, recipe=recipe, **sizes)


class NetworkRow(Network):
    """A candidate for images. accuracy: of integers, as is its standard error over recordings."""

    accuracy: float
    standard_error: float
    float_accuracy: float
    agreement: float
    multiplies_touch: int
    multiplies_step: int
    parameters: int
    seeds: int
    chosen: bool


class WorstMode(Result):
    """The figure under a disturbance of the panel."""

    mode: str
    figure: float


class ModeFigure(WorstMode):
    """held: within its bound."""

    bound: float
    held: bool


class CandidateCost(Result):
    """energy_touch_j: of a touch, from its first frame to its decision, joule. cells: logic cells, onset to
    decision. latency_s: from the last sample to the decision, at the board's clock. average_w: average power with one
    touch a second, on the board's clock, which always runs. It includes the scans of the configuration's converter if
    its data sheet gives a power."""

    energy_touch_j: float
    average_w: float
    cells: int
    latency_s: float


class CandidateRow(NetworkRow, CandidateCost):
    """A candidate for touches. score: what the rule compares. stressed_accuracy: decisions under disturbance alone. calm:
    the rule takes it by undisturbed recordings alone. fits: the board that holds it. decision_time_s: since the onset."""

    score: float
    score_standard_error: float
    stressed_accuracy: float | None
    worst: WorstMode | None
    stress: Sequence[ModeFigure]
    gate_modes: Sequence[ModeFigure]
    calm: bool
    block_memories: int
    fits: str | None
    decision_time_s: float | None
    scan_every: int
    front_end: FrontEnd
    front_end_words: str


class Baseline(Result):
    """Another classifier on the same folds. multiplies: of a touch; 0: it compares. hardware: could be built. whole: it
    sees whole recordings."""

    name: str
    groups: Sequence[str]
    accuracy: float
    standard_error: float
    multiplies: int
    hardware: bool
    whole: bool


class Doubt(Result):
    """Why a result may be worse than it looks, and what helps. code: function of `eskin.choose.doubts`, or
    ``wrong_rate``. groups: of the split that it is about."""

    code: str
    text: str
    groups: Sequence[str] = []


class Findings(Result):
    """What training.json and run.json share. front_end, candidates: if there was a choice. warnings: text of the
    doubts."""

    front_end: FrontEndRows | None = None
    candidates: Sequence[Annotated[CandidateRow | NetworkRow, Field(union_mode="left_to_right")]] | None = (
        None
    )
    baselines: Sequence[Baseline] = []
    doubts: Sequence[Doubt] = []
    warnings: Sequence[str] = []

    @property
    def priced(self) -> list[CandidateRow]:
        """Candidates for touches."""
        return [row for row in self.candidates or [] if isinstance(row, CandidateRow)]


# ---------------------------------------------------------------------- cross-validation
class Accuracies(Result):
    """Shares of recordings that the two models classify correctly."""

    float_accuracy: float
    integer_accuracy: float


class StepAccuracies(Accuracies):
    """Of the local decision of a step, ``time_s`` from the onset to the end of its window (median over touches)."""

    step: int
    time_s: float


class Shares(Accuracies):
    """With the share of recordings on which both models decide the same."""

    agreement: float


class FoldShares(Shares):
    """A fold, means over seeds. by_seed: each of these. Inside folds the choice that was made there."""

    held_out: str
    recordings: int
    by_seed: Mapping[str, Sequence[float]] = {}
    front_end: FrontEnd | None = None
    front_end_words: str = ""
    network: str = ""


class Judged(Shares):
    """A split: groups left out, seeds of the networks of a fold, standard_error, range and range_of
    (`eskin.training.splits.over_groups`) of the integers."""

    groups: Sequence[str]
    folds: int
    seeds: Sequence[int]
    standard_error: float
    range: tuple[float, float]
    range_of: str = "parts left out"
    per_fold: Sequence[FoldShares]


class Disturbed(Result):
    """Networks under the panel, on recordings and disturbances that no choice has met. undisturbed_accuracy: of the same
    recordings, which the bounds refer to. stress_held of stress_modes: modes of ``stress``. oscillator: at a rate that is off
    as a part's own oscillator may be. Empty without a panel."""

    stress: Sequence[ModeFigure] = []
    gate_modes: Sequence[ModeFigure] = []
    stressed_accuracy: float | None = None
    undisturbed_accuracy: float = 0.0
    stress_held: int = 0
    stress_modes: int = 0
    oscillator: ModeFigure | None = None

    @property
    def modes(self) -> list[ModeFigure]:
        """All figures."""
        return [*self.stress, *self.gate_modes]


class Nested(Judged):
    """Each fold left out of every step that uses a label, the choice included."""

    disturbed: Disturbed
    wall_s: float


class Split(Judged):
    """A record of the cross-validation. integer_spread: standard deviation over folds and seeds; integer_by_seed: over
    all folds. decision_time_s: since the onset, mean; None: no decision. confusion: integers, summed over seeds, rows
    are true classes, columns decided ones, the last column none. nested: absent if nothing was chosen, None if the
    choice could not be repeated."""

    integer_spread: float
    integer_by_seed: Sequence[float]
    per_step: Sequence[StepAccuracies]
    decision_time_s: float | None
    confusion: Sequence[Sequence[int]]
    nested: Nested | None = None

    @property
    def searched(self) -> bool:
        """True if something was chosen on its folds."""
        return "nested" in self.model_fields_set

    @property
    def unseen(self) -> Judged:
        """Figures on folds that took no part in the choice."""
        return self.nested or self


# ---------------------------------------------------------------------- the file
class SameGroups(Accuracies):
    """With single recordings left out."""

    folds: int


class SignalRange(Result):
    """Real values of a signal."""

    signal: str
    min: float
    max: float
    format: str


class Quantised(Result):
    """The configuration as it was quantised."""

    config: Record


class Adapted(Result):
    """A change of the model by recordings, ``data``: touches of each class, share of the recordings decided as labelled
    before and after. passed: nothing was lost."""

    data: str
    touches: Mapping[str, int]
    before: float
    after: float
    wall_s: float
    passed: bool


class Enrolled(Adapted):
    """Training continued; the new recordings are now trained on. old_before, old_after: of recordings trained on before;
    None without."""

    old_data: str | None
    seed: int
    setting: Record
    old_before: float | None
    old_after: float | None


class Taught(Adapted):
    """Touches taught. in_use: of each class, of ``places``."""

    in_use: Mapping[str, int]
    places: int


class Training(Findings):
    """training.json. Fields that a model does not need are absent, others than these are kept.

    touched: recordings with a touch. parameters: of the network; multiplies: of an image. ranges: of each signal, of
    images the largest value of each layer. unit, channel_names: of the recordings. same_groups: accuracy to expect
    of known groups; None: the cross-validation leaves out single recordings itself. widths: bits as quantise was asked.
    """

    model_config = ConfigDict(extra="allow")

    seed: int = 0
    recipe: Mapping[str, Any] = {}
    config: Mapping[str, Any] = {}
    data: str = ""
    unit: str = ""
    channel_names: Sequence[str] = []
    recordings: int = 0
    touched: int = 0
    parameters: int = 0
    multiplies: int = 0
    ranges: list[SignalRange] | dict[str, float] | None = None
    cross_validation: Sequence[Split] = []
    versions: Mapping[str, str] = {}
    wall_s: float = 0.0
    reasons: Sequence[str] = []
    same_groups: SameGroups | None = None
    quantisation_aware: bool = False
    widths: Mapping[str, Any] = {}
    quantised: Quantised | None = None
    enrolments: Sequence[Enrolled] = []
    taught: Sequence[Taught] = []


OTHER_SIGNALS = "give touches as strong and as long as in training, or a model trained on these"
"""The fix where a model's front end finds no touch; `eskin inspect` would show touches of another rule."""


def is_training_data(folder: str | Path, source: str, count: int) -> bool:
    """True if the model was trained on so many recordings of this source: accuracies on them are too high."""
    training = training_of(folder)
    return (training.data, training.recordings) == (source, count)


def training_of(folder: str | Path) -> Training:
    """The training record of a model folder; empty when it has none.

    Raises
    ------
    InputError
        The file is damaged.
    """
    path = Path(folder) / TRAINING_FILE
    return Training.read(path, "train the model again") if path.exists() else Training()
