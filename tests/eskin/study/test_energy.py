"""The energy estimate: its sums against sums by hand, its bounds, its page."""

import pytest

from eskin.golden.core import PRESETS, InputError
from eskin.golden.core.converters import CONVERTERS
from eskin.study.energy import (
    BATTERY_J,
    PARTS,
    Activity,
    Part,
    Turn,
    bitstream_power,
    counted_activity,
    estimate,
)
from eskin.verbs.energy import measured_power
from tests.support.table import each_row

CONFIG = PRESETS["thesis"].replace(feature_shift=(10, 9))
ACTIVITY = Activity(
    step_cycles=200,
    step_toggles=30_000,
    step_multiplies=1_200,
    touch_frames=6144,
    frame_cycles=16,
    quiet_frame_cycles=12,
    frame_toggles=900,
    idle_toggles=3,
    source="made up",
    recordings=2,
)
PART = Part(
    name="made",
    static_w=100e-6,
    clock_j=50e-12,
    toggle_j=0.2e-12,
    multiply_j=20e-12,
    oscillator_w={1e6: 300e-6, 6e6: 500e-6},
    starting_w=40e-6,
    boot_j=1e-3,
    band=2.0,
    rests_on="a test",
)


def test_a_step_a_touch_and_the_powers_are_the_sums_by_hand():
    energy = estimate(CONFIG, PART, ACTIVITY, 2e6)
    step = 200 * 50e-12 + 30_000 * 0.2e-12 + 1_200 * 20e-12
    assert energy.per_step_j == pytest.approx(step, rel=1e-12) == pytest.approx(40e-9)
    assert energy.per_touch_j == pytest.approx(20 * step)
    frame = 16 * 50e-12 + 900 * 0.2e-12
    assert energy.preprocessing_per_touch_j == pytest.approx(6144 * frame)
    on, stopped, own = energy.choices  # 1 MHz of its own would be too slow
    added = 20 * (step - 200 * 50e-12)
    idle = 100e-6 + 2e6 * (50e-12 + 3 * 0.2e-12) + 3000 * 900 * 0.2e-12
    assert energy.idle_w == on.idle_w == pytest.approx(idle) and on.average_w == pytest.approx(idle + added)
    assert stopped.average_w == pytest.approx(
        100e-6 + 3000 * (frame - 4 * 50e-12) + 20 * step + 6144 * 4 * 50e-12
    )
    assert own.clock_hz == 6e6 and own.idle_w == pytest.approx(
        500e-6 + 6e6 * 3 * 0.2e-12 + 3000 * 900 * 0.2e-12
    )
    assert BATTERY_J == 18000 and on.hours == pytest.approx(18000 / on.average_w / 3600)
    assert energy.touch_s == pytest.approx(2.048)


@each_row("name, awake", [("none", 0), ("ads7953", 1), ("mcp3208x2", None)])
def test_a_bitstream_at_the_boards_clock_is_the_sum_by_hand(name, awake):
    config = CONFIG.replace(converter=name)
    power = bitstream_power(config, PART, ACTIVITY, 12e6, 30)
    assert power.oscillators_w == pytest.approx(12e6 * 50e-12)
    part = 100e-6 + 12e6 * (50e-12 + 3 * 0.2e-12) + 3000 * 900 * 0.2e-12
    assert power.part_w == pytest.approx(part)
    if awake is None:  # two chips that sleep unselected: 8 transfers in series of 19 clocks at 1 MHz
        scan_s = 8 * (19 * 12 + 6 + 6) / 12e6
        assert power.converter_w == pytest.approx(2 * 1.6e-3 * 3000 * scan_s, rel=0.005)  # and asleep
    else:
        assert power.converter_w == pytest.approx(awake and CONVERTERS[name].watt)
    assert power.deciding_w == pytest.approx(0.5 * 20 * (30_000 * 0.2e-12 + 1_200 * 20e-12))
    assert power.waiting_w == pytest.approx(part + power.converter_w)
    assert power.average_w == power.waiting_w + power.deciding_w
    assert power.days_1000mah == pytest.approx(18000 / power.average_w / 86400)
    assert power.days_cr2032 == pytest.approx(0.225 * 3 * 3600 / power.average_w / 86400)
    assert f"longer than {1e-3 / power.waiting_w:.2g} s" in power.switch_off
    assert bitstream_power(config, "LFE5U-25F", ACTIVITY, 25e6).switch_off == ""


