"""Sources of stages: the integer model alone, with the simulated hardware, with a board, with a board's sensor, or a
stand-alone board.

Each takes frames as fast as they are given and returns the events that they cause (``eskin.live.feed``). The
model always runs, frame by frame and unthinned; what hardware says is held against it value by value.
"""

from __future__ import annotations

import contextlib
import dataclasses
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from eskin.cosim.scoreboard import (
    BUSY,
    INPUT_STALLED,
    OVERRUN,
    pack_decision,
    read_behind,
    registers_behind,
    unpack_decision,
)
from eskin.golden.core import AcceleratorConfig, InputError, Record
from eskin.golden.model import IntegerModel, Stream
from eskin.golden.model.position import PositionStream
from eskin.golden.model.prototypes import taught_in_use
from eskin.golden.model.stream import Decision
from eskin.live.feed import (
    Begin,
    Decided,
    Differs,
    Event,
    Frames,
    Hardware,
    Onset,
    Result,
    Stage,
    Step,
    Where,
)
from eskin.live.link import FRAME_NUMBERS, Link, LinkError
from eskin.live.recorder import Recorder
from eskin.rtl.program.memory_map import InterfaceRegister

if TYPE_CHECKING:  # it needs the simulators' packages, which the others do without
    from eskin.cosim.device import Accelerator

STAGES = ("sum", "fault", "feature", "state", "logit")
"""Stages of the simulated hardware with a number for each input, unit or class."""
NOTHING = np.zeros(0, dtype=np.int64)
EMPTY: Mapping[str, Stage] = {}
NO_SINCE = -1.0
"""In place of seconds since an onset that nobody saw."""


class ModelSource:
    """The integer model by itself: frames in, events out."""

    kind, stalls = "recordings", INPUT_STALLED

    def __init__(self, model: IntegerModel) -> None:
        self.stream = Stream(model)
        self.config = model.config
        self._told = 0  # touches whose beginning was told
        self._steps = 0  # of the recording
        self._positions = PositionStream(model.config) if model.config.interface.position else None

    def arm(self) -> list[Event]:
        """A new recording."""
        self.stream.arm()
        self._told = self._steps = 0
        if self._positions:
            self._positions.arm()
        return []

    def take(self, samples: np.ndarray) -> list[Event]:
        """The next frames (n, taxels)."""
        scanned = self.scanned(samples)
        decisions = self.stream.push(samples)
        return [*self.events(decisions), *self.compared(samples, scanned, decisions), *self.where(scanned)]

    def compared(
        self, samples: np.ndarray, scanned: np.ndarray, decisions: Sequence[Decision]
    ) -> list[Event]:
        """What hardware makes of frames, beside the model's decisions. ``scanned``: those that the chain takes."""
        return []

    def scanned(self, samples: np.ndarray) -> np.ndarray:
        """The frames among ``frames`` that the chain takes."""
        every = self.config.sensor.scan_every
        return samples[-self.stream.frame % every :: every]

    def where(self, samples: np.ndarray) -> list[Event]:
        """Positions of the next frames that the chain takes: of the last of them, and of those that end a touch."""
        positions = self._positions.push(samples) if self._positions else []
        shown = (position for position in positions if position.ended or position is positions[-1])
        frame_of = self.config.sensor.source_frame
        return [
            Where(frame_of(made.frame + 1), made.x, made.y, made.peak, made.ended, made.direction)
            for made in shown
        ]

    def finish(self) -> list[Event]:
        """The recording is over."""
        decisions = self.stream.finish()
        return [*self.events(decisions), *self.ended(decisions)]

    def ended(self, decisions: Sequence[Decision]) -> list[Event]:
        """What hardware has left at the end of a recording, beside the model's decisions."""
        return []

    @property
    def decision(self) -> int:
        """Decision of the recording: the global one of its first touch, -1 if none yet."""
        return self.stream.decision

    @property
    def record(self) -> Record | None:
        """What a recorder waits for and has."""
        return None

    def close(self) -> None:
        """Release its resources."""

    def events(self, decisions: Sequence[Decision]) -> list[Event]:
        """Events of the stream's decisions, with the beginnings of their touches before them."""
        events: list[Event] = []
        self._steps += sum(not decision.is_global for decision in decisions)
        for decision in decisions:
            self._begun(events, decision.touch, decision.onset_frame, decision.start_frame)
            place = decision.touch, decision.step, decision.frame
            verdict = decision.label, int(decision.margin)
            if decision.is_global:
                since = round((decision.frame - decision.onset_frame) / self.config.sensor.sample_rate_hz, 6)
                events.append(Decided(*place, *verdict, decision.partial, decision.unsure, since))
            else:
                feature, state, logit = (
                    np.asarray(decision.stages.get(name, NOTHING)) for name in ("feature", "state", "logit")
                )
                events.append(Step(*place, feature, state, logit, *verdict))
        if self.stream.onset_frame is not None:
            self._begun(
                events, self.stream.touches - 1, self.stream.onset_frame, self.stream.start_frame or 1
            )
        return events

    def _begun(self, events: list[Event], touch: int, onset: int, start: int) -> None:
        if touch >= self._told:
            events.append(Onset(touch, onset, start))
            self._told = touch + 1

    def _status(self, device: str, status: int) -> list[Event]:
        """A mismatch if register STATUS differs from the model once a piece of frames is decided."""
        return self._differing(device, {"STATUS": status & ~BUSY}, {"STATUS": self.stream.status})

    def _registers(self, device: str, map_: Mapping, got: Mapping[str, int]) -> list[Event]:
        """A mismatch for each last register of a recording that differs from the model."""
        want = registers_behind(
            self.config,
            map_,
            got,
            status=self.stream.status,
            touches=self.stream.touches,
            steps=self._steps,
            flags=self.stream.flagged,
            taught=int(taught_in_use(self.stream.model).sum()),
            may_be=self.stalls | OVERRUN * (self._steps > 2),
        )
        return self._differing(device, got, want)

    def _differing(self, device: str, got: Mapping[str, int], want: Mapping[str, int]) -> list[Event]:
        return [
            Differs(f"{device} {name} reads {got[name]} and the model expects {value}")
            for name, value in want.items()
            if got[name] != value
        ]


