"""Co-simulation of the generated Verilog: ways to play, designs, faults of bench and hardware, the runner, the generated
folder."""

import inspect
import json
import os
import re
import shutil
import subprocess
from functools import partial
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from eskin.cosim import flow, runner
from eskin.cosim.results import Cycles
from eskin.cosim.simulation import Simulation
from eskin.golden.core import AcceleratorConfig, InputError, SimulationError
from eskin.golden.model import Fixed, IntegerModel, run, write_vectors
from eskin.rtl.fpga.generate import generate
from eskin.rtl.host import control
from eskin.rtl.program.memory_map import Register
from eskin.rtl.program.schedule import frame_cycles, schedule
from eskin.rtl.program.timing import logit_to_decision
from eskin.rtl.top import accelerator
from eskin.training.made_up import random_recordings
from eskin.verbs.cosim import cosimulate
from eskin.verbs.generate import generate_design
from tests.support.generated_bench import flip, make
from tests.support.random_models import random_integer_model
from tests.support.small_designs import SMALL, WIDE

COSIM = Path(flow.__file__).parent
BUILDS = Path("build/simulators")
LENGTHS, NUMBERS = (400, 700, 30, 5), (11, 4, 25, 7)
"""Several touches, a partial one, one without a step, and no touch at all."""
DECLARED, ICARUS = {"pace": "declared", "clock_hz": 1e6}, {"simulator": "icarus"}


@pytest.fixture(scope="module")
def model() -> IntegerModel:
    return random_integer_model(SMALL, 5)


@pytest.fixture(scope="module")
def design(model, tmp_path_factory) -> Path:
    return generate(model.config, model.arrays, tmp_path_factory.mktemp("cosim") / "design")


@pytest.fixture(scope="module")
def vectors(model, tmp_path_factory) -> Path:
    recordings = random_recordings(model.config, LENGTHS, seed=4)
    trace = run(model, recordings)
    assert (trace.touches.completed > 0).sum() >= 3 and trace.partial.any() and (trace.first < 0).any()
    return write_vectors(tmp_path_factory.mktemp("vectors") / "vectors.npz", trace, recordings, NUMBERS)


@pytest.fixture
def play(design, vectors, tmp_path):
    """``play(**options)``: the shared design and vectors, in a work folder of the test's own."""
    apart = {"work": tmp_path / "work", "progress": lambda *move: None, "cycles": None}

    def job(design=design, vectors=vectors, job=flow.cosim, **options):
        given = {name: options.pop(name, value) for name, value in apart.items()}
        if job is flow.cosim:
            del given["cycles"]
        return job(design, vectors, Simulation(**options), **given)

    return job


# ---------------------------------------------------------------- ways to play
WAYS = {"cocotb": {}, "icarus": ICARUS, "bulk": {"cocotb": ()}, "both": {"cocotb": [1]}}
IN_BULK = {"bulk": 4, "both": 3}
SAME = "stages cycles steps decisions overruns probe budgets mismatch_list compared_values".split()


@pytest.mark.parametrize("options", [{}, DECLARED, {"stalls": True, "probe": True}])
def test_every_way_to_play_is_exact_and_counts_the_same(play, vectors, options):
    others = {"icarus"} if options == DECLARED else {*IN_BULK} if options else {}  # slow there; not in bulk
    moves: list[tuple] = []
    note = {"progress": lambda *move: moves.append(move)}
    results = {way: play(seed=5, **options | WAYS[way] | note) for way in WAYS if way not in others}
    assert moves[0][0].startswith("compiling") and (moves[-1][1:] == (3, 3)) == ("both" in results)
    first, cycles = results["cocotb"], results["cocotb"].cycles
    for way, result in results.items():
        here = IN_BULK.get(way, 0)
        assert result.passed and result.verdict == "bit-exact" and result.frames == sum(LENGTHS)
        assert (result.cocotb_recordings, result.bulk_recordings) == (4 - here, here)
        for name in (*SAME, *["simulated_cycles"] * (not here)):
            assert getattr(result, name) == getattr(first, name), name
    with np.load(vectors) as archive:
        flat = sum(len(archive[stage]) for stage in ("sum", "feature", "state", "logit"))
        # each touch is open for long enough to look at it
        registers = 7 * len(NUMBERS) + (archive["touches"] > 0).sum()
        assert first.compared_values == flat + archive["decision"].size + registers
    met = {row.name: row.met for row in first.budgets if not row.reference}
    assert met == dict.fromkeys(("frame", "step", "decision") if options == DECLARED else ("step",), True)
    assert first.probe == ("probe" in options)
    if "stalls" in options:
        assert cycles.frame_max > frame_cycles(SMALL, ends_window=True)
        other = play(seed=6, stalls=True)
        assert other.passed and other.simulated_cycles != first.simulated_cycles
    else:  # the design's own counter goes up to the last logit
        counted = first.registers["LONGEST"] + logit_to_decision(SMALL) - 1
        assert counted == cycles.step_max == schedule(SMALL).step_cycles


