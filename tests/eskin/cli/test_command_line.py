"""The command line: what each verb prints and writes, and that every bad input ends in one sentence, status 2
and no changed file."""

from __future__ import annotations

import json
import os
import re
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from eskin.cli import main as command_line
from eskin.golden.core.config import PRESETS, AcceleratorConfig
from eskin.golden.core.groups import GROUP_OF
from tests.support.table import each_row

ROOT = Path(__file__).resolve().parents[3]
VERBS = (
    "asic",
    "inspect",
    "convert",
    "train",
    "enrol",
    "import",
    "quantise",
    "evaluate",
    "compare",
    "generate",
    "export",
    "cosim",
    "build",
    "replay",
    "schedule",
    "run",
    "sweep",
    "baselines",
    "stability",
    "energy",
    "leak-check",
    "report",
    "watch",
)
CONFIG = AcceleratorConfig.of(
    name="small",
    taxels=4,
    sample_rate_hz=200.0,
    rest="tracked",
    rest_frames=8,
    onset="baseline",
    onset_mean_frames=4,
    onset_check_frames=4,
    onset_threshold=20,
    window_mode="free",
    pretrigger_frames=0,
    hop=6,
    window=12,
    steps=4,
    hidden=4,
    class_names=("rough", "smooth"),
    clock_hz=1e5,
    rearm_frames=16,
)


def arrays(**changes) -> dict[str, np.ndarray]:
    """Eight recordings of 100 frames that CONFIG's onset rule opens, with ``changes``; None leaves an array
    out."""
    rng = np.random.default_rng(11)
    samples = rng.normal(1000, 2, (8, 100, 4))
    for i in range(8):
        samples[i, 40:, i % 2] += 80 * np.sin(np.arange(60) * (0.05 if i % 2 else 0.3)) + 60
    good = {
        "samples": np.rint(samples).astype(np.uint16).reshape(-1, 4),
        "offsets": np.arange(0, 801, 100),
        "labels": np.arange(8) % 2,
        "class_names": np.array(["rough", "smooth"]),
        "sample_rate_hz": np.array(200.0),
        "trial": np.arange(8) // 2,
    } | changes
    return {name: value for name, value in good.items() if value is not None}


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """An empty working folder with the archive ``data.npz`` and the configuration ``config.json``."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    np.savez("data.npz", **arrays())
    Path("config.json").write_text(CONFIG.to_json())
    return tmp_path


@pytest.fixture
def model(folder) -> Path:
    """``model``: an untrained network, quantised on data.npz."""
    import torch

    from eskin.golden.data.load import load_recordings
    from eskin.golden.model.model import FloatModel
    from eskin.golden.training.network import RecurrentClassifier
    from eskin.golden.training.quantise import quantise

    network = RecurrentClassifier(CONFIG, generator=torch.Generator().manual_seed(2)).arrays()
    FloatModel(CONFIG, network | {"mu": np.array(20.0), "sigma": np.array(30.0)}).save(folder / "model", {})
    quantise(folder / "model", load_recordings(folder / "data.npz"))
    return folder / "model"


@pytest.fixture
def call(monkeypatch, capsys) -> Callable[..., tuple[int, str, str]]:
    """``call("inspect", "data.npz")`` -> (status, standard output, standard error), as the installed command
    would end."""

    def run(*words: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["eskin", *map(str, words)])
        with pytest.raises(SystemExit) as end:
            command_line.main()
            sys.exit(0)
        shown = capsys.readouterr()
        return end.value.code or 0, shown.out, shown.err

    return run


def everything(folder: Path) -> dict[str, bytes]:
    """Every file below ``folder`` and what is in it."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def refused(call, folder: Path, words: list[object], *parts: str) -> None:
    """The command ends with 2, one line on standard error that has every part, nothing on standard output,
    and no file changed."""
    before = everything(folder)
    status, out, err = call(*words)
    assert status == 2, (status, err)
    assert err.startswith("eskin: ") and err.count("\n") == 1 and "Traceback" not in err, err
    for part in parts:
        assert part in err
    assert out == "" and everything(folder) == before


