"""Compares what the hardware says with the golden trace, value by value as the values come, and stops at the
first that differs: a wrong one, one too many, one that is missing, one with an unknown bit."""

import json
import logging
import operator
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from eskin.golden.core import AcceleratorConfig, Arrays, Record

LOG = logging.getLogger("cocotb.scoreboard")
LOG.addHandler(logging.NullHandler())  # elsewhere nothing is shown
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
KEPT: dict[str, Callable[[int, int], int]] = {"FAULTS": operator.or_, "LONGEST": max}
KEPT |= dict.fromkeys(("STATUS", "TOUCHES", "VERSION"), lambda _, last: last)
"""Registers read behind every recording, and how two recordings' values are joined."""
ARMED, TOUCH, BUSY, NO_TOUCH = 1, 2, 4, 8
"""Bits of STATUS."""
WRITE_REFUSED, INPUT_STALLED, OVERRUN, TAXEL_FAULT = 1, 2, 8, 64
"""Bits of FAULTS that a recording may raise."""
MARGIN_FRAMES, MARGIN_BEATS = 4, 16
"""Most that is on its way between a frame's conversion and the detector's state."""
ODD = 1 << 9
"""Bit of TAUGHT that says nothing by itself."""


def flat_stages(config: AcceleratorConfig) -> dict[str, str]:
    """The flat stages of this configuration's chain."""
    return IMAGE_STAGES if config.is_image else FLAT_STAGES


def unpack_decision(config: AcceleratorConfig, payload: int) -> dict[str, int]:
    """The fields of a decision's 32 bits, the margin in logit LSBs or in votes."""
    fields = {name: payload >> low & (1 << width) - 1 for name, (low, width) in _places(config).items()}
    return fields | {"margin": fields["margin"] * _margin_unit(config, fields["is_global"])}


def pack_decision(config: AcceleratorConfig, row: Sequence[int]) -> int:
    """The 32 bits of an expected decision."""
    fields = dict(zip(DECISION_FIELDS, row, strict=True))
    fields["margin"] //= _margin_unit(config, fields["is_global"])
    return sum(fields[name] << low for name, (low, _) in _places(config).items())


def _places(config: AcceleratorConfig) -> dict[str, tuple[int, int]]:
    return WIDE_DECISION_FIELDS if config.wide_decisions else DECISION_FIELDS


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

    @property
    def look(self) -> int:
        """Frames behind which the first touch is open whatever is on its way; 0: it never is for certain."""
        begin, end = self.arrays["open"][self.position].tolist()
        margin = MARGIN_BEATS // self.arrays["samples"].shape[1]
        if "map" in self.arrays:  # open from its first pixel to its decision, and without a converter
            return (begin + margin) * (begin + margin < end)
        margin += MARGIN_FRAMES
        return (begin + margin) * (0 < begin < end - 2 * margin)

    def __getitem__(self, name: str) -> np.ndarray:
        # an array without offsets has a row a frame
        own = f"{name.removesuffix('_frame')}_offsets"
        offsets = self.arrays[own if own in self.arrays else "offsets"]
        return self.arrays[name][slice(*offsets[self.position : self.position + 2].tolist())]


def loading(design: Path) -> tuple[Record, list[tuple[int, int]]]:
    """Register map of a generated folder, and the bus writes that load the model and measure its steps."""
    map_ = json.loads((design / "registers.json").read_text())
    words = (int(word, 16) for word in (design / "load.hex").read_text().split())
    writes = [divmod(word, 1 << 16) for word in words]
    return map_, [*writes, (map_["registers"]["MEASURE"], map_["measures"]["STEP"])]


def read_behind(map_: Mapping[str, Any], read: Callable[[str, int], int]) -> dict[str, int]:
    """Registers behind a recording. ``read(name, word)`` gives one word; the words of a register make one number."""
    return {
        name: sum(read(name, word) << 16 * word for word in range(words))
        for name, words in map_["behind"].items()
    }


