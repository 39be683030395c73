"""Where stages come from: the integer model alone, the simulated hardware beside it, a board beside it, or a
board that works by itself.

Each takes frames as fast as they are given and tells what they brought (``eskin.live.feed``). The model
always runs, frame by frame and unthinned; what hardware says is held against it value by value.
"""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from eskin.cosim.link import Link, LinkError
from eskin.cosim.scoreboard import DECISION_FIELDS, UNEXPECTED_FAULTS
from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.errors import InputError
from eskin.golden.model.image_stream import ImageStream
from eskin.golden.model.model import IntegerModel
from eskin.golden.model.position import Position, PositionStream
from eskin.golden.model.stream import Decision, Stream
from eskin.live.feed import Decided, Differs, Event, Hardware, Onset, Stage, Step, Where

STAGES = ("sum", "fault", "feature", "state", "map", "logit")
"""Stages of the simulated hardware with a number for each input, unit, value of a map or class."""
NOTHING = np.zeros(0, dtype=np.int64)
NO_SINCE = -1.0
"""In place of seconds since an onset that nobody saw."""


class Source(Protocol):
    """Frames in, events out."""

    kind: str

    def arm(self) -> list[Event]:
        """A new recording."""

    def take(self, samples: np.ndarray) -> list[Event]:
        """The next frames (n, taxels)."""

    def finish(self) -> list[Event]:
        """The recording is over."""

    @property
    def decision(self) -> int:
        """Of the recording: the global decision of its first touch, -1 none yet."""

    def close(self) -> None:
        """Give back what it holds."""


class ModelSource:
    """The integer model by itself."""

    kind = "recordings"

    def __init__(self, model: IntegerModel) -> None:
        self.stream: Stream | ImageStream = ImageStream(model) if model.config.is_image else Stream(model)
        self.config = model.config
        self._told = 0  # touches whose beginning was told
        self._positions = PositionStream(model.config) if model.config.interface.position else None

    def arm(self) -> list[Event]:
        self.stream.arm()
        self._told = 0
        if self._positions:
            self._positions.arm()
        return []

    def take(self, samples: np.ndarray) -> list[Event]:
        return [*self.events(self.stream.push(samples)), *self.where(samples)]

    def where(self, samples: np.ndarray) -> list[Event]:
        """Positions of the next frames: of the last of them, and of those that end a touch."""
        told = self._positions.push(samples) if self._positions else []
        return [_where(made) for made in told if made.ended or made is told[-1]]

    def finish(self) -> list[Event]:
        return self.events(self.stream.finish())

    @property
    def decision(self) -> int:
        return self.stream.decision

    def close(self) -> None:
        pass

    def events(self, decisions: Sequence[Decision]) -> list[Event]:
        """What the stream's decisions mean, with the beginnings of their touches before them."""
        found: list[Event] = []
        for made in decisions:
            self._begun(found, made.touch, made.onset_frame, made.start_frame)
            if made.is_global:
                since = (made.frame - made.onset_frame) / self.config.sensor.sample_rate_hz
                found.append(
                    Decided(
                        made.touch,
                        made.step,
                        made.frame,
                        made.label,
                        int(made.margin),
                        made.partial,
                        made.unsure,
                        since,
                    )
                )
            else:
                feature, state, logit = (
                    np.asarray(made.stages.get(name, NOTHING)) for name in ("feature", "state", "logit")
                )
                found.append(
                    Step(
                        made.touch, made.step, made.frame, feature, state, logit, made.label, int(made.margin)
                    )
                )
        if self.stream.onset_frame is not None:
            self._begun(found, self.stream.touches - 1, self.stream.onset_frame, self.stream.start_frame or 1)
        return found

    def _begun(self, found: list[Event], touch: int, onset: int, start: int) -> None:
        if touch >= self._told:
            found.append(Onset(touch, onset, start))
            self._told = touch + 1


def _where(made: Position) -> Where:
    return Where(made.frame + 1, made.x, made.y, made.peak, made.ended, made.direction)


class Simulator(Protocol):
    """As eskin.cosim.live.LiveSimulator."""

    def arm(self) -> None: ...
    def take(self, samples: np.ndarray) -> list: ...
    def finish(self): ...
    def read(self, register: str) -> int: ...
    def close(self) -> None: ...