def test_an_oscillator_that_runs_for_each_scan_is_the_sum_by_hand():
    """10 scans a second: 1 ms to start, 4 ms to scan, 3 of which the converter is awake, 5 ms of work behind."""
    config = CONFIG.replace(converter="ads7953", sample_rate_hz=10.0)
    power = bitstream_power(config, PART, ACTIVITY, 6e6, 30, Turn(1e-3, 4e-3, 5e-3, 0.03))
    on = 10 * 9e-3 * 400e-6 + 10 * 1e-3 * 40e-6
    assert power.oscillators_w == pytest.approx(on)
    toggles = 10 * 9e-3 * 6e6 * 3 * 0.2e-12 + 10 * 900 * 0.2e-12
    assert power.part_w == pytest.approx(100e-6 + on + toggles)
    assert power.converter_w == pytest.approx(0.03 * 14.5e-3 + 0.97 * 5e-6)
    cycles = 20 * 200 + 6144 * 4
    switched = 20 * (30_000 * 0.2e-12 + 1_200 * 20e-12)
    assert power.deciding_w == pytest.approx(0.5 * (switched + cycles / 6e6 * 400e-6))
    awake = bitstream_power(config.replace(converter="none"), PART, ACTIVITY, 6e6, awake="of a reason")
    assert "always on: of a reason" in awake.oscillator and awake.converter_w == 0
    # the line through the table's ends: what an oscillator takes without its output, 43 of 357 uW at 6 MHz
    assert PARTS["iCE40UP5K"].starting_w == pytest.approx(43e-6, rel=0.02)


@each_row(
    "text, watt",
    [
        ("0,0.001\n1,0.003\n3,0.003\n", 8e-3 / 3 * 3.3),
        ("time,current,voltage\n0,0.001,2\n1,0.003,2\n3,0.003,2\n", 8e-3 / 3 * 2),
        ("Voltage (mV);Current (uA);Time (ms)\n2000;1000;0\n2000;3000;1\n", 4e-3),
        ("time,power\n0,1\n1,1\n", "current"),
        ("time,current\n1,1\n0,1\n", "do not rise"),
    ],
)
def test_an_instruments_record_is_its_mean_power(tmp_path, text, watt):
    file = tmp_path / "record.csv"
    file.write_text(text)
    if isinstance(watt, str):
        with pytest.raises(InputError, match=watt):
            measured_power(file)
    else:
        assert measured_power(file).mean_w == pytest.approx(watt)


def test_the_fit_meets_what_the_source_measured():
    """UP5K, total of all supplies as published: outside 12 MHz with a 28-bit counter, and one more 196 cells
    of counters."""
    part = PARTS["iCE40UP5K"]
    rails = 4.1e-6 * 1.219 + (1.3 + 3.4 + 1.5) * 1e-6 * 3.283
    measured = 613.5e-6 * 1.219 + rails
    assert part.static_w + 12e6 * (part.clock_j + 2 * part.toggle_j) == pytest.approx(measured, rel=0.05)
    # seven counters more, two bits a cycle each
    assert 12e6 * 7 * 2 * part.toggle_j == pytest.approx(27.8e-6 * 1.219, rel=0.05)
    assert 12e6 * part.multiply_j == pytest.approx((882 - 645) * 1e-6 * 1.219, rel=0.05)
    assert part.oscillator_w[6e6] == pytest.approx(388.4e-6 * 1.219 + 4.1e-6 * 1.219 + 8.66e-6 * 3.283)


def test_idle_toggles_are_what_two_runs_differ_by():
    full = {
        "cycles": 1000,
        "busy": 900,
        "toggles": {"cell": 400, "classifier": 40, "ring": 600},
        "multiplies": 300,
    }
    slow = full | {"cycles": 3000, "busy": 1928, "toggles": {"cell": 410, "classifier": 40, "ring": 4590}}
    counts = dict(frames=60, touch_frames=24, steps=4, step_cycles=77, quiet_frame_cycles=19, recordings=1)
    activity = counted_activity(full, slow, **counts)
    steps = (activity.step_cycles, activity.step_toggles, activity.step_multiplies)
    assert steps == (77, 110, 75)
    frames = (activity.touch_frames, activity.frame_cycles, activity.quiet_frame_cycles)
    assert frames == (24, 39, 19)
    assert (activity.frame_toggles, activity.idle_toggles) == (10, 2)
