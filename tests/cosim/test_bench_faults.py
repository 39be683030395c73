"""Faults of the bench itself, in its wrapper and in the timing of its source, are told as those of the hardware are."""

from functools import partial
from pathlib import Path

import pytest

from eskin.cosim import flow, runner
from eskin.golden.model import run, write_vectors
from eskin.rtl.fpga.generate import generate
from eskin.training.made_up import random_recordings
from tests.support.random_models import random_integer_model
from tests.support.small_designs import SMALL

COSIM = Path(flow.__file__).parent
PACE = {"pace": "declared", "clock_hz": 60e3}
"""20 cycles a frame."""
FAULTS = {
    "two taxels change places": ("wrapper.sv", "frame + beat)", "frame + (beat ^ 1))", {}, "stage sum, index 0"),
    "the last number is not marked": ("wrapper.sv", "{beat == BEATS - 1, beat", "{1'b0, beat", {}, "a standstill"),
    "a value is not told": ("wrapper.sv", "!== 1'bz)", "!== 1'bz && cycle[5:0] != 9)", {}, "expected "),
    "frames come before they are due": ("wrapper.sv", "cycle >= due", "cycle + 3 >= due", PACE, "when it was due"),
    "X is taken for a value": ("wrapper.sv", "? values[32*k +: 32] : 32'bx", "? {values[32*k + 1 +: 31], 1'bx} : 0", {}, "unknown bits"),
    "frames of a block in the wrong order": ("bench.py", "frames[of].astype", "frames[of][::-1].astype", {}, "stage sum, index 0"),
    "a frame of each block is lost": ("bench.py", "count = len(frames[of])", "count = max(1, len(frames[of]) - 1)", {}, "stage sum, index 0"),
    "frames are due a cycle late": ("bench.py", "dues[of].astype", "(dues[of] + 1).astype", PACE, "frame 2, stage input"),
    "blocks come late": ("bench.py", "await self._free.wait()", "await Timer(4000, 'ns')", {}, "was not offered"),
}  # fmt: skip
"""Name -> file, its text, another text, options, what the bench then says."""


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    model, folder = random_integer_model(SMALL, 5), tmp_path_factory.mktemp("faults")
    recordings = random_recordings(model.config, (400,), seed=4)
    design = generate(model.config, model.arrays, folder / "design")
    vectors = write_vectors(folder / "vectors.npz", run(model, recordings), recordings)
    builds = Path(__file__).resolve().parents[2] / "build" / "simulators"
    return partial(flow.cosim, design, vectors, simulator="icarus", waves=False, builds=builds)


@pytest.mark.parametrize("options", [{}, PACE])
def test_without_a_fault_every_frame_is_offered_when_it_is_due(played, options, tmp_path):
    assert played(work=tmp_path, **options)["bit_exact"]


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_of_the_bench_is_found(played, fault, tmp_path, monkeypatch):
    file, text, other, options, said = FAULTS[fault]
    broken = (COSIM / file).read_text()
    assert broken.count(text) == 1
    if file == "bench.py":
        (tmp_path / "bench_with_a_fault.py").write_text(broken.replace(text, other))
        monkeypatch.syspath_prepend(tmp_path)
        start = runner.run
        module = {"bench": "bench_with_a_fault"}
        monkeypatch.setattr(runner, "run", lambda *args, **given: start(*args, **given | module))
    else:
        wrapper = tmp_path / file
        wrapper.write_text(broken.replace(text, other))
        monkeypatch.setattr(runner, "build", partial(runner.build, wrapper=wrapper))
    result = played(work=tmp_path / "work", **options)
    print(result["mismatch_list"])
    assert not result["bit_exact"] and said in result["mismatch_list"][0]
