"""Every field of every register: written and read in the simulated design, as its description says."""

import pytest

from eskin.golden.model import run
from eskin.golden.model.decision_word import decision_word
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
from eskin.training.made_up import random_recordings
from tests.rtl.host.test_driver import CONFIG
from tests.support.driver_board import Board
from tests.support.random_models import random_integer_model


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_every_field_does_what_its_description_says(tmp_path):
    """Each field is written and read in simulation, with what else its access does."""
    config = random_integer_model(
        CONFIG.replace(checksum=True, fault_frames=16, fault_activity=3, decision="vote", scan_every=2), 3
    ).config
    model = random_integer_model(config, 3)
    length = config.rest_level.rest_frames + config.last_frame + 4 * config.windows.hop
    source = random_recordings(config, [length], 5)
    recordings = source.scanned(2)
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

    # every frame of the source
    board.driver("arm_every")
    words = []
    for frame in source.samples.tolist():
        words += board.driver.frame(frame) + board.driver.decisions()
    board.driver("finish")
    settle()
    holds("CONTROL.EVERY", words + board.driver.decisions() == expected)

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