def test_a_clock_below_the_lowest_misses_a_budget(play):
    lowest = play(job=flow.lowest_clock)
    slower = play(pace="declared", clock_hz=0.95 * lowest.clock_hz)
    assert lowest.passed and slower.bit_exact and not slower.passed
    # counts that ask for too much, as the counts of a clock at which steps wait for one another, do not keep the
    # search up there
    asking = Cycles(**{name: 3 * count for name, count in lowest.cycles})
    again = play(job=flow.lowest_clock, cycles=asking)
    assert again.clock_hz == lowest.clock_hz


def test_recordings_without_a_touch_are_no_proof(model, play, tmp_path):
    quiet = random_recordings(model.config, [5, 5], seed=4)
    vectors = write_vectors(tmp_path / "vectors.npz", run(model, quiet), quiet, [0, 1])
    for options in ({}, {"cocotb": ()}, {"job": flow.lowest_clock}):
        result = play(vectors=vectors, **options)
        assert result.bit_exact and result.verdict == "no decision" and not result.passed


# ---------------------------------------------------------------- designs
class Peak(Fixed):
    """The plain arithmetic, which notes the largest sum of a row."""

    peak = 0.0

    def _narrow(self, value, shift, fmt):  # type: ignore[override]
        self.peak = max(self.peak, float(np.abs(value).max()))
        return super()._narrow(value, shift, fmt)


def at_the_ends(config: AcceleratorConfig) -> IntegerModel:
    """Random weights; half of the rows of W at an end of their format and features three times as large, so
    that sums leave 32 bits."""
    rng, model = np.random.default_rng(3), random_integer_model(config, 3)
    arrays = dict(model.arrays)
    for name in (name for name in arrays if name[0] == "W"):
        ends = np.where(rng.random((config.network.hidden, 1)) < 0.5, -(1 << 15), (1 << 15) - 1)
        arrays[name] = np.where(rng.random(ends.shape) < 1 / 2, ends, arrays[name])
    arrays["scale"] = np.minimum(3 * arrays["scale"], config.scale_format.max_code)
    model = IntegerModel(model.config, arrays)
    peak = Peak(model.config)
    model.run(peak, run(model, random_recordings(model.config, LENGTHS, 3)).features)
    assert config.accumulator_bits > 32 and config.addend_parts == 3 and peak.peak >= 1 << 31
    return model


FEW = SMALL.replace(hop=60, window=121, touch_frames=240, steps=3, lanes=16)
"""Windows are so long that no step holds a frame up: the frame's own time is measured."""
LARGE = SMALL.replace(hop=4, window=8, touch_frames=16, steps=3, sample_rate_hz=100.0, lanes=4, taxels=256)
MOVING = dict(rest="tracked", rest_frames=4, onset="baseline", onset_mean_frames=8, onset_check_frames=4)
CLASSES = tuple(f"class {k}" for k in range(128))
DESIGNS = {
    "one taxel, moving sums": (FEW.replace(taxels=1, **MOVING), (600,)),
    "the largest array, the most classes": (
        LARGE.replace(
            feature_kinds=("mean", "activity"), decision="last", class_names=CLASSES, margin_threshold=3
        ),
        (40,),
    ),
    "weights of 16 bits": (WIDE.replace(lanes=4), LENGTHS),
}


