"""rtl/host/driver: the C driver, as compilers see it, and as it plays recordings into the Verilated shell."""

from __future__ import annotations

import ctypes
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from eskin.cosim.device import Design, Device
from eskin.golden.core.config import PRESETS
from eskin.golden.model.decision_word import decision_word
from eskin.golden.model.model import random_integer_model
from eskin.golden.model.pipeline import run
from eskin.golden.model.prototypes import forget, taught_in_use
from eskin.golden.model.stream import Stream
from eskin.golden.model.vectors import random_recordings
from eskin.rtl.fpga.generate import generate
from eskin.rtl.program.memory_map import Event, Fault, Register
from tests.golden.model.test_prototypes import taught_model
from tests.support.touch_scenes import scene

CONFIG = PRESETS["thesis"].replace(
    taxels=5,
    feature_shift=(),
    hidden=4,
    steps=12,
    hop=60,
    window=120,
    touch_frames=800,
    lanes=1,
    onset_threshold=5,
)
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic")
BUILDS = Path("build") / "driver_builds"
FIELDS = ("cls", "step", "margin", "global_", "partial", "unsure")
READ = ctypes.CFUNCTYPE(ctypes.c_uint32, ctypes.c_void_p, ctypes.c_uint32)
WRITE = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_uint32, ctypes.c_uint32)


class Handle(ctypes.Structure):
    _fields_ = [
        ("base", ctypes.c_void_p),
        ("read", READ),
        ("write", WRITE),
        ("context", ctypes.c_void_p),
        ("next", ctypes.c_uint32),
    ]


class Decision(ctypes.Structure):
    _fields_ = [(name, ctypes.c_uint16 if name == "margin" else ctypes.c_uint8) for name in FIELDS]


@pytest.fixture(scope="module")
def model():
    return random_integer_model(CONFIG, 3)


@pytest.fixture(scope="module")
def design(model, tmp_path_factory):
    return generate(model.config, model.arrays, tmp_path_factory.mktemp("driver") / "design", bus="wishbone")


