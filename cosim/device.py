"""A device in this process: bus accesses, frames, waiting, a record of every stage. The cycles themselves run
in C++.

`eskin.cosim.bulk` plays recordings into it, `eskin.live.sources` single frames.
"""

import ctypes
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from eskin.cosim.latency import standstill_cycles
from eskin.cosim.runner import build_library
from eskin.cosim.scoreboard import flat_stages
from eskin.golden.core import AcceleratorConfig, SimulationError

KERNEL = Path(__file__).with_suffix(".cpp")
FOREVER = 1 << 62  # no cycle reaches it, and it fits the C program's int64
STUCK = 100_000
"""Cycles after which a chain that is waited for has certainly failed."""
QUIET, SETTLE = 4, 6
"""Cycles a bus command may need before busy shows it; those that `Accelerator` waits for one."""
FRAME_END, HUNG = -1, -2
"""Events of `Device.seen` that are no stage's: a frame's last taxel is taken; the watchdog acts (``value``
frames and ``also`` taxels taken)."""
COUNTS = "cycle decisions stalls refused overruns frame_cycles_max frame taxel stop_at poke_at watch"
SEEN = np.dtype([("stage", "<i4"), ("value", "<u4"), ("also", "<u4"), ("cycle", "<i8")], align=True)
Write = tuple[int, int]
"""Address and word of a bus write."""


class State(ctypes.Structure):
    """Counts and settings of a device, in the C++ program's memory."""

    _fields_ = [(name, ctypes.c_int64) for name in COUNTS.split()]


def _passed(value: Any) -> Any:
    if isinstance(value, float):
        return ctypes.c_double(value)
    if isinstance(value, str):
        return value.encode()
    return ctypes.c_int64(value.ctypes.data if isinstance(value, np.ndarray) else value)


class Design:
    """A Verilated design; an unchanged one is taken from ``builds``.

    Parameters
    ----------
    verilog:
        Holds the module ``top``.

    Raises
    ------
    InputError, SimulationError
        A tool is missing; the build fails.
    """

    def __init__(self, verilog: str, builds: Path, *, top: str = "accelerator") -> None:
        self._functions = ctypes.CDLL(str(build_library(verilog, top, KERNEL, builds)))

    def __getattr__(self, name: str) -> Any:
        """A function of the C++ program: its whole numbers have 64 bits, and an array goes in as its address."""
        function = getattr(self._functions, name)
        function.restype = ctypes.c_int64
        setattr(self, name, lambda *given: function(*map(_passed, given)))
        return getattr(self, name)


