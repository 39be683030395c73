"""rtl/interface/sample_narrower.py against the golden conversion, every code of 12 bits and the ends of wider
ones."""

import numpy as np

from eskin.golden.core import PRESETS
from eskin.golden.core.converters import code_bits
from eskin.golden.model import codes_of, samples_of
from eskin.rtl.interface.sample_narrower import SampleNarrower
from tests.support.stream_bench import simulate
from tests.support.table import each_row

FORMS = {
    "full scale": dict(),
    "signed": dict(sample_signed=True),
    "offset, zeros appended": dict(converter=dict(name="ads7953", code_offset=700, code_shift=-5)),
    "narrower, rounded": dict(converter=dict(name="ads7953", code_offset=-3, code_shift=3)),
    "offset without shift": dict(converter=dict(name="ads7953", code_offset=-27352, code_shift=0)),
    "20 bits, zero at 4096": dict(
        converter=dict(
            name="spi", frame_bits=28, channel_bit=24, code_bits=20, code_offset=4096, code_shift=4
        )
    ),
}


@each_row("name", FORMS)
def test_it_equals_the_golden_conversion(name):
    config = (
        PRESETS["fabric"].replace(sample_signed=False).replace(**(dict(converter="ads7953") | FORMS[name]))
    )
    top = 1 << code_bits(config)
    codes = np.unique(
        np.concatenate(
            [np.arange(0, 1500), np.arange(0, top, max(1, top // 3000)), np.arange(top - 1500, top)]
        )
    )
    dut, got = SampleNarrower(config), []

    async def play(ctx):
        for code in codes:
            ctx.set(dut.code, int(code))
            got.append(ctx.get(dut.sample))

    simulate(dut, play)
    assert got == samples_of(codes, config).tolist()


def test_a_code_of_a_sample_is_the_nearest_and_the_way_back_is_exact():
    config = PRESETS["thesis"].replace(converter="ads7953")
    samples = np.arange(0, 65536, 7)
    back = samples_of(codes_of(samples, config), config)
    assert np.abs(back - samples)[samples < 65528 - 8].max() <= 8
    codes = np.arange(4096)
    assert (codes_of(samples_of(codes, config), config) == codes).all()
    config = PRESETS["pvdf"].replace(converter=dict(name="ads7953", code_offset=-27352, code_shift=0))
    assert samples_of(codes_of(np.array([27352, 29000, 31447, 40000]), config), config).tolist() == [
        27352,
        29000,
        31447,
        31447,
    ]
