"""Settings of a co-simulation, from the verb to the bench."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from eskin.cosim.netlist import Hardware
from eskin.golden.core import InputError


@dataclass(frozen=True, kw_only=True)
class Simulation:
    """How recordings are played.

    Attributes
    ----------
    simulator:
        ``verilator`` or ``icarus``.
    pace:
        ``full``: a beat whenever ready. ``declared``: frames at the sensor's rate, at ``clock_hz``.
    clock_hz:
        Default: the configuration's.
    stalls:
        Random gaps on both sides; ``seed`` makes them. It is cocotb's seed, too.
    probe:
        Write weights during a touch; that must be refused and flagged, and the streams must not change.
    waves:
        On a mismatch, play its recording once more and keep waves.
    cocotb:
        Positions of the recordings that are played under cocotb; the others are played in bulk in this process
        (`eskin.cosim.bulk`). Default: all. What this process cannot play goes under cocotb, too:
        Icarus, a board's netlist, a converter, stalls, ``probe``.
    threads:
        Threads that play in bulk; default: one per core.
    level, target:
        ``rtl``; ``netlist`` for a board of eskin.rtl.fpga.targets, or for ``asic``, a chip of the process ``pdk``, whose
        registers, latches and memories begin at random: ``liberty`` files, constants in ROMs (``rom``).
    converter:
        Begin at a converter's pins: this one, or None for the configuration's (``none``: frames as they were
        recorded). The golden model reads the samples that the converter makes of the recordings. Frames then
        come at the declared rate, by the design's own sample clock.
    standalone:
        The netlist of a board without a host, on its part's own oscillators, from power-on (`eskin.cosim.standalone`).
    bench:
        Of many recordings, ``cocotb``: all are played under cocotb; ``sample``: one of each class, and the others in bulk
        where that can be.
    hardware:
        A netlist of the same design; default: the design's own Verilog.
    builds:
        Folder that keeps simulators.
    """

    simulator: str = "verilator"
    pace: str = "full"
    clock_hz: float | None = None
    stalls: bool = False
    seed: int = 1
    probe: bool = False
    waves: bool = True
    cocotb: Sequence[int] | None = None
    threads: int | None = None
    level: str = "rtl"
    target: str | None = None
    pdk: str | None = None
    liberty: list[Path] | None = None
    rom: bool = False
    converter: str | None = None
    standalone: bool = False
    bench: str = "sample"
    hardware: Hardware | None = None
    builds: Path = Path("build/simulators")

    @property
    def chip(self) -> bool:
        """A chip's netlist is played.

        Raises
        ------
        InputError
            A target and a level that do not go together.
        """
        if (self.level == "rtl") != (self.target is None):
            raise InputError(
                f"`level` {self.level}: needs a board; add `target`, such as `target` icebreaker"
                if self.target is None
                else f"`target` {self.target}: is for netlists; add `level` netlist"
            )
        of_chip = self.target == "asic", bool(self.pdk), bool(self.liberty)
        if any((*of_chip, self.rom)) and not all(of_chip):
            raise InputError(
                "`target` asic: goes with `level` netlist, `pdk` NAME and `liberty` FILE; give all of them or none"
            )
        return all(of_chip)
