"""What the benches reach: states, stalls, saturations, table halves, faults, registers, counted on the
simulated hardware.

``make coverage`` plays small configurations in which extremes are forced, compares nearly all of them bit for
bit with the golden model, and writes ``build/coverage/coverage.json`` and ``.md``: for every point of every
group the cycles in which it was seen. A point that no run reaches is a hole, and the exit status 1.
"""

import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest

from eskin.golden.core import QFormat, write_json
from eskin.golden.model import IntegerModel, network_formats
from eskin.rtl.common.layouts import frame_layout
from eskin.rtl.engine.sequencer import control_layout
from eskin.rtl.frontend.window_averager import Operation
from eskin.rtl.host.control import HostControl
from eskin.rtl.program.memory_map import Control, Fault, Measure, Memory, Register
from eskin.rtl.program.microcode import Microcode
from eskin.rtl.program.schedule import schedule
from tests.rtl.top import test_accelerator as chain
from tests.support.random_models import random_integer_model
from tests.support.stream_bench import Bench, simulate, unpack

PORTS = {
    "frames in": "i",
    "onset detector": "front_end.onset_detector.o",
    "ring": "front_end.pretrigger_ring.o",
    "window averager": "front_end.window_averager.o",
    "normaliser": "front_end.normaliser.o",
    "decisions out": "o",
}
WRITTEN = (Register.CONTROL, Register.MEASURE, Register.MEMORY_SELECT, Register.MEMORY_DATA, Register.MASK)
NARROWED = ("sigmoid index", "tanh index", "value", "logit", "feature", "state", "state index", "clip")
LOADED = ("weights", "ADDENDS", "CONSTANTS", "MEANS")
GROUPS: dict[str, list[str]] = {
    "detector": ["settling", "armed", "touch", "rearming", "touch begins"],
    "ring": ["full", "not full", "touch", "no touch"],
    "averager": [*(f"operation {one.name}" for one in Operation), "bank 0", "bank 1", "last beat of a frame"],
    "sequencer": ["primes", "waits", "goes", "repeats a word", "turns back to the step", "restarts"],
    "classifier": [
        "idle",
        "finds the largest",
        "finds the next",
        "scores are votes",
        "ends a touch",
        "finishes",
    ],
    "control": ["idle", "busy", "clear", "restart by a write", "finish", "frame open"],
    "ports": [f"{port} {what}" for port in PORTS for what in ("moves", "is held up", "is empty")],
    "saturation": [f"{what} {end}" for what in NARROWED for end in ("low", "high")],
    "tables": [
        f"{table}, {part}"
        for table in ("sigmoid", "tanh")
        for part in ("lower half", "upper half", "first entry", "last entry")
    ],
    "faults": [str(flag.name) for flag in Fault],
    "registers": [f"{register.name} {'written' if register in WRITTEN else 'read'}" for register in Register],
    "commands": [
        *(f"CONTROL {one.name}" for one in Control),
        *(f"MEASURE {one.name}" for one in Measure),
        *(f"{memory} {what}" for memory in LOADED for what in ("loaded", "refused")),
    ],
}
LOOKED_AT = (
    "i__",
    "o__",
    "bus__",
    "busy",
    "control.",
    "classifier.",
    "front_end.",
    "engine.sequencer.",
    "engine.narrowing.",
    "engine.elementwise.",
    "engine.activation.",
)
POINTS = [f"{group}: {point}" for group, points in GROUPS.items() for point in points]


