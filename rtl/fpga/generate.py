"""Everything that leaves the project for one integer model: Verilog, memory images, register map, C header,
cocotb bench.

The generator reads none of these files; co-simulation reads accelerator.sv, config.json, registers.json and
load.hex.
"""

import json
from collections.abc import Callable, Iterable
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from eskin.golden.core import (
    PREFIX,
    AcceleratorConfig,
    Arrays,
    InputError,
    Record,
    check_prefix,
    model_hash,
    prefixed,
    replacing_folder,
    template,
)
from eskin.rtl import host
from eskin.rtl.fpga.export import TOP, WAIVER, rom, verilog
from eskin.rtl.program.memory_map import (
    ID_VALUE,
    READABLE_VERSIONS,
    VERSION_VALUE,
    Control,
    Event,
    Fault,
    ImageMemory,
    Measure,
    Register,
    Status,
    interface_registers,
    load_writes,
    memories,
    memory_images,
    memory_name,
    teach_registers,
    words_per_entry,
)
from eskin.rtl.program.register_files import Entry, entries, system_rdl, written
from eskin.rtl.program.schedule import longest_step, step_cycles
from eskin.rtl.top.accelerator import Accelerator
from eskin.rtl.top.sensing import Sensing
from eskin.rtl.top.system import Bus, System

SENSING = "sensing"
DRIVER = sorted((Path(host.__file__).parent / "driver").glob("eskin.*"))
BENCH = Path(__file__).parent / "templates" / "test_accelerator.py"
MAKEFILE = BENCH.with_name("cocotb.mk")
HEADERS = (
    "load registers assert complex ctype errno fenv features float inttypes iso646 limits locale math memory setjmp signal "
    "stdalign stdarg stdatomic stdbool stdckdint stdbit stddef stdint stdio stdlib stdnoreturn string strings tgmath "
    "threads time uchar unistd wchar wctype endian fcntl poll pthread sched semaphore termios new"
)
"""Headers beside the driver, and of C's library and POSIX, which it or a program around it reads."""
MARK = "registers.json"
"""A folder with this file was generated and may be replaced."""


