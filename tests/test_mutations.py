"""Is the suite able to fail? Each mutation below breaks the code in a copy of the project and must turn the named tests red."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from scripts import mutant_job

ROOT = Path(__file__).resolve().parent.parent
CHAIN = "tests/rtl/top/test_accelerator.py::test_bit_exact_at_every_stage"
THESIS = f"{CHAIN}[thesis-0.0]"
LOWEST = "tests/rtl/top/test_accelerator.py::test_the_lowest_clock_loses_nothing_and_far_below_it_the_overrun_is_flagged"

DETECTOR = "tests/rtl/frontend/test_fault_detector.py"
MUTATIONS = {
    "one weight bit": (
        "rtl/program/memory_map.py",
        "return int(rows[group.first_row + lane, column])",
        "return int(rows[group.first_row + lane, column]) ^ (matrix == 'W_z' and column + group.first_row + lane == 0)",
        THESIS,
    ),
    "one table entry": (
        "rtl/engine/activation_unit.py",
        "else (*sigmoid, *~tanh))]",
        "else (*sigmoid, *~tanh))]\n        table[len(table) // 2] += 1",
        "tests/rtl/engine/test_activation_unit.py::test_hardware_gives_every_entry_one_cycle_later",
    ),
    "RND replaced by TRN, rows": ("rtl/program/memory_map.py", "(1 << shifts[block.narrowing] - 1)", "0", THESIS),
    "RND replaced by TRN, element-wise": ("rtl/engine/elementwise.py", "else 1 << config.formats.gate_frac - 1", "else 0", THESIS),
    "SAT replaced by WRAP": (
        "rtl/common/fixed.py",
        "return _cast(Mux(fits, value[: fmt.width], limit), target)",
        "return _cast(value[: fmt.width], target)",
        "tests/rtl/engine/test_engine.py::test_bit_exact_with_stalls[3]",
    ),
    "reset gate on the wrong side": (
        "rtl/program/cells.py",
        '("gru", "before"): gru_reset_before',
        '("gru", "before"): gru_reset_before_wrong',
        THESIS,
    ),
    "hop off by one": ("rtl/frontend/window_averager.py", "config.windows.hop", "(config.windows.hop + 1)", THESIS),
    "the last window's constant replaced by the others'": (
        "rtl/program/memory_map.py",
        "int(scales[q, constant])",
        "int(scales[0, constant])",
        THESIS,
    ),
    "one golden word": (
        "golden/model/pipeline.py",
        "    return trace\n\n\ndef _flat_stream",
        "        trace.streams['state'][0][5] += 1\n    return trace\n\n\ndef _flat_stream",
        THESIS,
    ),
    "a weight write let through during a touch": (
        "rtl/host/control.py",
        "loader.locked.eq(touch),",
        "loader.locked.eq(0),",
        "tests/rtl/top/test_accelerator.py::test_weight_write_during_a_touch_is_refused_and_flagged",
    ),
    "the ring's history one frame short": (
        "rtl/frontend/pretrigger_ring.py",
        "config.windows.pretrigger_frames",
        "(config.windows.pretrigger_frames - 1)",
        THESIS,
    ),
    "ties to the highest class": (
        "rtl/decision/score_search.py",
        "exceeds = total[-1]",
        "exceeds = total >= (1 << len(held) + 1) - 2",
        "tests/rtl/decision/test_score_search.py",
    ),
    "finish without waiting for beats under way": (
        "rtl/host/recording_state.py",
        "idle.eq(quiet.all() & ",
        "idle.eq(",
        "tests/rtl/host/test_control.py::test_finish_waits_for_everything_in_flight_and_ends_the_touch",
    ),
    "a mask bit that stays": (
        "rtl/host/control.py",
        "m.d.sync += mask.eq(bus.w_data)",
        "m.d.sync += mask.eq(bus.w_data | 1)",
        "tests/rtl/host/test_control.py::test_identity_masks_and_unknown_addresses",
    ),
    "rounding half left out of an addend": (
        "rtl/program/memory_map.py",
        "+ (1 << shifts[block.narrowing] - 1)",
        "",
        "tests/rtl/program/test_memory_map.py::test_images_hold_every_parameter[1-plain-gru-before]",
    ),
    "one operation swapped": ("rtl/program/cells.py", '(("S.h-T.n", "z"),)', '(("S.h-T.n", "r"),)', THESIS),
    "one hazard ignored": (
        "rtl/program/timing.py",
        "return self.row + 2",
        "return self.row + 1",
        "tests/rtl/engine/test_engine.py::test_bit_exact_and_cycles_of_the_schedule",
    ),
    "rows that do not wait for the new state": (
        "rtl/program/cells.py",
        "return made_from is not None and made_from <=",
        "return region == 'x' and made_from <=",
        "tests/rtl/program/test_schedule.py",
    ),
    "old state overwritten before its last reader": (
        "rtl/program/scheduler.py",
        "position > last_old.get(op.state, -1) and ",
        "",
        "tests/rtl/engine/test_engine.py::test_dsp_lanes_are_bit_exact_too",
    ),
    "a DSP accumulator loaded in the slot of a product": (
        "rtl/program/scheduler.py",
        "return timing(config).gap if accumulates else 0",
        "return 0",
        "tests/rtl/engine/test_engine.py::test_dsp_lanes_are_bit_exact_too",
    ),
    "swap a slot late": (
        "rtl/program/microcode.py",
        "self._slots.set(begin + swap, swap=1)",
        "self._slots.set(begin + swap + 1, swap=1)",
        "tests/rtl/program/test_schedule.py::test_a_swap_too_soon_or_a_shift_too_few_is_seen",
    ),
    "a swap without the sums": ("rtl/engine/row_chain.py", "Mux(self.swap, self.acc[lane], behind)", "behind", THESIS),
    "chain one shift short": (
        "rtl/program/scheduler.py",
        "start + self.config.hardware.lanes + 1))",
        "start + self.config.hardware.lanes))",
        THESIS,
    ),
    "a repeated word that does not count": (
        "rtl/engine/sequencer.py",
        "(count if name in self._code.counted else 0)",
        '(count if name in self._code.counted and name != "vector" else 0)',
        "tests/rtl/engine/test_sequencer.py",
    ),
    "no wait for the window": (
        "rtl/engine/sequencer.py",
        '(~field("wait") | self.go)',
        "1",
        "tests/rtl/engine/test_sequencer.py::test_waiting_freezes_the_slot_until_go",
    ),
    "one counter for all": ("rtl/host/cycle_counter.py", "with m.Case(Measure.STEP):", "with m.Case(3):", "tests/rtl/host/test_control.py"),
    "one gate order": ("rtl/program/cells.py", '((f"W_{gate}", "x"),)', "((f\"W_{dict(z='r', r='z').get(gate, gate)}\", \"x\"),)", THESIS),
    "one lane off by one": (
        "rtl/program/memory_map.py",
        "rows[group.first_row + lane, column]",
        "rows[group.first_row + (lane + 1) % group.rows, column]",
        THESIS,
    ),
    "overrun tied to one buffer": (
        "rtl/engine/window_queue.py",
        "self.i.p.first & full.all()",
        "self.i.p.first & full.any()",
        f"{LOWEST}[two windows end together-1]",
    ),
    "no allowance for the onset's verdict": (
        "rtl/program/timing.py",
        "FRAME_EXTRA_CYCLES = 7",
        "FRAME_EXTRA_CYCLES = -1",
        f"{LOWEST}[tracked, free-12]",
    ),
    "a block's verdict that raises no flag": (
        "rtl/frontend/fault_detector.py",
        " | (block_last & judged & ~active)",
        "",
        f"{DETECTOR}::test_every_change_of_a_small_format",
    ),
    "fault flags of an earlier recording": ("rtl/frontend/fault_detector.py", "(before.flag & known)", "before.flag", DETECTOR),
    "a swing between the ends of the range taken for activity": (
        "rtl/frontend/fault_detector.py",
        "at_end = (sample == 0) | sample.all()",
        "at_end = sample.all()",
        DETECTOR,
    ),
    "a large change taken for a small one": ("rtl/frontend/fault_detector.py", " | ~high.all())", ")", DETECTOR),
    "settling frames judged": ("rtl/frontend/fault_detector.py", "judged.eq(~self.settling)", "judged.eq(1)", DETECTOR),
    "a block's first change counted": ("rtl/frontend/fault_detector.py", "active = ~block_first & ", "active = ", DETECTOR),
    "the flag of a window read out late": (
        "rtl/frontend/window_averager.py",
        "Mux(now.draining, read.data[bits], self.i.p.masked)",
        "self.i.p.masked",
        "tests/rtl/frontend/test_window_averager.py",
    ),
    "a flagged taxel that still counts for the onset": (
        "rtl/frontend/onset_detector.py",
        "now.masked = now.masked | faults.flag",
        "flag = now.masked | faults.flag",
        "tests/rtl/frontend/test_onset_detector.py",
    ),
    "flags that do not travel with the ring's frames": (
        "rtl/frontend/pretrigger_ring.py",
        "self.o.p.masked.eq(read.data[bits])",
        "self.o.p.masked.eq(self.i.p.masked)",
        "tests/rtl/frontend/test_pretrigger_ring.py",
    ),
    "M and one of K": (
        "rtl/frontend/onset_filter.py",
        ">= config.onset_rule.onset_hits",
        "> config.onset_rule.onset_hits",
        "tests/rtl/frontend/test_onset_filter.py",
    ),
    "frames that are not judged taken for quiet ones": (
        "rtl/frontend/onset_detector.py",
        "onset_filter.i.valid.eq(frame_left & judged)",
        "onset_filter.i.valid.eq(frame_left)",
        "tests/rtl/frontend/test_onset_detector.py",
    ),
    "unsure at the threshold itself": (
        "rtl/decision/classifier.py",
        "config.network.margin_threshold - 1",
        "config.network.margin_threshold",
        "tests/rtl/decision/test_classifier.py",
    ),
    "unsure lost on the serial line": (
        "rtl/host/packet_transmitter.py",
        "is_decision & self.decision.p.unsure",
        "0",
        "tests/rtl/host/test_uart_link.py::test_divisors_and_decisions",
    ),
    "fault flags shown the other way round": (
        "rtl/frontend/fault_detector.py",
        "Cat(self.flags[1:], self.flag)",
        "Cat(self.flag, self.flags)",
        DETECTOR,
    ),
    "state not cleared before a touch": (
        "rtl/program/microcode.py",
        "for address in [self.layout.state_zero, *zeroed]:",
        "for address in [self.layout.state_zero]:",
        THESIS,
    ),
}
EXTRA = {
    "reset gate on the wrong side": (
        "rtl/program/cells.py",
        "CELLS: dict",
        "def gru_reset_before_wrong():\n    from dataclasses import replace\n    right = gru_reset_before()\n"
        '    after = tuple(replace(b, terms=(("W_n", "x"), ("U_n", "h0"))) if b.name == "n" else b for b in right.after)\n'
        '    keep = ElementOp("reset", (("S.h", "one"),), state="h0")\n'
        "    elements = (NORMALISE, keep, right.elements[2])\n"
        '    return replace(right, after=after, elements=elements, state_regions=("x", "h", "h0"))\n\n\nCELLS: dict',
    )
}


@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.parametrize("name", list(MUTATIONS))
def test_mutation_turns_the_suite_red(name, tmp_path):
    file, old, new, test = MUTATIONS[name]
    mutant_job.copy_project(ROOT, tmp_path)
    for path, before, after in [(file, old, new), *([EXTRA[name]] if name in EXTRA else [])]:
        text = (tmp_path / path).read_text()
        assert before in text, f"{path} no longer has '{before}': write the mutation anew"
        (tmp_path / path).write_text(text.replace(before, after))
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", test],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=280,
    )
    assert done.returncode == 1, f"the mutation survived: {test}\n{done.stdout[-2000:]}"
    assert "AssertionError" in done.stdout or "assert" in done.stdout, done.stdout[-2000:]
