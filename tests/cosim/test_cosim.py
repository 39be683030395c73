"""Co-simulation of the generated Verilog, small and on both simulators; what the harness, the runner and the
generated folder promise."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from eskin.cosim import flow, runner
from eskin.cosim.scoreboard import DECISION_FIELDS
from eskin.golden.core import InputError
from eskin.golden.model import IntegerModel, run, write_vectors
from eskin.rtl.fpga.generate import c_header, generate, pack_decision, register_map
from eskin.rtl.program.memory_map import Register, mapped
from eskin.rtl.program.schedule import frame_cycles, schedule
from eskin.rtl.program.timing import logit_to_decision
from eskin.training.made_up import random_recordings
from eskin.verbs.flow import cosimulate
from eskin.verbs.generate_job import generate_design
from tests.support.generated_bench import flip, make
from tests.support.random_models import random_integer_model
from tests.support.small_designs import SMALL
from tests.support.table import each_row

WAVES_AFTER = 500  # cycles, as in the bench, which is imported in the simulator alone
ROOT = Path(__file__).resolve().parents[2]
BUILDS = ROOT / "build" / "simulators"
CONFIG = SMALL
LENGTHS = (400, 700, 30, 5)
"""Several touches, a partial one, one without a step, and no touch at all."""
NUMBERS = (11, 4, 25, 7)


@pytest.fixture(scope="session")
def model() -> IntegerModel:
    return random_integer_model(CONFIG, 5)


@pytest.fixture(scope="session")
def design(model, tmp_path_factory) -> Path:
    return generate(model.config, model.arrays, tmp_path_factory.mktemp("cosim") / "design")


@pytest.fixture(scope="session")
def vectors(model, tmp_path_factory) -> Path:
    recordings = random_recordings(model.config, LENGTHS, seed=4)
    trace = run(model, recordings)
    assert (trace.touches.completed > 0).sum() >= 3 and trace.partial.any() and (trace.first < 0).any()
    return write_vectors(tmp_path_factory.mktemp("vectors") / "vectors.npz", trace, recordings, NUMBERS)


@pytest.fixture
def play(design, vectors, tmp_path):
    """``play(simulator, **options)``: the shared design and vectors, in a work folder of the test's own."""

    def call(simulator: str, **options):
        return flow.cosim(
            design,
            options.pop("vectors", vectors),
            simulator=simulator,
            work=tmp_path / "work",
            builds=BUILDS,
            **options,
        )

    return call


def values_in(vectors: Path) -> int:
    with np.load(vectors) as archive:
        flat = sum(len(archive[stage]) for stage in ("sum", "feature", "state", "logit"))
        return flat + archive["decision"].size + 3 * len(archive["numbers"])


@pytest.mark.parametrize("stalls", [False, True])
def test_every_stage_is_exact_on_both_simulators_and_takes_the_same_cycles(play, vectors, stalls):
    results = [play(simulator, stalls=stalls, seed=5) for simulator in runner.SIMULATORS]
    for result in results:
        assert result["mismatch_list"] == [] and result["bit_exact"] and result["passed"]
        assert result["compared_values"] == values_in(vectors)
        assert result["recordings"] == len(LENGTHS) and result["frames"] == sum(LENGTHS)
    assert (
        results[0]["simulated_cycles"] == results[1]["simulated_cycles"]
        and results[0]["cycles"] == results[1]["cycles"]
    )
    assert stalls == (results[0]["cycles"]["frame_max"] > frame_cycles(CONFIG, ends_window=True))


@pytest.mark.parametrize("pace", flow.PACES)
def test_recordings_in_bulk_give_what_they_give_under_cocotb(play, vectors, pace):
    clock = {"pace": pace, "clock_hz": 1.0e6}
    here, there = play("verilator", cocotb=(), **clock), play("verilator", **clock)
    assert (here["bulk_recordings"], there["cocotb_recordings"]) == (len(LENGTHS), len(LENGTHS))
    assert here["bit_exact"] and here["compared_values"] == values_in(vectors)
    for name in ("stages", "cycles", "frames", "steps", "decisions", "overruns"):
        assert here[name] == there[name], name
    both = play("verilator", cocotb=[1], **clock)
    assert (both["cocotb_recordings"], both["bulk_recordings"]) == (1, len(LENGTHS) - 1)
    for name in ("stages", "cycles", "frames", "steps", "decisions", "overruns"):
        assert both[name] == there[name], name


