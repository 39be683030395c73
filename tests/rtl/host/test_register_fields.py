"""Every field of every register: written and read in the simulated design, as its description says."""

import re

import numpy as np
import pytest

from eskin.golden.core import PRESETS, ConverterFault
from eskin.golden.model import codes_of, random_integer_model, random_recordings, run, samples_of
from eskin.golden.model.decision_word import decision_word
from eskin.golden.model.position import positions
from eskin.rtl.fpga.generate import generate
from eskin.rtl.program.memory_map import (
    NO_DECISION,
    Control,
    Event,
    Fault,
    InterfaceRegister,
    Measure,
    Memory,
    Register,
    ShellRegister,
    Status,
    interface_registers,
)
from eskin.rtl.program.register_files import entries
from eskin.rtl.program.schedule import step_cycles
from tests.rtl.host.test_driver import CONFIG
from tests.support.driver_board import Board


@pytest.mark.timeout(1800)
def test_every_field_does_what_its_description_says(tmp_path):
    """Each field is written and read in simulation, with what else its access does."""
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
        return board.read(4 * register)

    def put(register, word):
        board.write(4 * register, word)

    def irq():
        return board.device.get("irq")

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
    assert board.driver.load()

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
    assert not get(ShellRegister.NEXT_TAXEL) >> 31  # ended by the read that showed it
    put(ShellRegister.SAMPLE, 0)
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
    holds("NEXT_TAXEL.REFUSED", get(ShellRegister.NEXT_TAXEL) >> 31)
    assert word == expected[0]

    # the same with an interrupt; global decisions alone; two measures
    put(ShellRegister.ENABLE, Event.GLOBAL)
    raised, events = [], []
    board.driver("arm")
    put(Register.MEASURE, Measure.FRAME)
    words = []
    for frame in frames:
        words += board.driver.frame(frame)
        events.append(get(ShellRegister.EVENTS))
        raised.append(irq())
        words += board.driver.decisions()
    board.driver("finish")
    settle()
    words += board.driver.decisions()
    for name in ("CLASS", "STEP", "MARGIN", "GLOBAL", "PARTIAL", "UNSURE"):
        holds(f"DECISION.{name}", words == expected)
    holds("EVENTS.GLOBAL", 0 < sum(bool(bits & Event.GLOBAL) for bits in events) < len(events))
    holds("ENABLE.GLOBAL", raised == [bool(bits & Event.GLOBAL) for bits in events])
    longest = get(Register.LONGEST)
    put(Register.MEASURE, Measure.STEP)
    holds("MEASURE.KIND", longest and get(Register.LONGEST) == 0)
    board.driver("enable", 0, 1)
    assert board.driver.play(frames, irq) == [word for word in expected if word >> 29 & 1]
    holds("ENABLE.GLOBAL_ONLY", get(ShellRegister.ENABLE) == 1 << 8)
    step = get(Register.LONGEST)
    holds("LONGEST.VALUE", 0 < step <= step_cycles(config) and step != longest)
    get(0x3F)
    holds("FAULTS.ADDRESS", get(Register.FAULTS) & Fault.ADDRESS)
    put(Register.CONTROL, Control.CLEAR_FAULTS)
    holds("CONTROL.CLEAR_FAULTS", get(Register.LONGEST) == get(Register.FAULTS) == 0)
    put(ShellRegister.ENABLE, 0)

    # an open touch that ends
    board.driver("arm")
    words = []
    for frame in frames:
        words += board.driver.frame(frame) + board.driver.decisions()
        if words:
            break
    board.driver("finish")
    settle()
    words += board.driver.decisions()
    holds("CONTROL.FINISH", words[-1] >> 29 & 3 == 3 and not get(Register.STATUS) & Status.TOUCH)

    # a wrong word, the right one again from the first place on
    lane = [int(line, 16) for line in (tmp_path / "design" / "memories" / "lane0.hex").read_text().split()]
    for wrong in (1, 0):
        board.driver("arm")
        settle()
        put(Register.MEMORY_SELECT, 0)
        put(Register.MEMORY_DATA, lane[0] ^ wrong)
        put(Register.MEMORY_DATA, lane[1])
        decisions = board.driver.play(frames, irq)
        raised = bool(get(Register.FAULTS) & Fault.CHECKSUM), bool(get(Register.STATUS) & Status.FAULT)
        assert raised == (bool(wrong),) * 2 and (wrong or decisions == expected)
    for field in ("MEMORY_SELECT.VALUE", "MEMORY_DATA.VALUE", "FAULTS.CHECKSUM", "STATUS.FAULT"):
        told.add(field)

    # a taxel out of use changes nothing; one that is stuck is told
    stuck = [[*frame[:2], 7, *frame[3:]] for frame in frames]
    put(Register.MASK, 1 << 2)
    holds("MASK.VALUE", board.driver.play(frames, irq) == board.driver.play(stuck, irq) != expected)
    put(Register.MASK, 0)
    board.driver.play(stuck, irq)
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