class Coverage:
    """Counts points in all simulations that `chain.play` makes within `watching`."""

    def __init__(self) -> None:
        self.seen: Counter[str] = Counter()

    def watching(self, config, play: Callable[[], Any]) -> Any:
        """What ``play()`` returns, its bench watched in every cycle."""
        watch = self._watch

        class Watched(Bench):
            def __init__(self, dut, **options) -> None:
                super().__init__(dut, **options)
                watch(self._sim, dut, config)

        with mock.patch.object(chain, "Bench", Watched):
            return play()

    def _watch(self, sim, dut, config) -> None:
        named = {}
        for (
            info
        ) in sim._design.fragments.values():  # signals by their path in the design; no public way to them
            for signal, name in info.signal_names.items():
                named[".".join([*info.name, name]).removeprefix("top.dut.")] = signal
        named |= {
            f"{port}__{name}": getattr(getattr(dut, port), name)
            for port in ("i", "o")
            for name in ("valid", "ready")
        }
        named |= {f"bus__{name}": getattr(dut.bus, name) for name in ("addr", "w_data", "w_stb", "r_stb")} | {
            "busy": dut.busy
        }
        names = [name for name in named if name.startswith(LOOKED_AT) and "$" not in name]
        points = _Points(config, self.seen)

        async def monitor(ctx):
            tick = ctx.tick().sample(*(named[name] for name in names))
            while True:
                points.cycle(dict(zip(names, (await tick)[2:], strict=True)))

        sim.add_testbench(monitor, background=True)

    def holes(self) -> list[str]:
        """Points that were never seen."""
        return [point for point in POINTS if not self.seen[point]]

    def table(self) -> str:
        """Markdown: groups with their shares, holes, points with their cycles."""
        lines = ["| group | points | reached |", "| :-- | --: | --: |"]
        for group, points in GROUPS.items():
            lines.append(
                f"| {group} | {len(points)} | {sum(self.seen[f'{group}: {point}'] > 0 for point in points)} |"
            )
        lines += [
            "",
            *(f"- hole: {point}" for point in self.holes()),
            "",
            "| point | cycles |",
            "| :-- | --: |",
        ]
        return "\n".join([*lines, *(f"| {point} | {self.seen[point]} |" for point in POINTS)]) + "\n"