def test_stalls_depend_on_the_seed_alone(play):
    runs = [play("verilator", stalls=True, seed=seed) for seed in (1, 2, 1)]
    cycles = [run["simulated_cycles"] for run in runs]
    assert cycles[0] == cycles[2] != cycles[1]


FEW_TAXELS = {
    "moving sums": dict(
        rest="tracked", rest_frames=4, onset="baseline", onset_mean_frames=8, onset_check_frames=4
    ),
    "all kinds, free": dict(
        rest="initial",
        rest_frames=4,
        clip=300,
        window_mode="free",
        pretrigger_frames=0,
        window=120,
        feature_kinds=("mean", "activity", "integral"),
        feature_scale="taxel",
    ),
}


@each_row(("taxels", "fields"), [(1, "moving sums"), (2, "all kinds, free")])
def test_frames_of_few_taxels_take_no_more_cycles_than_their_schedule(taxels, fields, tmp_path):
    """Windows are so long that no step holds a frame up: what is measured is the frame's own."""
    config = CONFIG.replace(taxels=taxels, hop=60, window=121, touch_frames=240, steps=3, lanes=16)
    config = config.replace(**FEW_TAXELS[fields])
    recordings = random_recordings(config, (600,), 3)
    result = cosimulate(
        random_integer_model(config, 3), recordings, simulator="icarus", work=tmp_path, builds=BUILDS
    )
    assert result["bit_exact"] and result["decisions"]
    assert 3 <= result["cycles"]["frame_max"] <= frame_cycles(config)


def test_the_largest_array_and_the_most_classes(tmp_path):
    config = CONFIG.replace(
        hop=4,
        window=8,
        touch_frames=16,
        steps=3,
        sample_rate_hz=100.0,
        lanes=4,
        taxels=256,
        feature_kinds=("mean", "activity"),
        decision="last",
        class_names=tuple(f"class {k}" for k in range(128)),
        margin_threshold=3,
    )
    model = random_integer_model(config, 3)
    recordings = random_recordings(model.config, (40,), 3)
    result = cosimulate(model, recordings, simulator="icarus", work=tmp_path, builds=BUILDS)
    assert result["bit_exact"] and result["decisions"] > 3


def test_declared_pace_measures_latency_and_meets_the_budgets(play, vectors, tmp_path):
    clock = 1.0e6
    result = play("verilator", pace="declared", clock_hz=clock)
    assert result["passed"] and result["overruns"] == 0
    assert {row["name"]: row["met"] for row in result["budgets"] if not row["reference"]} == {
        "frame": True,
        "step": True,
        "decision": True,
    }


@pytest.mark.parametrize("clock", [{}, {"pace": "declared", "clock_hz": 1.0e6}])
def test_the_designs_own_counter_agrees_with_the_bench(play, clock):
    """The register counts up to the last logit."""
    result = play("verilator", **clock)
    counted, cycles = result["registers"]["LONGEST"], result["cycles"]
    assert counted + logit_to_decision(CONFIG) - 1 == cycles["step_max"] == schedule(CONFIG).step_cycles


def test_a_clock_below_the_lowest_misses_a_budget(design, vectors, tmp_path):
    options = {"work": tmp_path / "work", "builds": BUILDS}
    clock, result = flow.lowest_clock(design, vectors, **options)
    assert result["passed"] and result["clock_hz"] == clock
    slower = flow.cosim(design, vectors, pace="declared", clock_hz=0.95 * clock, **options)
    assert slower["bit_exact"] and not slower["passed"]
    # counts that ask for too much, as those of a clock at which steps wait for one another, do not keep the
    # search up there
    asking = {name: 3 * count for name, count in result["cycles"].items() if count is not None}
    assert flow.lowest_clock(design, vectors, cycles=asking, **options)[0] == clock


@each_row("seed", [None, 1, 2])
def test_a_weight_write_during_a_touch_is_refused_flagged_and_harmless(play, seed):
    result = play("verilator", probe=True, stalls=seed is not None, seed=seed or 0)
    assert (
        result["probe"]["before"] & 1 == 0
        and result["probe"]["after"] & 1 == 1
        and result["probe"]["cleared"] & 1 == 0
    )
    assert result["passed"]