# ---------------------------------------------------------------------- recordings in other forms
def write_tables(folder: Path) -> None:
    """The archive's recordings as CSV files, one a recording."""
    good = arrays()
    for index in range(8):
        file = folder / str(good["class_names"][index % 2]) / f"trial{index // 2}.csv"
        file.parent.mkdir(parents=True, exist_ok=True)
        samples = good["samples"][100 * index : 100 * (index + 1)]
        rows = [
            ",".join([f"{frame / 200:.3f}", *map(str, row)]) for frame, row in enumerate(samples.tolist())
        ]
        file.write_text("\n".join(["time,a,b,c,d", *rows]))


def test_convert_says_what_it_understood_and_writes_the_same_recordings(call, folder):
    write_tables(folder / "csv")
    status, out, _ = call(*"convert csv --out made.npz".split())
    assert (
        status == 0
        and "2 folders are classes, 8 files recordings" in out
        and "200 Hz" in out
        and "eskin inspect made.npz" in out
    )
    with np.load("made.npz") as made:
        samples = np.concatenate(
            [arrays()["samples"][100 * n : 100 * (n + 1)] for n in (0, 2, 4, 6, 1, 3, 5, 7)]
        )
        assert np.array_equal(made["samples"], samples) and made["trial"].tolist() == [0, 1, 2, 3] * 2
    assert call(*"evaluate nothing --data csv".split())[0] == 2
    assert call(*"inspect csv --config config.json".split())[0] == 0


BAD_TABLES = {
    "ragged": (b"time,a,b,c,d\n0.000,1,2,3,4\n0.005,1,2,3\n0.010,1,2,3,4\n", "line 3"),
    "fewer taxels": (b"time,a,b,c\n0.000,1,2,3\n0.005,1,2,3\n", "3 taxels"),
    "no text": (b"\xff\xfet\x00", "UTF-8"),
}


@each_row("kind", BAD_TABLES)
def test_a_bad_table_is_refused_in_a_sentence_and_nothing_is_written(call, folder, kind):
    write_tables(folder / "csv")
    content, said = BAD_TABLES[kind]
    (folder / "csv" / "smooth" / "trial2.csv").write_bytes(content)
    refused(call, folder, "convert csv --out made.npz".split(), "csv", said)
    refused(call, folder, "train --data csv --out made".split(), "csv", said)


def test_a_bad_matlab_file_is_refused_in_a_sentence(call, folder):
    from scipy.io import savemat

    savemat("bad.mat", {"samples": np.zeros((2, 9, 4)), "labels": [1, 2]})
    refused(call, folder, "convert bad.mat --out made.npz".split(), "bad.mat", "does not say its rate")
    Path("bad.mat").write_bytes(Path("bad.mat").read_bytes()[:150])
    refused(call, folder, "convert bad.mat --out made.npz".split(), "bad.mat", "damaged")
    refused(call, folder, "convert data.npz --out made.csv".split(), "--out made.csv", ".npz")
    refused(call, folder, "convert data.npz --out made.npz --rate nan".split(), "--rate nan")


# ---------------------------------------------------------------------- help and usage
def test_help_lists_the_verbs_of_this_release_and_no_others(call):
    status, out, _ = call("--help")
    listed = [
        line.split()[1]
        for line in out.partition("The whole job")[2].splitlines()
        if line.startswith("│ ") and line[2] != " "
    ]
    assert status == 0 and sorted(listed) == sorted(VERBS)


@each_row("verb", VERBS)
def test_every_verb_explains_itself_with_an_example(call, verb):
    status, out, _ = call(verb, "--help")
    assert status == 0 and f"Example: eskin {verb}" in out


@each_row(
    "words",
    [
        ["bogus"],
        ["inspect"],
        ["train", "--out", "x"],
        "train --data d --out x --cell rnn".split(),
        "cosim m --data d --level netlist".split(),
        "cosim m --data d --simulator other".split(),
        ["inspect", "a", "b"],
        "generate m --out x --lanes four".split(),
    ],
)
def test_bad_usage_ends_with_2(call, folder, words):
    before = everything(folder)
    status, _, err = call(*words)
    assert status == 2 and "Traceback" not in err and everything(folder) == before


