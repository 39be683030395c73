"""eskin/study/energy.py: the data sheet's power times chips and seconds, and nothing where no
figure was read."""

import pytest

from eskin.golden.core import PRESETS
from eskin.golden.core.converters import CONVERTERS
from eskin.study.energy import converter_power, in_words
from tests.support.table import each_row

THESIS = PRESETS["thesis"].replace(feature_shift=(10, 9))


@each_row("name, count", [("ads7953", 1), ("mcp3208x2", 2), ("ad7476", 16)])
def test_chips_times_power_times_the_touch(name, count):
    power = converter_power(THESIS.replace(converter=name))
    assert power.chips == count and power.power_w == pytest.approx(count * CONVERTERS[name].watt)
    assert power.per_touch_j == pytest.approx(power.power_w * 6144 / 3000) and "not measured" in in_words(
        power
    )
    half = converter_power(THESIS.replace(converter=name, scan_every=2))
    assert half.scanning_w == pytest.approx(power.scanning_w / 2) and 0 < half.scanning_w < power.power_w / 2


def test_without_a_figure_or_a_converter_nothing_is_made_up():
    assert converter_power(THESIS) is None
    power = converter_power(THESIS.replace(converter="ddc232", clock_hz=20e6))
    assert power.power_w is None is power.per_touch_j
    assert in_words(power) == "ddc232: no figure of its data sheet at hand"