def test_one_golden_word_is_found_and_its_waves_are_kept(play, vectors, tmp_path):
    with np.load(vectors) as archive:
        arrays = dict(archive)
    low = int(arrays["state_offsets"][1])
    index = 3 * CONFIG.network.hidden + 2
    arrays["state"][low + index] ^= 1
    np.savez(tmp_path / "changed.npz", **arrays)
    result = play("icarus", vectors=tmp_path / "changed.npz")
    assert result["mismatches"] == 1 and not result["passed"]
    want = int(arrays["state"][low + index])
    sentence = result["mismatch_list"][0]
    frame = int(arrays["decision_frame"][arrays["decision_offsets"][1] + 3])
    place = f"recording {NUMBERS[1]}, frame {frame}, stage state, index {index} (touch 0, step 3, unit 2)"
    assert sentence.startswith(f"{place}: expected {want}, got {want ^ 1} at cycle ")
    bulk = play("verilator", vectors=tmp_path / "changed.npz", cocotb=(), waves=False)
    assert bulk["mismatch_list"][0].startswith(f"{place}: expected {want}, got {want ^ 1} at cycle ")
    kept = Path(result["waves"])
    formats = json.loads((kept / "signals.json").read_text())["formats"]
    assert formats["wrapper.probe__state__value"] == str(CONFIG.formats.state_format)
    waves = (kept / "waves.vcd").read_text()
    assert " probe__state__value " in waves and waves.count("\n#") > 2 * WAVES_AFTER


def test_one_weight_bit_is_found_in_the_state(design, vectors, tmp_path):
    broken = shutil.copytree(design, tmp_path / "broken")
    words = (broken / "load.hex").read_text().split()
    loads = [k for k, word in enumerate(words) if word.startswith(f"{Register.MEMORY_DATA:02x}")]
    words[loads[1]] = f"{int(words[loads[1]], 16) ^ 0x10:06x}"
    (broken / "load.hex").write_text("\n".join(words) + "\n")
    result = flow.cosim(broken, vectors, simulator="icarus", work=tmp_path / "work", builds=BUILDS)
    assert not result["bit_exact"] and "stage state, index " in result["mismatch_list"][0]


def test_loading_many_words_is_no_standstill(design, vectors, tmp_path):
    long = shutil.copytree(design, tmp_path / "long")
    words = (long / "load.hex").read_text().split()
    harmless = [f"{Register.MEASURE:02x}0001"] * (30 * (CONFIG.step_ideal + 1000))
    (long / "load.hex").write_text("\n".join(harmless + words) + "\n")
    result = flow.cosim(long, vectors, work=tmp_path / "work", builds=BUILDS)
    assert result["verdict"] == "bit-exact" and result["passed"] and result["gave_up"] is None


def test_recordings_without_a_touch_are_no_proof(model, design, tmp_path):
    quiet = random_recordings(model.config, [5, 5], seed=4)
    vectors = write_vectors(tmp_path / "vectors.npz", run(model, quiet), quiet, [0, 1])
    result = flow.cosim(design, vectors, work=tmp_path / "work", builds=BUILDS)
    assert result["bit_exact"] and result["verdict"] == "no decision"


STUB = """
module accelerator (
    input clk, input rst, input [17:0] i__payload, input i__valid, output i__ready, output [31:0] o__payload, output o__valid,
    input o__ready, input [7:0] bus__addr, input [15:0] bus__w_data, input bus__w_stb, input bus__r_stb, output [15:0] bus__r_data,
    output busy, output probe__sum__valid, output [31:0] probe__sum__value, output probe__feature__valid,
    output probe__fault__valid, output [31:0] probe__fault__value,
    output [31:0] probe__feature__value, output probe__state__valid, output [31:0] probe__state__value, output probe__logit__valid,
    output [31:0] probe__logit__value, output probe__step__valid, output [31:0] probe__step__value);
    assign i__ready = @READY@, o__valid = @VALID@, busy = 1'b0, bus__r_data = @ID@, o__payload = @PAYLOAD@;
    assign {probe__sum__valid, probe__fault__valid, probe__feature__valid} = 0;
    assign {probe__state__valid, probe__logit__valid, probe__step__valid} = 0;
    reg [30:0] count = 0;
    always @(posedge clk) count <= count + 1;
endmodule
"""