# ---------------------------------------------------------------------- the verbs
def test_stability_runs_the_asked_modes_and_ends_with_1_when_one_is_beyond_its_bound(
    call, folder, model, monkeypatch
):
    import dataclasses

    name = "weight bit flips, mean"
    words = [
        "stability",
        model,
        "--data",
        "data.npz",
        "--out",
        "s",
        "--no-cosim",
        "--mode",
        name,
        "--mode",
        "mains hum",
    ]
    status, out, _ = call(*words)
    assert status == 0 and "2 failure modes" in out and "held" in out and Path("s/stability.html").is_file()
    result = json.loads(Path("s/stability.json").read_text())
    assert [mode["name"] for mode in result["modes"]] == [name, "mains hum"] and result["defences"] == []
    from eskin.golden.stability.table import MODES

    monkeypatch.setitem(MODES, name, dataclasses.replace(MODES[name], at_most=-1.0))
    assert call(*words)[0] == 0  # a finished experiment is taken over
    # in this process, where the bound was changed
    status, out, _ = call(*[word if word != "s" else "t" for word in words], "--few", "3", "--jobs", "1")
    assert status == 1 and "FAILED" in out


def test_stability_refuses_before_it_writes(call, folder, model):
    base = ["stability", model, "--data", "data.npz", "--out", "s", "--no-cosim"]
    refused(call, folder, [*base, "--mode", "tie"], "mode 'tie'", "unknown")
    refused(
        call,
        folder,
        ["stability", folder / "none", "--data", "data.npz", "--out", "s"],
        "none",
        "config.json",
    )
    Path("s").write_text("a file")
    refused(call, folder, [*base, "--mode", "mains hum"], "s is a file")


def test_inspect_shows_the_archive_and_writes_picture_and_figures(call, folder):
    status, out, _ = call(*"inspect data.npz --config config.json --json figures.json".split())
    assert status == 0
    figures = json.loads(Path("figures.json").read_text())
    assert (
        figures["recordings"] == 8
        and figures["taxels"] == 4
        and figures["classes"] == {"rough": 4, "smooth": 4}
    )
    assert figures["groups"] == {"trial": 4} and figures["lengths"] == {"min": 100, "median": 100, "max": 100}
    assert [taxel["state"] for taxel in figures["taxel"]] == ["ok"] * 4
    onsets = figures["onset_frames"]
    assert len(onsets) == 8 and all(40 < frame <= 52 for frame in onsets)
    assert "200 Hz" in out and "trial (4 values)" in out and str(onsets[3]) in out and "rough" in out
    assert (folder / "build/inspect/data.png").read_bytes().startswith(b"\x89PNG")


def test_inspect_points_at_dead_and_saturated_taxels(call, folder):
    samples = arrays()["samples"]
    samples[:, 2] = 7
    touched = np.arange(800) % 100 >= 60
    samples[:, 3] = np.where(touched, 65535, samples[:, 3])  # clipped while the others move
    np.savez("data.npz", **arrays(samples=samples))
    status, out, _ = call(*"inspect data.npz --config config.json --json figures.json".split())
    states = [taxel["state"] for taxel in json.loads(Path("figures.json").read_text())["taxel"]]
    assert status == 0 and states == ["ok", "ok", "constant", "saturated"] and "taxels to look at" in out
    assert re.search(r"│ 2 +│ constant +│ 7 +│ 7 +│", out) and re.search(r"│ 3 +│ saturated ", out)


def test_a_taxel_that_rests_at_its_lowest_code_is_not_saturated(call, folder):
    """A capacitive taxel reads 0 until it is touched: at an end for long stretches, while nothing moves."""
    samples = np.maximum(arrays()["samples"].astype(int) - 1010, 0).astype(np.uint16)
    np.savez("data.npz", **arrays(samples=samples))
    call(*"inspect data.npz --config config.json --json figures.json".split())
    figures = json.loads(Path("figures.json").read_text())
    assert (samples == 0).mean() > 0.4 and [taxel["state"] for taxel in figures["taxel"]][:2] == ["ok", "ok"]


