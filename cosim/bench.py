"""The cocotb bench: recorded frames go in, and every stage is compared with the golden trace as its values come.

It runs in the simulator's own Python around cosim/wrapper.sv, in a work folder with ``bench.json``, the settings
(`eskin.cosim.flow`), which name the file of vectors: the trace that the golden model computed. It leaves ``result.json``.
Any other scenario is a separate cocotb test that starts from `Bench`.
"""

import json
import logging
from collections.abc import AsyncIterator, Callable, Coroutine, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import cocotb
import numpy as np
from cocotb.queue import Queue
from cocotb.triggers import Event, FallingEdge, RisingEdge, SimTimeoutError, Timer, with_timeout

from eskin.cosim.results import Answer, Conversion
from eskin.cosim.scoreboard import (
    INPUT_STALLED,
    WRITE_REFUSED,
    Mismatch,
    Recording,
    Scoreboard,
    flat_stages,
    loading,
    read_behind,
)
from eskin.golden.core import AcceleratorConfig, write_json
from eskin.golden.core.converters import code_bits

CYCLE_NS = 10
STAGES = "sum fault feature state map logit step decision".split()
KINDS = [*STAGES, *"frame waited sent scan lost unstable unknown stuck".split()]
"""Kinds of events, as cosim/wrapper.sv numbers them."""
EVENT = np.dtype({"names": ["word", "cycle", "kind"], "formats": ["<i4", "<i8", "u1"], "offsets": [0, 4, 11]})
SLICE = 16  # events in one word of wrapper.events
WAVES_AFTER = 500  # cycles kept behind a mismatch
PROBED = 2  # frames after which an open touch is looked for again
STILL = "a standstill"
PATTERN = 1024  # cycles after which the patterns `offers` and `accepts` begin again


class Values(NamedTuple):
    """Values of one kind in the order they came: 32-bit codes with their sign, and the cycle of each."""

    codes: np.ndarray
    cycles: np.ndarray


class StageMonitor:
    """The values of one stage: ``async for codes, cycles in monitor``."""

    def __init__(self, stage: str, events: "EventReader") -> None:
        self.stage, self.log = stage, logging.getLogger(f"cocotb.monitor.{stage}")
        self._came: Queue[Values] = Queue()
        events.take[stage] = self._came.put_nowait

    async def __aiter__(self) -> AsyncIterator[Values]:
        while True:
            values = await self._came.get()
            self.log.debug("%d values by cycle %d", len(values.codes), values.cycles[-1])
            yield values