def compiled(folder, *command):
    source = '#include "load.h"\n#include "eskin.h"\nsize_t size(void);\nsize_t size(void) { return sizeof eskin_load; }\n'
    (folder / "user.c").write_text(source)
    for name in ("eskin.c", "user.c"):
        done = subprocess.run(
            [*command, *STRICT, "-c", name, "-o", f"{name}.o"], cwd=folder, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("command", [("gcc",), ("g++", "-x", "c++", "-std=c++17")], ids=["c", "c++"])
def test_compiles_without_a_warning(design, command):
    options = [option for option in STRICT if not ("++" in command[0] and option.startswith("-std"))]
    for name in ("eskin.c",):
        call = [*command, *options, "-c", name, "-o", "out.o"]
        done = subprocess.run(call, cwd=design, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    if command == ("gcc",):
        compiled(design, "gcc", "-ffreestanding")


@pytest.mark.parametrize("target", ["riscv32-freestanding", "thumb-freestanding"])
def test_compiles_for_small_processors(design, target):
    pytest.importorskip("ziglang", reason="ziglang (extra soc) is not installed")
    cpu = "generic_rv32" if "riscv" in target else "cortex_m0plus"
    compiled(
        design, sys.executable, "-m", "ziglang", "cc", "-target", target, f"-mcpu={cpu}", "-ffreestanding"
    )


class Board:
    """The Verilated shell behind the driver's read and write functions: Wishbone cycles at its ports."""

    def __init__(self, folder):
        verilog = (folder / "eskin_wishbone.sv").read_text()
        self.device = Device(Design(verilog, BUILDS, "this test", top="eskin_wishbone"))
        self.device.reset()
        library = folder / "eskin.so"
        subprocess.run(["gcc", *STRICT, "-shared", "-fPIC", "eskin.c", "-o", library], cwd=folder, check=True)
        self.driver = ctypes.CDLL(str(library))
        self.refused = 0
        self.handle = Handle(None, READ(self.read), WRITE(self.write), None, 0)
        words = [int(line, 16) for line in (folder / "load.hex").read_text().split()]
        self.load = (ctypes.c_uint32 * len(words))(*words)

    def __call__(self, name, *arguments):
        return getattr(self.driver, f"eskin_hw_{name}")(ctypes.byref(self.handle), *arguments)

    def _access(self, offset, word):
        put, device = self.device.put, self.device
        for name, value in (
            ("cyc", 1),
            ("stb", 1),
            ("we", word is not None),
            ("adr", offset),
            ("sel", 15),
            ("dat_w", word or 0),
        ):
            put(f"wb_{name}", int(value))
        for _ in range(5000):
            device.cycle()
            if device.get("wb_ack"):
                break
        else:
            raise AssertionError(f"no answer at {offset:#x}")
        value = device.get("wb_dat_r")
        device.cycle()
        put("wb_stb", 0)
        return value

    def read(self, context, offset):
        return self._access(offset, None)

    def write(self, context, offset, word):
        self._access(offset, word)

    def decisions(self):
        """Those that wait, as words."""
        found, words = Decision(), []
        while self("decision", ctypes.byref(found)):
            place = zip((0, 7, 15, 29, 30, 31), FIELDS, strict=True)
            words.append(sum(getattr(found, name) << low for low, name in place))
        return words

    def play(self, frames, lazy=False):
        """Decisions of a recording; ``lazy``: they are taken only when the device takes no more frames."""
        words = []
        self("arm")
        for frame in frames:
            codes = (ctypes.c_uint16 * len(frame))(*(int(code) & 0xFFFF for code in frame))
            while not self("frame", codes):
                self.refused += 1
                words += self.decisions()
            if not lazy and self.device.get("irq"):
                words += self.decisions()
        self("finish")
        while self("busy"):
            words += self.decisions()
        return words + self.decisions()


@pytest.mark.parametrize("lazy", [False, True], ids=["interrupt", "lazy"])
def test_recordings_decide_as_the_model_does(model, design, lazy):
    length = CONFIG.rest_level.rest_frames + CONFIG.last_frame + 4 * CONFIG.windows.hop
    recordings = random_recordings(model.config, [length, length // 2, length, length], 5)
    rows, offsets = run(model, recordings).streams["decision"]
    board = Board(design)
    assert board("present")
    board("load", board.load, len(board.load))
    board("enable", Event.DECISION, 0)
    count = 0
    for number in range(len(recordings)):
        samples = recordings.samples[slice(*recordings.offsets[number : number + 2])]
        expected = [decision_word(model.config, row) for row in rows[slice(*offsets[number : number + 2])]]
        assert board.play(samples, lazy) == expected
        count += len(expected)
        assert not board("faults") & ~(Fault.OVERRUN if lazy else 0)
    assert count == len(rows) and bool(board.refused) == lazy
    board("enable", 0, 0)
    board.device.cycle(4)
    assert not board.device.get("irq")


def test_registers_are_as_the_files_describe_them(design):
    """Reset values, what reads as 0, what holds what was written, and that no other address is a register."""
    board = Board(design)
    described = set()
    for register in ElementTree.parse(design / "eskin.svd").getroot().iter("register"):
        offset, access = int(register.findtext("addressOffset"), 16), register.findtext("access")
        mask, reset = (int(register.findtext(name), 16) for name in ("resetMask", "resetValue"))
        described.add(offset)
        value = board.read(None, offset)
        assert value & mask == reset & mask if "read" in access else value == 0, register.findtext("name")
        if access == "read-write":
            fields = [field.findtext("bitRange").strip("[]").split(":") for field in register.iter("field")]
            bits = sum((2 << int(high)) - (1 << int(low)) for high, low in fields)
            board.write(None, offset, 0xFFFFFFFF)
            assert board.read(None, offset) == bits
            board.write(None, offset, 0)
        elif access == "read-only" and offset != 4 * Register.FAULTS:
            board.write(None, offset, 0xFFFFFFFF)
            assert board.read(None, offset) & mask == value & mask
    assert not board("faults") & ~Fault.WRITE_REFUSED
    for offset in range(0, 512, 4):
        if offset not in described:
            board("clear_faults")
            assert board.read(None, offset) == 0
            assert board("faults") == (Fault.ADDRESS if offset < 0x100 else 0), hex(offset)


def test_touches_are_taught_and_forgotten_through_the_driver(tmp_path):
    model = forget(taught_model("gru"))
    board = Board(generate(model.config, model.arrays, tmp_path / "design", bus="wishbone"))
    board("load", board.load, len(board.load))
    stream, recordings = Stream(model), scene(12, seed=6)
    seen = []
    for index in range(2, 12):
        stream.arm()
        if index == 4:
            board("teach", 2, 1)
            stream.teach(2, following=True)
        samples = recordings.recording(index)
        expected = [*stream.push(samples), *stream.finish()]
        words = [decision_word(model.config, decision.row()) for decision in expected]
        assert board.play(samples) == words
        seen += words
        label = index % 3
        if index == 9:
            board("forget", label, 0)
            stream.forget(label)
        else:
            board("teach", label, 0)
            stream.teach(label)
        while board("busy"):
            pass
        assert board("taught") == taught_in_use(stream.model).sum() and not board("teaching_refused")
    board("teach", 3, 0)  # no such class
    assert board("teaching_refused") and len(seen) > 60
    board("forget", 0, 1)
    assert board("taught") == 0
