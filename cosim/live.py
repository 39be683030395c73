"""The simulated accelerator in lock step: frames go in, and every stage that they bring comes back before the
next ones go."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from eskin.cosim.device import Design, Device
from eskin.cosim.latency import standstill_cycles
from eskin.cosim.scoreboard import flat_stages
from eskin.golden.core import AcceleratorConfig


class Brought(NamedTuple):
    """Values of a frame (or of the recording's end): stage -> values in order. cycles: clock cycles until the
    device was idle."""

    stages: dict[str, list[int]]
    cycles: int


class LiveSimulator:
    """``accelerator`` under Verilator; end it with ``close``.

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
        A tool is missing; the build fails; the simulated hardware stands still.
    """

    def __init__(
        self,
        design: str,
        config: AcceleratorConfig,
        registers: Mapping[str, Any],
        boot: Sequence[tuple[int, int]],
        builds: Path,
    ) -> None:
        self._addresses, self._commands = registers["registers"], registers["bits"]["CONTROL"]
        self._limit = standstill_cycles(config) + 4 * config.last_frame * (config.sensor.taxels + 32)
        design_ = Design(design, builds, "watching the simulated hardware")
        self._device = Device(design_, config.sensor.sample_bits, (*flat_stages(config), "step"))
        self._device.reset(boot)
        self._through(0)

    def arm(self) -> None:
        """A new recording."""
        self.write("CONTROL", sum(self._commands[name] for name in ("ARM", "EVERY", "CLEAR_FAULTS")))

    def take(self, samples: np.ndarray) -> list[Brought]:
        """The source's next frames (n, taxels), A/D codes; what each brought."""
        brought = []
        for frame in np.asarray(samples):
            begun = self._device.state.cycle
            self._device.frames(frame[None], limit=self._limit)
            brought.append(self._through(begun))
        return brought

    def finish(self) -> Brought:
        """Events that the end of the recording produces."""
        return self.write("CONTROL", self._commands["FINISH"])

    def read(self, register: str) -> int:
        """A register's value."""
        return self._device.read(self._addresses[register])

    def write(self, register: str, word: int) -> Brought:
        """Write a register; the values that have arrived when the device is idle."""
        self._device.write(self._addresses[register], word)
        return self._through(self._device.state.cycle)

    def close(self) -> None:
        """End the simulator."""
        self._device.close()

    def _through(self, begun: int) -> Brought:
        """Values that have arrived when the device is idle."""
        self._device.settle(self._limit)
        stages = {
            "step_cycles" if stage == "step" else stage: (
                values.view(np.uint32) if stage == "decision" else values
            ).tolist()
            for stage, (values, _) in self._device.streams().items()
            if values.size
        }
        self._device.forget()
        return Brought(stages, self._device.state.cycle - begun)
