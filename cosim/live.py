"""The simulated accelerator in lock step: frames go in, and every stage that they bring comes back before the
next ones go."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from eskin.cosim.device import Design, Device
from eskin.cosim.latency import standstill_cycles
from eskin.cosim.scoreboard import flat_stages
from eskin.golden.core import AcceleratorConfig


@dataclass
class Brought:
    """Values of a frame (or of the recording's end): stage -> values in order. cycles: clock cycles until
    nothing was under way."""

    stages: dict[str, list[int]] = field(default_factory=dict)
    cycles: int = 0


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
        self._command("ARM", "EVERY", "CLEAR_FAULTS")

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
        return self._command("FINISH")

    def read(self, register: str) -> int:
        """A register's value."""
        return self._device.read(self._addresses[register])

    def write(self, register: str, word: int) -> None:
        """Write a register; returns when nothing is under way."""
        self._device.write(self._addresses[register], word)
        self._through(self._device.state.cycle)

    def close(self) -> None:
        """End the simulator."""
        self._device.close()

    def _command(self, *names: str) -> Brought:
        self._device.write(self._addresses["CONTROL"], sum(self._commands[name] for name in names))
        return self._through(self._device.state.cycle)

    def _through(self, begun: int) -> Brought:
        """Values that have come once nothing is under way."""
        self._device.settle(self._limit)
        brought = Brought(cycles=self._device.state.cycle - begun)
        names = [{"step": "step_cycles"}.get(stage, stage) for stage in self._device.stages]
        for stage, value, _, _ in self._device.seen().tolist():
            if stage >= 0:
                signed = value if names[stage] == "decision" or value < 1 << 31 else value - (1 << 32)
                brought.stages.setdefault(names[stage], []).append(signed)
        self._device.forget()
        return brought