class Chips:
    """One AD7476 a taxel at the pins of a Verilated design, cycle by cycle, and its stimulator's line.

    codes: of the frame under way. broken: they answer with ones, zeros included. frames: begun so far. levels: of
    the line, one a cycle.
    """

    def __init__(self, device):
        self.device, self.codes, self.broken, self.frames = device, np.zeros(16, int), False, 0
        self._words, self._place, self._was, self.levels = 0, 0, (1, 1), []

    def cycle(self, count=1):
        device = self.device
        for _ in range(count):
            device.cycle()
            self.levels.append(device.get("stim_tx"))
            select, clock = device.get("pins__cs_n"), device.get("pins__sclk")
            if self._was[0] and not select:
                self.frames += 1
                self._words, self._place = list(map(int, self.codes)), 15
            elif self._was[1] and not clock and self._place:
                self._place -= 1
            self._was = (select, clock)
            bits = [1 if self.broken else word >> self._place & 1 for word in self._words or [0] * 16]
            device.put("pins__miso", sum(bit << line for line, bit in enumerate(bits)))

    def frame(self, codes):
        """The next frame is of these codes, and is told."""
        self.codes, before = codes, self.frames
        while self.frames == before:
            self.cycle()
        self.cycle(220)  # of 307

    def sent(self, bit_cycles=8):
        """Bytes of the stimulator's line since the last call."""
        levels, said, at = self.levels, b"", 0
        while at + 10 * bit_cycles <= len(levels):
            if levels[at]:
                at += 1
                continue
            bits = levels[at + bit_cycles * 3 // 2 : at + 9 * bit_cycles : bit_cycles]
            said, at = said + bytes([sum(bit << n for n, bit in enumerate(bits))]), at + 9 * bit_cycles
        self.levels = []
        return said


@pytest.mark.slow
def test_every_field_beside_the_accelerator_does_what_its_description_says(tmp_path):
    """Position, converter's faults and stimulator's settings behind a bus, with chips at the converter's pins and the
    stimulator's line read."""
    config = PRESETS["thesis"].replace(
        hidden=4,
        lanes=1,
        converter="ad7476",
        clock_hz=8 * 115200.0,
        position=True,
        position_rest=0,
        position_threshold=1000,
        stimulator="positions",
        hold_s=0.05,
    )
    model = random_integer_model(config, 3)
    config, interface, told = model.config, model.config.interface, set()
    board = Board(generate(config, model.arrays, tmp_path / "design", bus="wishbone"))
    chips = Chips(board.device)

    def holds(field, condition):
        assert condition, field
        told.add(field)

    def get(register):
        return board.read(4 * register)

    # settings, before any scan: as configured, then as written, the amplitude at most 255
    names = ("amplitude", "delay", "frequency", "width")
    settings = {name: InterfaceRegister[f"STIM_{name.upper()}"] for name in names}
    for name, register in settings.items():
        assert get(register) == getattr(interface, f"stim_{name}")
        for word, read in ((0x100, 255 if name == "amplitude" else 0x100), (17, 17)):
            board.write(4 * register, word)
            holds(f"{register.name}.VALUE", get(register) == read)
    assert get(InterfaceRegister.POSITIONS) == get(InterfaceRegister.CONVERTER_FAULTS) == 0

    # a touch of two cells that slides down the third column, and ends
    scene = np.full((8, 4, 4), 400)  # below the threshold; all 0 would be a converter that is stuck
    for number, row in ((2, 0), (3, 1), (4, 2), (5, 3)):
        scene[number, row, 2], scene[number, row, 3] = 9000, 3000
    codes = codes_of(scene.reshape(8, 16), config)
    expected = positions(samples_of(codes, config), config)
    assert [position.ended for position in expected] == [False] * 4 + [True]
    board.driver("arm")
    rows = []
    chips.sent()
    for frame in codes:
        chips.frame(frame)
        rows.append([get(register) for register in list(InterfaceRegister)[:3]])
    for count, position in enumerate(expected, 1):
        place, peak, number = rows[position.frame]
        assert number == count
        holds("POSITION.X", place & 255 == position.x)
        holds("POSITION.Y", place >> 8 == position.y)
        holds("POSITION_PEAK.CELL", peak & 255 == position.peak)
        holds("POSITION_PEAK.DIRECTION", peak >> 8 & 7 == position.direction)
        holds("POSITION_PEAK.ENDED", peak >> 11 & 1 == position.ended)
    assert expected[-1].direction
    holds("POSITIONS.VALUE", rows[-1][2] == len(expected))
    board.driver("arm")
    assert get(InterfaceRegister.POSITIONS) == 0

    # what was written is what the stimulator gets, up to the limits of the bitstream
    for word in (17, 0xFFFF):
        for _ in range(200):  # until the line rests
            chips.frame(codes[0])
        for register in settings.values():
            board.write(4 * register, word)
        chips.sent()
        for _ in range(60):
            chips.frame(codes[2])
        said = chips.sent()
        for name, frame in (("delay", b"SD"), ("frequency", b"SF"), ("width", b"SW")):
            body = re.search(b">" + frame + b";(.{2,4}?)<", said, re.DOTALL)
            wanted = min(word, getattr(interface, f"{name}_limit"))
            assert body and int.from_bytes(body[1], "big") == wanted, (name, said)
        banks = re.search(b">C1;(.{16})<>C2;(.{16})<", said, re.DOTALL)
        assert banks and max(banks[1] + banks[2]) == min(word, interface.amplitude_limit)

    # ones all the way: a bit that the data sheet fixes is wrong, and every code at the end of its range
    chips.broken = True
    chips.frame(codes[0])
    chips.frame(codes[0])
    faults = get(InterfaceRegister.CONVERTER_FAULTS)
    assert faults == ConverterFault.STUCK | ConverterFault.ORDER
    chips.broken = False
    chips.frame(codes[2])
    chips.frame(codes[2])
    assert get(InterfaceRegister.CONVERTER_FAULTS) == faults
    board.driver("clear_faults")
    holds("CONVERTER_FAULTS.VALUE", get(InterfaceRegister.CONVERTER_FAULTS) == 0)
    assert told == {
        f"{register.name}.{field}"
        for register in interface_registers(config)
        for field in register.fields or ("VALUE",)
    }