@pytest.mark.parametrize("name", DESIGNS)
def test_a_design_is_exact(name, tmp_path):
    config, lengths = DESIGNS[name]
    model = at_the_ends(config) if "bits" in name else random_integer_model(config, 3)
    recordings = random_recordings(model.config, lengths, 3)
    result = cosimulate(model, recordings, Simulation(simulator="icarus"), work=tmp_path)
    assert result.bit_exact and result.decisions > 2, result.mismatch_list
    if config.windows.hop == FEW.windows.hop:
        assert 3 <= result.cycles.frame_max <= frame_cycles(config)


# ---------------------------------------------------------------- faults
STUB = """
module accelerator (
    input clk, input rst, input [17:0] i__payload, input i__valid, output i__ready, output [31:0] o__payload, output o__valid,
    input o__ready, input [7:0] bus__addr, input [15:0] bus__w_data, input bus__w_stb, input bus__r_stb, output [15:0] bus__r_data,
    output busy, output probe__sum__valid, output [31:0] probe__sum__value, output probe__feature__valid,
    output probe__fault__valid, output [31:0] probe__fault__value,
    output [31:0] probe__feature__value, output probe__state__valid, output [31:0] probe__state__value, output probe__logit__valid,
    output [31:0] probe__logit__value, output probe__step__valid, output [31:0] probe__step__value);
    assign {i__ready, o__valid, bus__r_data} = {%s}, busy = 1'b0, o__payload = count;
    assign {probe__sum__valid, probe__fault__valid, probe__feature__valid} = 0;
    assign {probe__state__valid, probe__logit__valid, probe__step__valid} = 0;
    reg [30:0] count = 0;
    always @(posedge clk) count <= count + 1;
endmodule
"""
QUIET = "(bus__addr == 3 ? 16'd9 : 16'he5c1)"  # STATUS behind ARM, ID
ALL = r"(?s).*"
WEIGHT = rf"(?<=\n{Register.MEMORY_DATA:02x})\w+"  # the first word of a memory
PACE = {"pace": "declared", "clock_hz": 60e3}  # 20 cycles a frame
FAULTS = {
    "frames come before they are due": ("wrapper.sv", "cycle >= due", "cycle + 3 >= due", PACE, "when it was due"),
    "X is taken for a value": ("wrapper.sv", r"\? values\[32\*k \+: 32\] : 32'bx", "? {values[32*k + 1 +: 31], 1'bx} : 0", {}, "unknown bits"),
    "frames of a block in the wrong order": ("bench.py", r"frames\[of\].astype", "frames[of][::-1].astype", {}, "stage sum, index 0"),
    "frames are due a cycle late": ("bench.py", r"dues\[of\].astype", "(dues[of] + 1).astype", PACE, "frame 2, stage input"),
    "blocks come late": ("bench.py", r"await self._free.wait\(\)", "await Timer(4000, 'ns')", {}, "was not offered"),
    "a bit of a weight": ("load.hex", WEIGHT, lambda word: f"{int(word[0], 16) ^ 16:04x}", {}, "stage state, index "),
    "nothing is taken": ("accelerator.sv", ALL, STUB % f"2'b00, {QUIET}", {}, "a standstill"),
    "X on valid": ("accelerator.sv", ALL, STUB % "2'b1x, 16'he5c1", {}, "an X on valid, ready or busy"),
    "a decision changes": ("accelerator.sv", ALL, STUB % f"1'b1, ~o__ready, {QUIET}", {"stalls": True}, "changed before it was taken"),
    "a refused write is not flagged": ("accelerator.sv", "refused = written & locked", "refused = 1'b0", {"probe": True}, "FAULTS): expected 1"),
    "another ID": ("accelerator.sv", ALL, STUB % "2'b10, 16'h1234", {}, "this is no accelerator"),
    "an unknown ID": ("accelerator.sv", ALL, STUB % "2'b10, 16'hxxxx", {}, "register ID reads"),
}  # fmt: skip
"""Name -> file, its text (a pattern), another text, options, what the bench then says."""


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_found(play, design, fault, tmp_path, monkeypatch):
    file, old, new, options, expected = FAULTS[fault]
    broken, options = shutil.copytree(design, tmp_path / "broken"), options | ICARUS | {"waves": False}
    right = broken / file if (broken / file).exists() else COSIM / file
    text, count = re.subn(old, new if callable(new) else lambda _: new, right.read_text(), count=1)
    assert count == 1
    (broken / file).write_text(text)
    if file == "bench.py":
        (broken / file).rename(tmp_path / "bench_with_a_fault.py")
        monkeypatch.syspath_prepend(tmp_path)
        start = runner.run
        monkeypatch.setattr(
            runner, "run", lambda *args, bench, **given: start(*args, bench="bench_with_a_fault", **given)
        )
    elif file == "wrapper.sv":
        monkeypatch.setattr(runner, "build", partial(runner.build, wrapper=broken / file))
    if "ID" in fault:
        with pytest.raises(SimulationError, match=expected):
            play(design=broken, **options)
        return
    result = play(design=broken, **options)
    sentence = result.mismatch_list[0]
    assert not result.passed and expected in sentence
    assert result.verdict == ("gave up" if "stage input" in sentence else "differs")
    if fault == "nothing is taken":
        again = play(design=broken, job=flow.lowest_clock, **options)
        assert again.pace == "declared" and again.gave_up.recording == NUMBERS[0]


