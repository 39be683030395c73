"""Compares what the harness captured with what the golden model expects, value by value and exactly.

A value that is missing, superfluous or not fully known (an X or Z bit) is a mismatch like a wrong one.
"""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from eskin.golden.core import AcceleratorConfig, Arrays, Pool

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


STATUS_STAGE = "status"
UNEXPECTED_FAULTS = 0x85
"""FAULTS bits that no recording may raise: a write refused, framing, a register that is not there."""
TAXEL_FAULT = 0x40
NO_TOUCH = 0x8
KEPT_MISMATCHES = 50


@dataclass(frozen=True)
class Mismatch:
    """One difference.

    recording: its number. stage: ``sum`` ... ``decision``, ``status``, ``handshake``, ``input``. index: of
    the value in the recording's stream of that stage. place: the index in words (step, taxel ...). frame:
    live frame (1-based) that completes the step's window, 0 unknown. expected, actual: the two values, None
    where there is none. cycle: stamp of the captured value, -1 none.
    """

    recording: int
    stage: str
    index: int
    place: str
    frame: int
    expected: int | None
    actual: int | str | None
    cycle: int = -1

    def __str__(self) -> str:
        frame = f", frame {self.frame}" if self.frame else ""
        expected = "nothing more" if self.expected is None else self.expected
        actual = "nothing" if self.actual is None else self.actual
        at = f" at cycle {self.cycle}" if self.cycle >= 0 else ""
        where = f"recording {self.recording}{frame}, stage {self.stage}, index {self.index} ({self.place})"
        return f"{where}: expected {expected}, got {actual}{at}"


@dataclass
class Verdict:
    """What a comparison found: values compared and mismatches by stage, and the first mismatches. chain: the
    stages that there are."""

    chain: tuple[str, ...] = (*FLAT_STAGES, "decision", STATUS_STAGE)
    compared: Counter[str] = field(default_factory=Counter)
    differing: Counter[str] = field(default_factory=Counter)
    first: list[Mismatch] = field(default_factory=list)

    @property
    def compared_values(self) -> int:
        """Values compared at all stages."""
        return self.compared.total()

    @property
    def mismatches(self) -> int:
        """Mismatches at all stages."""
        return self.differing.total()

    @property
    def stages(self) -> dict[str, dict[str, int]]:
        """Stage -> {compared_values, mismatches}, every stage of the chain whether or not anything was
        compared there."""
        # a unary plus drops the counts of 0; dict.fromkeys keeps each name once, in order
        names = dict.fromkeys([*self.chain, *(+self.compared), *self.differing])
        return {
            name: {"compared_values": self.compared[name], "mismatches": self.differing[name]}
            for name in names
        }

    def add(self, mismatch: Mismatch) -> None:
        """Count a mismatch and keep it if it is one of the first."""
        self.differing[mismatch.stage] += 1
        if len(self.first) < KEPT_MISMATCHES:
            self.first.append(mismatch)

    @property
    def bit_exact(self) -> bool:
        """True when values were compared and none differs: no value at all proves nothing."""
        return self.mismatches == 0 and self.compared_values > 0


@dataclass(frozen=True)
class Stream:
    """A captured stage of one recording: words as text (hex digits, x and z), and their cycle stamps."""

    words: list[str]
    cycles: list[int]

    @cached_property
    def definite(self) -> np.ndarray:
        """Which words have no X or Z bit."""
        return _definite(self.words)

    @cached_property
    def codes(self) -> np.ndarray:
        """The words as numbers of 32 bits; 0 where they are not definite."""
        numbers = (int(word, 16) if good else 0 for word, good in zip(self.words, self.definite, strict=True))
        return np.fromiter(numbers, np.uint32, len(self.words))

    def mismatch(self, recording: int, stage: str, index: int, place: str, frame: int, want: Any, got: Any):
        """The `Mismatch` at a place of this stream."""
        cycle = self.cycles[index] if index < len(self.cycles) else -1
        return Mismatch(recording, stage, index, place, frame, want, got, cycle)


@dataclass(frozen=True)
class Recording:
    """What the golden model expects of one recording: ``recording["state"]`` is its part of that array of
    `eskin.golden.model.vectors.write_vectors`."""

    arrays: Arrays
    position: int

    @property
    def number(self) -> int:
        """What it is called."""
        return int(self.arrays["numbers"][self.position])

    def span(self, name: str) -> slice:
        """Its part of the array ``name``. An array without offsets of its own has a row a frame."""
        stage = name.removesuffix("_frame")
        offsets = self.arrays.get(f"{stage}_offsets", self.arrays["offsets"])
        return slice(*offsets[self.position : self.position + 2].tolist())

    def __getitem__(self, name: str) -> np.ndarray:
        return self.arrays[name][self.span(name)]


def recordings_of(expected: Arrays) -> list[Recording]:
    """All of them, as played."""
    return [Recording(expected, position) for position in range(len(expected["numbers"]))]


