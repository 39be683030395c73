"""Upsets in the hardware: every outcome of a flipped flip-flop or memory bit against what the golden model says.

A scenario is two recordings: one with two touches, in whose first touch the upset comes, and after a new ``arm`` one more. So each upset
shows what it does to the touch it hits, to the next touch of the same recording, and to the first of the next one.
"""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cosim import upsets as bench
from golden.errors import InputError
from golden.model import IntegerModel
from golden.pipeline import run
from golden.preprocess import find_touches
from golden.recordings import Recordings
from golden.stability import rebuilt
from rtl.generate import boot_writes, pack_decision, register_map
from rtl.memory_map import Fault
from rtl.upsets import Site, with_upsets
from rtl.watchdog import bound

SLACK = 256
"""Cycles beyond the watchdog's bound before a wait counts as a hang: what idle takes to be seen."""
FLAGS = Fault.CHECKSUM | Fault.WATCHDOG

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Scenario:
    """What is played: two recordings, the first with two touches, and the payloads of their decisions (touch by touch)."""

    model: IntegerModel
    recordings: Recordings
    expected: tuple[tuple[tuple[int, ...], ...], ...]

    @property
    def second(self) -> tuple[int, ...]:
        """Decisions of the second touch of the first recording."""
        return self.expected[0][1]


def payloads(model: IntegerModel, recordings: Recordings) -> list[tuple[tuple[int, ...], ...]]:
    """Payloads of the decisions of each recording's touches, in order."""
    trace = run(model, recordings)
    rows, offsets = trace.streams["decision"]
    packed = [pack_decision(row) for row in rows]
    found = []
    for number in range(len(recordings)):
        mine = packed[offsets[number] : offsets[number + 1]]
        sizes = trace.offered()[trace.touches.recording == number].sum(axis=1)
        ends = np.cumsum([0, *sizes])
        found.append(tuple(tuple(mine[low:high]) for low, high in zip(ends[:-1], ends[1:], strict=True)))
    return found


def scenario(model: IntegerModel, recordings: Recordings) -> Scenario:
    """The shortest scenario that the recordings give: the neighbourhoods of their touches, one of them twice in a row.

    Raises
    ------
    InputError
        No recording gives two touches in a row.
    """
    config = model.config
    touches = find_touches(config, recordings)
    lead, tail = config.rest_frames + config.pretrigger_frames + 4 * config.onset_mean_frames, 2 * config.rearm_frames + config.hop
    whole = [row for row in touches.first_touch() if row >= 0 and touches.completed[row] == config.steps]
    pieces = []
    for row in whole[:20]:
        stream = recordings.recording(int(touches.recording[row]))
        begin = max(0, int(touches.onset_frame[row]) - lead)
        pieces.append((stream[begin : int(touches.onset_frame[row]) + config.last_frame + config.hop + tail], int(touches.recording[row])))
    single = config.opens_at_once
    for piece, number in pieces:
        twice = piece if single else np.concatenate([piece, piece])
        other, other_number = pieces[-1]
        chosen = rebuilt(recordings, [twice, other], [number, other_number])
        expected = payloads(model, chosen)
        full = config.steps + 1
        if len(expected[0]) >= (1 if single else 2) and expected[1] and all(len(touch) == full for touch in expected[0][:2]):
            return Scenario(model, chosen, tuple(expected))
    raise InputError(f"{recordings.source}: no recording has a whole touch that can be played twice; give recordings with whole touches")