SEEDS = {
    "CHECKSUM always": ("Cat(self.check_failed, *wrong).any()", "Const(1, 1)"),
    "WATCHDOG by every ARM": ("Fault.WATCHDOG: self.hung", "Fault.WATCHDOG: arm"),
    "OVERRUN stuck": ("OVERRUN: self.engine.overrun", "OVERRUN: Const(1, 1)"),
    "INPUT_STALLED never": ("frames.offered & frames.first & ~frames.taken", "Const(0, 1)"),
    "INPUT_STALLED always": ("frames.offered & frames.first & ~frames.taken", "frames.offered"),
    "ADDRESS by every read": ("& ~known", "& (~known | bus.r_stb)"),
    "ARMED stuck": ("Cat(self.detector.armed", "Cat(1"),
    "ARMED never": ("Cat(self.detector.armed", "Cat(Const(0, 1)"),
    "TOUCH stuck": ("armed, touch, self.busy", "armed, 1, self.busy"),
    "TOUCH never": ("armed, touch, self.busy", "armed, Const(0, 1), self.busy"),
    "BUSY never": ("touch, self.busy", "touch, Const(0, 1)"),
    "BUSY stuck": ("touch, self.busy", "touch, Const(1, 1)"),
    "NO_TOUCH by touches of now": ("~state.touched", "~touch"),
    "FAULT stuck": ("faults[4:6].any()", "1"),
    "VERSION 0": ("Register.VERSION: VERSION_VALUE", "Register.VERSION: 0"),
    "LONGEST constant": ("LONGEST: cycles.longest", "LONGEST: 70"),
    "LONGEST of frames": ("measure=measure,", "measure=0,"),
    "LONGEST kept": ("m.d.comb += forgotten.eq(1)", "pass"),
    "TOUCHES constant": ("TOUCHES: state.touches", "TOUCHES: 1"),
}
"""Faults of the registers (rtl/host/control.py) -> its text, another text."""


@pytest.mark.parametrize(
    "seed", [pytest.param(seed, marks=[pytest.mark.slow] * (k > 1)) for k, seed in enumerate([None, *SEEDS])]
)
def test_a_false_register_is_found(seed, tmp_path, monkeypatch):
    """Under cocotb, and the last one in bulk, too."""
    source, (old, new) = inspect.getsource(control), SEEDS.get(seed, ("", ""))
    assert old in source
    names = dict(vars(control))
    exec(source.replace(old, new) if seed else source, names)
    monkeypatch.setattr(accelerator, "HostControl", names["HostControl"])
    model = random_integer_model(SMALL.replace(checksum=True, watchdog=True), 5)
    recordings = random_recordings(model.config, (400, 5), seed=4)
    design = generate(model.config, model.arrays, tmp_path / "design")
    vectors = write_vectors(tmp_path / "vectors.npz", run(model, recordings), recordings)
    ways = {"icarus": ICARUS, "bulk": {"simulator": "verilator", "cocotb": ()}}
    for way in ways if seed == "TOUCHES constant" else ("icarus",):
        how = Simulation(builds=tmp_path / "builds", waves=False, **ways[way])
        result = flow.cosim(design, vectors, how, work=tmp_path / way)
        assert result.passed == (seed is None), result.mismatch_list
        assert seed is None or "stage status" in result.mismatch_list[0]