class SimulationSource(ModelSource):
    """The simulated RTL in lock step with the model: every value of every stage of each frame is compared."""

    kind, stalls = "simulation", 0  # a frame is given to a device that is idle

    def __init__(self, model: IntegerModel, device: Accelerator) -> None:
        super().__init__(model)
        self._device = device

    def arm(self) -> list[Event]:
        self._device.command("CLEAR_FAULTS")
        self._device.command("ARM", "EVERY")
        self._device.brought()
        return super().arm()

    def compared(
        self, samples: np.ndarray, scanned: np.ndarray, decisions: Sequence[Decision]
    ) -> list[Event]:
        events: list[Event] = []
        for number, sample in enumerate(samples, self.stream.frame - len(samples) + 1):
            completed = [decision for decision in decisions if decision.frame == number]
            events += self._compare(completed, self._device.brought(sample[None]), f"frame {number}")
        return events + self._status("register", self._device.register("STATUS"))

    def ended(self, decisions: Sequence[Decision]) -> list[Event]:
        self._device.command("FINISH")
        compared = self._compare(decisions, self._device.brought(), "the recording's end")
        map_ = self._device.map
        return compared + self._registers("register", map_, read_behind(map_, self._device.register))

    def close(self) -> None:
        self._device.close()

    def _compare(
        self, decisions: Sequence[Decision], received: dict[str, list[int]], where: str
    ) -> list[Event]:
        """One frame's values, decision by decision; values left over are a difference too."""
        queues = {stage: deque(values) for stage, values in received.items() if stage != "step"}
        compared: list[Event] = []
        for decision in decisions:
            stages = {}
            for stage in filter(decision.stages.__contains__, STAGES):
                expected, queue = np.ravel(decision.stages[stage]).tolist(), queues.get(stage)
                stages[stage] = _stage(expected, [queue.popleft() if queue else None for _ in expected])
            compared.append(_hardware(self.config, decision, queues.get("decision"), stages))
        return compared + [
            Differs(
                f"at {where} the hardware gave {len(values)} values of stage {stage} that the model "
                "does not have"
            )
            for stage, values in queues.items()
            if values
        ]