class SimulationSource(ModelSource):
    """The simulated RTL in lock step with the model: every value of every stage of each frame is compared."""

    kind = "simulation"

    def __init__(self, model: IntegerModel, simulator: Simulator) -> None:
        super().__init__(model)
        self._simulator = simulator
        self.cycles_max = 0

    def arm(self) -> list[Event]:
        self._simulator.arm()
        return super().arm()

    def take(self, samples: np.ndarray) -> list[Event]:
        first = self.stream.frame + 1
        decisions = self.stream.push(samples)
        brought = self._simulator.take(samples)
        self.cycles_max = max([self.cycles_max, *(frame.cycles for frame in brought)])
        by_frame: dict[int, list[Decision]] = {}
        for made in decisions:
            by_frame.setdefault(made.frame, []).append(made)
        compared: list[Event] = []
        for frame, came in enumerate(brought, first):
            compared += self._compare(by_frame.get(frame, []), came.stages, f"frame {frame}")
        return [*self.events(decisions), *self.where(samples), *compared]

    def finish(self) -> list[Event]:
        decisions = self.stream.finish()
        compared = self._compare(decisions, self._simulator.finish().stages, "the recording's end")
        touches, faults = self._simulator.read("TOUCHES"), self._simulator.read("FAULTS")
        if touches != self.stream.touches % 256:
            compared.append(
                Differs(f"register TOUCHES reads {touches} and the model saw {self.stream.touches}")
            )
        if faults & UNEXPECTED_FAULTS:
            compared.append(
                Differs(
                    f"register FAULTS reads 0x{faults:04x}: the chain saw a fault that no recording may raise"
                )
            )
        return [*self.events(decisions), *compared]

    def close(self) -> None:
        self._simulator.close()

    def _compare(self, decisions: Sequence[Decision], came: dict[str, list[int]], where: str) -> list[Event]:
        """One frame's values, decision by decision; what is left over is a difference too."""
        left = {stage: deque(values) for stage, values in came.items() if stage != "step_cycles"}
        found: list[Event] = []
        for made in decisions:
            stages = {
                stage: _stage(made.stages[stage], left.get(stage)) for stage in STAGES if stage in made.stages
            }
            stages["decision"] = _decision_stage(made, left.get("decision"))
            found.append(Hardware(made.touch, made.step, made.is_global, stages))
        for stage, values in left.items():
            if values:
                found.append(
                    Differs(
                        f"at {where} the hardware gave {len(values)} values of stage {stage} that the model "
                        "does not have"
                    )
                )
        return found


def _stage(expected: np.ndarray, came: deque[int] | None) -> Stage:
    values = tuple(came.popleft() if came else None for _ in range(np.size(expected)))
    wrong = tuple(
        place
        for place, (aim, value) in enumerate(zip(np.asarray(expected).tolist(), values, strict=True))
        if value != aim
    )
    return Stage(values, wrong)


def _decision_stage(made: Decision, came: deque[int] | None) -> Stage:
    """Class and margin first, so that they can be shown; then step, is_global, partial, unsure."""
    if not came:
        return Stage((None,) * len(SHOWN), tuple(range(len(SHOWN))))
    payload, row = came.popleft(), dict(zip(DECISION_FIELDS, made.row(), strict=True))
    values = decoded(payload)
    return Stage(
        tuple(values[name] for name in SHOWN),
        tuple(place for place, name in enumerate(SHOWN) if values[name] != row[name]),
    )


SHOWN = ("class", "margin", "step", "is_global", "partial", "unsure")