@dataclass(frozen=True)
class Capture:
    """All files of one run, by recording number.

    stages: stage -> recording -> Stream; for ``decision`` the stamp is the edge at which it could first be
    taken. steps: recording -> cycles of each step. status: recording -> (STATUS, FAULTS, TOUCHES, cycle of
    arm, words of TAXEL_FAULTS ...), words as text. frame_cycles: stamps (low 32 bits) of the edges that took
    each frame's last taxel, recording after recording as played. summary: name -> value.
    """

    stages: dict[str, dict[int, Stream]]
    steps: dict[int, Stream]
    status: dict[int, tuple]
    frame_cycles: np.ndarray
    summary: dict[str, int]

    def stream(self, stage: str, recording: int) -> Stream:
        """Empty where nothing came."""
        return self.stages[stage].get(recording, Stream([], []))


def flat_stages(config: AcceleratorConfig) -> dict[str, str]:
    """The flat stages of this configuration's chain."""
    return IMAGE_STAGES if config.is_image else FLAT_STAGES


def kept_values(config: AcceleratorConfig) -> int:
    """Values of all maps of an image: of a convolution with a pool behind it only the pool's."""
    following = zip(config.stages, config.stages[1:], strict=False)
    return sum(math.prod(stage.result) for stage, behind in following if not isinstance(behind.layer, Pool))


def read_capture(work: Path, flat: Iterable[str] = tuple(FLAT_STAGES)) -> Capture:
    """The files that harness.sv left in ``work``; ``flat``: the flat stages that there are."""
    status = {}
    for recording, status_word, faults, touches, cycle, *flags in _rows(work / "status.txt"):
        status[int(recording)] = (status_word, faults, touches, int(cycle), *flags)
    return Capture(
        stages={stage: _read_stream(work / f"{stage}.txt") for stage in (*flat, "decision")},
        steps=_read_stream(work / "step.txt"),
        status=status,
        frame_cycles=np.fromfile(work / "frames.bin", dtype="<u4"),
        summary={name: int(value) for name, value in _rows(work / "summary.txt")},
    )


def _rows(path: Path) -> Iterator[list[str]]:
    with path.open() as lines:
        for line in lines:
            yield line.split()


def _read_stream(path: Path) -> dict[int, Stream]:
    streams: dict[int, Stream] = {}
    for recording, word, cycle, *_ in _rows(path):
        stream = streams.setdefault(int(recording), Stream([], []))
        stream.words.append(word)
        stream.cycles.append(int(cycle))
    return streams


def compare(config: AcceleratorConfig, expected: Arrays, capture: Capture, *, probes: bool = True) -> Verdict:
    """The verdict over every recording and stage.

    Parameters
    ----------
    expected:
        Arrays of eskin.golden.model.vectors.write_vectors.
    probes:
        False: the hardware has no probes; decisions and registers alone are compared.
    """
    flat = flat_stages(config)
    chain = (*flat, "decision", STATUS_STAGE)
    verdict = Verdict(tuple(stage for stage in chain if stage != "fault" or config.faults.fault_frames))
    sizes = {
        "sum": config.inputs,
        "fault": config.inputs,
        "feature": config.inputs,
        "state": config.network.hidden,
        "logit": config.classes,
    } | ({"map": kept_values(config)} if config.is_image else {})
    numbers = [int(number) for number in expected["numbers"]]
    counts = {
        "protocol_errors": "decisions that changed before they were taken",
        "unknown": "cycles with an X on valid, ready or busy",
    }
    for name, place in counts.items():
        if capture.summary[name]:
            verdict.add(
                Mismatch(numbers[0] if numbers else -1, "handshake", 0, place, 0, 0, capture.summary[name])
            )
    if capture.summary["stuck"]:
        place = "no beat was taken for the watchdog's time"
        verdict.add(
            Mismatch(
                capture.summary["stuck_recording"],
                "input",
                0,
                place,
                capture.summary["stuck_frame"],
                None,
                "a standstill",
            )
        )
    for recording in recordings_of(expected):
        number, steps = recording.number, _steps(recording)
        for stage, unit in flat.items() if probes else ():
            stream = capture.stream(stage, number)
            _compare_flat(verdict, number, stage, unit, sizes[stage], recording[stage], stream, steps)
        stream = capture.stream("decision", number)
        _compare_decisions(
            verdict, config, number, recording["decision"], stream, recording["decision_frame"]
        )
        flags = expected["flags"][: recording.position + 1] if config.faults.fault_frames else None
        touches = int(expected["touches"][recording.position])
        _compare_status(verdict, number, touches, capture.status.get(number), flags)
    for stage, streams in capture.stages.items():
        for number in set(streams) - set(numbers):
            verdict.add(
                Mismatch(
                    number, stage, 0, "a recording that was not played", 0, None, streams[number].words[0]
                )
            )
    return verdict


