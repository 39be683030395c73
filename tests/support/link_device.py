"""A board in Python behind a pseudo-terminal: docs/specification_interfaces.md section 9, with the golden model for an
accelerator."""

from __future__ import annotations

import os
import pty
import select
import threading
import time
import tty
from collections.abc import Callable

import numpy as np

from eskin.golden.core import AcceleratorConfig
from eskin.golden.data import Recordings
from eskin.golden.model.preprocess import TouchFinder
from eskin.live import link
from eskin.rtl.program.memory_map import (
    ID_VALUE,
    VERSION_VALUE,
    Control,
    Fault,
    InterfaceRegister,
    Register,
    Status,
)
from eskin.rtl.program.schedule import longest_step
from tests.support.link_flow import pack_decisions


class Device:
    """``with Device(config, decide) as device:`` answers on ``device.port``.

    Parameters
    ----------
    decide:
        (frames, taxels) codes of a recording -> its decision rows and the touches begun.
    registers:
        Values instead of the usual ones.
    loses:
        Called with the running number of every packet, from (True) or to (False) the device: whether it gets
        lost.
    frames_limit:
        Frames after which the port goes away.
    """

    def __init__(
        self,
        config: AcceleratorConfig,
        decide: Callable[[np.ndarray], tuple[np.ndarray, int]],
        *,
        registers: dict[int, int] | None = None,
        loses: Callable[[int, bool], bool] = lambda number, sent: False,
        frames_limit: int | None = None,
        deaf: bool = False,
    ) -> None:
        self.config, self.decide, self.loses, self.limit, self.deaf = (
            config,
            decide,
            loses,
            frames_limit,
            deaf,
        )
        self.given = registers or {}
        self.registers = {Register.ID: ID_VALUE, Register.VERSION: VERSION_VALUE}
        self.writes: list[tuple[int, int]] = []
        self._arm()
        self.accepted = self.expected = self.decisions = 0
        self.packets = {True: 0, False: 0}
        self.decision_packets: list[int] = []  # their numbers among those sent
        self.error: BaseException | None = None

    def __enter__(self) -> Device:
        self.master, self.slave = pty.openpty()
        tty.setraw(self.slave)
        self.port = os.ttyname(self.slave)
        self.stop_read, self.stop_write = os.pipe()
        self.thread = threading.Thread(target=self._guarded)
        self.thread.start()
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        os.write(self.stop_write, b"x")
        self.thread.join(20)
        for handle in {self.master, self.slave, self.stop_read, self.stop_write} - {-1}:
            os.close(handle)
        if self.error and not error:
            raise self.error

    def _guarded(self) -> None:
        try:
            self._serve()
        except BaseException as error:
            self.error = error

    def _serve(self) -> None:
        unpacker = link.Unpacker()
        while True:
            ready, _, _ = select.select([self.master, self.stop_read], [], [])
            if self.stop_read in ready:
                return
            for body in unpacker.feed(os.read(self.master, 4096)):
                self.packets[False] += 1
                if not self.deaf and not self.loses(self.packets[False], False):
                    self._act(body)
                if self.limit is not None and self.accepted >= self.limit:
                    os.close(self.slave)
                    os.close(self.master)
                    self.master = self.slave = -1
                    return

    def _act(self, body: bytes) -> None:
        number, command, words = body[0], body[1], np.frombuffer(body[2:], dtype="<u2")
        if command & link.READ:
            address = command & 0x3F
            if address == Register.STATUS:
                self.registers[address] = self._status()
            word = (self.registers | self.given).get(address, 0)
            self._send(word | self.expected << 16 | address << 24)
        elif number == self.expected and len(words) == (
            self.config.sensor.taxels if command & link.FRAME else 1
        ):
            self.expected = self.expected + 1 & 0xFF
            if command & link.FRAME:
                self.frames.append(words)
                self.accepted += 1
                if not self.config.is_image:
                    for _, onset, start in self.finder.push(self._samples()[-1:, None])[1]:
                        self.begun, self.until = True, max(start - 1 + self.config.last_frame, onset)
            else:
                self._write(command, int(words[0]))

    def _write(self, address: int, word: int) -> None:
        self.writes.append((address, word))
        if address == Register.CONTROL and word & Control.ARM:
            self._arm()
        if address == Register.CONTROL and word & Control.FINISH:
            rows, touches = self.decide(self._samples())
            self.until = 0
            flagged = self.finder.flagged.ravel() if self.config.faults.fault_frames else ()
            flags = sum(1 << taxel for taxel in np.flatnonzero(flagged).tolist())  # of 16 at most
            self.registers |= {Register.TAXEL_FAULTS: flags, Register.FAULTS: Fault.TAXEL * (flags > 0)}
            self.registers[Register.TOUCHES] = touches
            self.registers[Register.LONGEST] = longest_step(self.config) * bool(len(rows))
            for payload in pack_decisions(self.config, rows):
                self.decision_packets.append(self.packets[True] + 1)
                self._send(payload | link.DECISION, payload >> 31 << 7)
                self.decisions = (self.decisions + 1) % link.NUMBERS

    def _arm(self) -> None:
        self.frames: list[np.ndarray] = []
        self.finder, self.begun, self.until = TouchFinder(self.config), False, 0

    def _samples(self) -> np.ndarray:
        samples = np.array(self.frames, dtype=np.int32).reshape(-1, self.config.sensor.taxels)
        return samples.astype(np.int16).astype(np.int32) if self.config.sensor.sample_signed else samples

    def _status(self) -> int:
        if self.config.is_image:
            begun, open_ = bool(self.frames), 0 < len(self.frames) < self.config.image.height
            armed = not begun
        else:
            begun, open_, armed = self.begun, len(self.frames) < self.until, bool(self.finder.armed[0])
        return Status.ARMED * armed | Status.TOUCH * open_ | Status.NO_TOUCH * (not begun)

    def _send(self, payload: int, unsure: int = 0) -> None:
        self.packets[True] += 1
        if not self.loses(self.packets[True], True):
            os.write(self.master, link.pack(bytes([self.decisions | unsure]) + payload.to_bytes(4, "little")))


