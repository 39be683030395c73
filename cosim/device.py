"""A device in this process: bus accesses, frames, waiting, a record of every stage. The cycles themselves run
in C++.

Behind it stands a Verilated design (`Design`) or a chip's netlist in tables (`eskin.cosim.gates.Chip`). What
is played into it, a scenario, is the same for both: `eskin.cosim.live`, `eskin.cosim.bulk`.
"""

import ctypes
import functools
from collections.abc import Iterable
from pathlib import Path
from typing import Protocol

import numpy as np

from eskin.cosim.c_source import library, structure
from eskin.cosim.runner import build_library
from eskin.golden.core import SimulationError

KERNEL = Path(__file__).with_suffix(".cpp")
ROLES = (
    *(f"bus__{name}" for name in ("addr", "w_data", "w_stb", "r_stb", "r_data")),
    *("i__payload", "i__valid", "i__ready", "o__valid", "o__payload", "busy", "hung"),
)
"""Ports that the C++ program knows, in its order; a design may lack some."""
FOREVER = 1 << 62  # no cycle reaches it, and it fits the C program's int64
STUCK = 100_000
"""Cycles after which a chain that is waited for has certainly failed."""
QUIET = 4
"""Cycles a bus command may need before busy shows it."""
FRAME_END, HUNG = -1, -2
"""Events of `Device.seen` that are no stage's: a frame's last taxel is taken; the watchdog acts (``value``
frames and ``also`` taxels taken)."""
State, Seen = (structure(KERNEL, name) for name in ("State", "Seen"))
SEEN = np.dtype(Seen)
Write = tuple[int, int]
"""Address and word of a bus write."""


class Model(Protocol):
    """Interface of the model behind a device."""

    library: ctypes.CDLL

    def begin(self, seed: int) -> None:
        """As after power-on. ``seed`` chooses the contents that may then be anything."""

    def open(self) -> int:
        """A device of the C++ program."""

    def port(self, device: int, name: str) -> int:
        """Number of a port; -1: there is none."""


class Design:
    """A Verilated design; an unchanged one is taken from ``builds``.

    Parameters
    ----------
    verilog:
        Holds the module ``top``.
    purpose:
        What needs it, for the message about a missing tool.

    Raises
    ------
    InputError, SimulationError
        A tool is missing; the build fails.
    """

    def __init__(self, verilog: str, builds: Path, purpose: str, top: str = "accelerator") -> None:
        self.library = library(build_library(verilog, top, KERNEL, builds, purpose), KERNEL)

    def begin(self, seed: int) -> None:
        """Nothing depends on ``seed``: registers begin as the Verilog says, and a reset restores that."""

    def open(self) -> int:
        """As after power-on."""
        return self.library.open_device()

    def port(self, device: int, name: str) -> int:
        """Number of a port; -1: there is none."""
        return self.library.port_of(device, name.encode())