def test_inspect_lists_few_recordings_and_says_what_next(call, folder):
    good = arrays()
    np.savez(
        "data.npz",
        **arrays(
            samples=np.tile(good["samples"], (4, 1)),
            offsets=np.arange(0, 3201, 100),
            labels=np.arange(32) % 2,
            trial=None,
        ),
    )
    _, out, _ = call(*"inspect data.npz --config config.json".split())
    assert "onsets of 10 recordings" in out and "no group says which recordings are alike" in out
    assert "next: eskin run --data data.npz --out build/data" in out
    _, out, _ = call(*"inspect data.npz --config config.json --json figures.json".split())
    assert len(json.loads(Path("figures.json").read_text())["onset_frames"]) == 32
    np.savez("data.npz", **good)
    _, out, _ = call(*"inspect data.npz --config config.json".split())
    assert (
        "next: eskin run --data data.npz --group trial" in out
        and "fewer than 5 recordings of rough, smooth" in out
    )


def test_inspect_describes_an_archive_that_gives_no_configuration(call, folder):
    wide = np.tile(arrays()["samples"], 65)[:, :257]
    np.savez("data.npz", **arrays(samples=wide))
    assert call(*"inspect data.npz --json figures.json".split())[0] == 0
    figures = json.loads(Path("figures.json").read_text())
    assert (
        figures["onset_frames"] is None
        and "taxels: is 257; it must lie in 1..256" in figures["configuration"]["reasons"][0]
    )


def test_compare_sets_float_against_integer(call, folder, model):
    status, out, err = call(*"compare model --data data.npz --out page --json compare.json".split())
    assert status == 0, err
    result = json.loads(Path("compare.json").read_text())
    assert [one["stage"] for one in result["stages"]] == [
        "features",
        "accumulators",
        "gates",
        "hidden state",
        "logits",
    ]
    signals = {one["signal"]: one for one in result["signals"]}
    assert {"W_z", "U_n", "V", "b_y", "features", "logits"} <= set(signals) and signals["logits"][
        "values"
    ] == 2 * result["steps"]
    assert (
        result["logit_error"]["max"] == pytest.approx(signals["logits"]["error_max"])
        and "page/compare.html" in out
    )
    page = Path("page/compare.html").read_text()
    assert "data:image/svg" in page and 'src="http' not in page and all(name in page for name in signals)
    assert call(*"compare model --out page".split())[0] == 0
    refused(call, folder, "compare model --data nothing.npz".split(), "nothing.npz")


def test_a_model_goes_through_quantise_generate_and_evaluate(call, folder, model):
    status, out, err = call(*"quantise model --data data.npz --weight-bits 6".split())
    assert status == 0, err
    assert AcceleratorConfig.load("model/config.json").formats.weight_format.width == 6 and "weight" in out
    status, out, err = call(*"generate model --out design --lanes 2 --data data.npz".split())
    assert status == 0, err
    assert AcceleratorConfig.load("design/config.json").hardware.lanes == 2
    plain = {"accelerator.sv", "registers.h", "registers.json", "testbench.sv", "component.xml"}
    assert plain | {"eskin.rdl", "eskin.svd", "filelist.f", "eskin.core", "waiver.vlt"} <= set(
        os.listdir("design")
    )
    behind = {"eskin.h", "eskin.c", "load.h"}
    for options, more in (
        ("--bus wishbone --fifo 0", {"eskin_wishbone.sv"} | behind),
        ("--streams axis", {"eskin_axis.sv"}),
    ):
        status, out, err = call("generate", "model", "--out", "design", *options.split())
        assert status == 0, err
        assert set(os.listdir("design")) & (behind | {"eskin_wishbone.sv", "eskin_axis.sv"}) == more
    for options, sentence in (("--fifo 2", "is of a bus"), ("--bus apb --fifo 3", "is 3; give 0, 2 or 4")):
        refused(
            call, folder, ["generate", "model", "--out", "design", *options.split()], f"--fifo: {sentence}"
        )
    status, out, err = call(*"evaluate model --data data.npz --json evaluate.json".split())
    result = json.loads(Path("evaluate.json").read_text())
    assert {
        "recordings",
        "float_accuracy",
        "integer_accuracy",
        "agreement",
        "per_step",
        "per_class",
        "not_touched",
    } <= set(result)
    bad = result["float_accuracy"] - result["integer_accuracy"] > 0.01 or result["agreement"] < 0.98
    assert status == int(bad), err
    assert result["recordings"] == 8 and result["not_touched"] == 0 and len(result["per_step"]) == 4


