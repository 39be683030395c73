"""rtl/host/driver: the C driver, as compilers see it, and as it plays recordings into the Verilated shell."""

from __future__ import annotations

import subprocess
import sys
from xml.etree import ElementTree

import pytest

from eskin.golden.core.config import PRESETS
from eskin.golden.data.load import load_recordings
from eskin.golden.model.decision_word import decision_word
from eskin.golden.model.model import random_integer_model
from eskin.golden.model.pipeline import run
from eskin.golden.model.vectors import random_recordings
from eskin.rtl.fpga.generate import generate
from eskin.rtl.program.memory_map import (
    NO_DECISION,
    Control,
    Event,
    Fault,
    Measure,
    Memory,
    Register,
    ShellRegister,
    Status,
)
from eskin.rtl.program.register_files import entries
from eskin.rtl.program.schedule import step_cycles
from tests.support.driver_board import STRICT, Board

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


@pytest.mark.timeout(400)
def test_every_field_does_what_its_description_says(tmp_path):
    """Each field is written and read in simulation, with what else its access does; those of a converter's and the
    stimulator's registers are in tests/rtl/interface."""
    config = random_integer_model(
        CONFIG.replace(checksum=True, fault_frames=16, fault_activity=3, decision="vote"), 3
    ).config
    model = random_integer_model(config, 3)
    length = config.rest_level.rest_frames + config.last_frame + 4 * config.windows.hop
    recordings = random_recordings(config, [length], 5)
    trace = run(model, recordings)
    rows, frames = (
        trace.streams["decision"][0],
        [[int(code) for code in frame] for frame in recordings.samples],
    )
    expected = [decision_word(config, row) for row in rows]
    first, last = (next(number for number, row in enumerate(rows) if row[0] == kind) for kind in (0, 1))
    assert first < last  # local ones and then a global one
    board, told = Board(generate(config, model.arrays, tmp_path / "design", bus="wishbone")), set()

    def holds(field, condition):
        assert condition, field
        told.add(field)

    def get(register):
        return board.read(None, 4 * register)

    def put(register, word):
        board.write(None, 4 * register, word)

    def settle():
        for _ in range(20000):
            if not get(Register.STATUS) & Status.BUSY:
                return
        raise AssertionError("stays busy")

    def play(frames):
        """Give frames and take no decision until it refuses; how many went in."""
        for count, frame in enumerate(frames):
            codes = [*frame, 0]
            for taxel in range(0, config.sensor.taxels, 2):
                put(ShellRegister.SAMPLE_PAIR, codes[taxel] | codes[taxel + 1] << 16)
            if get(ShellRegister.NEXT_TAXEL):
                return count
        return len(frames)

    holds("ID.VALUE", get(Register.ID) == 0xE5C1)
    holds("VERSION.VALUE", get(Register.VERSION) == 5)
    board("load", board.load, len(board.load))

    # samples: one, a pair, the high half behind the last taxel
    put(Register.CONTROL, Control.ARM)
    places = [get(ShellRegister.NEXT_TAXEL)]
    for register in (ShellRegister.SAMPLE, ShellRegister.SAMPLE_PAIR, ShellRegister.SAMPLE_PAIR):
        put(register, 0xFFFF_FFFF if register == ShellRegister.SAMPLE else 0)
        places.append(get(ShellRegister.NEXT_TAXEL))
    holds("NEXT_TAXEL.TAXEL", places == [0, 1, 3, 0])
    holds("EVENTS.SPACE", get(ShellRegister.EVENTS) & Event.SPACE)
    put(ShellRegister.SAMPLE, 0)
    put(Register.CONTROL, Control.ARM)
    board.device.cycle(4)
    holds("CONTROL.ARM", get(ShellRegister.NEXT_TAXEL) == 0)
    settle()
    for status in (Status.ARMED, Status.NO_TOUCH):
        holds(f"STATUS.{status.name}", get(Register.STATUS) & status)

    # a recording whose decisions nobody takes
    assert get(ShellRegister.DECISION) == NO_DECISION
    assert not get(ShellRegister.EVENTS) & (Event.DECISION | Event.GLOBAL | Event.FAULT)
    taken = play(frames)
    assert 0 < taken < len(frames)
    holds("NEXT_TAXEL.REFUSED", get(ShellRegister.NEXT_TAXEL) >> 31)
    holds("EVENTS.DECISION", get(ShellRegister.EVENTS) & Event.DECISION)
    holds("STATUS.BUSY", get(Register.STATUS) & Status.BUSY)
    holds("STATUS.TOUCH", get(Register.STATUS) & Status.TOUCH and not get(Register.STATUS) & Status.NO_TOUCH)
    holds("TOUCHES.COUNT", get(Register.TOUCHES) == 1)
    for event in (Event.SPACE, Event.DECISION):
        put(ShellRegister.ENABLE, event)
        board.device.cycle(3)
        holds(f"ENABLE.{event.name}", board.device.get("irq") == bool(get(ShellRegister.EVENTS) & event))
    put(Register.MEMORY_SELECT, Memory.CONSTANTS)
    put(Register.MEMORY_DATA, 1)
    holds("FAULTS.WRITE_REFUSED", get(Register.FAULTS) & Fault.WRITE_REFUSED)
    holds("EVENTS.FAULT", get(ShellRegister.EVENTS) & Event.FAULT)
    put(ShellRegister.ENABLE, Event.FAULT)
    board.device.cycle(3)
    holds("ENABLE.FAULT", board.device.get("irq"))
    overrun = get(Register.FAULTS)  # which stays as long as windows wait
    put(Register.CONTROL, Control.CLEAR_FAULTS)
    assert get(Register.FAULTS) == Fault.OVERRUN
    word = get(ShellRegister.DECISION)
    assert not get(ShellRegister.NEXT_TAXEL) >> 31 and word == expected[0]

    # the same with an interrupt; global decisions alone; two measures
    put(ShellRegister.ENABLE, Event.GLOBAL)
    irq, events = [], []
    board("arm")
    put(Register.MEASURE, Measure.FRAME)
    words = []
    for frame in frames:
        words += board.frame(frame)
        events.append(get(ShellRegister.EVENTS))
        irq.append(board.device.get("irq"))
        words += board.decisions()
    board("finish")
    settle()
    words += board.decisions()
    for name in ("CLASS", "STEP", "MARGIN", "GLOBAL", "PARTIAL", "UNSURE"):
        holds(f"DECISION.{name}", words == expected)
    holds("EVENTS.GLOBAL", 0 < sum(bool(bits & Event.GLOBAL) for bits in events) < len(events))
    holds("ENABLE.GLOBAL", irq == [bool(bits & Event.GLOBAL) for bits in events])
    longest = get(Register.LONGEST)
    put(Register.MEASURE, Measure.STEP)
    holds("MEASURE.KIND", longest and get(Register.LONGEST) == 0)
    board("enable", 0, 1)
    assert board.play(frames) == [word for word in expected if word >> 29 & 1]
    holds("ENABLE.GLOBAL_ONLY", get(ShellRegister.ENABLE) == 1 << 8)
    step = get(Register.LONGEST)
    holds("LONGEST.VALUE", 0 < step <= step_cycles(config) and step != longest)
    get(0x3F)
    holds("FAULTS.ADDRESS", get(Register.FAULTS) & Fault.ADDRESS)
    put(Register.CONTROL, Control.CLEAR_FAULTS)
    holds("CONTROL.CLEAR_FAULTS", get(Register.LONGEST) == get(Register.FAULTS) == 0)
    put(ShellRegister.ENABLE, 0)

    # an open touch that ends
    board("arm")
    words = []
    for frame in frames:
        words += board.frame(frame) + board.decisions()
        if words:
            break
    board("finish")
    settle()
    words += board.decisions()
    holds("CONTROL.FINISH", words[-1] >> 29 & 3 == 3 and not get(Register.STATUS) & Status.TOUCH)

    # a wrong word, the right one again from the first place on
    lane = [int(line, 16) for line in (tmp_path / "design" / "memories" / "lane0.hex").read_text().split()]
    for wrong in (1, 0):
        board("arm")
        settle()
        put(Register.MEMORY_SELECT, 0)
        put(Register.MEMORY_DATA, lane[0] ^ wrong)
        put(Register.MEMORY_DATA, lane[1])
        decisions = board.play(frames)
        raised = bool(get(Register.FAULTS) & Fault.CHECKSUM), bool(get(Register.STATUS) & Status.FAULT)
        assert raised == (bool(wrong),) * 2 and (wrong or decisions == expected)
    for field in ("MEMORY_SELECT.VALUE", "MEMORY_DATA.VALUE", "FAULTS.CHECKSUM", "STATUS.FAULT"):
        told.add(field)

    # a taxel out of use changes nothing; one that is stuck is told
    stuck = [[*frame[:2], 7, *frame[3:]] for frame in frames]
    put(Register.MASK, 1 << 2)
    holds("MASK.VALUE", board.play(frames) == board.play(stuck) != expected)
    put(Register.MASK, 0)
    board.play(stuck)
    holds("TAXEL_FAULTS.VALUE", get(Register.TAXEL_FAULTS) & 1 << 2)
    holds("FAULTS.TAXEL", get(Register.FAULTS) & Fault.TAXEL)

    # what no CPU behind a bus can bring about: it paces itself, the shell counts taxels, no watchdog here
    holds("FAULTS.OVERRUN", overrun & Fault.OVERRUN)
    for fault in (Fault.INPUT_STALLED, Fault.FRAMING, Fault.WATCHDOG):
        holds(f"FAULTS.{fault.name}", not (overrun | get(Register.FAULTS)) & fault)
    told |= {"SAMPLE.TAXEL", "SAMPLE_PAIR.FIRST", "SAMPLE_PAIR.SECOND"}  # the decisions are of these samples
    assert told == {
        f"{register.name}.{field.name}" for register in entries(config, True) for field in register.fields
    }


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("bus", ["wishbone", "apb", "axi4lite"])
def test_recordings_of_two_data_sets_through_each_bus(bus, shared_data, tmp_path):
    """Ten recordings each, with pauses at random; every decision is the golden model's."""
    for preset, archive in (("pvdf", "pvdf_indent"), ("fabric", "fabric_slide")):
        model = random_integer_model(PRESETS[preset].replace(lanes=1), 3)
        config = model.config
        recordings = load_recordings(shared_data / archive / "recordings.npz", config=config)
        recordings = recordings.subset(recordings.evenly(10))
        rows, offsets = run(model, recordings).streams["decision"]
        board = Board(generate(config, model.arrays, tmp_path / preset, bus=bus), bus, seed=1, pause=0.3)
        board("load", board.load, len(board.load))
        board("enable", Event.DECISION, 0)
        frames = board.device.state.cycle
        for number in range(len(recordings)):
            expected = [decision_word(config, row) for row in rows[slice(*offsets[number : number + 2])]]
            assert board.play(recordings.recording(number), lazy=number % 4 == 3) == expected
        cycles = board.device.state.cycle - frames
        print(
            f"{bus}, {preset}: {len(rows)} decisions equal, {cycles / len(recordings.samples):.1f} cycles a frame"
        )
        assert len(rows)
