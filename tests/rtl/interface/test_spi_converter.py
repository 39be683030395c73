"""rtl/interface/spi_converter.py: a frame's codes at their taxels, and each kind of wrong answer."""

import random

from eskin.golden.core import PRESETS, ConverterFault, converter_plan
from eskin.rtl.interface.spi_converter import SpiConverter
from tests.support.converter_bench import play_frames
from tests.support.spi_chip import SpiSlave
from tests.support.table import each_row

SLOW = PRESETS["thesis"].replace(clock_hz=2e6, sample_rate_hz=500.0)
"""A clock at which half a period has the fewest cycles."""
CONFIGS = {
    name: SLOW.replace(**fields)
    for name, fields in {
        "ads7953": dict(converter="ads7953"),
        "mcp3208x2": dict(converter="mcp3208x2"),
        "in series": dict(converter=dict(name="mcp3208x2", data_lines=1)),
        "ad7476": dict(converter="ad7476"),
        "ad7476 in series": dict(converter=dict(name="ad7476", data_lines=1)),
        "spi": dict(
            converter=dict(
                name="spi", frame_bits=24, channels=4, channel_bit=20, code_bit=2, delay=1, tag_bits=2
            )
        ),
    }.items()
}
ASLEEP = [f"{name}, asleep" for name in ("ads7953", "ad7476", "ad7476 in series")]
"""The others sleep without another plan."""


def plan_of(name: str):
    """The plan of one of CONFIGS, or that by which its chips sleep between scans."""
    plan = converter_plan(CONFIGS[name.removesuffix(", asleep")])
    return plan.sleeping if name.endswith("asleep") else plan


INSIDE = [700 + k for k in range(16)]


def frame_of(name: str, codes: list[int], spoil=lambda word, select, line, channel: word, count: int = 1):
    """(the last frame, chips) of ``count`` frames; ``spoil`` changes what a line says."""
    plan = plan_of(name)
    chip = plan.chip
    dut, channels, transfer = SpiConverter(plan, 16), plan.chip.channels, [-1]

    def answer(line, fell):
        transfer[0] += line == 0
        select = fell.bit_length() - 1
        channel = transfer[0] % plan.per_select - plan.first
        counts = 0 <= channel < channels
        place = (select * plan.lines + line) * channels + channel
        code = codes[place] if counts else random.getrandbits(chip.code_bits)
        tag = (channel if counts else 9) << chip.tag_bit & (1 << chip.tag_bits + chip.tag_bit) - 1
        return spoil(code << chip.code_bit | tag, select, line, channel)

    chips = SpiSlave(dut.pins, chip.bits, answer, late=plan.half > 1)
    frames = play_frames(dut, chips, count)
    assert {frame.cycles for frame in frames} == {plan.scan_cycles}
    return frames[-1], chips


@each_row("name", [*CONFIGS, *ASLEEP])
def test_every_code_at_its_taxel_and_a_stuck_line_is_a_fault(name):
    plan = plan_of(name)
    chip = plan.chip
    codes = random.Random(name).choices(range(1, 4095), k=16)
    frame, chips = frame_of(name, codes, count=2)
    assert frame.codes == dict(enumerate(codes)) and not frame.fault
    last = {plan.per_select - 1: plan.short or chip.bits}  # of a select
    clocks = [last.get(number % plan.per_select, chip.bits) for number in range(len(plan.transfers))]
    words = zip(plan.transfers, clocks, strict=True)
    assert chips.heard == 2 * [(1 << group, count, command) for (group, command), count in words]
    stuck = range(16) if name.startswith("ad7476") else [plan.lines - 1]
    for level in (0, (1 << chip.bits) - 1):

        def spoil(word, select, line, channel, level=level):
            return level if line in stuck else word

        fault = frame_of(name, INSIDE, spoil)[0].fault
        assert ConverterFault.STUCK in fault
        assert (ConverterFault.ORDER in fault) == bool(chip.tag_bits or (level and chip.zeros))


def test_commands_are_those_of_the_data_sheets():
    ads, mcp = (
        [command for _, command in converter_plan(CONFIGS[name]).transfers]
        for name in ("ads7953", "mcp3208x2")
    )
    assert ads == [0x1800 | channel << 7 for channel in range(16)] + [0, 0]
    asleep = [command for _, command in plan_of("ads7953, asleep").transfers]
    # power-down with the last word but one, in effect at the end of the last, which leaves it as it is
    assert asleep == [*ads[:-2], 0x1820, 0]
    woken = plan_of("ad7476 in series, asleep")
    assert len(woken.transfers) == 16 * 3 and (woken.waking, woken.short) == (1, 6)
    assert plan_of("mcp3208x2, asleep") == plan_of("mcp3208x2")
    assert [f"{command:019b}"[:5] for command in mcp] == [f"11{channel:03b}" for channel in range(8)]


STUCK, ORDER = ConverterFault.STUCK, ConverterFault.ORDER
SPOILED = [
    *(
        ("in series", INSIDE, lambda w, s, l, c, chip=chip, end=end: end if s == chip else w, STUCK)
        for chip in (0, 1)
        for end in (0, 0xFFF)
    ),
    # one taxel at its end is no fault
    *(
        (name, [0, 4095, *INSIDE[2:]], lambda w, s, l, c: w, ConverterFault(0))
        for name in ("ad7476", "ad7476 in series")
    ),
    # all of them are one; the last transfer, which has no code, changes nothing
    *(("ad7476, asleep", INSIDE, lambda w, s, l, c, end=end: end, STUCK) for end in (0, 0xFFF)),
    ("mcp3208x2", [0] * 7 + INSIDE[7:], lambda w, s, l, c: w, ConverterFault(0)),
    # a wrong number and a wrong null bit
    *(
        ("ads7953", INSIDE, lambda w, s, l, c, at=at: w ^ 0x2000 if c == at else w, ORDER)
        for at in (0, 5, 15)
    ),
    ("mcp3208x2", INSIDE, lambda w, s, l, c: w | 1 << 12 if (l, c) == (1, 7) else w, ORDER),
]


@each_row("name, codes, spoil, fault", SPOILED)
def test_what_a_chip_says_wrongly_is_told(name, codes, spoil, fault):
    assert frame_of(name, codes, spoil)[0].fault == fault