@pytest.mark.timeout(240)
def test_cosim_compares_and_a_spoiled_weight_ends_with_1(call, folder, model, monkeypatch):
    words = "cosim model --data data.npz --recordings 2 --simulator icarus --lanes 2 --json c.json".split()
    status, out, err = call(*words)
    result = json.loads(Path("c.json").read_text())
    assert status == 0 and result["bit_exact"] and result["recordings"] == 2 and result["steps"] == 8, err
    assert (
        result["lanes"] == 2
        and result["simulator"] == "icarus"
        and "bit-exact" in out
        and os.listdir("build/cosim") == []
    )

    from eskin.verbs import flow

    true_generate = flow.generate
    spoiled = lambda config, arrays, *rest, **more: true_generate(
        config, {**arrays, "b_y": arrays["b_y"] + [64, 0]}, *rest, **more
    )
    monkeypatch.setattr(flow, "generate", spoiled)
    status, out, _ = call(*words)
    result = json.loads(Path("c.json").read_text())
    assert status == 1 and not result["bit_exact"] and "mismatch: " in out and "stage logit" in out
    assert Path(result["waves"]).is_dir() and result["waves"] in out.replace("\n", "")


@each_row(
    ("words", "sentence"),
    [
        (["--logit-error", "0.5"], "give --data with it, and no width"),
        ("--logit-error 0.5 --data data.npz --weight-bits 8".split(), "give --data with it, and no width"),
        (["--group", "person"], "--group says what --logit-error leaves out; give both"),
        (
            "--logit-error -1 --data data.npz".split(),
            "field logit_error: is -1; give the largest difference of a logit, 0.5 say",
        ),
        ("--logit-error 0.5 --data data.npz --group nobody".split(), "has no group array 'nobody'"),
    ],
)
def test_widths_by_error_are_refused_where_they_cannot_be_chosen(call, folder, model, words, sentence):
    refused(call, folder, ["quantise", "model", *words], sentence)


@each_row(
    ("float_accuracy", "agreement", "status"),
    [(0.9, 1.0, 0), (0.91, 0.98, 0), (0.9101, 1.0, 1), (0.9, 0.979, 1)],
)
def test_evaluate_ends_with_1_when_integers_lose_more_than_they_may(
    call, folder, model, monkeypatch, float_accuracy, agreement, status
):
    import eskin.golden.training.evaluate

    figures = {"float_accuracy": float_accuracy, "integer_accuracy": 0.9, "agreement": agreement}
    compare = eskin.golden.training.evaluate.compare
    monkeypatch.setattr(eskin.golden.training.evaluate, "compare", lambda *traces: compare(*traces) | figures)
    assert call(*"evaluate model --data data.npz".split())[0] == status


# ---------------------------------------------------------------------- bad input (issue 2)
BAD_ARCHIVES = {
    "without offsets": (dict(offsets=None), "array offsets: is missing"),
    "label outside": (dict(labels=np.full(8, 2)), "array labels: gives recording 0 class 2"),
    "samples that are no number": (
        dict(samples=np.full((800, 4), np.nan)),
        "array samples: holds nan at row 0, taxel 0",
    ),
}


@each_row("case", BAD_ARCHIVES)
def test_a_bad_archive_is_refused_by_every_verb_that_reads_one(call, folder, model, case):
    changes, sentence = BAD_ARCHIVES[case]
    np.savez("bad.npz", **arrays(**changes))
    for words in (
        ["inspect", "bad.npz"],
        "train --data bad.npz --out model".split(),
        "run --data bad.npz --out result".split(),
        "quantise model --data bad.npz".split(),
        "evaluate model --data bad.npz --json e.json".split(),
        "cosim model --data bad.npz --json c.json".split(),
        "generate model --out design --data bad.npz".split(),
    ):
        work = [path for path in folder.glob(".result.work*")]
        assert not work
        refused(call, folder, words, "bad.npz", sentence)


