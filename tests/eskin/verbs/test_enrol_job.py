"""eskin enrol: the verb, its evaluation kept by content, and an enrolled model in the board of the old
one."""

import dataclasses
import json

import numpy as np
import pytest

from eskin.data.archive import save_archive
from eskin.golden.model import IntegerModel
from eskin.golden.model import run as run_model
from eskin.rtl.fpga.generate import boot_writes
from eskin.teach import enrol
from eskin.training import recipe
from eskin.training.integers import quantise
from eskin.training.train import TrainingRequest, train
from eskin.verbs import replay_job
from tests.eskin.teach.test_enrol import FEW, OLD, REST
from tests.support.link_device import Device, golden_decisions
from tests.support.touch_scenes import SMALL


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("enrolled")
    signed = SMALL.replace(sample_signed=True)
    with pytest.MonkeyPatch.context() as patch:
        few = {name: dataclasses.replace(one, updates=200) for name, one in recipe.RECIPES.items()}
        patch.setattr(recipe, "RECIPES", few)
        train(OLD, signed, TrainingRequest(folds=0), out=folder / "model")
    quantise(folder / "model", OLD)
    for name, recordings in (("few", FEW), ("old", OLD)):
        save_archive(dataclasses.replace(recordings, sample_signed=True), folder / f"{name}.npz")
    return folder


def test_the_board_of_the_old_model_runs_the_new_one(call, files, tmp_path, monkeypatch):
    """The device is of the old configuration; replay loads the new weights, and the decisions are the new
    model's."""
    setting = dataclasses.replace(enrol.SETTINGS[True], updates=80)
    monkeypatch.setitem(enrol.SETTINGS, True, setting)
    words = f"enrol {files}/model --data {files}/few.npz --with {files}/old.npz --out {tmp_path}/m2"
    status, out, errors = call(*words.split(), "--json", tmp_path / "enrol.json")
    assert status == 0 and "same bitstream" in out
    assert all(line.startswith("enrolment: ") for line in errors.splitlines())  # progress, on a slow machine
    assert json.loads((tmp_path / "enrol.json").read_text())["old_after"] is not None
    old, new = IntegerModel.load(files / "model"), IntegerModel.load(tmp_path / "m2")
    assert new.config == old.config
    few = REST.subset(np.arange(6))
    # else the test could not tell them apart
    assert (run_model(old, few).decision != run_model(new, few).decision).any()
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