@pytest.mark.parametrize(
    ("ready", "valid", "payload", "identity", "said"),
    [
        ("1'b0", "1'b0", "32'd0", "16'he5c1", "a standstill"),
        ("1'b1", "1'bx", "32'd0", "16'he5c1", "an X on valid, ready or busy"),
        ("1'b1", "~o__ready", "count", "16'he5c1", "changed before it was taken"),
        ("1'b1", "1'b0", "32'd0", "16'h1234", "this is no accelerator"),
        ("1'b1", "1'b0", "32'd0", "16'hxxxx", "register ID reads"),
    ],
)
def test_a_hardware_that_does_not_answer(design, vectors, tmp_path, ready, valid, payload, identity, said):
    broken = shutil.copytree(design, tmp_path / "broken")
    text = STUB
    for name, value in {"READY": ready, "VALID": valid, "PAYLOAD": payload, "ID": identity}.items():
        text = text.replace(f"@{name}@", value)
    (broken / "accelerator.sv").write_text(text)
    options = {
        "simulator": "icarus",
        "work": tmp_path / "work",
        "builds": tmp_path / "builds",
        "stalls": True,
    }
    if "reg" in said or "accelerator" in said:
        with pytest.raises(runner.SimulationError, match=said):
            flow.cosim(broken, vectors, **options)
    else:
        result = flow.cosim(broken, vectors, **options)
        assert not result["passed"] and any(said in sentence for sentence in result["mismatch_list"])
        stopped = any("a standstill" in sentence for sentence in result["mismatch_list"])
        assert result["verdict"] == ("gave up" if stopped else "differs")
        assert bool(result["gave_up"]) == stopped and (
            not stopped or result["gave_up"]["recording"] in NUMBERS
        )
        assert stopped or said != "a standstill"
        if stopped:
            with_clock = flow.lowest_clock(broken, vectors, **options | {"stalls": False})[1]
            assert with_clock["pace"] == "declared" and with_clock["verdict"] == "gave up"


# ---------------------------------------------------------------- runner
def test_a_build_is_kept_and_a_changed_source_is_another(tmp_path):
    source = tmp_path / "accelerator.sv"
    source.write_text(
        STUB.replace("@READY@", "1").replace("@VALID@", "0").replace("@PAYLOAD@", "0").replace("@ID@", "0")
    )
    first = runner.build("icarus", [source], {"TAXELS": 4}, tmp_path / "builds")
    made = (first.folder / "sim.vvp").stat().st_mtime_ns
    assert runner.build("icarus", [source], {"TAXELS": 4}, tmp_path / "builds") == first
    assert (first.folder / "sim.vvp").stat().st_mtime_ns == made
    assert runner.build("icarus", [source], {"TAXELS": 5}, tmp_path / "builds").folder != first.folder
    source.write_text(source.read_text() + "\n")
    assert runner.build("icarus", [source], {"TAXELS": 4}, tmp_path / "builds").folder != first.folder


@pytest.mark.parametrize("simulator", runner.SIMULATORS)
def test_folders_may_have_any_name(design, vectors, tmp_path, simulator):
    """Make takes no blank."""
    odd = tmp_path / "it's my (own) $data"
    shutil.copytree(design, odd / "design")
    where = {"work": odd / "work", "builds": odd / "builds"}
    assert flow.cosim(odd / "design", vectors, simulator=simulator, **where)["bit_exact"]


def test_a_failing_build_shows_the_end_of_its_log_and_is_tried_again(tmp_path):
    source = tmp_path / "accelerator.sv"
    source.write_text("module accelerator (input clk;\n")
    for _ in range(2):
        with pytest.raises(
            runner.SimulationError, match="(?s)building the simulator failed.*accelerator.sv:1.*syntax error"
        ):
            runner.build("icarus", [source], {}, tmp_path / "builds")


def test_a_simulation_that_takes_too_long_is_ended(play, monkeypatch):
    start = runner.run
    monkeypatch.setattr(runner, "run", lambda *args, limit_s, **options: start(*args, limit_s=0.3, **options))
    with pytest.raises(runner.SimulationError, match="took longer than 0 s"):
        play("icarus")


@pytest.mark.parametrize("tool", ["perl", "g++", "make", "iverilog"])
def test_a_missing_tool_is_named(tmp_path, monkeypatch, tool):
    which = shutil.which
    monkeypatch.setattr(shutil, "which", lambda name, *rest: None if name == tool else which(name, *rest))
    with pytest.raises(InputError, match=rf"needs the tool '{tool.replace('+', '.')}'.*apt-get install"):
        runner.build("icarus" if tool == "iverilog" else "verilator", [], {}, tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"simulator": "modelsim"}, "--simulator modelsim: is unknown; use verilator or icarus"),
        ({"simulator": "icarus", "pace": "slow"}, "--pace slow: is unknown; use full or declared"),
        (
            {"simulator": "icarus", "pace": "declared", "clock_hz": 9000.0},
            "--clock 9000: is too slow for 4 taxels .* at least 12000 Hz",
        ),
    ],
)
def test_bad_options_are_one_sentence(play, tmp_path, options, said):
    with pytest.raises(InputError, match=said):
        play(**options)
    assert not list(tmp_path.iterdir())