class EventReader:
    """Reads the wrapper's events whenever it wakes, and gives each kind of event to its receiver.

    Attributes
    ----------
    take: kind -> function that takes its `Values`.
    """

    def __init__(self, dut) -> None:
        self.take: dict[str, Callable[[Values], None]] = {}
        self._woken, self._count = dut.woken, dut.count
        self._slices = [dut.events[k] for k in range(len(dut.events))]

    async def run(self) -> None:
        """For ever."""
        while True:
            await self._woken.value_change
            count = self._count.value.to_unsigned()
            words = (part.value for part in self._slices[: -(-count // SLICE)])
            data = b"".join(word.to_bytes(byteorder="little") for word in words)
            rows = np.frombuffer(data, EVENT)[:count]
            for kind in sorted({*rows["kind"].tolist()}):
                of = rows[rows["kind"] == kind]
                self.take[KINDS[kind]](Values(of["word"], of["cycle"] & (1 << 56) - 1))


class HostBus:
    """The register bus, an access at a time.

    Parameters
    ----------
    registers: name -> address. commands: bits of register CONTROL by name.
    """

    def __init__(self, dut, registers: Mapping[Any, int], commands: Mapping[str, int]) -> None:
        self._dut, self._registers, self._commands = dut, registers, commands
        self.log = logging.getLogger("cocotb.driver.bus")

    async def write(self, register: str | int, word: int) -> None:
        """A 16-bit word to a register, by its name or its address."""
        self._dut.bus__w_data.value = word
        await self._access(register, self._dut.bus__w_stb)

    async def read(self, register: str, offset: int = 0) -> int:
        """The register ``offset`` addresses behind ``register``; fails on an X bit."""
        await self._access(register, self._dut.bus__r_stb, offset)
        value = self._dut.bus__r_data.value
        if not value.is_resolvable:
            raise RuntimeError(f"register {register} reads {value}")
        return value.to_unsigned()

    async def command(self, *names: str) -> None:
        """``ARM``, ``FINISH``, ``CLEAR_FAULTS``."""
        await self.write("CONTROL", sum(self._commands[name] for name in names))

    async def _access(self, register: Any, strobe: Any, offset: int = 0) -> None:
        self.log.debug("access to %s", register)
        self._dut.bus__addr.value = self._registers.get(register, register) + offset
        strobe.value = 1
        await FallingEdge(self._dut.clk)
        strobe.value = 0


class FrameSource:
    """Offers frames, a block of at most one hop at a time: while one is on its way the next waits in the wrapper.

    Parameters
    ----------
    block, bits:
        Frames of a block; bits of a number in it.
    period:
        Cycles from frame to frame; 0: whenever the hardware is ready.

    Attributes
    ----------
    frames: sent so far; sent: of this recording. overruns: of these, those with a ``period`` that were due before the
    hardware was ready. waited: cycles in which a number was offered and not taken. stalled: it was a frame's first
    one, in this recording. longest: cycles of a frame, from its first number's offer on. offered, accepted: cycles of
    the first and the last number of each frame of the recording; scans: cycles in which a converter's scans began.
    jitter: largest distance of one from the declared rate, cycles.
    """

    def __init__(self, dut, events: EventReader, *, block: int, bits: int, period: float) -> None:
        self._dut, self._block, self._type, self.period = dut, block, f"<u{bits // 8}", period
        self._free, self.jitter, self.stalled = Event(), 0.0, False
        self.log = logging.getLogger("cocotb.driver.frames")
        self.frames = self.overruns = self.waited = self.longest = self.sent = 0
        self.offered, self.accepted, self.scans = list[int](), list[int](), list[int]()
        events.take |= {"sent": lambda _: self._free.set(), "waited": self._has_waited}
        events.take |= dict.fromkeys(("frame", "lost"), self._was_taken)
        events.take["scan"] = self._has_scanned

    def begin(self, stalls: np.random.Generator | None = None) -> None:
        """A recording begins: its first frame is due now. ``stalls`` draws gaps between numbers, and cycles in which no
        decision is accepted."""
        self._due = self._dut.cycle.value.to_unsigned() + 1
        self.sent, self.stalled = 0, False
        self.offered, self.accepted, self.scans = [], [], []
        if stalls is None:
            return
        for pattern in (self._dut.offers, self._dut.accepts):
            # stretches of 64 cycles without gaps, with short gaps (twice as often) or with long ones
            shares = np.repeat(stalls.choice([1.0, 0.5, 0.5, 0.02], PATTERN // 64), 64)
            open_ = np.packbits(stalls.random(PATTERN) < shares)
            pattern.value = int.from_bytes(open_.tobytes())

    async def send(self, frames: np.ndarray) -> None:
        """Offer the recording's next frames (frames, numbers); returns when the last block is on its way."""
        dut, dues = self._dut, self._dues(self.sent, len(frames))
        for low in range(0, len(frames), self._block):
            of = slice(low, low + self._block)
            dut.block.value = int.from_bytes(frames[of].astype(self._type).tobytes(), "little")
            dut.dues.value = int.from_bytes(dues[of].astype("<u8").tobytes(), "little")
            dut.frames.value = count = len(frames[of])
            self.sent += count
            self.frames += count
            self.log.debug("frame %d of the recording is on its way", self.sent)
            self._free.clear()
            await self._free.wait()

    def untimely(self) -> int:
        """The first frame (from 2 on) that was not offered when it was due, or else when the frame before was through; 0:
        there is none."""
        right = np.maximum(self._dues(1, len(self.accepted) - 1), self.accepted[:-1]) + 1
        return int(np.append(np.flatnonzero(self.offered[1:] != right) + 2, 0)[0])

    def _dues(self, first: int, count: int) -> np.ndarray:
        return np.ceil(self._due + (first + np.arange(count)) * self.period) * (self.period > 0)

    def _has_waited(self, values: Values) -> None:
        first = int((values.codes < 0).sum())  # the top bit: it was a frame's first number
        self.overruns += bool(self.period) * first
        self.stalled |= first > 0
        self.waited += int((values.codes & 0x7FFFFFFF).sum())

    def _has_scanned(self, values: Values) -> None:
        for cycle in values.cycles.tolist():
            self.scans.append(cycle)
            due = self.scans[0] + (len(self.scans) - 1) * self.period
            self.jitter = max(self.jitter, abs(cycle - due))

    def _was_taken(self, values: Values) -> None:
        self.offered += (values.cycles - values.codes + 1).tolist()
        self.accepted += values.cycles.tolist()
        self.longest = max(self.longest, *values.codes.tolist())


class Bench:
    """Source, bus, monitors, scoreboard and budgets around one wrapper.

    ``bench.json`` holds: design (the generated folder), vectors (the file), frames (which of its arrays is sent), block,
    bits, period (as of `FrameSource`), patience (cycles without progress that are a standstill), stalls (a seed, or
    null), probes (false: the hardware has none), positions (of the recordings to play), probe (weight writes in an open
    touch), waves_from (cycle).
    """

    def __init__(self, dut) -> None:
        self.dut = dut
        self.settings: dict[str, Any] = json.loads(Path("bench.json").read_text())
        design = Path(self.settings["design"])
        self.config = AcceleratorConfig.load(design / "config.json")
        self.map, self.boot = loading(design)
        with np.load(self.settings["vectors"]) as archive:
            expected = dict(archive)
        self.recordings = [Recording(expected, position) for position in self.settings["positions"]]
        self.bus = HostBus(dut, self.map["registers"], self.map["bits"]["CONTROL"])
        self.events = EventReader(dut)
        self.source = FrameSource(
            dut, self.events, **{name: self.settings[name] for name in ("block", "bits", "period")}
        )
        self.scoreboard = Scoreboard(self.config, self.map, probes=self.settings["probes"])
        self.probed = False

    async def start(self) -> None:
        """Reset, the monitors, register ID, the model."""
        dut, events = self.dut, self.events
        self.scoreboard.begin(self.recordings[0])
        for stage in (*flat_stages(self.config), "decision", "step"):
            monitor = StageMonitor(stage, events)
            cocotb.start_soon(self._guarded(self._follow(monitor)))
        events.take |= {
            "unstable": lambda _: self._differs("handshake", "a decision changed before it was taken"),
            "unknown": self._unknown,
            "stuck": lambda _: self._differs("input", "no number was taken for the watchdog's time", STILL),
        }
        cocotb.start_soon(self._guarded(events.run()))
        for _ in range(4):
            await FallingEdge(dut.clk)
        dut.rst.value = 0
        identity = await self.bus.read("ID")
        if identity != self.map["id"]:
            raise RuntimeError(
                f"register ID reads 0x{identity:04x}, not 0x{self.map['id']:04x}: this is no accelerator"
            )
        for address, word in self.boot:
            await self.bus.write(address, word)

    async def play_recording(self, recording: Recording) -> None:
        """ARM, all frames, FINISH, and the registers on the way and at the end."""
        dut, source, settings = self.dut, self.source, self.settings
        self.scoreboard.begin(recording)
        await self.bus.command("CLEAR_FAULTS")  # before ARM, which may raise none
        await self.bus.command("ARM")
        self.scoreboard.armed = dut.cycle.value.to_unsigned()
        await self.until(dut.idle)
        await self._look("ARM")
        if "waves_from" in settings:
            cocotb.start_soon(self._dump(settings["waves_from"]))
        dut.measured.value = 1
        seed = settings["stalls"]
        source.begin(None if seed is None else np.random.default_rng([seed, recording.number]))
        frames = recording[settings["frames"]]
        while settings["probe"] and not self.probed and len(frames):
            await source.send(frames[:PROBED])
            await self.until(dut.idle)
            await self.write_weights()
            frames = frames[PROBED:]
        if (look := recording.look - source.sent) > 0:
            await source.send(frames[:look])
            await source.send(frames[look : look + settings["block"]])  # which goes on meanwhile
            await FallingEdge(dut.clk)
            await self._look("TOUCH")
            frames = frames[look + settings["block"] :]
        await source.send(frames)
        await self.until(dut.through, 2 * settings["block"] * source.period)
        timed = seed is None and not settings["probe"] and settings["frames"] == "samples"
        if timed and (late := source.untimely()):
            self._differs("input", "the frame was not offered when it was due", frame=late)
        finished = dut.cycle.value.to_unsigned()
        await self.bus.command("FINISH")
        await self._look("FINISH")
        await self.until(dut.idle)
        dut.measured.value = 0
        every = [(name, word) for name, words in self.map["behind"].items() for word in range(words)]
        words = {place: await self.bus.read(*place) for place in every}
        self.scoreboard.faults |= INPUT_STALLED * source.stalled
        self.scoreboard.end(read_behind(self.map, lambda *place: words[place]), source.accepted, finished)

    async def _look(self, after: str) -> None:
        self.scoreboard.look(after, await self.bus.read("STATUS"))

    async def write_weights(self) -> None:
        """If a touch is open, weights are written; the chain must refuse that and tell of it."""
        if not await self.bus.read("STATUS") & self.map["bits"]["STATUS"]["TOUCH"]:
            return
        await self.bus.write("MEMORY_SELECT", 0)
        for _ in range(4):
            await self.bus.write("MEMORY_DATA", 0x5A5A)
        await self.until(self.dut.idle)
        self.scoreboard.faults |= WRITE_REFUSED
        self.probed = True

    async def until(self, signal: Any, cycles: float = 0) -> None:
        """``idle`` or ``through`` (all frames that were sent are taken) is high; at most so many cycles longer than
        `patience`."""
        await FallingEdge(self.dut.clk)
        if signal.value:
            return
        limit = round(cycles) + self.settings["patience"]
        try:
            await with_timeout(RisingEdge(signal), limit * CYCLE_NS, "ns")
        except SimTimeoutError:
            self._differs("input", "it stays busy for the watchdog's time", STILL)
        await FallingEdge(self.dut.clk)

    async def _follow(self, monitor: StageMonitor) -> None:
        async for codes, cycles in monitor:
            self.scoreboard.check(monitor.stage, codes, cycles)

    async def __aenter__(self) -> None:
        pass

    async def __aexit__(self, kind: Any, error: BaseException | None, _: Any) -> None:
        """The result. After a mismatch the waveform continues for a short time."""
        if error is not None and not isinstance(error, Mismatch):
            return  # no answer: the log says why
        if error is not None and "waves_from" in self.settings:
            await Timer(WAVES_AFTER * CYCLE_NS, "ns")
            self.dut.dump.value = 0
            await FallingEdge(self.dut.clk)
        dut, source = self.dut, self.source
        answer = Answer.of(
            self.scoreboard,
            frame_max=source.longest,
            frames=source.frames,
            simulated_cycles=dut.cycle.value.to_unsigned(),
            overruns=source.overruns,
            input_stalls=source.waited,
            probe=self.probed,
        )
        if self.settings["frames"] == "codes":
            answer.conversion = Conversion(
                converter=self.config.interface.converter.name,
                code_bits=code_bits(self.config),
                jitter_cycles=round(source.jitter, 3),
                faults=dut.faults.value.to_unsigned(),
                violations=dut.violations.value.to_unsigned(),
            )
            answer.overruns = answer.conversion.faults >> 2 & 1
        write_json("result.json", answer)

    async def _guarded(self, task: Coroutine[Any, Any, None]) -> None:
        """A difference that is found beside the test ends it."""
        async with self:
            await task

    async def _dump(self, begin: int) -> None:
        await Timer((begin + 1) * CYCLE_NS, "ns")
        self.dut.dump.value = 1

    def _differs(self, stage: str, place: str, got: int | str = 1, cycle: int = -1, frame: int = 0) -> None:
        frame = frame or len(self.source.accepted) + 1
        raise self.scoreboard.mismatch(stage, 0, 0, got, cycle, place, frame)

    def _unknown(self, values: Values) -> None:
        kind, cycle = int(values.codes[0]), int(values.cycles[0])
        if kind >= len(KINDS):
            self._differs("handshake", "an X on valid, ready or busy", "x", cycle)
        self._differs(KINDS[kind], "a value with unknown bits", "x", cycle)


@cocotb.test()
async def play(dut) -> None:
    """Every recording, in order."""
    bench = Bench(dut)
    async with bench:
        await bench.start()
        for recording in bench.recordings:
            await bench.play_recording(recording)
