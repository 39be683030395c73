"""What no good host does: resets in the middle of anything, and registers that start unknown. Traffic of every kind is
tests/test_fuzz.py's."""

import re
from pathlib import Path

import pytest

from eskin.training.formats import with_network
from tests.support.traffic import changed, initial_values
from tests.support.traffic_case import CONFIG, Case, judge, power_up, resets, small_case, x_script

BUILDS = Path("build/simulators")


def check_power_up(case: Case, folder: Path, seeds: int) -> None:
    """No register and no word of a memory that anything writes needs its initial value.

    An X gets through where a DSP block can add a product only: what the state memory held before the first
    touch, times 0.
    """
    power = power_up(case, folder, BUILDS, seeds)
    assert power.total > 200 and power.bits > 1500  # the smallest, linear and compact, has 1894
    # every register but those that memories read into, whose names Yosys made
    registers = re.findall(
        r"^ *reg (?:signed )?(?:\[\d+:0\] )?(?:[a-z]\w*|\\\S+ );$", case.verilog, re.MULTILINE
    )
    statements = [number for number in initial_values(case.verilog) if "initial" in power.text[number]]
    assert len(statements) == len(registers) > 0
    assert [power.text[number] for number in power.constants] == []
    words = {power.text[number].split("[")[0].strip() for number in power.multiplied}
    assert words <= ({"state_memory"} if case.config.hardware.lane_type == "dsp" else set())
    print(f"{power.total} initial values, {power.bits} bits; multiplied by 0: {len(power.multiplied)}")


def test_every_register_and_memory_may_start_unknown(tmp_path):
    check_power_up(small_case(), tmp_path, 0)


def test_registers_without_their_reset_are_seen(tmp_path):
    case = small_case()
    unreset = changed(case.verilog, initial_values(case.verilog)).replace("rst ?", "1'b0 ?")
    assert unreset.count("1'b0 ?") > 50
    assert all(judge(x_script(case), case, tmp_path, BUILDS, unreset).values())


@pytest.mark.timeout(3600)
@pytest.mark.parametrize("count", [6, pytest.param(1000, marks=pytest.mark.slow)])
def test_bit_exact_after_resets(tmp_path, count):
    found = judge(resets(small_case(), count, 3), small_case(), tmp_path, BUILDS)
    assert found == {number: [] for number in range(count)}


VARIANTS = {
    "gru after": dict(reset="after", lanes=1),
    "lstm, dsp": dict(cell="lstm", lane_type="dsp", lanes=3),
    "one lane, rom": dict(lanes=1, loadable=False),
    "lstm, rom": dict(cell="lstm", loadable=False),
    "linear, rom": dict(cell="linear", loadable=False),
    "checked, rom": dict(checksum=True, loadable=False),
    "free, baseline": dict(
        window_mode="free", window=6, rest="tracked", rest_frames=5, onset="baseline", onset_threshold=300
    ),
    "immediate": dict(
        onset="immediate", rest="initial", rest_frames=3, pretrigger_frames=0, decision="early"
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("variant", VARIANTS)
def test_unknown_and_resets_in_every_variant(tmp_path, variant):
    changes = dict(VARIANTS[variant])
    network = {key: changes.pop(key) for key in ("cell", "reset") if key in changes}
    case = Case(with_network(CONFIG.replace(**changes), **network))
    check_power_up(case, tmp_path / "x", 3)
    found = judge(resets(case, 30, 4), case, tmp_path / "r", BUILDS)
    assert found == {number: [] for number in range(30)}
