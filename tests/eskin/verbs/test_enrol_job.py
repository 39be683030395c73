"""eskin enrol: the verb, its evaluation kept by content, and an enrolled model in the board of the old
one."""

import dataclasses
import json

import numpy as np
import pytest

from eskin.golden.data import save_archive
from eskin.golden.model import IntegerModel
from eskin.golden.model import run as run_model
from eskin.rtl.fpga.generate import boot_writes
from eskin.teach import evaluate as evaluating
from eskin.training.quantise import quantise
from eskin.training.train import TrainingRequest, train
from eskin.verbs import enrol_job, replay_job
from tests.eskin.teach.test_enrol import BOTH, FEW, OLD, REST
from tests.support.link_device import Device, golden_decisions
from tests.support.table import each_row
from tests.support.touch_scenes import SMALL


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("enrolled")
    signed = SMALL.replace(sample_signed=True)
    train(OLD, signed, TrainingRequest(folds=0), out=folder / "model")
    quantise(folder / "model", OLD)
    (folder / "small.json").write_text(signed.to_json())
    for name, recordings in (("few", FEW), ("old", OLD), ("both", BOTH)):
        save_archive(dataclasses.replace(recordings, sample_signed=True), folder / f"{name}.npz")
    return folder


def test_the_board_of_the_old_model_runs_the_new_one(call, files, tmp_path, monkeypatch):
    """The device is of the old configuration; replay loads the new weights, and the decisions are the new
    model's."""
    status, out, errors = call(
        "enrol",
        files / "model",
        "--data",
        files / "few.npz",
        "--with",
        files / "old.npz",
        "--out",
        tmp_path / "m2",
        "--json",
        tmp_path / "enrol.json",
    )
    assert status == 0 and "same bitstream" in out
    assert all(line.startswith("enrolment: ") for line in errors.splitlines())  # progress, on a slow machine
    assert json.loads((tmp_path / "enrol.json").read_text())["old_after"] is not None
    old, new = IntegerModel.load(files / "model"), IntegerModel.load(tmp_path / "m2")
    assert new.config == old.config
    few = REST.subset(np.arange(6))
    assert (
        run_model(old, few).decision != run_model(new, few).decision
    ).any()  # else the test could not tell them apart
    monkeypatch.setattr(replay_job, "ANSWER_S", 0.1)
    with Device(old.config, golden_decisions(new, few)) as device:
        result = replay_job.replay(
            new, few, port=device.port, baud=2_000_000, progress=lambda done, total: None
        )
    assert result["passed"] and result["recordings"] == 6
    loads = {name: boot_writes(model.config, model.arrays) for name, model in (("old", old), ("new", new))}
    assert device.writes[1 : 1 + len(loads["new"])] == loads["new"] != loads["old"]
    # the same memories, other words
    assert [address for address, _ in loads["new"]] == [address for address, _ in loads["old"]]


def test_the_evaluation_is_kept_and_repeats(call, files, tmp_path, monkeypatch):
    monkeypatch.setitem(enrol_job.evaluate.__kwdefaults__, "cache", tmp_path / "cache")
    options = ["enrol", "--data", files / "both.npz", "--config", files / "small.json"]
    options += "--evaluate --group mounting -k 1".split()
    status, out, errors = call(*options, "--seeds", "1", "--json", tmp_path / "one.json")
    assert status == 0 and "mounting" in out and "Traceback" not in errors
    one = json.loads((tmp_path / "one.json").read_text())
    assert {
        "group",
        "value",
        "k",
        "layers",
        "before",
        "after",
        "others_before",
        "others_after",
        "recordings",
    } <= set(one["rows"][0])
    assert (
        set(one["mean"]) == {"1"}
        and one["mean"]["1"]["after"] > one["mean"]["1"]["before"]
        and one["seeds"] == [0]
    )

    judged = []
    monkeypatch.setattr(
        evaluating, "judge", lambda recordings, question: judged.append(question.seed) or one_seed(one)
    )

    def one_seed(result):
        figures = "before after others_before others_after"
        names = ("value", "k", *figures.split(), "recordings", "others", "lacking")
        return [{name: row[name] for name in names} for row in result["rows"]]

    assert call(*options, "--seeds", "2", "--json", tmp_path / "two.json")[0] == 0
    assert judged == [1]  # seed 0 is known
    assert call(*options, "--seeds", "1", "--readout", "prototypes")[0] == 0
    assert judged == [1, 0]  # another question


@each_row(
    ("arguments", "says"),
    [
        (
            ("--evaluate", "--data", "both.npz", "--group", "person", "--config", "small.json"),
            "no group array 'person'; it has mounting",
        ),
        (("--evaluate", "--data", "both.npz", "--config", "small.json"), "option --group: is missing"),
        (
            ("--evaluate", "--data", "both.npz", "--group", "mounting", "-k", "0"),
            "-k 0: is no list of touches a class",
        ),
        (
            ("model", "--evaluate", "--data", "both.npz", "--group", "mounting"),
            "MODEL: belongs to no --evaluate",
        ),
        (("model", "--data", "few.npz"), "option --out: is missing"),
        (("--evaluate", "--group", "seq"), "option --data: is missing"),
        (("model", "--out", "m"), "option --data: is missing"),
        (("model", "--teach", "few.npz", "--data", "few.npz", "--out", "m"), "--teach trains nothing"),
        (("--data", "few.npz", "--out", "m"), "MODEL: is missing"),
        (("model", "--data", "few.npz", "--out", "m", "--group", "a"), "option --group: needs --evaluate"),
        (("few.npz", "--data", "few.npz", "--out", "m"), "so it is no model folder"),
        (("model", "--data", "missing.npz", "--out", "m"), "missing.npz"),
    ],
)
def test_bad_usage_is_one_sentence(call, files, monkeypatch, arguments, says):
    monkeypatch.chdir(files)
    status, _, errors = call("enrol", *arguments)
    assert (
        status == 2 and says in errors and len(errors.strip().splitlines()) <= 2 and "Traceback" not in errors
    ), errors
    assert not (files / "m").exists()


def test_help_has_both_examples(call):
    _, out, _ = call("enrol", "--help")
    assert "--evaluate" in out and "few.npz" in out