def registers_behind(
    config: AcceleratorConfig,
    map_: Mapping[str, Any],
    got: Mapping[str, int],
    *,
    status: int,
    touches: int,
    steps: int,
    flags: Any,
    taught: int,
    may_be: int,
    faults: int = 0,
) -> dict[str, int]:
    """Expected registers behind a recording that began with CLEAR_FAULTS and ARM, beside those that were ``got``.

    Parameters
    ----------
    map_:
        Register map (eskin.rtl.fpga.generate.register_map).
    flags, taught:
        Fault flags of the taxels, if there are any; taught touches in use.
    faults, may_be:
        Bits of FAULTS that must be, apart from TAXEL, and those that may be.
    """
    # it grows with a step that the recording's end cuts short, too, but not so far
    longest = map_["longest_step"] if steps else min(got["LONGEST"], map_["longest_step"] - 1)
    faults |= got["FAULTS"] & may_be | TAXEL_FAULT * bool(np.any(flags))
    want = {"STATUS": status, "FAULTS": faults, "TOUCHES": touches % 256, "LONGEST": longest}
    want |= {"VERSION": map_["version"]}
    if config.faults.fault_frames:
        want["TAXEL_FAULTS"] = sum(1 << taxel for taxel in np.flatnonzero(flags).tolist())
    if config.readout_rule.taught:
        want["TAUGHT"] = taught | got["TAUGHT"] & ODD
    return want


