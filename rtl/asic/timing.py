"""OpenSTA on a netlist: the slowest path of a corner with a wire load, the clock it allows."""

import re
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from eskin.rtl.asic.liberty import Library
from eskin.rtl.fpga.tools import ToolError

PERIOD_NS = 20.0
STA_LIMIT_S = 900.0
MACRO_DERATING = 1.6
"""Factor on the delays of macros at a corner for which no file has them: about the slowdown of the cells from
typ to slow."""


@dataclass(frozen=True)
class Slowest:
    """The slowest path. fmax_hz: the clock it allows; start, end: its first and last cell; derated:
    macros of another corner were taken slower."""

    fmax_hz: float
    start: str
    end: str
    derated: bool


BY_STA = "OpenSTA"
NOT_TOLD = "not told without OpenSTA: sudo apt-get install opensta"


def has_sta() -> bool:
    """True if OpenSTA is installed."""
    return shutil.which("sta") is not None


def wire_load_of(library: Library, preferred: str) -> str:
    """The library's wire load ``wanted``, or its middle one."""
    names = list(library.wire_loads)
    return preferred if preferred in names else names[len(names) // 2] if names else ""


def slowest(
    verilog: Path, top: str, libraries: Sequence[Library], foreign: Sequence[Library], wire_load: str
) -> Slowest:
    """The slowest path between registers.

    Parameters
    ----------
    libraries:
        The corner's files.
    foreign:
        Macros' files of another corner, taken MACRO_DERATING times slower.
    wire_load:
        Name of the load model of every net; empty for none.

    Raises
    ------
    ToolError
    """
    macros = [cell for library in foreign for cell in library.cells]
    files = "".join(f"read_liberty {{{library.path.resolve()}}}\n" for library in (*libraries, *foreign))
    load = f"set_wire_load_model -name {wire_load}\n" if wire_load else ""
    derating = f"set_timing_derate -late -cell_delay {MACRO_DERATING}"
    slower = "".join(f"{derating} [get_lib_cells */{macro}]\n" for macro in macros)
    # its clock is ideal: there is no pessimism to take back (crpr)
    script = f"""{files}read_verilog {{{verilog.resolve()}}}
link_design {top}
set sta_crpr_enabled 0
create_clock -name clk -period {PERIOD_NS} [get_ports clk]
{load}{slower}report_checks -path_delay max -from [all_registers -clock_pins] -to [all_registers -edge_triggered -data_pins] -digits 4
exit
"""
    with tempfile.TemporaryDirectory() as folder:  # two calls may ask about one netlist
        (Path(folder) / "timing.tcl").write_text(script)
        finished = subprocess.run(
            ["sta", "-exit", "timing.tcl"],
            cwd=folder,
            capture_output=True,
            text=True,
            timeout=STA_LIMIT_S,
            check=False,
        )
    slack = re.search(r"([-\d.]+) +slack \((?:MET|VIOLATED)\)", finished.stdout)
    if finished.returncode or slack is None:
        raise ToolError(f"OpenSTA failed: {(finished.stdout + finished.stderr).strip()[-800:]}")
    begin, end = (re.findall(rf"{word}: (\S+)", finished.stdout)[0] for word in ("Startpoint", "Endpoint"))
    return Slowest(1e9 / (PERIOD_NS - float(slack[1])), begin, end, bool(macros))


SDC = """# clock and what lies outside; hertz: {clock_hz:g}
create_clock -name clk -period {period_ns:.3f} [get_ports clk]
set_input_delay {outside:.3f} -clock clk [all_inputs]
set_output_delay {outside:.3f} -clock clk [all_outputs]
"""