def compare_played(
    verdict: Verdict,
    config: AcceleratorConfig,
    number: int,
    rows: np.ndarray,
    frames: np.ndarray,
    payloads: Sequence[int],
    touches: int,
    words: tuple[int, int, int],
) -> None:
    """Compare what a board said of one recording.

    Parameters
    ----------
    rows, frames, touches:
        Golden decisions, the frame that completes each, touches begun.
    payloads:
        The board's decisions, 32 bits each. words: its STATUS, FAULTS and TOUCHES at the end.
    """
    stream = Stream([f"{payload:08x}" for payload in payloads], [])
    _compare_decisions(verdict, config, number, rows, stream, frames)
    status, faults, counted = (f"{word:04x}" for word in words)
    _compare_status(verdict, number, touches, (status, faults, counted, 0))


def _steps(recording: Recording) -> list[tuple[int, int, int]]:
    """(touch, step, completing frame) of each step of a recording, from its expected decisions."""
    rows, frames = recording["decision"], recording["decision_frame"]
    local = rows[:, 0] == 0
    touches = np.cumsum(rows[local, 1] == 0) - 1  # every touch begins with its step 0
    return list(zip(touches.tolist(), rows[local, 1].tolist(), frames[local].tolist(), strict=True))


def _definite(words: Iterable[str]) -> np.ndarray:
    return np.array([not set(word.lower()) & {"x", "z"} for word in words], dtype=bool)


def _compare_flat(
    verdict: Verdict,
    number: int,
    stage: str,
    unit: str,
    size: int,
    expected: np.ndarray,
    stream: Stream,
    steps: list[tuple[int, int, int]],
) -> None:
    # probes are sign-extended to 32 bits, so int32 gives the codes their signs back
    actual, count = stream.codes.astype(np.int32), len(stream.words)
    shared = min(len(expected), count)
    verdict.compared[stage] += shared
    differing = np.flatnonzero((actual[:shared] != expected[:shared]) | ~stream.definite[:shared]).tolist()
    for index in [*differing, *range(shared, max(len(expected), count))]:
        ordinal, element = divmod(index, size)
        place, frame = "after the last step", 0
        if ordinal < len(steps):
            touch, step, frame = steps[ordinal]
            place = f"touch {touch}, step {step}, {unit} {element}"
        want = int(expected[index]) if index < len(expected) else None
        got = (
            None if index >= count else int(actual[index]) if stream.definite[index] else stream.words[index]
        )
        verdict.add(stream.mismatch(number, stage, index, place, frame, want, got))


def _compare_decisions(
    verdict: Verdict,
    config: AcceleratorConfig,
    number: int,
    expected: np.ndarray,
    stream: Stream,
    frames: np.ndarray,
) -> None:
    shared = min(len(expected), len(stream.words))
    verdict.compared["decision"] += shared * len(DECISION_FIELDS)
    for index, (row, word) in enumerate(zip_longest(expected.tolist(), stream.words)):
        if index >= shared:
            wrong = [("whole decision, class or payload", row and row[2], word)]
        elif not stream.definite[index]:
            wrong = [("payload", row[2], word)]
        else:
            of = "the global decision" if row[0] else f"step {row[1]}"
            fields = unpack_decision(config, int(word, 16))
            pairs = zip(fields.items(), offered_row(config, row), strict=True)
            wrong = [(f"{name} of {of}", want, got) for (name, got), want in pairs if want != got]
        frame = int(frames[index]) if index < len(frames) else 0
        for place, want, got in wrong:
            verdict.add(stream.mismatch(number, "decision", index, place, frame, want, got))


def _compare_status(
    verdict: Verdict, number: int, touches: int, words: tuple | None, flags: np.ndarray | None = None
) -> None:
    if words is None:
        verdict.add(
            Mismatch(number, STATUS_STAGE, 0, "registers at the end of the recording", 0, touches, None)
        )
        return
    read = [*words[:3], *words[4:]]
    if not _definite(read).all():
        verdict.add(
            Mismatch(
                number, STATUS_STAGE, 0, "STATUS, FAULTS, TOUCHES, TAXEL_FAULTS", 0, touches, " ".join(read)
            )
        )
        return
    status, faults, counted = (int(word, 16) for word in words[:3])
    values = {
        "NO_TOUCH of STATUS": (int(touches == 0), int(bool(status & NO_TOUCH))),
        "FAULTS that must not be": (0, faults & UNEXPECTED_FAULTS),
        "TOUCHES": (touches, counted),
    }
    if flags is not None:
        got = sum(int(word, 16) << 16 * k for k, word in enumerate(words[4:]))
        bit = int(bool(faults & TAXEL_FAULT))
        values["TAXEL_FAULTS"] = (sum(1 << int(taxel) for taxel in np.flatnonzero(flags[-1])), got)
        # sticky: an earlier recording may have set the bit, but only one with a flag
        values["TAXEL of FAULTS"] = (int(flags[-1].any() or (bit and flags.any())), bit)
    verdict.compared[STATUS_STAGE] += len(values)
    for index, (place, (want, got)) in enumerate(values.items()):
        if want != got:
            verdict.add(Mismatch(number, STATUS_STAGE, index, place, 0, want, got))