class Device:
    """One device, as after power-on.

    Parameters
    ----------
    sample_bits:
        Of a sample.
    stages:
        Probes that are taken down, as far as the design has them; decisions always.
    seed:
        Of what the Verilog begins at random, not 0.

    Attributes
    ----------
    state: its counts and settings. stages: recorded stages, ``decision`` the last.
    """

    def __init__(
        self, design: Design, sample_bits: int = 0, stages: Iterable[str] = (), seed: int = 1
    ) -> None:
        self._design, self._bits = design, sample_bits
        self._device: int | None = design.open_device(seed)
        self.state = State.from_address(self._call("state_of"))
        self.state.stop_at, self.state.watch, self.state.poke_at = FOREVER, -1, -1
        pairs = {stage: (f"probe__{stage}__valid", f"probe__{stage}__value") for stage in stages}
        pairs["decision"] = "o__valid", "o__payload"
        self.stages = [stage for stage, pair in pairs.items() if self._call("add_stage", *pair)]

    def __del__(self) -> None:
        self.close()

    def close(self) -> None:
        """Give its memory back."""
        # getattr: __del__ also runs when __init__ failed before there was a device
        if getattr(self, "_device", None):
            self._call("close_device")
        self._device = None

    def _call(self, name: str, *given: Any) -> int:
        """A function of the C++ program for this device."""
        return getattr(self._design, name)(self._device, *given)

    def put(self, name: str, value: int) -> None:
        """Drive an input, where there is one."""
        self._call("put_port", name, value)

    def get(self, name: str) -> int:
        """Value of an output; 0 if there is none."""
        return self._call("get_port", name)

    def cycle(self, count: int = 1) -> None:
        """So many clock cycles."""
        self._call("cycles", count)

    def reset(self, boot: Iterable[Write] = ()) -> None:
        """Reset, then bus writes."""
        for name in ("i__valid", "bus__w_stb", "bus__r_stb"):
            self.put(name, 0)
        self.put("o__ready", 1)
        self.put("rst", 1)
        self.cycle(4)
        self.put("rst", 0)
        for address, word in boot:
            self.write(address, word)

    def write(self, address: int, word: int) -> None:
        """A bus write."""
        self._call("write_word", address, word)

    def read(self, address: int) -> int:
        """A bus read."""
        return self._call("read_word", address)

    def settle(self, limit: int = STUCK, quiet: int = QUIET) -> None:
        """Cycles until the device is idle.

        Raises
        ------
        SimulationError
            It never is: more than ``limit`` cycles pass without a decision.
        """
        if not self._call("settle_device", quiet, limit):
            raise SimulationError("the simulated hardware hangs: it stays busy")

    def frames(self, frames: np.ndarray, period: float = 0.0, limit: int = STUCK) -> None:
        """Play frames (frames, taxels).

        Parameters
        ----------
        period:
            Clock cycles from frame to frame; 0: a taxel whenever one is taken.

        Raises
        ------
        SimulationError
            A taxel is not taken within ``limit`` cycles.
        """
        samples = np.ascontiguousarray(frames, np.int32)
        if not self._call("play_frames", samples, *samples.shape, self._bits, float(period), limit):
            raise SimulationError("the simulated hardware hangs: it does not accept a beat")

    def poke(self, cycle: int, **values: int) -> None:
        """Give inputs, by name, these values in one cycle and 0 in all others."""
        self._call("unpoke")
        for name, value in values.items():
            self._call("poke", name, value)
        self.state.poke_at = cycle

    def seen(self) -> np.ndarray:
        """Events since the last `forget`: rows of ``SEEN``. stage: its place in `stages`; also: the word on
        the bus."""
        size = self._call("event_count") * SEEN.itemsize
        return np.frombuffer(ctypes.string_at(self._call("events_of"), size), SEEN)

    def streams(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Values (32-bit codes with their sign) and cycles of each stage since the last `forget`."""
        events = self.seen()
        rows = {stage: events[events["stage"] == place] for place, stage in enumerate(self.stages)}
        return {stage: (row["value"].astype(np.int32), row["cycle"]) for stage, row in rows.items()}

    def forget(self) -> None:
        """Drop the events so far."""
        self._call("forget")


class Accelerator(Device):
    """A device behind its register map.

    Parameters
    ----------
    registers:
        Register map (eskin.rtl.fpga.generate.register_map).
    boot:
        (register, word) writes that load the model.
    probes:
        False: decisions alone are taken down.

    Attributes
    ----------
    limit: cycles without progress after which it stands still. map: ``registers``.
    """

    def __init__(
        self,
        design: Design,
        config: AcceleratorConfig,
        registers: Mapping[str, Any],
        boot: Iterable[Write],
        *,
        probes: bool = True,
        seed: int = 1,
    ) -> None:
        stages = (*flat_stages(config), "step") if probes else ()
        super().__init__(design, config.sensor.sample_bits, stages, seed)
        self.map, self._addresses = registers, registers["registers"]
        self._commands = registers["bits"]["CONTROL"]
        self.limit = standstill_cycles(config)
        self.reset([*boot, (self._addresses["MEASURE"], registers["measures"]["STEP"])])

    def command(self, *names: str) -> None:
        """Commands of register CONTROL, until they are carried out.

        Raises
        ------
        SimulationError
            The device stands still.
        """
        self.write(self._addresses["CONTROL"], sum(self._commands[name] for name in names))
        self.settle(self.limit, SETTLE)

    def register(self, name: str, offset: int = 0) -> int:
        """The register ``offset`` addresses behind ``register``."""
        return self.read(self._addresses[name] + offset)

    def brought(self, frames: np.ndarray | None = None) -> dict[str, list[int]]:
        """Values of each stage since the last time, once ``frames`` are taken and the device is idle.

        Raises
        ------
        SimulationError
            The device stands still.
        """
        if frames is not None:
            self.frames(frames, limit=self.limit)
        self.settle(self.limit)
        found = {stage: values.tolist() for stage, (values, _) in self.streams().items() if values.size}
        self.forget()
        return found
