"""Events of a source: frames, and every stage that the frames bring. They are plain data, so that page and
tests read them.

Frames are numbered from 1 in their recording, touches and steps from 0, as in docs/specification.md.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Begin:
    """A recording begins.

    number: its index in the data, -1 where there is none. label: its class, -1 unknown. frames: its length, 0
    unknown. level (taxels): codes that the eye takes for rest.
    """

    number: int
    label: int
    frames: int
    level: np.ndarray


@dataclass(frozen=True)
class Frames:
    """Frames ``first``, ``first`` + 1, ...; samples (n, taxels), A/D codes."""

    first: int
    samples: np.ndarray


@dataclass(frozen=True)
class Onset:
    """A touch begins: the frame that met the rule (0: the gate opens at once) and the first frame of its
    first window."""

    touch: int
    frame: int
    start: int


@dataclass(frozen=True)
class Where:
    """Position of a touch, docs/specification_interfaces.md section 13: centre x, y in sixteenths of a
    cell, ``peak`` a taxel.

    frame: whose it is (0: not known). ended: the touch is over; direction: of its slide,
    `eskin.golden.model.position.direction`.
    """

    frame: int
    x: int
    y: int
    peak: int
    ended: bool
    direction: int


@dataclass(frozen=True)
class Step:
    """A window is complete, and what the model makes of it.

    frame: the live frame that completes it. features (D), hidden (H), logits (C): codes. label, margin: the
    local decision.
    """

    touch: int
    step: int
    frame: int
    features: np.ndarray
    hidden: np.ndarray
    logits: np.ndarray
    label: int
    margin: int


@dataclass(frozen=True)
class Decided:
    """A touch's global decision.

    frame: the frame that completes it. since: seconds from the onset to that frame. partial: the recording
    ended before the touch did. unsure: its margin is below the threshold.
    """

    touch: int
    step: int
    frame: int
    label: int
    margin: int
    partial: bool
    unsure: bool
    since: float


@dataclass(frozen=True)
class Stage:
    """Values of the hardware at one stage (None: nothing came), and the places where they differ from the
    model's."""

    values: tuple[int | None, ...]
    wrong: tuple[int, ...] = ()


@dataclass(frozen=True)
class Hardware:
    """Values of the hardware for a step (or, ``closing``, for a touch), stage by stage: ``sum``,
    ``feature``, ``state``, ``logit`` and ``decision``, of which class and margin come first."""

    touch: int
    step: int
    closing: bool
    stages: Mapping[str, Stage]


@dataclass(frozen=True)
class Differs:
    """Something of the hardware that belongs to no step of the model, or could not be compared: a sentence;
    is it a mismatch."""

    sentence: str
    mismatch: bool = True


@dataclass(frozen=True)
class End:
    """A recording is over. decision: its first touch's, -1 none. whole: the recording was played to its
    end."""

    decision: int
    whole: bool = True


@dataclass(frozen=True)
class Result:
    """A recording that was played to its end. since: of its first touch's decision, -1 none. wrong:
    values of hardware that differ."""

    number: int
    label: int
    decision: int
    since: float
    wrong: int


Event = Begin | Frames | Onset | Where | Step | Decided | Hardware | Differs | End | Result


@dataclass
class Tally:
    """Recordings that have been played: counted by the player, shown by the page.

    recordings: played to their end. correct, undecided: of those with a label. compared, mismatches: values
    of hardware. behind_s: how much later than asked the source is.
    """

    frames: int = 0
    recordings: int = 0
    labelled: int = 0
    correct: int = 0
    undecided: int = 0
    touches: int = 0
    compared: int = 0
    mismatches: int = 0
    behind_s: float = 0.0
    frames_per_s: float = 0.0
    sentences: list[str] = field(default_factory=list)