class SensorDevice(Device):
    """A device with a sensor, which sends the sensor's frames at the scans' rate while it is asked to.

    rest: (frames, taxels) codes of the sensor untouched, again and again. touch: frames that come next. lost: as many
    of the next frames are left out. sent: every frame that was sent.
    """

    def __init__(self, config: AcceleratorConfig, rest: np.ndarray) -> None:
        super().__init__(config, lambda samples: (np.zeros((0, 6)), 0))
        self.rest, self.touch, self.lost, self.number = rest, np.zeros((0, rest.shape[1]), int), 0, 0
        self.sent: list[np.ndarray] = []
        self._stopped = threading.Event()

    def __enter__(self) -> SensorDevice:
        super().__enter__()
        threading.Thread(target=self._scan, daemon=True).start()
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        self._stopped.set()
        super().__exit__(kind, error, trace)

    def _write(self, address: int, word: int) -> None:
        super()._write(address, word)
        if address == InterfaceRegister.FRAMES:
            self.registers[address] = word & 1

    def _scan(self) -> None:
        begin, rate = time.monotonic(), self.config.sensor.scan_rate_hz
        while not self._stopped.wait(0.01):
            data = b""
            for _ in range(int((time.monotonic() - begin) * rate) - self.number):
                frame = self.rest[self.number % len(self.rest)]
                if len(self.touch):
                    frame, self.touch = self.touch[0], self.touch[1:]
                if self.registers.get(InterfaceRegister.FRAMES) and not self.lost:
                    words = np.array([self.number, *frame]) & 0xFFFF
                    data += link.pack(words.astype("<u2").tobytes())
                    self.sent.append(frame)
                self.number, self.lost = self.number + 1, max(0, self.lost - 1)
            while data:
                data = data[os.write(self.master, data) :]


def golden_decisions(model, recordings: Recordings) -> Callable[[np.ndarray], tuple[np.ndarray, int]]:
    """``decide`` of Device by the golden model; only for exactly these recordings, so that a shifted one is
    noticed."""
    from eskin.golden.model import images_of, run, run_images

    recordings = recordings.scanned(model.config.sensor.scan_every)  # a host sends no others
    if model.config.is_image:
        rows, offsets = run_images(model, images_of(recordings)).streams["decision"]
        touches = np.ones(len(recordings), dtype=np.int64)
    else:
        trace = run(model, recordings)
        rows, offsets = trace.streams["decision"]
        touches = np.bincount(trace.touches.recording, minlength=len(recordings))
    known = {
        recordings.recording(index).astype(np.int32).tobytes(): (
            rows[offsets[index] : offsets[index + 1]],
            int(touches[index]),
        )
        for index in range(len(recordings))
    }
    return lambda samples: known[samples.tobytes()]
