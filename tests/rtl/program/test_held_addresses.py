"""On a chip an address that a slot does not use is the address before it; addresses that are used are the same
everywhere."""

from eskin.golden.core import PRESETS
from eskin.rtl.program.microcode import ADDRESSES, Microcode
from eskin.rtl.program.schedule import schedule
from tests.support.table import each_row


@each_row("cell, lanes", [({}, 4), ({"cell": "lstm"}, 1), ({"cell": "linear"}, 4)])
def test_only_unused_addresses_are_held(cell, lanes):
    config = PRESETS["thesis"].replace(lanes=lanes, **cell)
    usual, holding = (
        Microcode(schedule(config.replace(clock_gate=stops, one_port=stops))) for stops in (False, True)
    )
    assert usual.slots == holding.slots
    before, after = list(usual.unrolled()), list(holding.unrolled())
    changes = [0, 0]
    for slot, fields in enumerate(holding.slots):
        for name in ADDRESSES:
            if name in fields:
                assert after[slot][name] == fields[name]
            elif slot > 0 and name not in holding.counted:
                assert after[slot][name] == after[slot - 1][name]
            assert after[slot][name] <= max(word[name] for word in before)  # no wider
            changes[0] += slot > 0 and before[slot][name] != before[slot - 1][name]
            changes[1] += slot > 0 and after[slot][name] != after[slot - 1][name]
        assert {name: value for name, value in before[slot].items() if name not in ADDRESSES} == {
            name: value for name, value in after[slot].items() if name not in ADDRESSES
        }
    assert changes[1] < changes[0]
