"""Compares what the hardware says with the golden trace, value by value as the values come, and stops at the
first that differs: a wrong one, one too many, one that is missing, one with an unknown bit."""

import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eskin.golden.core import AcceleratorConfig, Arrays, Pool, Record

FLAT_STAGES = {"sum": "taxel", "fault": "taxel", "feature": "taxel", "state": "unit", "logit": "class"}
"""Stages with one number a beat, and what a step's numbers count."""

IMAGE_STAGES = {"map": "value", "logit": "class"}
"""The same of a network for images: the values of all its maps in their order."""

DECISION_FIELDS = {
    "is_global": (29, 1),
    "step": (21, 8),
    "class": (0, 5),
    "margin": (5, 16),
    "partial": (30, 1),
    "unsure": (31, 1),
}
"""Lowest bit and width of each field of the decision payload, in the order of the expectation's columns."""

WIDE_DECISION_FIELDS = DECISION_FIELDS | {"step": (7, 8), "class": (0, 7), "margin": (15, 14)}
"""The same for more than 32 classes. Margins are in units of `MARGIN_UNIT` logit LSBs there, or in votes."""
MARGIN_UNIT = 4
REGISTERS = ("STATUS", "FAULTS", "TOUCHES", "LONGEST")
"""Read behind every recording."""
UNEXPECTED_FAULTS = 0x85
"""FAULTS bits that no recording may raise: a write refused, framing, a register that is not there."""
TAXEL_FAULT, NO_TOUCH = 0x40, 0x8
"""A bit of FAULTS, and one of STATUS."""


def flat_stages(config: AcceleratorConfig) -> dict[str, str]:
    """The flat stages of this configuration's chain."""
    return IMAGE_STAGES if config.is_image else FLAT_STAGES


def unpack_decision(config: AcceleratorConfig, payload: int) -> dict[str, int]:
    """The fields of a decision's 32 bits, the margin in logit LSBs or in votes."""
    places = WIDE_DECISION_FIELDS if config.wide_decisions else DECISION_FIELDS
    fields = {name: payload >> low & (1 << width) - 1 for name, (low, width) in places.items()}
    return fields | {"margin": fields["margin"] * _margin_unit(config, fields["is_global"])}


def offered_row(config: AcceleratorConfig, row: Sequence[int]) -> list[int]:
    """An expected decision as the payload holds it: with more than 32 classes its margin in whole units."""
    values = dict(zip(DECISION_FIELDS, row, strict=True))
    values["margin"] -= values["margin"] % _margin_unit(config, values["is_global"])
    return list(values.values())


def _margin_unit(config: AcceleratorConfig, is_global: int) -> int:
    votes = is_global and config.network.decision == "vote"
    return 1 if votes or not config.wide_decisions else MARGIN_UNIT


@dataclass
class Mismatch(AssertionError):
    """The first difference.

    recording: its number. stage: ``sum`` ... ``decision``, ``status``, ``handshake``, ``input``. index: of the value
    in the recording's stream of that stage. place: the index in words (step, taxel ...). frame: live frame
    (1-based) that completes the step's window, 0 unknown. expected, got: the two values, None where there is
    none. cycle: in which the value came, -1 none; since_arm: the same since ARM.
    """

    recording: int
    stage: str
    index: int
    place: str
    frame: int
    expected: int | None
    got: int | str | None
    cycle: int = -1
    since_arm: int = 0

    def __str__(self) -> str:
        frame = f", frame {self.frame}" if self.frame else ""
        expected = "nothing more" if self.expected is None else self.expected
        got = "nothing" if self.got is None else self.got
        at = f" at cycle {self.cycle}" if self.cycle >= 0 else ""
        where = f"recording {self.recording}{frame}, stage {self.stage}, index {self.index} ({self.place})"
        return f"{where}: expected {expected}, got {got}{at}"


@dataclass(frozen=True)
class Recording:
    """Expected values of one recording: ``recording["state"]`` is its part of that array of
    `eskin.golden.model.vectors.write_vectors`."""

    arrays: Arrays
    position: int

    @property
    def number(self) -> int:
        """Number of the recording in messages."""
        return int(self.arrays["numbers"][self.position])

    def __getitem__(self, name: str) -> np.ndarray:
        # an array without offsets of its own has a row a frame
        own = f"{name.removesuffix('_frame')}_offsets"
        offsets = self.arrays[own if own in self.arrays else "offsets"]
        return self.arrays[name][slice(*offsets[self.position : self.position + 2].tolist())]