class _Points:
    """What a cycle's signals show."""

    def __init__(self, config, seen: Counter[str]) -> None:
        self.config, self.seen = config, seen
        self.frame = frame_layout(config)
        self.words = control_layout(Microcode(schedule(config)))
        self.before: tuple[int, int, int, int] | None = None
        self.loading = 0

    def note(self, group: str, **points: bool) -> None:
        """Count those that are true."""
        self.seen.update(
            f"{group}: {point.replace('_', ' ')}" for point, is_true in points.items() if is_true
        )

    def cycle(self, now: dict[str, int]) -> None:
        """One clock cycle."""
        self.states(now)
        self.streams(now)
        self.bus(now)
        if now["engine.sequencer.enable"]:
            self.slot(now)

    def states(self, now: dict[str, int]) -> None:
        def of(block: str, *names: str) -> tuple[int, ...]:
            return tuple(now.get(f"{block}.{name}", 0) for name in names)

        (settling,) = of("front_end.onset_detector.marks", "settle_left")
        armed, touch, begins = of(
            "front_end.onset_detector", "status__armed", "status__touch", "status__started"
        )
        self.note(
            "detector",
            settling=settling and not touch,
            armed=armed,
            touch=touch,
            rearming=not (settling or armed or touch),
            touch_begins=begins,
        )
        ready, touch = of("front_end.pretrigger_ring", "i__ready", "touch")
        if "front_end.pretrigger_ring.i__ready" in now:
            self.note("ring", full=not ready, not_full=ready, touch=touch, no_touch=not touch)
        offered, operation, bank, last = of(
            "front_end.window_averager", "i__valid", "operation", "bank", "frame_last"
        )
        if offered and "front_end.window_averager.operation" in now:
            self.seen[f"averager: operation {Operation(operation).name}"] += 1
        self.note("averager", bank_0=not bank, bank_1=bank, last_beat_of_a_frame=last)
        waiting, enable, ended, primed, count, turn, restart = of(
            "engine.sequencer", "waiting", "enable", "ended", "primed", "count", "turn", "restart"
        )
        self.note(
            "sequencer",
            primes=self.words is not None and not primed,
            waits=waiting and not enable,
            goes=waiting and enable,
            repeats_a_word=count > 0,
            turns_back_to_the_step=turn,
            restarts=ended and restart,
        )
        (others,) = of("classifier.search", "others")
        idle, voting, ended, finished = of("classifier", "idle", "voting", "ended", "finished")
        self.note(
            "classifier",
            idle=idle,
            finds_the_largest=not idle and not others,
            finds_the_next=others,
            scores_are_votes=voting,
            ends_a_touch=ended,
            finishes=finished,
        )
        (in_frame,) = of("control.cycles", "in_frame")
        clear, restart, finish = of("control", "clear", "restart", "finish")
        self.note(
            "control",
            idle=not now["busy"],
            busy=now["busy"],
            clear=clear,
            frame_open=in_frame,
            restart_by_a_write=restart and not clear,
            finish=finish,
        )

    def streams(self, now: dict[str, int]) -> None:
        for port, path in PORTS.items():
            if f"{path}__valid" in now:
                valid, ready = now[f"{path}__valid"], now[f"{path}__ready"]
                self.seen[
                    f"ports: {port} {'is empty' if not valid else 'moves' if ready else 'is held up'}"
                ] += 1
        if self.config.rest_level.clip and now["front_end.onset_detector.o__valid"]:
            deviation = ~unpack(self.frame, now["front_end.onset_detector.o__payload"])["complement"]
            self.note(
                "saturation",
                clip_low=deviation == -self.config.rest_level.clip,
                clip_high=deviation == self.config.rest_level.clip,
            )

    def bus(self, now: dict[str, int]) -> None:
        self.seen.update(f"faults: {flag.name}" for flag in Fault if now["control.faults"] & flag)
        address, word = now["bus__addr"], now["bus__w_data"]
        register = max((one for one in Register if one <= address), default=Register.ID)
        if now["bus__r_stb"] and register not in WRITTEN:
            self.seen[f"registers: {register.name} read"] += 1
        if not now["bus__w_stb"] or register not in WRITTEN:
            return
        self.seen[f"registers: {register.name} written"] += 1
        if register == Register.CONTROL:
            self.seen.update(f"commands: CONTROL {one.name}" for one in Control if word & one)
        elif register == Register.MEASURE:
            self.seen[f"commands: MEASURE {Measure(word).name}"] += 1
        elif register == Register.MEMORY_SELECT:
            self.loading = word
        elif register == Register.MEMORY_DATA:
            memory = "weights" if self.loading < self.config.hardware.lanes else Memory(self.loading).name
            self.seen[f"commands: {memory} {'loaded' if now['control.load__enable'] else 'refused'}"] += 1

    def slot(self, now: dict[str, int]) -> None:
        """A slot of the engine's program: narrowings and table entries of which a result is kept."""
        config = self.config
        word = unpack(self.words, now["engine.sequencer.word"])
        total = now["engine.narrowing.total"]
        if (
            word["gate_write"] or (word["t_write"] and not word["value"])
        ) and self.before:  # the table answers a slot later
            index, tanh, activated, earlier = self.before
            table, low, high = (
                "tanh" if tanh else "sigmoid",
                config.index_format.min_code,
                config.index_format.max_code,
            )
            self.seen[f"tables: {table}, {'lower' if index < 0 else 'upper'} half"] += 1
            self.seen[f"tables: {table}, first entry"] += index == low
            self.seen[f"tables: {table}, last entry"] += index == high
            if activated:
                self.note("saturation", state_index_low=index == low, state_index_high=index == high)
            else:
                self.narrowed(
                    f"{table} index",
                    earlier >> (config.tanh_shift if tanh else config.sigmoid_shift),
                    config.index_format,
                )
        if word["t_write"] and word["value"]:
            self.narrowed("value", total >> config.value_shift, config.formats.state_format)
        if word["logit"]:
            self.narrowed("logit", total >> config.logit_shift, config.formats.logit_format)
        if word["state_write"]:
            name, fmt = (
                ("feature", config.formats.feature_format)
                if word["feature"]
                else ("state", config.formats.state_format)
            )
            self.narrowed(name, now["engine.elementwise.acc"] >> config.formats.gate_frac, fmt)
        self.before = now["engine.activation.index"], word["tanh"], word["activated"], total

    def narrowed(self, name: str, exact: int, fmt: QFormat) -> None:
        """Did a result not fit?"""
        self.seen[f"saturation: {name} low"] += exact < fmt.min_code
        self.seen[f"saturation: {name} high"] += exact > fmt.max_code