def generate(
    config: AcceleratorConfig,
    arrays: Arrays,
    out: str | Path,
    *,
    vectors: str | Path | None = None,
    bus: Bus | None = None,
    axis: bool = False,
    top: str | None = None,
) -> Path:
    """Write the generated folder, whole or not at all.

    Parameters
    ----------
    config:
        Configuration of the integer model, with the wanted ``lanes``.
    arrays:
        Arrays of the integer model (docs/specification.md, section 8).
    out:
        New folder, an empty one, or an earlier generated one, which is replaced.
    vectors:
        File of eskin.golden.model.vectors.write_vectors; its first recording is what the cocotb bench plays.
        None: no bench.
    bus, axis:
        With ``bus`` or ``axis`` the module of `eskin.rtl.top.system.System` too.
    top:
        Name of the module that a system takes; with it all other modules, and the driver with all that it and
        registers.h declare, begin with this name, so that several designs go into one system.

    The folder
    ---------- accelerator.sv (module accelerator), with a converter sensing.sv (module sensing: the
    accelerator behind its pins), config.json, memories/*.hex (one word a line, as MEMORY_SELECT addresses
    them), load.hex (bus writes that load the model: address and word), registers.json, registers.h,
    eskin.rdl (`eskin.rtl.program.register_files`); with vectors: test_accelerator.py (a cocotb
    bench), its Makefile and vectors.npz; behind a bus eskin_BUS.sv (module eskin_BUS), eskin.h and eskin.c (its driver), load.h
    (load.hex for it); with streams alone eskin_axis.sv. Of these modules the module that a system takes, the
    last named here that is there, is in filelist.f and eskin.core (FuseSoC); waiver.vlt
    has what Verilator's lint shall pass over.

    Raises
    ------
    InputError
        When ``out`` holds something else, or streams are asked for where a converter feeds.
    OSError
        It cannot be written; ``out`` is as it was.
    """
    out, converter = Path(out), config.interface.converter.name
    if out.is_dir() and any(out.iterdir()) and not (out / MARK).exists():
        raise InputError(f"{out}: is a folder with other files in it; give a new folder with `out`")
    if out.exists() and not out.is_dir():
        raise InputError(f"{out}: is a file; give a new folder with `out`")
    if top is not None:
        check_prefix("`top`", top)
        if bus and top in HEADERS.split():
            raise InputError(
                f"`top` {top}: names the driver {top}.h, which would hide another header; give another name"
            )
    if axis and converter != "none":
        raise InputError(f"`streams`: frames come from the converter '{converter}'; leave it out")
    images = rom(config, arrays)
    modules: list[tuple[str, Callable[..., Any]]] = [(TOP, Accelerator)]
    if converter != "none":
        modules.append((SENSING, Sensing))
    if bus or axis:
        system = partial(System, host=bus, source="stream" if axis else None)
        modules.append((f"{PREFIX}_{bus or 'axis'}", system))
    # the last one is the system's and has the name itself
    names = [name for name, _ in modules]
    if top:
        names = [*(f"{top}_{name}" for name in names[:-1]), top]
    with replacing_folder(out) as folder:
        for name, (_, design) in zip(names, modules, strict=True):
            (folder / f"{name}.sv").write_text(verilog(design(config, images), name))
        write_contents(folder, contents(config, arrays))
        (folder / MARK).write_text(json.dumps(register_map(config), indent=2) + "\n")
        registers = entries(config, bus is not None, converter == "none" and not axis)
        prefix = top or PREFIX
        (folder / "registers.h").write_text(prefixed(c_header(config, registers), prefix))
        (folder / "eskin.rdl").write_text(
            system_rdl(registers).replace("addrmap eskin", rf"addrmap \{prefix}")
        )
        if bus:
            for source in DRIVER:
                text = source.read_text().replace('"eskin.h"', f'"{prefix}.h"')
                (folder / f"{prefix}{source.suffix}").write_text(prefixed(text, prefix))
            load = template(__file__, "load.h").render(writes=boot_writes(config, arrays))
            (folder / "load.h").write_text(prefixed(load, prefix))
        if vectors is not None:
            _write_bench(config, folder, Path(vectors), names[0])
        (folder / "filelist.f").write_text(f"{names[-1]}.sv\n")
        lines = WAIVER.read_text().splitlines(keepends=True)
        waived = (
            line.replace("@FILE@", f"{name}.sv")
            for line in lines
            for name in (names if "@FILE@" in line else names[:1])
        )
        (folder / WAIVER.name).write_text("".join(waived))
        core = template(__file__, "eskin.core").render(top=names[-1], release=version("eskin"))
        (folder / "eskin.core").write_text(core)
    return out


def contents(config: AcceleratorConfig, arrays: Arrays) -> dict[str, str]:
    """The files by which a design's model is known, by name: config.json, memories/*.hex and load.hex."""
    files = {"config.json": config.to_json(model_hash(config, arrays))}
    for select, words in memory_images(config, arrays).items():
        width = 16 * words_per_entry(config, select)
        files[f"memories/{memory_name(config, select)}.hex"] = _hex(words, width)
    loaded = [address << 16 | word for address, word in boot_writes(config, arrays)]
    return files | {"load.hex": _hex(loaded, 24)}


def write_contents(folder: Path, files: dict[str, str]) -> None:
    """Write the files of `contents`."""
    for name, text in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)


def boot_writes(config: AcceleratorConfig, arrays: Arrays) -> list[tuple[int, int]]:
    """(register, word) writes after reset: the whole model, or the mask alone where the memories are ROM."""
    memory = (Register.MEMORY_SELECT, Register.MEMORY_DATA)
    return [
        (int(register), word)
        for register, word in load_writes(config, arrays)
        if config.hardware.loadable or register not in memory
    ]


