"""Sizes of the exported C as a compiler for microcontrollers makes it: clang of the Python package
ziglang."""

import importlib.util
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

from eskin.exchange.plain_c import SOURCE
from eskin.golden.core import PREFIX, SimulationError, prefixed

CORES = {
    "Cortex-M0+": ("thumb-freestanding-eabi", "cortex_m0plus"),
    "Cortex-M4": ("thumb-freestanding-eabi", "cortex_m4"),
    "RV32IMC": ("riscv32-freestanding-none", "generic_rv32+m+c"),
}
"""Target and core of each, as ziglang calls them."""
WARNINGS = ("-std=c99", "-Wall", "-Wextra", "-Werror")
STATE = '#include "eskin_model.h"\neskin_state the_state = { 0 };\n'


def there() -> bool:
    """Is the compiler installed?"""
    return importlib.util.find_spec("ziglang") is not None


def compile_for(core: str, source: Path, out: Path, *options: str) -> None:
    """``source`` to an object, optimised for size.

    Raises
    ------
    SimulationError
        The compiler refuses it.
    """
    target, cpu = CORES[core]
    clang = (sys.executable, "-m", "ziglang", "cc", "-target", target, f"-mcpu={cpu}", "-ffreestanding")
    command = [*clang, *WARNINGS, "-Os", "-fno-sanitize=all", "-c", *options, str(source), "-o", str(out)]
    finished = subprocess.run(command, capture_output=True, text=True, cwd=source.parent)
    if finished.returncode:
        raise SimulationError(f"{source.name}: does not compile for {core}: {finished.stderr[:400]}")


def sections(elf: bytes) -> dict[str, int]:
    """Bytes of each section of a 32-bit little-endian object, by name."""
    table, entry, count, names = *struct.unpack_from("<I", elf, 32), *struct.unpack_from("<HHH", elf, 46)
    heads = [struct.unpack_from("<10I", elf, table + entry * number) for number in range(count)]
    text = heads[names][4]
    return {elf[text + head[0] : elf.index(b"\0", text + head[0])].decode(): head[5] for head in heads}


def sizes(folder: Path, core: str, image: bool, prefix: str = PREFIX) -> dict[str, int]:
    """Bytes of ``code``, ``tables`` and ``state`` of a model exported with ``prefix`` on a core."""
    with tempfile.TemporaryDirectory() as work:
        model, state = Path(work) / "model.o", Path(work) / "state.o"
        compile_for(core, folder.absolute() / prefixed(SOURCE, prefix), model)
        of_model = sections(model.read_bytes())
        writable = of_model
        if not image:
            source = Path(work) / "state.c"
            source.write_text(prefixed(STATE, prefix))
            compile_for(core, source, state, f"-I{folder.absolute()}")
            writable = sections(state.read_bytes())
    total = lambda table, *starts: sum(size for name, size in table.items() if name.startswith(starts))
    return {
        "code": total(of_model, ".text"),
        "tables": total(of_model, ".rodata", ".data"),
        "state": total(writable, ".bss", ".data"),
    }
