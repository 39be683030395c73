"""Words against slots: what the sequencer runs is what was placed, counting addresses and repeats and all."""

from dataclasses import replace

import pytest

from eskin.rtl.program.cells import cell_program
from eskin.rtl.program.microcode import ADDRESSES, CONTROLS, Layout, Microcode
from eskin.rtl.program.schedule import schedule
from tests.support.small_designs import CELLS, reference
from tests.support.table import each_row

LANES = [1, 3, 4, 12]


@pytest.fixture(scope="module", params=CELLS, ids=["before", "after", "lstm"])
def codes(request):
    """Microcode of a cell by (lane type, lanes)."""
    return {
        (lane_type, lanes): Microcode(schedule(reference(*request.param, lanes, lane_type=lane_type)))
        for lane_type in ("plain", "dsp")
        for lanes in LANES
    }


def test_unrolled_words_are_the_slots(codes):
    for code in codes.values():
        unrolled = list(code.unrolled())
        assert len(unrolled) == len(code.slots)
        for number, (word, fields) in enumerate(zip(unrolled, code.slots, strict=True)):
            assert set(fields) <= {*ADDRESSES, *CONTROLS}
            assert all(word[name] == fields.get(name, 0) for name in CONTROLS), number
            assert all(word[name] == fields[name] for name in ADDRESSES if name in fields), number
            assert word["wait"] == (number == code.wait) and word["end"] == (number == len(code.slots) - 1)


@each_row("checksum", [False, True])
@each_row("cell, reset", CELLS)
def test_a_length_or_ed_into_the_address_of_scale_or_check_leads_to_its_own_word(cell, reset, checksum):
    """Few units, one to three lengths of windows: the constants begin where a power of two does."""
    counts = set()
    for hidden in range(4, 10):
        for hop, window, steps in ((10, 20, 3), (8, 17, 4), (8, 17, 5)):
            windows = {
                "hop": hop,
                "window": window,
                "steps": steps,
                "touch_frames": 40,
                "pretrigger_frames": 4,
            }
            config = reference(cell, reset).replace(checksum=checksum, hidden=hidden, **windows)
            place, lengths = Layout(config, cell_program(config)), len(config.window_lengths)
            gates = [
                place.gate(region, index) for region in place.program.gate_regions for index in range(hidden)
            ]
            words = ["scale", "check"] if checksum else ["scale"]
            constants = [place.gate(word, 0) | length for word in words for length in range(lengths)]
            constants += [place.gate("one", 0), place.gate("zero", 0)]
            assert len({*gates, *constants}) == len(gates) + len(constants) and max(gates) < min(constants)
            assert set(constants) <= set(range(place.constants, place.gate_depth)), (hidden, lengths)
            if checksum:  # the bit by which the engine tells the check word's length, the window's before, from the scale's
                bit = place.check_base.bit_length() - 1
                assert [place.gate(word, 0) >> bit & 1 for word in words] == [0, 1]
            counts.add(lengths)
    assert counts == {1, 2, 3}


def test_a_schedule_with_two_uses_of_one_slot_is_refused():
    plan = schedule(reference())
    first, second, *rest = plan.mac_after
    with pytest.raises(RuntimeError, match="vector is needed as"):
        Microcode(replace(plan, mac_after=(first, replace(second, cycle=first.cycle), *rest)))
    with pytest.raises(RuntimeError, match="the schedule ends too soon"):
        Microcode(replace(plan, slots_after=plan.slots_after - 5))


def test_vector_counts_within_a_word_and_nothing_else_does():
    plan = schedule(reference())
    code = Microcode(plan)
    code.slots = [{}] * code.wait + [
        {"mac": 1, "vector": 5},
        {"mac": 1, "vector": 6, "t": 3},
        {"mac": 1, "vector": 7},
        {"mac": 1, "vector": 9},
        {"mac": 1, "vector": 10, "t": 4},
        {"mac": 1, "vector": 11, "t": 4},
        {"mac": 1, "vector": 12, "t": 5},
        {"mac": 1, "vector": 0},
        {},
    ]
    words = [word for word in code.words[code.again_word + 1 :] if not word["wait"] and word["mac"]]
    # the slot that waits is a separate word, and so is the slot after it
    assert [(word["vector"], word["repeat"], word["t"]) for word in words] == [
        (6, 1, 3),
        (9, 2, 4),
        (12, 0, 5),
        (0, 0, 0),
    ]