@dataclass(frozen=True)
class Campaign:
    """A design with upset inputs, ready to play a scenario."""

    scenario: Scenario
    simulator: Path
    sites: list[Site]
    words: np.ndarray
    work: Path
    limit: int

    @classmethod
    def build(cls, given: Scenario, builds: Path, work: Path, *, limit: int | None = None) -> Campaign:
        """Generate and compile; ``limit``: cycles after which a wait is a hang (default: the watchdog's bound and some)."""
        model = given.model
        config = model.config
        limit = limit or bound(config) + SLACK
        text, sites = with_upsets(config, model.arrays)
        streams = [given.recordings.recording(number) for number in range(len(given.recordings))]
        words = bench.stimulus(register_map(config), boot_writes(config, model.arrays), streams, sample_bits=config.sample_bits, limit=limit)
        return cls(given, bench.build(text, builds), sites, words, work, limit)

    def play(self, upsets: Sequence[tuple[int, ...]], progress: Progress | None = None) -> list[dict[str, Any]]:
        """Raw results."""
        return bench.play(self.simulator, self.words, upsets, self.work, progress=progress)

    def clean(self) -> dict[str, Any]:
        """The run without an upset.

        Raises
        ------
        RuntimeError
            It is not what the golden model says.
        """
        (result,) = self.play([bench.NONE])
        for recording, expected in zip(result["recordings"], self.scenario.expected, strict=True):
            got = tuple(event[0] for event in recording["decisions"])
            if got != tuple(value for touch in expected for value in touch) or recording["faults"] & FLAGS or recording["hang"]:
                raise RuntimeError("without an upset the hardware does not do what the golden model does")
        return result

    # ------------------------------------------------------------------ flip-flops
    def flip_flops(self) -> list[Site]:
        """Registers, memories' output registers among them; not the watchdog's own, nor what the bus reads last."""
        return [site for site in self.sites if not site.words and site.block != "watchdog"]

    def choose(self, count: int, seed: int, clean: dict[str, Any]) -> list[tuple[Site, int, int]]:
        """(register, bit, cycle): every flip-flop bit equally often (at least once each where ``count`` allows), blocks in turn; cycles of
        the first touch and before it."""
        rng = np.random.default_rng(seed)
        bits = [(site, bit) for site in self.flip_flops() for bit in range(site.width)]
        rounds = -(-count // len(bits))
        order = [bits[i] for _ in range(rounds) for i in rng.permutation(len(bits))][:count]
        first = clean["recordings"][0]["decisions"][len(self.scenario.expected[0][0]) - 1][2]
        return [(site, bit, int(rng.integers(0, first))) for site, bit in order]

    def judge(self, result: dict[str, Any]) -> dict[str, Any]:
        """What an upset did: hang, and whether the decisions of each touch are those of the golden model."""
        first, then = result["recordings"]
        touches = self.scenario.expected[0]
        got = tuple(event[0] for event in first["decisions"])
        flagged = [event for event in first["decisions"] if event[1] & FLAGS]
        here, following = touches[0], [value for touch in touches[1:] for value in touch]
        recovered = got[len(got) - len(following) :] == tuple(following) if following else True
        restarted = None
        if not recovered and first["cleared"]:
            restarted = self._as_new(first)
        globals_ = [event for event in first["decisions"] if event[0] >> 29 & 1]
        silent = bool(globals_) and not globals_[0][1] & FLAGS and (globals_[0][0] & 31) != (here[-1] & 31)
        return {
            "hang": max(first["hang"], then["hang"]), "exact": got[: len(here)] == here, "wrong_unflagged": silent,
            "flagged": bool(flagged) or bool((first["faults"] | then["faults"]) & FLAGS), "cleared": bool(first["cleared"]),
            "next_touch": recovered, "as_new": restarted,
            "next_recording": tuple(event[0] for event in then["decisions"]) == tuple(v for t in self.scenario.expected[1] for v in t),
        }  # fmt: skip

    def _as_new(self, recording: dict[str, Any]) -> bool:
        """After the watchdog acted: is the rest of the recording decided as a recording by itself is?"""
        frames, taxels, cycle = recording["cleared"][-1]
        stream = self.scenario.recordings.recording(0)
        begin = frames + (taxels > 0)
        expected: tuple[int, ...] = ()
        if begin < len(stream):
            rest = rebuilt(self.scenario.recordings, [stream[begin:]], [0])
            expected = tuple(value for touch in payloads(self.scenario.model, rest)[0] for value in touch)
        return tuple(event[0] for event in recording["decisions"] if event[2] > cycle) == expected


def summary(records: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Counts of a flip-flop campaign's records."""
    lasting = Counter(record["register"] for record in records if not (record["next_touch"] or record["as_new"]))
    return {
        "flips": len(records),
        "hangs": sum(record["hang"] > 0 for record in records),
        "exact": sum(record["exact"] for record in records),
        "wrong_unflagged": sum(record["wrong_unflagged"] for record in records),
        "flagged": sum(record["flagged"] for record in records),
        "cleared": sum(record["cleared"] for record in records),
        "next_touch": sum(record["next_touch"] for record in records),
        "as_new": sum(bool(record["as_new"]) for record in records),
        "next_recording": sum(record["next_recording"] for record in records),
        "lasting": dict(sorted(lasting.items())),
        "until_written": sorted({record["register"] for record in records if not record["next_recording"]}),
    }


def undefended(model: IntegerModel, **changes: Any) -> IntegerModel:
    """The model on a design with other defences."""
    return dataclasses.replace(model, config=model.config.replace(**changes))