def decoded(payload: int) -> dict[str, int]:
    """The fields of a decision's 32 bits."""
    return {name: payload >> low & (1 << width) - 1 for name, (low, width) in DECISION_FIELDS.items()}


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
        with self._named():
            self._link.begin()
        self._waiting.clear()
        self._heard = 0
        return super().arm()

    def take(self, samples: np.ndarray) -> list[Event]:
        with self._named():
            self._link.feed(samples)
        decisions = self.stream.push(samples)
        self._waiting.extend(decisions)
        return [
            *self.events(decisions),
            *self._compare(),
            *self._held_against_the_boards(self.where(samples)),
        ]

    def _held_against_the_boards(self, told: list[Event]) -> list[Event]:
        """The board's registers of position against the model's last position."""
        last = told[-1] if told else None
        if not isinstance(last, Where):
            return told
        with self._named():
            position, peak = self._link.read("POSITION"), self._link.read("POSITION_PEAK")
        wrong = (position, peak) != (last.x | last.y << 8, last.peak | last.direction << 8 | last.ended << 11)
        said = f"frame {last.frame}: the board says {position:#06x}, {peak:#06x}; the model x {last.x}, y {last.y}, peak {last.peak}"
        return [*told[:-1], dataclasses.replace(last, wrong=wrong), *[Differs(said)] * wrong]

    def finish(self) -> list[Event]:
        decisions = self.stream.finish()
        self._waiting.extend(decisions)
        with self._named():
            played = self._link.end()
        found = [*self.events(decisions), *self._compare()]
        if self._link.lost:
            found.append(
                Differs(
                    "decisions of this recording got lost on the line, so it was not compared to its end",
                    mismatch=False,
                )
            )
            return found
        for made in self._waiting:
            found.append(
                Hardware(made.touch, made.step, made.is_global, {"decision": _decision_stage(made, None)})
            )
        if played.touches != self.stream.touches % 256:
            found.append(
                Differs(
                    f"the board's register TOUCHES reads {played.touches} and the model saw "
                    f"{self.stream.touches}"
                )
            )
        if played.faults & UNEXPECTED_FAULTS:
            found.append(Differs(f"the board's register FAULTS reads 0x{played.faults:04x}"))
        return found

    def _compare(self) -> list[Event]:
        found: list[Event] = []
        while self._heard < len(self._link.decisions) and not self._link.lost:
            payload = self._link.decisions[self._heard]
            if not self._waiting:  # the board is never ahead of the model: it got the same frames
                found.append(
                    Differs(f"the board gave a decision that the model does not have: {decoded(payload)}")
                )
            else:
                made = self._waiting.popleft()
                found.append(
                    Hardware(
                        made.touch,
                        made.step,
                        made.is_global,
                        {"decision": _decision_stage(made, deque([payload]))},
                    )
                )
            self._heard += 1
        return found

    def _named(self) -> _Named:
        return _Named(self._port)


class _Named:
    """``with _Named(port):`` a LinkError becomes the one sentence that names the port."""

    def __init__(self, port: str) -> None:
        self._port = port

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: type | None, error: BaseException | None, trace: object) -> None:
        if isinstance(error, LinkError):
            raise InputError(f"--port {self._port}: {error}") from None


class Listener:
    """A board that takes its frames from its own converter: its decisions as they come. No frames are on the
    link, and no model runs."""

    kind = "listening"

    def __init__(self, config: AcceleratorConfig, link: Link, port: str) -> None:
        self.config, self._link, self._port = config, link, port
        self._touch = self._positions = 0
        self.decision = -1

    def listen(self, timeout_s: float) -> list[Event]:
        """Decisions that come within ``timeout_s``."""
        with _Named(self._port):
            heard = self._link.listen(timeout_s)
            where = self._where() if self.config.interface.position else []
            # those too that came with the answers
            return [*(self._event(decoded(payload)) for payload in heard), *where]

    def _where(self) -> list[Event]:
        """The latest position, where it is new and its registers belong together."""
        before = self._link.read("POSITIONS")
        place, peak = self._link.read("POSITION"), self._link.read("POSITION_PEAK")
        if before == self._positions or before != self._link.read("POSITIONS"):
            return []
        self._positions = before
        return [Where(0, place & 0xFF, place >> 8, peak & 0xFF, bool(peak >> 11 & 1), peak >> 8 & 7)]

    def close(self) -> None:
        pass

    def _event(self, fields: dict[str, int]) -> Event:
        none = np.zeros(0, dtype=np.int64)
        label, margin = min(fields["class"], self.config.classes - 1), fields["margin"]
        if not fields["is_global"]:
            if fields["step"] == 0 and self.decision >= 0:
                self._touch, self.decision = self._touch + 1, -1
            return Step(self._touch, fields["step"], 0, none, none, none, label, margin)
        self.decision = label
        return Decided(
            self._touch,
            fields["step"],
            0,
            label,
            margin,
            bool(fields["partial"]),
            bool(fields["unsure"]),
            NO_SINCE,
        )