class Device:
    """One device.

    Parameters
    ----------
    sample_bits:
        Of a sample.
    stages:
        Probes that are taken down, as far as the design has them; decisions always.

    Attributes
    ----------
    state: its counts and settings. stages: what is taken down, ``decision`` the last.
    """

    def __init__(self, model: Model, sample_bits: int = 0, stages: Iterable[str] = ()) -> None:
        self._model, self._library, self._bits = model, model.library, sample_bits
        # the cached function below holds the handle and not self, which would never be closed otherwise
        handle = model.open()
        self._device: int | None = handle
        self.port = functools.cache(lambda name: model.port(handle, name))
        self.state = State.from_address(self._library.state_of(self._device))
        self.state.stop_at = self.state.global_after = FOREVER
        self.state.watch = self.state.poke_at = -1
        for role, name in enumerate(ROLES):
            self._library.set_role(self._device, role, self.port(name))
        pairs = {stage: (f"probe__{stage}__valid", f"probe__{stage}__value") for stage in stages} | {
            "decision": ("o__valid", "o__payload")
        }
        self.stages = tuple(stage for stage, (valid, _) in pairs.items() if self.port(valid) >= 0)
        for stage in self.stages:
            self._library.add_stage(self._device, *map(self.port, pairs[stage]))

    def __del__(self) -> None:
        self.close()

    def close(self) -> None:
        """Give its memory back."""
        # getattr: __del__ also runs when __init__ failed before there was a device
        device, self._device = getattr(self, "_device", None), None
        if device:
            self._library.close_device(device)

    def put(self, name: str, value: int) -> None:
        """Drive an input, where there is one."""
        self._library.put_port(self._device, self.port(name), value)

    def get(self, name: str) -> int:
        """Value of an output; 0 if there is none."""
        return self._library.get_port(self._device, self.port(name))

    def cycle(self, count: int = 1) -> None:
        """So many clock cycles."""
        self._library.cycles(self._device, count)
        self._rested()

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
        self._library.write_word(self._device, address, word)

    def read(self, address: int) -> int:
        """A bus read."""
        return self._library.read_word(self._device, address)

    def settle(self, limit: int = STUCK, quiet: int = QUIET) -> None:
        """Cycles until the device is idle.

        Raises
        ------
        SimulationError
            It never is: more than ``limit`` cycles pass without a decision.
        """
        if not self._library.settle_device(self._device, quiet, limit):
            raise SimulationError("the simulated hardware hangs: it stays busy")
        self._rested()

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
        if not self._library.play_frames(
            self._device, samples.ctypes.data, *samples.shape, self._bits, period, limit
        ):
            raise SimulationError("the simulated hardware hangs: it does not accept a beat")
        self._rested()

    def line(self, levels: np.ndarray) -> bytes:
        """Levels of the sending serial line, a byte (0, 1) a cycle, while the receiving line has ``levels``.

        Bit 1 of a level offers a decision from that cycle on until it is taken.
        """
        driven, sent = np.ascontiguousarray(levels, np.uint8), np.zeros(len(levels), np.uint8)
        ports = map(self.port, ("rx", "tx", "decision__valid", "decision__ready"))
        self._library.play_line(self._device, *ports, driven.ctypes.data, len(driven), sent.ctypes.data)
        return sent.tobytes()

    def poke(self, cycle: int, **values: int) -> None:
        """Give inputs, by name, these values in one cycle and 0 in all others."""
        self._library.unpoke(self._device)
        for name, value in values.items():
            self._library.poke(self._device, self.port(name), value)
        self.state.poke_at = cycle

    def seen(self) -> np.ndarray:
        """Events since the last `forget`: rows of ``SEEN``. stage: its place in `stages`; also: the word on
        the bus."""
        count, size = self._library.event_count(self._device), SEEN.itemsize
        return (
            np.frombuffer(ctypes.string_at(self._library.events_of(self._device), count * size), SEEN)
            if count
            else np.empty(0, SEEN)
        )

    def streams(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Values (32-bit codes with their sign) and cycles of each stage since the last `forget`."""
        events = self.seen()
        rows = {stage: events[events["stage"] == place] for place, stage in enumerate(self.stages)}
        return {stage: (row["value"].astype(np.int32), row["cycle"]) for stage, row in rows.items()}

    def forget(self) -> None:
        """Drop the events so far."""
        self._library.forget(self._device)

    def mark_frames(self) -> None:
        """Note counts at each frame's first taxel from now on, for `marks`."""
        self._library.mark_frames(self._device)

    def marks(self, width: int) -> np.ndarray:
        """For each frame the counts (``width`` of them) in the cycle that takes its first taxel, before
        the edge."""
        count = self._library.mark_count(self._device)
        return np.frombuffer(ctypes.string_at(self._library.marks_of(self._device), 8 * count)).reshape(
            -1, width
        )

    def _rested(self) -> None:
        if self.state.failed:
            raise SimulationError("the netlist does not settle within a clock cycle")
