"""Upsets in simulation: a design with the inputs of `eskin.rtl.fpga.upsets` is played from power-on for every
upset of a list."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from eskin.cosim.device import FOREVER, HUNG, QUIET, Design, Device
from eskin.golden.core import Record, SimulationError

PURPOSE = "an upset campaign"
PORTS = ("upset_register", "upset_memory", "upset_word", "upset_bit")
NONE = (0, 0, 0, 0, 0, -1)
"""The entry of a run without an upset."""
RESET, ARM_AGAIN, NO_ARM = 65535, 65534, 65533
"""In place of a register: how the recording is broken off at that cycle, by a reset, by the next one's arm,
or without either (which must go wrong)."""
GLOBAL = 29
"""The payload's bit of a global decision."""
JOBS = 2
"""Simulations at a time."""


@dataclass(frozen=True)
class Played:
    """What is played for every upset.

    design: with upset inputs. registers: register map (`eskin.rtl.fpga.generate.register_map`). boot:
    (register, word) writes that load the model. streams: recordings, A/D codes (frames, taxels). limit:
    cycles after which a wait is a hang.
    """

    design: Design
    registers: Mapping[str, Any]
    boot: Sequence[tuple[int, int]]
    streams: Sequence[np.ndarray]
    sample_bits: int
    limit: int

    def runs(
        self,
        upsets: Sequence[tuple[int, ...]],
        *,
        stop: bool = False,
        progress: Callable[[int, int], None] | None = None,
    ) -> list[Record]:
        """Run every upset (register, memory, word, bit, recording, cycle since that recording's arm).

        Of each ``recordings``: decisions [payload, FAULTS when it was offered, cycle], faults, status,
        touches, cycles, hang (1: an input waits for ever, 2: it stays busy), cleared [frames taken, taxels
        taken of the next one, cycle]: where the watchdog acted.

        ``stop``: end each run with the first global decision after the upset.
        """
        results = []
        with ThreadPoolExecutor(JOBS) as pool:  # the device's cycles run outside of Python's lock
            for result in pool.map(lambda upset: {"recordings": list(self._run(upset, stop))}, upsets):
                results.append(result)
                if progress:
                    progress(len(results), len(upsets))
        return results

    def _run(self, upset: tuple[int, ...], stop: bool) -> Iterator[Record]:
        register, *_, hit_recording, hit = upset
        addresses, commands = self.registers["registers"], self.registers["bits"]["CONTROL"]
        device = Device(self.design, self.sample_bits)
        device.state.watch = addresses["FAULTS"]
        device.reset(self.boot)
        for number, stream in enumerate(self.streams):
            device.forget()
            if not (number and register == NO_ARM):
                device.write(addresses["CONTROL"], commands["ARM"])
            # ARM clears the chain at the end of the cycle after it was written. Decisions offered up to then
            # belong to the recording before (docs/specification.md, section 7).
            device.cycle()
            if not (number and register == NO_ARM):
                device.forget()
            begun = device.state.cycle
            if number == hit_recording and hit >= 0:
                pokes = (
                    dict(zip(PORTS, upset, strict=False))
                    if register < NO_ARM
                    else {"rst": int(register == RESET)}
                )
                device.poke(begun + hit, **pokes)
                device.state.stop_at = begun + hit + 1 if register >= NO_ARM else FOREVER
                device.state.global_after = begun + hit if stop else FOREVER
            hang = self._hang(partial(device.frames, stream, limit=self.limit))
            if device.state.cycle < device.state.stop_at:
                device.write(addresses["CONTROL"], commands["FINISH"])
            if hang:  # nothing to wait for: an input hangs already
                device.cycle(QUIET)
            else:
                hang = 2 * self._hang(lambda: device.settle(self.limit))
            device.state.stop_at = FOREVER
            result: Record = {
                name.lower(): device.read(addresses[name]) for name in ("FAULTS", "STATUS", "TOUCHES")
            }
            events = [
                (stage, value, also, cycle - begun) for stage, value, also, cycle in device.seen().tolist()
            ]
            result["decisions"] = [[value, also, cycle] for stage, value, also, cycle in events if stage == 0]
            result["cleared"] = [
                [value, also, cycle] for stage, value, also, cycle in events if stage == HUNG and cycle >= 0
            ]
            yield result | {"hang": hang, "cycles": device.state.cycle - begun}
            if (
                stop
                and number == hit_recording
                and any(value >> GLOBAL & 1 and cycle > hit >= 0 for value, _, cycle in result["decisions"])
            ):
                return

    @staticmethod
    def _hang(wait: Callable[[], None]) -> int:
        try:
            wait()
        except SimulationError:
            return 1
        return 0
