"""Upsets in the hardware: every outcome of a flipped flip-flop or memory bit against what the golden model
says.

A scenario is two recordings: one with two touches, in whose first touch the upset comes, and after a new
``arm`` one more. So each upset shows what it does to the touch it hits, to the next touch of the same
recording, and to the first of the next one.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from eskin.cosim import upsets as bench
from eskin.cosim.device import Design
from eskin.golden.core import AcceleratorConfig, InputError, Record
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel, find_touches, run
from eskin.rtl.fpga.generate import boot_writes, pack_decision, register_map
from eskin.rtl.fpga.upsets import Site, with_upsets
from eskin.rtl.program.memory_map import Fault
from eskin.rtl.program.microcode import Microcode
from eskin.rtl.program.schedule import schedule
from eskin.rtl.program.signature import constant_addends
from eskin.rtl.top.watchdog import bound, longest_wait
from eskin.study.stability.core import rebuilt

SLACK = 256
"""Cycles beyond the watchdog's bound before a wait counts as a hang: the bench sees idle late."""
AROUND = (-9, 3)
"""Cycles around a decision's offer at which a recording is left: `arm` falls before, into and behind it."""
FLAGS = Fault.CHECKSUM | Fault.WATCHDOG

PROGRAM, TABLES, MEANS, ZEROS = "program", "activation tables", "means", "words that stand for 0"
CHUNK = 64
"""Upsets whose records are kept together."""

Progress = Callable[[int, int], None]
Keep = Callable[[str, Callable[[], Any]], Any]


@dataclass(frozen=True)
class Scenario:
    """What is played: two recordings, the first with two touches, and the payloads of their decisions (touch
    by touch)."""

    model: IntegerModel
    recordings: Recordings
    expected: tuple[tuple[tuple[int, ...], ...], ...]


def payloads(model: IntegerModel, recordings: Recordings) -> list[tuple[tuple[int, ...], ...]]:
    """Payloads of the decisions of each recording's touches, in order."""
    trace = run(model, recordings)
    rows, offsets = trace.streams["decision"]
    packed = [pack_decision(model.config, row) for row in rows]
    by_recording = []
    for number in range(len(recordings)):
        own = packed[offsets[number] : offsets[number + 1]]
        sizes = trace.offered()[trace.touches.recording == number].sum(axis=1)
        ends = np.cumsum([0, *sizes])
        by_recording.append(tuple(tuple(own[low:high]) for low, high in pairwise(ends)))
    return by_recording


def scenario(model: IntegerModel, recordings: Recordings) -> Scenario:
    """The shortest scenario that the recordings give: the neighbourhoods of their touches, one of them twice
    in a row.

    Raises
    ------
    InputError
        No recording gives two touches in a row.
    """
    config = model.config
    touches = find_touches(config, recordings)
    lead = (
        config.rest_level.rest_frames
        + config.windows.pretrigger_frames
        + 4 * config.onset_rule.onset_mean_frames
    )
    tail = 2 * config.onset_rule.rearm_frames + config.windows.hop
    whole = [
        row for row in touches.first_touch() if row >= 0 and touches.completed[row] == config.windows.steps
    ]
    pieces = []
    for row in whole[:20]:
        number, onset = int(touches.recording[row]), int(touches.onset_frame[row])
        end = onset + config.last_frame + config.windows.hop + tail
        pieces.append((recordings.recording(number)[max(0, onset - lead) : end], number))
    single = config.opens_at_once
    for piece, number in pieces:
        twice = piece if single else np.concatenate([piece, piece])
        last_piece, last_number = pieces[-1]
        chosen = rebuilt(recordings, [twice, last_piece], [number, last_number])
        expected = payloads(model, chosen)
        full = config.windows.steps + 1
        if (
            len(expected[0]) >= (1 if single else 2)
            and expected[1]
            and all(len(touch) == full for touch in expected[0][:2])
        ):
            return Scenario(model, chosen, tuple(expected))
    raise InputError(
        f"{recordings.source}: no recording has a whole touch that can be played twice; give recordings "
        "with whole touches"
    )


def hang_limit(config: AcceleratorConfig) -> int:
    """Cycles after which a wait is a hang, whether the design has a watchdog or not: what still works behind a
    block that stands ends its steps first, as a whole chain would; the watchdog counts from the last of them."""
    watched = config.replace(watchdog=True, checksum=True)
    return longest_wait(watched) + bound(watched) + SLACK