def _stage(expected: Sequence[int], values: Sequence[int | None]) -> Stage:
    pairs = enumerate(zip(expected, values, strict=True))
    return Stage(tuple(values), tuple(place for place, (aim, value) in pairs if value != aim))


def _hardware(
    config: AcceleratorConfig,
    made: Decision,
    received: deque[int] | None,
    stages: Mapping[str, Stage] = EMPTY,
) -> Hardware:
    """Beside the other stages the decision: class and margin first, so that they can be shown; then step,
    is_global, partial, unsure."""
    row = unpack_decision(config, pack_decision(config, made.row()))
    values = unpack_decision(config, received.popleft()) if received else {}
    decision = _stage([row[name] for name in SHOWN], [values.get(name) for name in SHOWN])
    return Hardware(made.touch, made.step, made.is_global, {**stages, "decision": decision})


SHOWN = ("class", "margin", "step", "is_global", "partial", "unsure")


class BoardSource(ModelSource):
    """A board on the link, given the same frames as the model; its decisions are compared, its stages are not
    on the link."""

    kind = "board"

    def __init__(self, model: IntegerModel, link: Link, port: str) -> None:
        super().__init__(model)
        self._link, self._port = link, port
        self._waiting: deque[Decision] = deque()  # the model's, without the board's beside them
        self._heard = 0

    def arm(self) -> list[Event]:
        with on_port(self._port):
            self._link.begin()
        self._waiting.clear()
        self._heard = 0
        return super().arm()

    def compared(
        self, samples: np.ndarray, scanned: np.ndarray, decisions: Sequence[Decision]
    ) -> list[Event]:
        with on_port(self._port):
            self._link.feed(scanned)
            status = self._link.settle().value
        self._waiting.extend(decisions)
        return self._compare() + self._status("the board's register", status)

    def ended(self, decisions: Sequence[Decision]) -> list[Event]:
        self._waiting.extend(decisions)
        with on_port(self._port):
            played = self._link.end()
        events = self._compare()
        if self._link.lost:
            sentence = "the line lost decisions of this recording, so its end was not compared"
            return [*events, Differs(sentence, mismatch=False)]
        missing = (_hardware(self.config, decision, None) for decision in self._waiting)
        registers = self._registers("the board's register", self._link.map, played.registers)
        return [*events, *missing, *registers]

    def _compare(self) -> list[Event]:
        compared: list[Event] = []
        while self._heard < len(self._link.decisions) and not self._link.lost:
            payload = self._link.decisions[self._heard]
            if self._waiting:
                compared.append(_hardware(self.config, self._waiting.popleft(), deque([payload])))
            else:  # the board is never ahead of the model: it got the same frames
                fields = unpack_decision(self.config, payload)
                sentence = f"the board sent a decision that the model does not have: {fields}"
                compared.append(Differs(sentence))
            self._heard += 1
        return compared


@contextlib.contextmanager
def on_port(port: str) -> Iterator[None]:
    """A LinkError in the block becomes a sentence that names the port.

    Raises
    ------
    InputError
    """
    try:
        yield
    except LinkError as error:
        raise InputError(f"--port {port}: {error}") from None


