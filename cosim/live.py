"""The simulated accelerator in lock step: frames go in, and every stage that they bring comes back before the next ones go."""

from __future__ import annotations

import os
import select
import subprocess
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from eskin.cosim.runner import build_bench
from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.errors import SimulationError

BENCH = Path(__file__).with_name("live_bench.cpp")
TAGS = {1: "sum", 2: "fault", 3: "feature", 4: "state", 5: "logit", 6: "decision", 7: "step_cycles", 11: "map"}
THROUGH, REPLY, STANDSTILL = 8, 9, 10
WRITE, FRAMES, SETTLE, READ = 1, 2, 3, 4
INPUT_BYTES = 32768
"""At most so much goes in before what comes out is read: half of what a pipe holds, so that neither side waits for the other."""
ANSWER_S = 60.0
"""To wait for a few frames' answer before the simulator is given up."""


@dataclass
class Brought:
    """What a frame (or the recording's end) brought: stage -> values as they came. cycles: clock cycles until nothing was under way."""

    stages: dict[str, list[int]] = field(default_factory=dict)
    cycles: int = 0


class LiveSimulator:
    """``accelerator`` under Verilator, a process of its own; end it with ``close``.

    Parameters
    ----------
    design:
        Verilog of eskin.rtl.fpga.export.
    registers:
        Register map (eskin.rtl.fpga.generate.register_map).
    boot:
        (register, word) writes that load the model.
    builds:
        Folder that keeps simulators.

    Raises
    ------
    InputError, SimulationError
        A tool is missing; the build fails; the simulator stops or stands still.
    """

    def __init__(
        self, design: str, config: AcceleratorConfig, registers: Mapping[str, Any], boot: Sequence[tuple[int, int]], builds: Path
    ) -> None:
        defined = ("-CFLAGS", "-DIMAGES") if config.is_image else ()
        program = build_bench(design, BENCH, builds, "watching the simulated hardware", defined)
        self._addresses, self._commands = registers["registers"], registers["bits"]["CONTROL"]
        self._taxels, self._mask = config.sensor.taxels, (1 << config.sensor.sample_bits) - 1
        self._log = tempfile.TemporaryFile()  # noqa: SIM115  # closed with the process
        self._process = subprocess.Popen([str(program)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._log, bufsize=0)
        self._rest = b""
        limit = 20 * (config.step_ideal + 1000) + 4 * config.last_frame * (config.sensor.taxels + 32)
        self._send([config.sensor.taxels, config.sensor.sample_bits, limit])
        for first in range(0, len(boot), INPUT_BYTES // 12):
            self._send([word for address, data in boot[first : first + INPUT_BYTES // 12] for word in (WRITE, address, data)])
        self._send([SETTLE])
        self._answers(1)

    def arm(self) -> None:
        """A new recording."""
        self._send([WRITE, self._addresses["CONTROL"], self._commands["ARM"] | self._commands["CLEAR_FAULTS"], SETTLE])
        self._answers(1)

    def take(self, samples: np.ndarray) -> list[Brought]:
        """Frames (n, taxels), A/D codes; what each brought."""
        brought: list[Brought] = []
        step = max(1, INPUT_BYTES // (4 * self._taxels))
        for first in range(0, len(samples), step):
            part = np.asarray(samples[first : first + step])
            self._send(np.concatenate([[FRAMES, len(part)], part.reshape(-1).astype(np.int64) & self._mask]))
            brought += self._answers(len(part))
        return brought

    def finish(self) -> Brought:
        """The recording's end: what it brought."""
        self._send([WRITE, self._addresses["CONTROL"], self._commands["FINISH"], SETTLE])
        return self._answers(1)[0]

    def read(self, register: str) -> int:
        """A register's value."""
        self._send([READ, self._addresses[register]])
        while True:
            for tag, value in self._pairs():
                if tag == REPLY:
                    return int(value)

    def close(self) -> None:
        """End the simulator."""
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe:
                pipe.close()
        try:
            self._process.wait(timeout=2)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._log.close()

    def _send(self, words: Sequence[int] | np.ndarray) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(np.asarray(words, dtype=np.int64).astype("<u4").tobytes())
        except OSError:
            raise self._stopped("stopped") from None

    def _pairs(self) -> np.ndarray:
        """(n, 2) tags and values that have come; waits for one at least."""
        assert self._process.stdout is not None
        begin = time.monotonic()
        while len(self._rest) < 8:
            ready, _, _ = select.select([self._process.stdout], [], [], 1.0)
            data = os.read(self._process.stdout.fileno(), 1 << 16) if ready else b""
            if ready and not data:
                raise self._stopped("stopped")
            if time.monotonic() - begin > ANSWER_S:
                raise self._stopped(f"said nothing for {ANSWER_S:.0f} s")
            self._rest += data
        whole = len(self._rest) // 8 * 8
        pairs = np.frombuffer(self._rest[:whole], dtype="<u4").reshape(-1, 2)
        self._rest = self._rest[whole:]
        return pairs

    def _answers(self, count: int) -> list[Brought]:
        """What the next ``count`` frames or settlings brought."""
        done, now = [], Brought()
        while len(done) < count:
            for tag, value in self._pairs().tolist():
                if tag == THROUGH:
                    now.cycles = value
                    done.append(now)
                    now = Brought()
                elif tag == STANDSTILL:
                    raise self._stopped("stands still: " + ("a beat is not taken" if value == 1 else "it stays busy"))
                elif tag in TAGS:
                    signed = value if TAGS[tag] == "decision" or value < 1 << 31 else value - (1 << 32)
                    now.stages.setdefault(TAGS[tag], []).append(signed)
        return done

    def _stopped(self, how: str) -> SimulationError:
        self._log.seek(0)
        return SimulationError(f"the simulated hardware {how}\n{self._log.read().decode(errors='replace')[-2000:]}")