class Scoreboard:
    """The golden trace beside what comes.

    Parameters
    ----------
    map_:
        Register map (eskin.rtl.fpga.generate.register_map).
    probes:
        False: the hardware has none; decisions and registers alone are compared.

    Attributes
    ----------
    compared: values compared so far, by stage. counts: steps, decisions. took, late: cycles of each step, and from the
    last taxel to each decision. differing: the first difference, if one was found. registers:
    last read, by name. armed: cycle of the recording's ARM.
    faults: bits of FAULTS that whoever plays the recording has caused.
    """

    def __init__(self, config: AcceleratorConfig, map_: Mapping[str, Any], *, probes: bool = True) -> None:
        self.config, self._flat, self._map = config, flat_stages(config) if probes else {}, map_
        chain = [stage for stage in flat_stages(config) if stage != "fault" or config.faults.fault_frames]
        self.compared = Counter(dict.fromkeys([*chain, "decision", "status"], 0))
        self.counts = {"steps": 0, "decisions": 0}
        self.took, self.late, self.differing = list[int](), list[int](), list[Mismatch]()
        self.registers: dict[str, int] = {}

    def begin(self, recording: Recording, armed: int = 0) -> None:
        """Start ``recording``: later values belong to it. armed: cycle of its ARM."""
        self.recording, self.armed, self.faults = recording, armed, 0
        words = [pack_decision(self.config, row) for row in recording["decision"].tolist()]
        self._wanted = {stage: recording[stage] for stage in self._flat}
        self._wanted["decision"] = np.array(words, np.uint32)
        if self._flat:
            steps = np.count_nonzero(recording["decision"][:, 0] == 0)
            self._wanted["step"] = np.full(steps, self._map["step_cycles"])
        self._seen = dict.fromkeys(self._wanted, 0)
        self._offered: list[int] = []

    def check(self, stage: str, values: np.ndarray, cycles: np.ndarray | None = None) -> None:
        """Compare the next values of a stage, and the cycles they came in. ``step``, the cycles of each step, does not
        count among the values.

        Raises
        ------
        Mismatch
        """
        if stage == "step":
            self.counts["steps"] += len(values)
            self.took += values.tolist()
        cycles = np.full(len(values), -1) if cycles is None else cycles
        each = {"decision": len(DECISION_FIELDS), "step": 0}.get(stage, 1)
        if stage == "decision":
            values = values.view(np.uint32)
            self._offered += cycles.tolist()
            if not self._flat:  # one local decision a step
                self.counts["steps"] += int((values >> DECISION_FIELDS["is_global"][0] & 1 == 0).sum())
        low = self._seen[stage]
        self._seen[stage] += len(values)
        wanted = self._wanted[stage][low : low + len(values)]
        if count := each * wanted.size:
            self.compared[stage] += count
        index = next(iter(np.flatnonzero(values[: len(wanted)] != wanted).tolist()), len(wanted))
        if index < len(values):
            want = int(wanted[index]) if index < len(wanted) else None
            raise self.mismatch(stage, low + index, want, int(values[index]), cycles[index])

    def look(self, after: str, status: int) -> None:
        """STATUS behind ``ARM`` when nothing is on its way any more, behind the frames of
        `Recording.look` (``TOUCH``), in the cycle behind ``FINISH``.

        Raises
        ------
        Mismatch
        """
        at_once = self.config.opens_at_once and not self.config.is_image
        want, ignored = {
            "ARM": (NO_TOUCH if at_once else NO_TOUCH | ARMED, 0),
            "TOUCH": (TOUCH, BUSY),
            "FINISH": (BUSY, ~BUSY),
        }[after]
        self._equal({f"STATUS behind {after}": (want, status & ~ignored)})

    def end(
        self, status: Mapping[str, int], accepted: Sequence[int] | None = None, finished: int = -1
    ) -> None:
        """The recording is over.

        Parameters
        ----------
        status:
            Registers of `read_behind`.
        accepted:
            Cycle of the last taxel of each frame. None: not known, nor whether INPUT_STALLED may be set.
        finished:
            Cycle of FINISH, which brings the decisions that no frame brings; -1: not known.

        Raises
        ------
        Mismatch
        """
        for name, combine in KEPT.items():
            self.registers[name] = combine(self.registers.get(name, 0), status[name])
        for stage, wanted in self._wanted.items():
            if (seen := self._seen[stage]) < len(wanted):
                raise self.mismatch(stage, seen, int(wanted[seen]), None)
        arrays, position = self.recording.arrays, self.recording.position
        frames, local = self.recording["decision_frame"], self.recording["decision"][:, 0] == 0
        ends = frames[local][2:]
        # a window waits for room only while the step two before it is not over; its first sum comes behind the
        # frame before its last one
        waits = (
            accepted is None
            or (np.array(self._offered)[local][: len(ends)] > np.array([0, *accepted])[ends - 1]).any()
        )
        want = registers_behind(
            self.config,
            self._map,
            status,
            status=int(arrays["status"][position]),
            touches=int(arrays["touches"][position]),
            steps=int(local.sum()),
            flags=arrays["flags"][position] if "flags" in arrays else (),
            taught=int(arrays["taught"][position]) if "taught" in arrays else 0,
            faults=self.faults,
            may_be=INPUT_STALLED * (accepted is None) | OVERRUN * bool(waits and len(ends)),
        )
        self._equal({name: (value, status[name]) for name, value in want.items()})
        self.counts["decisions"] += self._seen["decision"]
        LOG.info("recording %d: %s", self.recording.number, self._seen)
        begins = dict(enumerate(accepted or (), 1)) | ({0: finished} if finished >= 0 else {})
        pairs = zip(frames.tolist(), self._offered, strict=False)
        self.late += [cycle - begins[frame] for frame, cycle in pairs if frame in begins]

    def _equal(self, values: Mapping[str, tuple[int, int]]) -> None:
        """Compare expected values of registers, by name, with what was read."""
        self.compared["status"] += len(values)
        for index, (place, (want, got)) in enumerate(values.items()):
            if want != got:
                raise self.mismatch("status", index, want, got, place=place)

    def mismatch(
        self,
        stage: str,
        index: int,
        want: int | None,
        got: int | str | None,
        cycle: int = -1,
        place: str = "",
        frame: int = 0,
    ) -> Mismatch:
        """The first by its cycle: this one in the present recording, or one that was found before. By default it is at the
        place of that value of a stage; a decision shows its first field that differs."""
        if want is None:
            place = "one too many"
        elif not place:
            frame, place, want, got = self._told(stage, index, want, got)
        where = self.recording.number, stage, index, place, int(frame)
        found = [*self.differing, Mismatch(*where, want, got, int(cycle), int(cycle) - self.armed)]
        self.differing = sorted(found, key=lambda each: (each.cycle < 0, each.cycle))[:1]
        LOG.error("%s", self.differing[0])
        return self.differing[0]

    def _told(self, stage: str, index: int, want: int, got: Any) -> tuple[int, str, int, Any]:
        """Frame and place of a value that differs or is missing, and the two."""
        rows, frames = self.recording["decision"], self.recording["decision_frame"]
        missing = ", the first that is missing" if got is None else ""
        if stage == "decision":
            aim = unpack_decision(self.config, want)
            fields: Record = {"class": None} if missing else unpack_decision(self.config, got)
            name = next(name for name, value in fields.items() if value != aim[name])
            of = "the global decision" if aim["is_global"] else f"step {aim['step']}"
            return frames[index], f"{name} of {of}{missing}", aim[name], fields[name]
        local = rows[:, 0] == 0
        steps = rows[local, 1]
        ordinal, element = divmod(index, len(self._wanted[stage]) // len(steps))
        touch = np.count_nonzero(steps[: ordinal + 1] == 0) - 1  # every touch begins with its step 0
        of = self._flat.get(stage, "value")
        place = f"touch {touch}, step {steps[ordinal]}, {of} {element}{missing}"
        return frames[local][ordinal], place, want, got
