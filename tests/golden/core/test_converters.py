"""Converters that cannot keep up with their frames are refused, with the highest rate that works."""

import pytest

from eskin.golden.core import PRESETS
from tests.support.small_designs import with_converter
from tests.support.table import each_row, refused

BIG = with_converter("matrix", taxels=160, rows=16, columns=10)
MPR = with_converter("mpr121", taxels=117, rows=13, columns=9)
DDC_FAST = dict(clock_hz=20e6)
REFUSED = [
    (
        with_converter("mcp3208x2", data_lines=1),
        r"16 transfers of 2 chips in series at 1 MHz take 320 us, and of 333 us a frame at 3000 Hz 300 may be used.*at most 2811 Hz",
        2811.0,
    ),
    (
        with_converter("ads7953", sample_rate_hz=6000.0),
        "18 transfers at 2 MHz take 152 us.*at most 5937 Hz",
        5937.0,
    ),
    (
        with_converter("spi", channel_bit=0),
        "field converter.channel_bit: is 0 with the code's first bit at 11",
        None,
    ),
    (with_converter("mcp3208x2", taxels=40), "two chips have 16 channels", None),
    (
        with_converter("ddc232", version="C", **DDC_FAST),
        r"DVALID comes up to 277 us after CONV \(version C at 5 MHz\).*at most 2235 Hz",
        2235.0,
    ),
    (with_converter("ddc232", first=1, **DDC_FAST), "32 words of 20 bits at 2 MHz.*at most 2131 Hz", 2131.0),
    (
        with_converter("ddc232", version="C", clock_hz=12e6, sample_rate_hz=2500.0),
        "a rate of at most 1582 Hz works as it is",
        1582.0,
    ),
    (
        with_converter("ddc232", scan_every=2),
        "scan_every: is 2; a DDC232 integrates from frame to frame",
        None,
    ),
    (
        with_converter("ddc232", sample_rate_hz=7000.0, taxels=32),
        "integrates for 166.5 us at least: give at most 6006",
        1000.0,
    ),
    (
        BIG | dict(sample_rate_hz=300.0),
        r"160 cells of 28.8 us, 20 of them to settle .settle_s., take 4600 us.*; a rate of at most 195 Hz works",
        195.0,
    ),
    (
        MPR | dict(taxels=135, rows=15, sample_rate_hz=100.0),
        "converter.chips: is 1; 15 rows and 9 columns are 13 electrodes and 12 are there",
        None,
    ),
    (BIG | with_converter("mpr121", sample_rate_hz=100.0), "both are odd, or set chips 2", None),
    (
        MPR | with_converter("mpr121", hz=5e4, sample_rate_hz=200.0),
        r"12 electrodes over I2C at 50 kHz take \d+ us.*at most \d+ Hz works as it is",
        145.0,
    ),
    (MPR | dict(clock_hz=12e4, sample_rate_hz=100.0), "over I2C at 10 kHz take 32417 us", 27.0),
    (MPR | dict(sample_rate_hz=260.0), "is 260; an MPR121 has new data 250 times a second", 250.0),
]
"""Fields, the words of the refusal, and the rate that then works."""
SLEEPING = [
    # SCLK at 6 MHz: a transfer takes 1 + 2 * 16 + 2 cycles, and 6 clocks in place of 16 save 20. 10 transfers, of which the
    # chip is awake in 9; 3 of 16 chips in turn; 8 cells, beside them 2 transfers
    (dict(taxels=8, converter="ads7953"), 0.9 * (10 * 35 + 1)),
    (dict(converter=dict(name="ad7476", data_lines=1)), 3 * 35 - 20 + 1 / 16),
    (dict(taxels=8, rows=2, columns=4, converter=dict(name="matrix", settle_s=1e-7)), 8 * (2 + 38) + 2 * 38),
    # with `hz` 3 MHz
    (dict(taxels=8, converter=dict(name="ads7953", hz=3e6)), 0.9 * (10 * (2 + 2 * 2 * 16 + 2) + 1)),
    # a sample in 2, in 4 and in 128 ms: four within 9, 18 and 900 ms
    *(
        (dict(taxels=15, rows=5, columns=3, converter="mpr121", sample_rate_hz=hertz), 12e6 / hertz / often)
        for hertz, often in ((100.0, 2), (50.0, 4), (1.0, 128), (250.0, 1))
    ),
]
"""Fields, and cycles of a frame at 12 MHz in which a chip is awake, by the data sheets."""


@each_row("fields, cycles", SLEEPING)
def test_a_chip_that_sleeps_is_awake_for_so_long(fields, cycles):
    config = PRESETS["thesis"].replace(**{"clock_hz": 12e6, "sample_rate_hz": 100.0} | fields)
    rate = config.sensor.scan_rate_hz
    share = config.interface.converter.plan(config).sleeping.awake(rate / 12e6)
    assert share == pytest.approx(cycles * rate / 12e6, rel=1e-6)


@each_row("fields, words, rate", REFUSED)
def test_what_cannot_keep_up_is_refused(fields, words, rate):
    with refused(words):
        PRESETS["thesis"].replace(**fields)
    if rate:
        PRESETS["thesis"].replace(**fields | dict(sample_rate_hz=rate))