def test_one_golden_word_is_found_and_its_waves_are_kept(play, vectors, tmp_path, monkeypatch):
    monkeypatch.setenv("COCOTB_LOG_LEVEL", "DEBUG")
    with np.load(vectors) as archive:
        arrays = dict(archive)
    index = 3 * SMALL.network.hidden + 2
    word = int(arrays["state_offsets"][1]) + index
    arrays["state"][word] ^= 1
    for stage, later in (("feature", 4 * SMALL.inputs), ("logit", 3 * SMALL.classes)):  # while waves go on
        arrays[stage][int(arrays[f"{stage}_offsets"][1]) + later] ^= 1
    np.savez(tmp_path / "changed.npz", **arrays)
    want, frame = int(arrays["state"][word]), int(arrays["decision_frame"][arrays["decision_offsets"][1] + 3])
    place = f"recording {NUMBERS[1]}, frame {frame}, stage state, index {index} (touch 0, step 3, unit 2)"
    whole = flow.Run.play
    for options in (
        ICARUS | {"seed": 7},
        {"cocotb": [1], "waves": False},
        {"cocotb": (), "waves": False},
        ICARUS,
    ):
        result = play(vectors=tmp_path / "changed.npz", **options)
        assert result.mismatches == 1 and not result.passed
        assert result.mismatch_list[0].startswith(f"{place}: expected {want}, got {want ^ 1} at cycle ")
        if "waves" in options:
            assert result.recordings == (len(options["cocotb"]) or len(NUMBERS))
            continue
        if options == ICARUS:
            assert not result.waves and "by itself this recording agrees" in result.mismatch_list[1]
            continue
        shown = json.loads((Path(result.waves) / "result.json").read_text())
        assert shown["mismatch_list"][0].startswith(place)
        log = (tmp_path / "work" / "simulation.log").read_text()
        for part in ("driver.bus", "driver.frames", "monitor.state", "scoreboard"):
            assert f" cocotb.{part} " in log, part
        runner.join_results(tmp_path / "work")
        suites = ElementTree.parse(tmp_path / "results.xml").getroot()
        assert [suite.get("name") for suite in suites] == [".", f"waves_recording{NUMBERS[1]}"]
        assert all("COCOTB_RANDOM_SEED=7" in "".join(suite.itertext()) for suite in suites)
        agrees = lambda *given, waves=False: whole(*given) | ({"mismatch": None} if waves else {})
        monkeypatch.setattr(flow.Run, "play", agrees)
        waves = (Path(result.waves) / "waves.vcd").read_text()
        assert " probe__state__value " in waves and waves.count("\n#") > 2 * 500  # WAVES_AFTER of the bench


# ---------------------------------------------------------------- runner
def test_a_build_is_kept_a_changed_source_is_another_and_a_failing_one_shows_its_log(tmp_path):
    source = tmp_path / "accelerator.sv"
    source.write_text(STUB % "2'b00, 16'h0")

    def build(taxels: int) -> runner.Build:
        return runner.build("icarus", [source], {"TAXELS": taxels}, tmp_path / "builds")

    first = build(4)
    made = (first.folder / "sim.vvp").stat().st_mtime_ns
    assert build(4) == first and (first.folder / "sim.vvp").stat().st_mtime_ns == made
    assert build(5).folder != first.folder
    source.write_text(source.read_text() + "\n")
    assert build(4).folder != first.folder
    source.write_text("module accelerator (input clk;\n")
    with pytest.raises(SimulationError, match="(?s)the simulator failed.*accelerator.sv:1.*syntax error"):
        build(4)


@pytest.mark.parametrize("simulator", ["icarus", pytest.param("verilator", marks=pytest.mark.slow)])
def test_folders_may_have_any_name(design, play, tmp_path, simulator, monkeypatch):
    """Make takes no blank."""
    odd = tmp_path / "it's my (own) $data"
    there = {name: odd / name for name in ("design", "work", "builds")}
    shutil.copytree(design, there["design"])
    monkeypatch.setattr("tempfile.tempdir", str(odd))
    assert play(simulator=simulator, **there).bit_exact


def test_a_simulation_that_takes_too_long_is_ended(play, monkeypatch):
    start = runner.run
    monkeypatch.setattr(runner, "run", lambda *args, limit_s, **options: start(*args, limit_s=0.3, **options))
    with pytest.raises(SimulationError, match="took longer than 0 s"):
        play(**ICARUS)