@dataclass(frozen=True)
class Campaign:
    """A design with upset inputs, ready to play a scenario."""

    scenario: Scenario
    sites: list[Site]
    played: bench.Played

    @classmethod
    def build(cls, scenario: Scenario, builds: Path) -> Campaign:
        """Generate and compile."""
        model, config = scenario.model, scenario.model.config
        text, sites = with_upsets(config, model.arrays)
        played = bench.Played(
            Design(text, builds, bench.PURPOSE),
            register_map(config),
            boot_writes(config, model.arrays),
            [scenario.recordings.recording(number) for number in range(len(scenario.recordings))],
            config.sensor.sample_bits,
            hang_limit(config),
        )
        return cls(scenario, sites, played)

    def play(
        self, upsets: Sequence[tuple[int, ...]], progress: Progress | None = None, *, stop: bool = False
    ) -> list[Record]:
        """Raw results; ``stop``: up to the first global decision after the upset."""
        return self.played.runs(upsets, stop=stop, progress=progress)

    def clean(self) -> Record:
        """The run without an upset.

        Raises
        ------
        RuntimeError
            It is not what the golden model says.
        """
        (result,) = self.play([bench.NONE])
        for recording, expected in zip(result["recordings"], self.scenario.expected, strict=True):
            got = tuple(event[0] for event in recording["decisions"])
            if (
                got != tuple(value for touch in expected for value in touch)
                or recording["faults"] & FLAGS
                or recording["hang"]
            ):
                raise RuntimeError("without an upset the hardware does not do what the golden model does")
        return result

    # ------------------------------------------------------------------ flip-flops
    def flip_flops(self) -> list[Site]:
        """Registers, memories' output registers among them; not the watchdog's own, nor what the bus reads
        last."""
        return [site for site in self.sites if not site.words and site.block != "watchdog"]

    def choose(self, count: int, seed: int, clean: Record) -> list[tuple[Site, int, int]]:
        """(register, bit, cycle): every flip-flop bit equally often (at least once each where ``count``
        allows), blocks in turn; cycles of the first touch and before it."""
        rng = np.random.default_rng(seed)
        bits = [(site, bit) for site in self.flip_flops() for bit in range(site.width)]
        rounds = -(-count // len(bits))
        order = [bits[i] for _ in range(rounds) for i in rng.permutation(len(bits))][:count]
        first = clean["recordings"][0]["decisions"][len(self.scenario.expected[0][0]) - 1][2]
        return [(site, bit, int(rng.integers(0, first))) for site, bit in order]

    def judge(self, result: Record) -> Record:
        """What an upset did: hang, and whether the decisions of each touch are those of the golden model."""
        first, then = result["recordings"]
        touches = self.scenario.expected[0]
        got = tuple(event[0] for event in first["decisions"])
        flagged = [event for event in first["decisions"] if event[1] & FLAGS]
        hit, following = touches[0], [value for touch in touches[1:] for value in touch]
        recovered = got[len(got) - len(following) :] == tuple(following) if following else True
        restarted = None
        if not recovered and first["cleared"]:
            restarted = self._as_new(first)
        globals_ = [event for event in first["decisions"] if event[0] >> 29 & 1]
        silent = bool(globals_) and not globals_[0][1] & FLAGS and (globals_[0][0] & 31) != (hit[-1] & 31)
        return {
            "hang": max(first["hang"], then["hang"]),
            "exact": got[: len(hit)] == hit,
            "wrong_unflagged": silent,
            "flagged": bool(flagged) or bool((first["faults"] | then["faults"]) & FLAGS),
            "cleared": bool(first["cleared"]),
            "next_touch": recovered,
            "as_new": restarted,
            "next_recording": self.next_recording_exact(result),
        }

    def next_recording_exact(self, result: Record) -> bool:
        """Are the decisions of the second recording those of the golden model?"""
        following = result["recordings"][1]
        return not following["hang"] and [event[0] for event in following["decisions"]] == [
            v for touch in self.scenario.expected[1] for v in touch
        ]

    def _as_new(self, recording: Record) -> bool:
        """After the watchdog acted: is the rest of the recording decided as a recording by itself is?"""
        frames, taxels, cycle = recording["cleared"][-1]
        stream = self.scenario.recordings.recording(0)
        begin = frames + (taxels > 0)
        expected: tuple[int, ...] = ()
        if begin < len(stream):
            remainder = rebuilt(self.scenario.recordings, [stream[begin:]], [0])
            expected = tuple(
                value for touch in payloads(self.scenario.model, remainder)[0] for value in touch
            )
        return tuple(event[0] for event in recording["decisions"] if event[2] > cycle) == expected

    # ------------------------------------------------------------------ memories and configuration registers
    def constants(self) -> dict[str, list[tuple[int, int, int, int]]]:
        """What must not change, by kind: (register, memory, word, bit) of every bit."""
        config = self.scenario.model.config
        code = Microcode(schedule(config))
        place, addends = code.layout, sorted(constant_addends(code))
        gates = [word["gate"] for word in code.unrolled() if word["gate"] < place.constants]
        coefficients = (
            "scales, one, zero, check words",
            [place.constants + index for index in place.used_constants],
        )
        biases = ("biases", addends)
        words: dict[str, tuple[str, Sequence[int] | None]] = {
            **dict.fromkeys((f"engine.addends.{part}" for part in ("low", "middle", "high")), biases),
            **dict.fromkeys((f"engine.coefficients.{part}" for part in ("both", "constants")), coefficients),
            "engine.state_memory": (ZEROS, [place.state_zero]),
            "engine.t_memory": (ZEROS, [place.t_zero]),
            "engine.windows": (ZEROS, [place.window_none]),
            **dict.fromkeys(("engine.activation.table", "engine.narrowing.activation.table"), (TABLES, None)),
            "engine.sequencer.program": (PROGRAM, None),
            "front_end.normaliser.means": (MEANS, None),
            **{f"engine.weights_{lane}": ("weights", None) for lane in range(config.hardware.lanes)},
        }
        bits_of: defaultdict[str, list[tuple[int, int, int, int]]] = defaultdict(list)

        def add(kind: str, site: Site, numbers: Iterable[int]) -> None:
            bits_of[kind] += [(0, site.number, word, bit) for word in numbers for bit in range(site.width)]

        for site in self.sites:
            if site.name == "engine.coefficients.constants":  # 0 where gates are read
                add(ZEROS, site, sorted(set(gates)))
            if site.words and site.name in words:
                kind, numbers = words[site.name]
                add(kind, site, range(site.words) if numbers is None else numbers)
            elif site.name.startswith(("control.mask", "control.measure")) and not site.name.endswith(
                "_parity"
            ):
                bits_of["configuration registers"] += [(site.number, 0, 0, bit) for bit in range(site.width)]
        return bits_of

    def choose_constants(self, count: int, seed: int, clean: Record) -> list[tuple[str, tuple[int, ...]]]:
        """(kind, upset): ``count`` bits, kinds in turn until all of theirs are taken, at random cycles from
        ``arm`` to three steps before the end of the first touch: what is flipped later has been read for the
        last time. Means and tables: so long before the first step that they are walked through once more; at
        full pace, unlike the sensor's, few cycles are idle from then on, and windows run ahead of their
        steps."""
        rng = np.random.default_rng(seed)
        steps, events = self.scenario.model.config.windows.steps, clean["recordings"][0]["decisions"]
        last = events[max(steps - 3, 0)][2]
        config = self.scenario.model.config
        early = max(1, events[0][2] - 4 * config.formats.table_entries - 2 * schedule(config).step_cycles)
        waiting = {
            kind: [bits[i] for i in rng.permutation(len(bits))] for kind, bits in self.constants().items()
        }
        chosen: list[tuple[str, tuple[int, ...]]] = []
        while len(chosen) < count and any(waiting.values()):
            for kind, bits in waiting.items():
                if bits and len(chosen) < count:
                    cycle = rng.integers(0, early if kind in (TABLES, MEANS) else last)
                    chosen.append((kind, (*bits.pop(), 0, int(cycle))))
        return chosen

    def judge_constant(self, kind: str, upset: tuple[int, ...], result: Record) -> bool:
        """Is CHECKSUM set when the first global decision after the upset is offered (where the upset keeps it
        from coming: at the end)?

        A word that stands for 0 and was flipped before the prologue wrote it anew is right again: no flag,
        and no decision differs. The program's idle words and prologue run once a touch, in front of it: a
        word of theirs that is flipped later bears on the next touch and must be flagged before that one
        begins.
        """
        recording = result["recordings"][0]
        code = Microcode(schedule(self.scenario.model.config))
        if kind == PROGRAM and upset[2] < code.idle_words + code.again_word:
            return bool(recording["faults"] & Fault.CHECKSUM)
        after = [event for event in recording["decisions"] if event[0] >> 29 & 1 and event[2] > upset[-1]]
        flagged = bool((after[0][1] if after else recording["faults"]) & Fault.CHECKSUM)
        if kind == ZEROS and not flagged:
            played = [event[0] for event in recording["decisions"]]  # up to where the run was stopped
            return (
                bool(after)
                and played == [value for touch in self.scenario.expected[0] for value in touch][: len(played)]
            )
        return flagged


def _records(
    campaign: Campaign,
    title: str,
    chosen: Sequence[tuple[Record, tuple[int, ...]]],
    judge: Callable[[Record, Record], Record],
    keep: Keep | None,
    progress: Progress | None,
    *,
    stop: bool = False,
) -> list[Record]:
    """The record of each upset, completed by ``judge`` (record, result). CHUNK of them are kept at a time, so
    that an interrupted campaign goes on where it stopped."""
    records: list[Record] = []
    for start in range(0, len(chosen), CHUNK):
        piece = chosen[start : start + CHUNK]

        def make(piece=piece, start=start) -> list[Record]:
            report = (lambda done, _: progress(start + done, len(chosen))) if progress else None
            results = campaign.play([upset for _, upset in piece], report, stop=stop)
            return [
                record | judge(record, result) for (record, _), result in zip(piece, results, strict=True)
            ]

        records += keep(f"{title} {start} of {len(chosen)}", make) if keep else make()
        if progress:
            progress(len(records), len(chosen))
    return records


def upset_flip_flops(
    campaign: Campaign, count: int, seed: int, *, keep: Keep | None = None, progress: Progress | None = None
) -> list[dict]:
    """``count`` single upsets of flip-flops: {register, bit, cycle, and what `Campaign.judge` says} each.

    Parameters
    ----------
    keep:
        (name, make) -> records: hands back earlier records, or makes and keeps them.
    """
    sites = campaign.choose(count, seed, campaign.clean())
    chosen = [
        ({"register": site.name, "bit": bit, "cycle": at}, (site.number, 0, 0, bit, 0, at))
        for site, bit, at in sites
    ]
    return _records(
        campaign, f"flip-flops, seed {seed}", chosen, lambda _, result: campaign.judge(result), keep, progress
    )


def upset_constants(
    campaign: Campaign, count: int, seed: int, *, keep: Keep | None = None, progress: Progress | None = None
) -> list[dict]:
    """``count`` single upsets of constants and configuration registers: {kind, upset, flagged} each."""
    chosen = [
        ({"kind": kind, "upset": list(upset)}, upset)
        for kind, upset in campaign.choose_constants(count, seed, campaign.clean())
    ]

    def judge(record: Record, result: Record) -> Record:
        return {"flagged": campaign.judge_constant(record["kind"], record["upset"], result)}

    return _records(campaign, f"constants, seed {seed}", chosen, judge, keep, progress, stop=True)


def leave_recordings(
    campaign: Campaign,
    count: int,
    seed: int,
    *,
    ways: Sequence[int] = (bench.RESET, bench.ARM_AGAIN),
    keep: Keep | None = None,
    progress: Progress | None = None,
) -> list[dict]:
    """Leave the first recording at ``count`` random cycles, in each of ``ways`` in turn, and in each way at
    every cycle around its first global decision and the local one before it: {way, cycle, differs} of the
    next recording's touches."""
    rng = np.random.default_rng(seed)
    first = campaign.clean()["recordings"][0]
    leavings = [
        (ways[number % len(ways)], int(cycle))
        for number, cycle in enumerate(rng.integers(0, first["cycles"], count))
    ]
    last = next(number for number, event in enumerate(first["decisions"]) if event[0] >> 29 & 1)
    offered = [event[2] for event in first["decisions"][max(last - 1, 0) : last + 1]]
    near = sorted({cycle for at in offered for cycle in range(max(at + AROUND[0], 0), at + AROUND[1])})
    leavings += [(way, cycle) for cycle in near for way in ways]
    chosen = [({"way": way, "cycle": cycle}, (way, 0, 0, 0, 0, cycle)) for way, cycle in leavings]

    def judge(_: Record, result: Record) -> Record:
        return {"differs": not campaign.next_recording_exact(result)}

    return _records(campaign, f"resets, seed {seed}, {ways}", chosen, judge, keep, progress)


def summary(records: Sequence[Record]) -> Record:
    """Counts of a flip-flop campaign's records."""
    lasting = Counter(
        record["register"] for record in records if not (record["next_touch"] or record["as_new"])
    )
    counted = "exact wrong_unflagged flagged cleared next_touch as_new next_recording".split()
    return {
        "flips": len(records),
        "hangs": sum(record["hang"] > 0 for record in records),
        **{name: sum(bool(record[name]) for record in records) for name in counted},
        "lasting": dict(sorted(lasting.items())),
        "until_written": sorted({record["register"] for record in records if not record["next_recording"]}),
    }


def in_words(counts: Record) -> str:
    """A flip-flop campaign in a sentence."""
    flips = counts["flips"]
    return (
        f"{flips} upsets: {counts['exact']} leave the touch they hit as it was, {counts['cleared']} make "
        "the watchdog act, "
        f"{counts['wrong_unflagged']} give another class without a flag; the next touch of the recording is "
        "bit-exact after "
        f"{counts['next_touch']}, decided as a new recording's after {counts['as_new']}; the next recording "
        "is bit-exact after "
        f"{counts['next_recording']}, the others: {', '.join(counts['until_written']) or 'none'}"
    )


def flagged_by_kind(records: Sequence[Record]) -> dict[str, tuple[int, int]]:
    """(flips, flagged) of a campaign over constants, by kind."""
    flips = Counter(record["kind"] for record in records)
    flagged = Counter(record["kind"] for record in records if record["flagged"])
    return {kind: (count, flagged[kind]) for kind, count in flips.items()}
