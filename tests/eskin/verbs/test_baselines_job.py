"""eskin baselines: table and JSON; finished runs are not done again; bad input is one sentence before anything
is trained."""

import json
import os
from functools import partial

import pytest
from typer.testing import CliRunner

from eskin.cli.main import app
from eskin.golden.core import InputError
from eskin.study import baselines
from eskin.verbs import baselines_job
from tests.support.result_case import ROW_KEYS
from tests.support.table import each_row
from tests.support.touch_scenes import archived, scene


@pytest.fixture
def archive(tmp_path, monkeypatch):
    """An archive of the scene in the current folder; the pieces that are judged are noted."""
    archived(scene(40), tmp_path)
    monkeypatch.chdir(tmp_path)
    seen = []
    real = baselines.judge

    def noted(shared, piece):
        seen.append(piece.method.name)
        return real(shared, piece)

    monkeypatch.setattr(baselines, "judge", noted)
    monkeypatch.setattr(os, "cpu_count", lambda: 1)
    monkeypatch.setattr(baselines_job, "run", partial(baselines_job.run, folds=2, seeds=1))
    return seen


def call(*words):
    common = "baselines --data data.npz --config c.json --out out".split()
    return CliRunner().invoke(app, [*common, *words])


def test_table_and_json(archive, tmp_path):
    words = "--group person".split()
    done = call(*words)
    assert done.exit_code == 0, (done.output, done.exception)
    result = json.loads((tmp_path / "out" / "baselines.json").read_text())
    assert {row["method"]: row["hardware"] for row in result["rows"]} == {
        name: name == "gru" for name in ("logistic", "svm", "forest", "neighbours", "gru")
    }
    assert all(set(row) >= ROW_KEYS and row["split"] == "person" for row in result["rows"])
    shares = [row["accuracy"] for row in result["rows"]]
    assert shares == sorted(shares, reverse=True)
    assert "logistic regression" in done.output and "comparisons" in done.output
    assert call(*words).exit_code == 0 and len(archive) == 5  # all were kept


@each_row(
    ("options", "words"),
    [(["--group", "colour"], "no group array 'colour'"), (["--config", "none"], "configuration 'none'")],
)
def test_bad_usage_trains_nothing_and_writes_nothing(archive, tmp_path, options, words):
    done = call(*options)
    assert isinstance(done.exception, InputError) and words in str(done.exception)
    assert not archive and not (tmp_path / "out").exists()