def register_map(config: AcceleratorConfig) -> Record:
    """The register map as plain values."""
    named = ImageMemory if config.is_image else memories(config)
    words, readout = -(-config.sensor.taxels // 16), config.readout_rule
    return {
        "id": ID_VALUE,
        "version": VERSION_VALUE,
        "versions": list(READABLE_VERSIONS),
        "registers": {
            register.name: int(register)
            for register in (*Register, *interface_registers(config), *teach_registers(config))
        },
        "bits": {
            register: {bit.name: int(bit) for bit in bits}
            for register, bits in (("CONTROL", Control), ("STATUS", Status), ("FAULTS", Fault))
        },
        "measures": {measure.name: int(measure) for measure in Measure},
        "memories": {
            **({} if config.is_forest else {"WEIGHTS0" if config.is_image else "LANE0": 0}),
            **{memory.name: int(memory) for memory in named},
        },
        # words of each register that is read behind a recording
        "behind": dict.fromkeys(("FAULTS", "LONGEST", "STATUS", "TOUCHES", "VERSION"), 1)
        | {"TAXEL_FAULTS": words * (config.faults.fault_frames > 0), "TAUGHT": int(readout.taught > 0)},
        "longest_step": longest_step(config),
        "step_cycles": step_cycles(config),
        "lanes": config.hardware.lanes,
        "mask_words": words,
    }


def c_header(config: AcceleratorConfig, registers: Iterable[Entry] | None = None) -> str:
    """The register map as a C header: ``registers`` (default: the accelerator's own) and fields, bits,
    measures, memories."""
    values = {
        "flags": {"CONTROL": Control, "STATUS": Status, "FAULT": Fault, "EVENT": Event},
        "memories": ImageMemory if config.is_image else memories(config),
        "ID_VALUE": ID_VALUE,
        "VERSION_VALUE": VERSION_VALUE,
        "Measure": Measure,
    }
    return written("registers.h", registers or entries(config), config=config, **values)


def _hex(words: Iterable[int], bits: int) -> str:
    digits = -(-bits // 4)
    return "".join(f"{int(word) & (1 << bits) - 1:0{digits}x}\n" for word in words)


def pack_decision(config: AcceleratorConfig, row: Iterable[int]) -> int:
    """The payload of a decision row (is_global, step, class, margin, partial, unsure)."""
    is_global, step, label, margin, partial, unsure = (int(value) for value in row)
    flags = is_global << 29 | partial << 30 | unsure << 31
    if not config.wide_decisions:
        return label | margin << 5 | step << 21 | flags
    units = margin if is_global and config.network.decision == "vote" else margin >> 2
    return label | step << 7 | units << 15 | flags


def _write_bench(config: AcceleratorConfig, folder: Path, vectors: Path, module: str) -> None:
    """The bench, its Makefile, and the first recording of ``vectors`` with decisions as words."""
    stages = ("map", "logit") if config.is_image else ("sum", "fault", "feature", "state", "logit")
    with np.load(vectors) as archive:
        arrays = {name: archive[name][: archive[f"{name}_offsets"][1]] for name in stages}
        rows = archive["decision"][: archive["decision_offsets"][1]]
        arrays["samples"] = archive["samples"][: archive["offsets"][1]]
        faults = Fault.TAXEL * archive["flags"][0].any() if "flags" in archive else 0
        state = archive["status"][0], archive["touches"][0] % 256
        arrays["end"] = np.array([ID_VALUE, VERSION_VALUE, *state, faults])
    words = np.array([pack_decision(config, row) for row in rows], np.uint32)
    np.savez_compressed(folder / "vectors.npz", allow_pickle=False, decision=words.view(np.int32), **arrays)
    (folder / BENCH.name).write_text(BENCH.read_text())
    (folder / "Makefile").write_text(MAKEFILE.read_text().replace("@MODULE@", module))
