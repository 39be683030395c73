"""Upsets in the generated Verilog: the way in for them, the campaigns, and that each campaign can fail."""

import random
from functools import cache
from pathlib import Path

import pytest

from eskin.cosim import upsets as bench
from eskin.golden.model import IntegerModel, random_integer_model
from eskin.rtl.fpga.upsets import with_upsets
from eskin.rtl.program.memory_map import Fault
from eskin.verbs import upset_campaign
from eskin.verbs.link_upsets import upset_link
from tests.golden.model.test_prototypes import taught_model
from tests.rtl.top.test_accelerator import CONFIGS, recordings
from tests.support.touch_scenes import scene

BUILDS = Path("build/simulators")


@cache
def campaign(
    *, checksum: bool = True, watchdog: bool = True, name: str = "tracked, free"
) -> upset_campaign.Campaign:
    """A small design; tables of 64 entries, so that a touch at full pace leaves time to walk through them."""
    config = CONFIGS[name].replace(checksum=checksum, watchdog=watchdog, table_entries=64)
    model = random_integer_model(config, seed=5)
    given = upset_campaign.scenario(model, recordings(config, 3, [200] * 6))
    return upset_campaign.Campaign.build(given, BUILDS)


def test_every_register_and_memory_has_a_site():
    """As many bits as the design has: counted in the text, not by the function that made the sites."""
    config = CONFIGS["tracked, free"].replace(checksum=True, watchdog=True, feature_shift=(3,))
    text, sites = with_upsets(config)
    numbers = [site.number for site in sites if not site.words]
    assert sorted(numbers) == list(range(1, len(numbers) + 1)) and all(
        f"upset_register == {number} " in text for number in numbers
    )
    clocked = [line for line in text.splitlines() if "<=" in line and "upset_memory" not in line]
    plain = [line for line in clocked if "upset_register" not in line]
    assert len(clocked) - len(plain) >= len(numbers) and all("] <= " in line for line in plain), (
        "a register without a way in"
    )
    names = {site.name for site in sites}
    assert {"engine.coefficients.gates", "engine.weights_0", "watchdog.count", "control.measure"} <= names
    assert {"control", "engine.sequencer", "front_end.onset_detector", "classifier"} <= {
        site.block for site in sites
    }


def test_a_memory_bit_and_a_register_bit_can_be_flipped_and_the_rest_is_as_golden_says():
    made = campaign()
    clean = made.clean()
    flips = upset_campaign.upset_constants(made, 240, 1)
    kinds = upset_campaign.flagged_by_kind(flips)
    assert set(kinds) >= {
        "weights",
        "biases",
        "means",
        "scales, one, zero, check words",
        "words that stand for 0",
        "activation tables",
        "program",
        "configuration registers",
    }
    assert all(flips == flagged for flips, flagged in kinds.values()), kinds
    records = upset_campaign.upset_flip_flops(made, 150, 2)
    counts = upset_campaign.summary(records)
    assert counts["hangs"] == 0 and counts["flips"] == 150
    assert 0 < counts["exact"] < 150, "flips that change nothing, or all, show nothing"
    assert all(record["flagged"] for record in records if not record["next_recording"])
    assert not any(record["differs"] for record in upset_campaign.leave_recordings(made, 30, 3))
    left = upset_campaign.leave_recordings(made, 6, 3, ways=(bench.NO_ARM,))
    assert len(left) > 20, "every cycle around a decision is among them"
    assert any(record["differs"] for record in left)
    assert clean["recordings"][0]["faults"] & (Fault.CHECKSUM | Fault.WATCHDOG) == 0


def test_a_flip_of_what_the_readout_keeps_is_flagged_and_nothing_hangs():
    """Every bit of every register that outlasts a cycle, once."""
    taught = taught_model("gru")
    config = taught.config.replace(checksum=True, watchdog=True)
    given = upset_campaign.scenario(IntegerModel(config, taught.arrays, "a test"), scene(12, seed=8))
    made = upset_campaign.Campaign.build(given, BUILDS)
    kept = "address unit slot label chosen state count_0 count_1 count_2".split()
    rng = random.Random(6)
    sites = {
        site.name.removeprefix("readout."): site for site in made.flip_flops() if site.block == "readout"
    }
    assert sites.keys() >= set(kept)
    flips = [
        (sites[name].number, 0, 0, bit, 0, rng.randrange(100, 1100))
        for name in kept
        for bit in range(sites[name].width)
    ]
    for flip, result in zip(flips, made.play(flips), strict=True):
        judged = made.judge(result)
        assert judged["flagged"] and not judged["hang"], flip


def test_a_recording_left_at_any_cycle_around_a_decision_leaves_nothing_to_the_next():
    """`arm` is written, and takes hold, in every cycle around the first and the last two decisions of a
    touch: what is offered by then is the last recording's, what comes later the next one's."""
    made = campaign()
    (clean,) = made.play([bench.NONE])
    offered = [event[2] for event in clean["recordings"][0]["decisions"][: len(made.scenario.expected[0][0])]]
    cycles = sorted({at + shift for at in (offered[0], *offered[-2:]) for shift in range(-12, 9)})
    # The bench reads three registers before it writes `arm`: from the leaving cycle on, 5 cycles are the last
    # recording's yet.
    assert {at - 4 for at in offered[-2:]} | {at - 5 for at in offered[-2:]} <= set(cycles)
    upsets = [(way, 0, 0, 0, 0, cycle) for way in (bench.ARM_AGAIN, bench.RESET) for cycle in cycles]
    results = made.play(upsets)
    assert [
        upset for upset, result in zip(upsets, results, strict=True) if not made.next_recording_exact(result)
    ] == []
    whole = clean["recordings"][0]["decisions"]
    for (way, *_, cycle), result in zip(upsets, results, strict=True):
        # of the cycles whose decisions are written down with the recording that is left
        last = cycle + (0 if way == bench.RESET else 3)
        seen = [event[0] for event in result["recordings"][0]["decisions"]]
        assert seen == [event[0] for event in whole if event[2] <= last], (way, cycle)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["two windows end together", "tracked, DSP lane, LSTM"])
def test_no_flip_flop_hangs_the_chain(name):
    """Every flip-flop bit at least once, at least 2000 flips."""
    made = campaign(name=name)
    bits = sum(site.width for site in made.flip_flops())
    counts = upset_campaign.summary(upset_campaign.upset_flip_flops(made, max(2 * bits, 2000), 7))
    assert counts["hangs"] == 0 and counts["cleared"] > 0, counts
    assert all(name.startswith(("control.mask", "engine.")) for name in counts["until_written"]), counts[
        "until_written"
    ]


@pytest.mark.slow
def test_without_the_watchdog_some_hang():
    assert (
        upset_campaign.summary(upset_campaign.upset_flip_flops(campaign(watchdog=False), 2000, 7))["hangs"]
        > 0
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["thesis"])
def test_every_bit_of_every_constant_is_flagged(name):
    """All of them, not a sample."""
    made = campaign(name=name)
    bits = sum(map(len, made.constants().values()))
    kinds = upset_campaign.flagged_by_kind(upset_campaign.upset_constants(made, bits, 1))
    assert (
        all(flips == flagged for flips, flagged in kinds.values())
        and sum(flips for flips, _ in kinds.values()) == bits
    ), kinds


@pytest.mark.slow
def test_no_flip_flop_of_the_link_makes_it_dumb():
    records = upset_link(CONFIGS["thesis"], 2000, 1, builds=BUILDS)
    assert [record for record in records if not (record["answers"] and record["decides"])] == []
    assert any(record["register"] == "transmitter.fsm_state" for record in records)