@pytest.mark.parametrize("tool", ["perl", "g++", "make", "iverilog"])
def test_a_missing_tool_is_named(tmp_path, monkeypatch, tool):
    which = shutil.which
    monkeypatch.setattr(shutil, "which", lambda name, *rest: None if name == tool else which(name, *rest))
    with pytest.raises(InputError, match=rf"needs the tool '{re.escape(tool)}'.*apt-get install"):
        runner.build("icarus" if tool == "iverilog" else "verilator", [], {}, tmp_path)
    assert not list(tmp_path.iterdir())


def test_bad_options_are_one_sentence(play, vectors, tmp_path):
    with np.load(vectors) as archive:
        np.savez(tmp_path / "other.npz", **dict(archive) | {"samples": archive["samples"][:, :3]})
    wrong = {
        "`clock_hz` 9000: is too slow for 4 taxels .* at least 12000 Hz": DECLARED | {"clock_hz": 9000.0},
        "has 3 taxels and the accelerator has 4": {"vectors": tmp_path / "other.npz"},
    }
    for words, options in wrong.items():
        with pytest.raises(InputError, match=words):
            play(**options)
    assert not (tmp_path / "work").exists()


# ---------------------------------------------------------------- generated folder
@pytest.mark.parametrize(
    ("simulator", "lanes", "options"),
    [("icarus", 2, {}), pytest.param("verilator", None, {"top": "third"}, marks=pytest.mark.slow)],
)
def test_the_generated_bench_passes_by_itself_and_finds_one_changed_value(
    model, tmp_path, monkeypatch, simulator, lanes, options
):
    """In a folder with a blank in its path."""
    folder = generate_design(model.with_lanes(lanes), tmp_path / "my out", **options)
    monkeypatch.setenv("PYTHONOPTIMIZE", "1")  # without asserts
    done = make(folder, simulator, "WHEEL=1")
    assert done.returncode == 0 and "values in" in done.stdout and "PASS=1 FAIL=0" in done.stdout, done.stdout
    for index, name in enumerate(("ID", "VERSION", "STATUS", "TOUCHES", "FAULTS")):
        flip(folder, "end", index)
        done = make(folder, simulator, "WHEEL=1")
        assert done.returncode and f"register {name}: expected" in done.stdout, done.stdout
        flip(folder, "end", index)
    sentence = flip(folder, "state", 1)
    done = make(folder, simulator, "WHEEL=1")
    assert done.returncode and sentence in done.stdout


def test_a_generated_bench_that_compares_nothing_fails(model, tmp_path, monkeypatch):
    """Recordings without a touch are refused, one that comes first is passed over; no decision, no test that is run and an
    older cocotb, which finds none, are no success."""
    recordings = random_recordings(model.config, [5, 400], seed=4)
    with pytest.raises(InputError, match="none has a touch"):
        generate_design(model, tmp_path / "none", recordings=recordings.subset([0]))
    folder = generate_design(model, tmp_path / "out", recordings=recordings)
    with np.load(folder / "vectors.npz") as archive:
        arrays = dict(archive)
    assert len(arrays["decision"]) and len(arrays["samples"]) == 400
    (tmp_path / "verilator").write_text('#!/bin/sh\nexec verilator-cli "$@"\n')
    (tmp_path / "verilator").chmod(0o755)
    done = make(folder, "verilator", path=[str(tmp_path)])
    assert done.returncode and "call each other without end" in done.stdout
    monkeypatch.setenv("COCOTB_TEST_FILTER", "another")
    done = make(folder)
    assert done.returncode and "no test ran" in done.stdout
    monkeypatch.delenv("COCOTB_TEST_FILTER")
    empty = {name: values[: 5 * (name == "end")] for name, values in arrays.items()}
    np.savez(folder / "vectors.npz", allow_pickle=False, **empty)
    done = make(folder)
    assert done.returncode and "holds no decision" in done.stdout
    (tmp_path / "bin").mkdir()
    config = tmp_path / "bin" / "cocotb-config"
    config.write_text("#!/bin/sh\necho 1.9.2\n")
    config.chmod(0o755)
    done = subprocess.run(
        ["make", f"PATH={config.parent}:{os.environ['PATH']}"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode and "cocotb 2 is needed" in done.stderr