# ---------------------------------------------------------------------- runs
def extreme(model: IntegerModel) -> IntegerModel:
    """Every array at the ends of its format: sums beyond what narrowings hold; gates open and shut, with
    candidates of both signs."""
    arrays = {name: np.array(array) for name, array in model.arrays.items()}
    for name, fmt in network_formats(model.config).items():
        rows = np.arange(arrays[name].shape[0]) // (1 + name.endswith(("_n", "_g"))) % 2 == 0
        arrays[name][rows], arrays[name][~rows] = fmt.max_code, fmt.min_code
    return replace(model, arrays=arrays)


async def _registers(host: chain.Host) -> None:
    """Every register that changes nothing, and a frame broken off: the next one's first sample comes too
    early."""
    for measure in Measure:
        await host.write(Register.MEASURE, measure)
    for register in (Register.VERSION, Register.LONGEST, Register.STATUS, Register.FAULTS):
        await host.read(register)
    await host.write(Register.MASK, 0)
    await host.write(Register.CONTROL, Control.CLEAR_FAULTS)


async def _broken_frame(host: chain.Host) -> None:
    host.ctx.set(host.dut.i.payload, {"sample": 1000, "first": 1, "last": 0})
    host.ctx.set(host.dut.i.valid, 1)
    while not (await host.ctx.tick().sample(host.dut.i.ready))[-1]:
        pass
    host.ctx.set(host.dut.i.valid, 0)


async def _writes(host: chain.Host) -> None:
    for memory in (0, Memory.ADDENDS, Memory.CONSTANTS, Memory.MEANS):
        await host.write(Register.MEMORY_SELECT, memory)
        await host.write(Register.MEMORY_DATA, 0x1234)
    await host.read(0x0F)  # a register that is not there


def collect(coverage: Coverage) -> None:
    """All runs; those with a golden counterpart are compared at every stage."""

    def exact(
        config, seed: int, *, stall: float = 0.0, forced: bool = False, during=None, lengths=(150, 60, 33)
    ) -> None:
        model = random_integer_model(config, seed=seed)
        model = extreme(model) if forced else model
        data = chain.recordings(model.config, seed, list(lengths))
        streams, _ = coverage.watching(
            model.config, lambda: chain.play(model, data, stall=stall, during=during)
        )
        chain.check(model, data, streams)

    exact(chain.CONFIGS["thesis, defended"], 11, stall=0.4, during=_registers)
    exact(chain.CONFIGS["tracked, free, masked"], 9, stall=0.4)
    exact(chain.CONFIGS["thesis"], 0, stall=0.9, lengths=(100,))
    exact(chain.CONFIGS["tracked, touch windows, LSTM"], 7, forced=True, stall=0.4)
    exact(chain.tracked(cell="lstm", state_format=QFormat(4, 12)), 7, forced=True)
    exact(chain.tracked(masked_taxels=(1,), reset="after"), 6, forced=True)
    exact(chain.small(lanes=1, logit_format=QFormat(3, 5)), 1, forced=True)

    # Without a golden counterpart: writes during a touch, a frame broken off, a wrong word in a checked
    # memory, a chain that hangs.
    config = chain.small(checksum=True, watchdog=True, rearm_frames=60)
    model = random_integer_model(config, seed=3)
    data = chain.recordings(config, 3, [100])
    data.samples[20:, 2] = 3000
    coverage.watching(model.config, lambda: chain.play(model, data, during=_writes))
    coverage.watching(model.config, lambda: chain.play(model, data, during=_broken_frame))
    right = chain.load_writes(model.config, model.arrays)
    first = next(word for register, word in right if register == Register.MEMORY_DATA)
    wrong = [*right, (Register.MEMORY_SELECT, 0), (Register.MEMORY_DATA, first ^ 1)]
    with mock.patch.object(chain, "load_writes", lambda *_: wrong):
        coverage.watching(model.config, lambda: chain.play(model, data))
    flags = hung(config)
    coverage.seen["faults: WATCHDOG"] += flags == [Fault.WATCHDOG, 0]