def test_vectors_of_another_array_are_refused(play, vectors, tmp_path):
    with np.load(vectors) as archive:
        arrays = dict(archive) | {"samples": archive["samples"][:, :3]}
    np.savez(tmp_path / "other.npz", **arrays)
    with pytest.raises(InputError, match="has 3 taxels and the accelerator has 4"):
        play("icarus", vectors=tmp_path / "other.npz")


def test_cosim_needs_neither_torch_nor_amaranth():
    code = (
        "import sys, eskin.cosim.flow; sys.exit(any(name in sys.modules for name in ('torch', 'amaranth')))"
    )
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, timeout=600, check=False).returncode == 0


# ---------------------------------------------------------------- generated folder
def test_the_generated_bench_passes_by_itself_and_finds_one_changed_value(model, tmp_path):
    folder = generate_design(model, tmp_path / "out", lanes=2)
    kept = (folder / "vectors.npz").read_bytes()
    done = make(folder)
    assert done.returncode == 0 and "values in" in done.stdout and "PASS=1 FAIL=0" in done.stdout
    for stage in ("sum", "state", "decision"):
        (folder / "vectors.npz").write_bytes(kept)
        said = flip(folder, stage, 1)
        done = make(folder)
        assert done.returncode and said in done.stdout


@pytest.mark.slow
def test_the_generated_bench_runs_on_verilator_under_a_name_of_its_own(model, tmp_path):
    folder = generate_design(model, tmp_path / "out", top="third")
    done = make(folder, "verilator")
    assert done.returncode == 0 and "PASS=1 FAIL=0" in done.stdout, done.stdout[-2000:]


def test_decision_words_are_packed_as_the_scoreboard_unpacks_them():
    rng = np.random.default_rng(2)
    for _ in range(50):
        row = [int(rng.integers(0, 1 << width)) for _, width in DECISION_FIELDS.values()]
        assert [
            pack_decision(CONFIG, row) >> low & (1 << width) - 1 for low, width in DECISION_FIELDS.values()
        ] == row


def test_c_header_compiles_and_agrees_with_the_json(tmp_path):
    (tmp_path / "registers.h").write_text(c_header(CONFIG))
    values = register_map(CONFIG)
    registers = {name: value for name, value in values["registers"].items() if value in mapped(CONFIG)}
    assert len(registers) > 8
    checks = [f"ESKIN_{name} == {value}" for name, value in registers.items()]
    checks += [f"ESKIN_CONTROL_{name} == {value}" for name, value in values["bits"]["CONTROL"].items()]
    checks += [f"ESKIN_FAULT_{name} == {value}" for name, value in values["bits"]["FAULTS"].items()]
    checks += [f"ESKIN_MEASURE_{name} == {value}" for name, value in values["measures"].items()]
    assert values["measures"] == {"FRAME": 0, "STEP": 1, "WINDOWS": 2}
    checks += [
        f"ESKIN_MEMORY_{name} == {value}" for name, value in values["memories"].items() if name != "LANE0"
    ]
    asserts = "".join(f'_Static_assert({check}, "{check}");\n' for check in checks)
    (tmp_path / "check.c").write_text(f'#include "registers.h"\n{asserts}')
    command = ["gcc", "-std=c11", "-Wall", "-Werror", "-fsyntax-only", "check.c"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr


def test_memory_images_are_what_is_loaded(model, design):
    writes = [int(word, 16) for word in (design / "load.hex").read_text().split()]
    data = [
        word & 0xFFFF for word in writes if word >> 16 == register_map(CONFIG)["registers"]["MEMORY_DATA"]
    ]
    loaded = []
    for name in ("lane0", "lane1", "addends", "constants", "means"):
        for word in (design / "memories" / f"{name}.hex").read_text().split():
            loaded += [int(word, 16) & 0xFFFF] + ([int(word, 16) >> 16] if len(word) == 8 else [])
    assert data == loaded


def test_a_folder_with_other_files_is_refused_and_an_earlier_one_replaced(model, tmp_path):
    other = tmp_path / "other"
    other.mkdir()
    (other / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="other files in it; give a new folder with --out"):
        generate(model.config, model.arrays, other)
    assert [path.name for path in tmp_path.rglob("*")] == ["other", "notes.txt"]
    out = generate(model.config, model.arrays, tmp_path / "out")
    (out / "left_over").write_text("")
    generate(model.config, model.arrays, out)
    assert not (out / "left_over").exists() and sorted(path.name for path in tmp_path.iterdir()) == [
        "other",
        "out",
    ]