OTHER_DATA = {
    "other taxels": (
        dict(samples=np.ones((800, 6), np.uint16)),
        "array samples: has 6 taxels and configuration 'small'",
    ),
    "other classes": (dict(class_names=np.array(["a", "b"])), "array class_names: "),
}


@each_row("case", OTHER_DATA)
def test_recordings_of_another_sensor_or_task_are_refused(call, folder, model, case):
    changes, sentence = OTHER_DATA[case]
    np.savez("other.npz", **arrays(**changes))
    for words in (
        "evaluate model --data other.npz --json e.json".split(),
        "cosim model --data other.npz --json c.json".split(),
        "quantise model --data other.npz".split(),
        "generate model --out design --data other.npz".split(),
        "train --data other.npz --config config.json --out model".split(),
    ):
        refused(call, folder, words, "other.npz", sentence)


def test_a_short_recording_is_no_error(call, folder, model):
    keep = np.r_[0:70, 100:800]  # the first recording ends 30 frames after its touch began
    np.savez(
        "short.npz", **arrays(samples=arrays()["samples"][keep], offsets=np.r_[0, np.arange(70, 771, 100)])
    )
    status, _, err = call(*"evaluate model --data short.npz --json e.json".split())
    assert status in (0, 1), err
    assert json.loads(Path("e.json").read_text())["recordings"] == 8


def damage_cut(model: Path) -> str:
    path = model / "weights.npz"
    path.write_bytes(path.read_bytes()[:200])
    return "weights.npz: is damaged"


def damage_other_configuration(model: Path) -> str:
    path = model / "config.json"
    path.write_text(path.read_text().replace('"hidden": 4', '"hidden": 5'))
    return "use weights and config.json of one model"


@each_row("damage", [damage_cut, damage_other_configuration])
def test_a_damaged_or_foreign_model_folder_is_refused(call, folder, model, damage):
    whole = everything(model)
    sentence = damage(model)
    for words in (
        "generate model --out design".split(),
        "evaluate model --data data.npz --json e.json".split(),
        "cosim model --data data.npz --json c.json".split(),
    ):
        refused(call, folder, words, "model", sentence)
    for name, content in whole.items():
        (model / name).write_bytes(content)


BAD_CONFIGURATIONS = {
    "accumulator too narrow": (
        dict(lane_type="dsp", weight_format="SQ(8,8)", recurrent_format="SQ(8,8)"),
        "field lane_type: is 'dsp', whose accumulator has 32 bits, and these formats need",
    ),
    "clock too slow": (
        dict(clock_hz=1000.0),
        "field clock_hz: is 1000: 5 cycles a frame cannot take 4 taxels",
    ),
    "unknown field": (dict(hopp=3), "unknown field hopp"),
}


@each_row("case", BAD_CONFIGURATIONS)
def test_a_configuration_that_cannot_work_is_refused_before_any_work(call, folder, model, case, monkeypatch):
    changes, sentence = BAD_CONFIGURATIONS[case]
    values = json.loads(CONFIG.to_json())
    for field, value in changes.items():
        values[GROUP_OF.get(field, "windows")][field] = value
    Path("bad.json").write_text(json.dumps(values))
    import eskin.golden.data.load

    def too_late(*_, **__):
        raise AssertionError("recordings were read before the configuration was refused")

    monkeypatch.setattr(eskin.golden.data.load, "load_archive", too_late)
    for words in (
        "train --data data.npz --config bad.json --out model".split(),
        "run --data data.npz --config bad.json --out result".split(),
        "inspect data.npz --config bad.json".split(),
    ):
        refused(call, folder, words, "bad.json", sentence)


def test_folders_that_are_not_theirs_are_left_alone(call, folder, model):
    (folder / "mine").mkdir()
    (folder / "mine" / "thesis.tex").write_text("years of work")
    refused(call, folder, "train --data data.npz --out mine".split(), "mine", "thesis.tex")
    refused(call, folder, "generate model --out mine".split(), "mine", "other files")
    refused(call, folder, "run --data data.npz --out mine".split(), "mine", "other files")
    refused(call, folder, ["report", "mine"], "mine", "run.json")
    refused(call, folder, "train --data data.npz --out data.npz".split(), "data.npz", "is the input")
    refused(call, folder, "inspect data.npz --out mine".split(), "mine: is no regular file")
    refused(call, folder, "inspect data.npz --json /dev/null".split(), "/dev/null: is no regular file")