class SensorSource(ModelSource):
    """A board that sends its frames: the model takes them on this side, and a recorder keeps touches."""

    kind = "sensor"

    def __init__(self, model: IntegerModel, link: Link, port: str, recorder: Recorder) -> None:
        super().__init__(model)
        self._link, self._port, self.recorder = link, port, recorder
        self._number: int | None = None  # of the last frame
        self._since = NO_SINCE  # of the last decision

    def listen(self, timeout_s: float) -> list[Event]:
        """What the frames bring that come within ``timeout_s``."""
        with on_port(self._port):
            self._link.listen(timeout_s)
        sensor, heard = self.config.sensor, [*self._link.frames]
        self._link.frames.clear()
        if not heard:
            return []
        if {len(frame.words) for frame in heard} != {sensor.taxels}:
            raise InputError(
                f"--port {self._port}: the board's frames have {len(heard[0].words)} taxels and the model "
                f"{sensor.taxels}; use the model that its bitstream was built from"
            )
        samples = np.stack([frame.words for frame in heard])
        samples = samples.astype(np.int16 if sensor.sample_signed else np.uint16).astype(np.int32)
        numbers = np.array([frame.number for frame in heard])
        before = numbers[0] - 1 if self._number is None else self._number
        steps, self._number = np.diff(numbers, prepend=before) % FRAME_NUMBERS, int(numbers[-1])
        cuts = np.flatnonzero(steps != 1)
        events: list[Event] = []
        for gap, piece in zip([0, *(steps[cuts] - 1)], np.split(samples, cuts), strict=True):
            if gap:
                sentence = f"frames that are missing, so a new recording begins: {gap}"
                self.recorder.interrupt(sentence)
                events += [*self.arm(), Differs(sentence, mismatch=False)]
            if len(piece):
                events += self._heard(piece)
        return events

    def _heard(self, samples: np.ndarray) -> list[Event]:
        """What frames without a gap bring; behind a touch that was recorded the next recording begins."""
        first, made = self.stream.frame + 1, self.take(samples)
        events: list[Event] = [Frames(first, samples), *made]
        recorder = self.recorder
        self._since = next((event.since for event in made if isinstance(event, Decided)), self._since)
        if recorder.name and recorder.take(samples, made, self.stream):
            if not recorder.trouble:
                number = sum(recorder.archive.counts.values()) - 1
                events.append(Result(number, self._label, self.decision, self._since, 0))
            events += self.arm()
        return events

    def arm(self) -> list[Event]:
        self.recorder.begin()
        return [Begin(-1, self._label, 0, NOTHING), *super().arm()]

    @property
    def _label(self) -> int:
        """Class that is recorded, -1 if it is none of the model's."""
        names = self.config.network.class_names
        return names.index(self.recorder.name) if self.recorder.name in names else -1

    def change(self, name: str, undo: bool) -> list[Event]:
        """Record touches of this class from now on (empty: none); ``undo``: first take back the last one."""
        recorder = self.recorder
        if undo:
            recorder.archive.undo()
        if name == recorder.name:
            return []
        recorder.name, recorder.trouble = name, ""
        return self.arm()

    @property
    def record(self) -> Record:
        return self.recorder.progress(self.stream)

    def close(self) -> None:
        """The board sends no more frames; the archive is written."""
        with contextlib.suppress(LinkError):  # the board may be gone
            self._link.write([(InterfaceRegister.FRAMES, 0)])
        self.recorder.archive.close()


@dataclasses.dataclass
class Listener:
    """A board that takes its frames from its converter: its decisions as they come. No frames are on the
    link, and no model runs."""

    kind = "listening"
    record = None

    config: AcceleratorConfig
    link: Link
    port: str
    decision: int = -1
    touch: int = 0
    positions: int = 0

    def listen(self, timeout_s: float) -> list[Event]:
        """Decisions that come within ``timeout_s``."""
        with on_port(self.port):
            heard = self.link.listen(timeout_s)
            where = self._where() if self.config.interface.position else []
            # those too that came with the answers
            return [*(self._event(unpack_decision(self.config, payload)) for payload in heard), *where]

    def _where(self) -> list[Event]:
        """The latest position, where it is new and its registers belong together."""
        before = self.link.read("POSITIONS")
        place, peak = self.link.read("POSITION"), self.link.read("POSITION_PEAK")
        if before == self.positions or before != self.link.read("POSITIONS"):
            return []
        self.positions = before
        return [Where(0, place & 0xFF, place >> 8, peak & 0xFF, bool(peak >> 11 & 1), peak >> 8 & 7)]

    def close(self) -> None:
        pass

    def _event(self, fields: dict[str, int]) -> Event:
        step, margin = fields["step"], fields["margin"]
        label = min(fields["class"], self.config.classes - 1)
        if not fields["is_global"]:
            if step == 0 and self.decision >= 0:
                self.touch, self.decision = self.touch + 1, -1
            return Step(self.touch, step, 0, NOTHING, NOTHING, NOTHING, label, margin)
        self.decision = label
        flags = bool(fields["partial"]), bool(fields["unsure"])
        return Decided(self.touch, step, 0, label, margin, *flags, NO_SINCE)
