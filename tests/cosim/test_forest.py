"""Trees: the generated Verilog against golden at every stage. `eskin run` of tests/test_matrix.py plays them in Verilator."""

from tests.support.small_designs import TRACKED
from tests.support.strategies import Design, differences

BASE = TRACKED.replace(cell="trees", decision="last", trees=3, nodes=20, depth=4, lanes=1)
DEFENCES = dict(checksum=True, watchdog=True, fault_frames=16, feature_kinds=("mean", "activity"))


def test_every_stage_is_golden_with_defences_and_two_kinds(tmp_path):
    assert not differences(Design(BASE.replace(**DEFENCES), 4, True), tmp_path)