def loading(design: Path) -> tuple[Record, list[tuple[int, int]]]:
    """Register map and the bus writes that load the model, of a generated folder."""
    words = (int(word, 16) for word in (design / "load.hex").read_text().split())
    return json.loads((design / "registers.json").read_text()), [divmod(word, 1 << 16) for word in words]


def recordings_of(expected: Arrays) -> list[Recording]:
    """All of them, as played."""
    return [Recording(expected, position) for position in range(len(expected["numbers"]))]


class Scoreboard:
    """The golden trace beside what comes.

    Parameters
    ----------
    expected:
        Arrays of `eskin.golden.model.vectors.write_vectors`.
    probes:
        False: the hardware has none; decisions and registers alone are compared.

    Attributes
    ----------
    compared: values compared so far, by stage. counts: steps, decisions. took, late: cycles of each step, and from the
    last taxel to each decision. armed: cycle of the recording's ARM.
    """

    def __init__(self, config: AcceleratorConfig, expected: Arrays, *, probes: bool = True) -> None:
        self._config, self._expected = config, expected
        self._flat = flat_stages(config) if probes else {}
        self._sizes = dict.fromkeys(("sum", "fault", "feature"), config.inputs) | {
            "state": config.network.hidden,
            "logit": config.classes,
            "map": _kept_values(config) if config.is_image else 0,
        }
        chain = [stage for stage in flat_stages(config) if stage != "fault" or config.faults.fault_frames]
        self.compared = Counter(dict.fromkeys([*chain, "decision", "status"], 0))
        self.counts = {"steps": 0, "decisions": 0}
        self.took, self.late = list[int](), list[int]()
        self._flagged = False  # a taxel was, in this recording or an earlier one

    def begin(self, recording: Recording, armed: int = 0) -> None:
        """Start ``recording``: later values belong to it. armed: cycle of its ARM."""
        self.recording, self.armed = recording, armed
        self._seen = dict.fromkeys((*self._flat, "decision"), 0)
        self._offered: list[int] = []

    def check(self, stage: str, values: np.ndarray, cycles: np.ndarray | None = None) -> None:
        """The next values of a stage, and the cycles they came in; of ``step``, the cycles of each, there is no
        expectation.

        Raises
        ------
        Mismatch
        """
        if stage == "step":
            self.counts["steps"] += len(values)
            self.took += values.tolist()
            return
        if stage == "decision":
            self._offered += [] if cycles is None else cycles.tolist()
            if not self._flat:  # one local decision a step
                self.counts["steps"] += int((values >> DECISION_FIELDS["is_global"][0] & 1 == 0).sum())
            values = values.view(np.uint32)
        low = self._seen[stage]
        self._seen[stage] = high = low + len(values)
        wanted = self.recording[stage][low:high]
        if wanted.size:
            self.compared[stage] += wanted.size
        if stage == "decision":
            pairs = map(self._wrong_field, wanted.tolist(), values.tolist())
            wrong = [(index, *found) for index, found in enumerate(pairs) if found][:1]
        else:
            differing = np.flatnonzero(values[: len(wanted)] != wanted)[:1]
            wrong = [(k, self._place(stage, low + k), int(wanted[k]), int(values[k])) for k in differing]
        for index, place, want, got in wrong:
            raise self.mismatch(stage, low + index, place, want, got, -1 if cycles is None else cycles[index])
        if len(wanted) < len(values):
            index, got = len(wanted), int(values[len(wanted)])
            cycle = -1 if cycles is None else cycles[index]
            raise self.mismatch(stage, low + index, "one too many", None, got, cycle)

    def end(self, status: Mapping[str, int], taken: Sequence[int] = ()) -> None:
        """The recording is over.

        Parameters
        ----------
        status:
            Registers STATUS, FAULTS, TOUCHES and, where there are fault flags, TAXEL_FAULTS (all of its words as one
            number).
        taken:
            Cycle of the last taxel of each frame, for the decisions' latency.

        Raises
        ------
        Mismatch
        """
        for stage, seen in self._seen.items():
            wanted = self.recording[stage]
            if seen < len(wanted):
                decides = stage == "decision"
                place = "class" if decides else self._place(stage, seen)
                value = int(wanted[seen][2] if decides else wanted[seen])
                raise self.mismatch(stage, seen, f"{place}, the first that is missing", value, None)
        touches = int(self._expected["touches"][self.recording.position])
        faults = status["FAULTS"]
        values = {
            "NO_TOUCH of STATUS": (int(touches == 0), int(bool(status["STATUS"] & NO_TOUCH))),
            "FAULTS that must not be": (0, faults & UNEXPECTED_FAULTS),
            "TOUCHES": (touches, status["TOUCHES"]),
        }
        if self._config.faults.fault_frames and "TAXEL_FAULTS" in status:
            flags = np.flatnonzero(self._expected["flags"][self.recording.position]).tolist()
            values["TAXEL_FAULTS"] = (sum(1 << taxel for taxel in flags), status["TAXEL_FAULTS"])
            self._flagged |= bool(flags)
            bit = bool(faults & TAXEL_FAULT)  # sticky
            values["TAXEL of FAULTS"] = (int(bool(flags) or (bit and self._flagged)), int(bit))
        self.compared["status"] += len(values)
        for index, (place, (want, got)) in enumerate(values.items()):
            if want != got:
                raise self.mismatch("status", index, place, want, got)
        self.counts["decisions"] += self._seen["decision"]
        pairs = zip(self.recording["decision_frame"].tolist(), self._offered, strict=False)
        self.late += [cycle - taken[frame - 1] for frame, cycle in pairs if 0 < frame <= len(taken)]

    def result(self, frame_max: int) -> Record:
        """steps, decisions, stages, cycles, as `eskin.cosim.flow.cosim` describes them."""
        cycles: dict[str, int | None] = {"frame_max": frame_max}
        for name, which, of in (
            ("step_min", min, self.took),
            ("step_max", max, self.took),
            ("decision_latency_max", max, self.late),
        ):
            cycles[name] = which(of, default=None)
        stages = {name: {"compared_values": count, "mismatches": 0} for name, count in self.compared.items()}
        return {**self.counts, "stages": stages, "cycles": cycles}

    def mismatch(
        self,
        stage: str,
        index: int,
        place: str,
        want: int | None,
        got: int | str | None,
        cycle: int = -1,
        frame: int = 0,
    ) -> Mismatch:
        """One in the present recording; ``frame`` 0: that which brings the value."""
        frames, local = self.recording["decision_frame"], self.recording["decision"][:, 0] == 0
        frames = frames if stage == "decision" else np.repeat(frames[local], self._sizes.get(stage, 0))
        frame, cycle = frame or (int(frames[index]) if index < len(frames) else 0), int(cycle)
        where = self.recording.number, stage, int(index), place, frame
        return Mismatch(*where, want, got, cycle, cycle - self.armed)

    def _wrong_field(self, row: list[int], payload: int) -> tuple[str, int, int] | None:
        of = "the global decision" if row[0] else f"step {row[1]}"
        fields = unpack_decision(self._config, payload)
        pairs = zip(fields.items(), offered_row(self._config, row), strict=True)
        return next(((f"{name} of {of}", want, got) for (name, got), want in pairs if want != got), None)

    def _place(self, stage: str, index: int) -> str:
        ordinal, element = divmod(int(index), self._sizes[stage])
        rows = self.recording["decision"]
        steps = rows[rows[:, 0] == 0, 1]
        if ordinal >= len(steps):
            return "after the last step"
        touch = np.count_nonzero(steps[: ordinal + 1] == 0) - 1  # every touch begins with its step 0
        return f"touch {touch}, step {steps[ordinal]}, {self._flat[stage]} {element}"


def _kept_values(config: AcceleratorConfig) -> int:
    """Values of all maps of an image: of a convolution with a pool behind it only the pool's."""
    following = zip(config.stages, config.stages[1:], strict=False)
    return sum(math.prod(stage.result) for stage, behind in following if not isinstance(behind.layer, Pool))