def test_other_bad_options_are_refused(call, folder, model):
    refused(
        call,
        folder,
        "train --data data.npz --out new --group person".split(),
        "has no group array 'person'; it has trial",
    )
    refused(
        call,
        folder,
        "cosim model --data data.npz --recordings 0".split(),
        "--recordings 0: is no number of recordings",
    )
    refused(
        call,
        folder,
        "cosim model --data data.npz --recordings few".split(),
        "--recordings few: is no number of recordings",
    )
    refused(
        call,
        folder,
        "generate model --out design --lanes 0".split(),
        "field lanes: is 0; it must lie in 1..64",
    )
    for clock in ("0", "nan", "-1", "fast"):
        refused(
            call,
            folder,
            ["cosim", "model", "--data", "data.npz", "--clock", clock],
            "is no clock; give hertz",
        )
    lowest = "cosim model --data data.npz --clock lowest".split()
    refused(
        call,
        folder,
        lowest,
        "--clock lowest: budgets are met or missed at the sensor's pace; add --pace declared",
    )
    slow = "cosim model --data data.npz --pace declared --clock 700".split()
    refused(call, folder, slow, "--clock 700: is too slow for 4 taxels at 200 Hz")
    aware = "train --data data.npz --out other --state-bits 12".split()
    refused(call, folder, aware, "--state-bits: needs --quantisation-aware")
    refused(call, folder, ["inspect", "nothing.npz"], "nothing.npz", "is not there")
    refused(
        call, folder, "inspect data.npz --config fabrik".split(), "configuration 'fabrik'", "give a preset"
    )


# ---------------------------------------------------------------------- interrupts and full disks
def test_an_interrupt_ends_with_130_and_one_sentence(folder):
    os.mkfifo("pipe.json")
    before = set(os.listdir())
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "eskin.cli.main", "inspect", "data.npz", "--config", "pipe.json"]
    # a background job inherits an ignored SIGINT; a user at a terminal does not
    reset = lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)
    child = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment, preexec_fn=reset)
    try:
        writer, deadline = None, time.monotonic() + 60
        while writer is None and time.monotonic() < deadline:
            try:
                # succeeds once the command waits for data
                writer = os.open("pipe.json", os.O_WRONLY | os.O_NONBLOCK)
            except OSError:
                time.sleep(0.05)
        assert writer is not None and child.poll() is None
        child.send_signal(signal.SIGINT)
        _, err = child.communicate(timeout=60)
        os.close(writer)
    finally:
        child.kill()
    assert child.returncode == 130 and err.startswith("eskin: stopped by the user") and err.count("\n") == 1
    assert set(os.listdir()) == before


def test_a_full_disk_ends_with_2_and_leaves_the_old_file(folder):
    Path("picture.png").write_bytes(b"old")
    before = everything(folder)
    done = subprocess.run(
        [sys.executable, "-m", "eskin.cli.main", "inspect", "data.npz", "--out", "picture.png"],
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONDONTWRITEBYTECODE": "1"},
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096)),
    )
    assert done.returncode == 2 and done.stderr.startswith("eskin: ") and done.stderr.count("\n") == 1, (
        done.stderr
    )
    assert "File too large" in done.stderr and everything(folder) == before


def test_a_file_is_exchanged_not_overwritten(folder):
    from eskin.golden.core.files import write_json

    write_json("figures.json", {"old": 1})
    with open("figures.json") as reader:
        write_json("figures.json", {"new": 2})
        assert json.load(reader) == {"old": 1}  # whoever has it open sees the whole old file
    assert json.loads(Path("figures.json").read_text()) == {"new": 2}
    assert sorted(os.listdir()) == ["config.json", "data.npz", "figures.json"]
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json("figures.json", {"bad": float("nan")})
    assert json.loads(Path("figures.json").read_text()) == {"new": 2}


def test_presets_are_offered_by_name_in_the_help(call):
    out = call("train", "--help")[1]
    assert all(name in out for name in PRESETS)