def hung(config) -> list[int]:
    """FAULTS after the watchdog acted, and after they were cleared: on the block of the registers, as no
    chain hangs by itself."""
    dut, flags = HostControl(config), []

    async def bench(ctx):
        host = chain.Host(dut, ctx)
        ctx.set(dut.hung, 1)
        await ctx.tick()
        ctx.set(dut.hung, 0)
        flags.append(await host.read(Register.FAULTS))
        await host.write(Register.CONTROL, Control.CLEAR_FAULTS)
        flags.append(await host.read(Register.FAULTS))

    simulate(dut, bench)
    return flags


# ---------------------------------------------------------------------- tests
@pytest.mark.slow
def test_what_is_counted_is_what_happened():
    """One ordinary run: points against the run's own streams; extremes that were not forced are holes."""
    config = chain.CONFIGS["thesis"]
    model = random_integer_model(config, seed=0)
    data = chain.recordings(config, 0, [100])
    coverage = Coverage()
    streams, statuses = coverage.watching(model.config, lambda: chain.play(model, data, stall=0.3))
    chain.check(model, data, streams)
    seen = coverage.seen
    assert seen["ports: frames in moves"] == seen["ports: onset detector moves"] == data.samples.size
    assert seen["ports: window averager moves"] == seen["ports: normaliser moves"] == len(streams["sum"])
    assert (
        seen["ports: decisions out moves"]
        == len(streams["decision"])
        > 0
        < seen["ports: decisions out is held up"]
    )
    assert seen["detector: touch begins"] == sum(status[2] for status in statuses) > 0
    assert seen["sequencer: goes"] == len(streams["sum"]) // config.sensor.taxels
    assert seen["commands: CONTROL ARM"] == seen["control: finish"] == len(data)
    # a value, two gates; and the word that stands for 0, in the prologue that is ahead of the first touch and
    # follows each
    assert sum(
        seen[f"tables: {table}, {half} half"] for table in ("sigmoid", "tanh") for half in ("lower", "upper")
    ) == (3 * len(streams["state"]) + 1 + seen["detector: touch begins"])
    assert {"saturation: value low", "faults: CHECKSUM", "registers: VERSION read"} <= set(coverage.holes())


def test_a_hang_is_flagged_until_cleared():
    assert hung(chain.small(watchdog=True)) == [Fault.WATCHDOG, 0]


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_the_benches_reach_every_point():
    coverage = Coverage()
    collect(coverage)
    assert coverage.holes() == [] and set(coverage.seen) <= set(POINTS)


def main(out: Path = Path("build/coverage")) -> int:
    """Write and print the table; exit status 1 where a hole is left."""
    coverage = Coverage()
    collect(coverage)
    out.mkdir(parents=True, exist_ok=True)
    write_json(
        out / "coverage.json",
        {"points": {point: coverage.seen[point] for point in POINTS}, "holes": coverage.holes()},
    )
    (out / "coverage.md").write_text(coverage.table())
    print(coverage.table())
    return 1 if coverage.holes() else 0


if __name__ == "__main__":
    sys.exit(main())
