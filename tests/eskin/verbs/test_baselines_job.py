"""eskin baselines: table, chart and JSON; finished runs are not done again; bad input is one sentence before
anything is trained."""

import json

import pytest
from typer.testing import CliRunner

from eskin.cli.main import app
from eskin.golden.core import InputError
from eskin.study.baselines import judge as judging
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
    real = judging.judge
    monkeypatch.setattr(
        judging, "judge", lambda scene, piece: seen.append(piece.method.name) or real(scene, piece)
    )
    return seen


def call(*words):
    common = "baselines --data data.npz --config c.json --jobs 1 --seeds 1 --out out".split()
    return CliRunner().invoke(app, [*common, *words])


def test_table_chart_and_json(archive, tmp_path):
    words = "--group person --methods logistic,boosting,least-squares,gru12-n200".split()
    done = call(*words)
    assert done.exit_code == 0, (done.output, done.exception)
    result = json.loads((tmp_path / "out" / "baselines.json").read_text())
    assert [row["method"] for row in result["rows"]] == ["logistic", "boosting", "least-squares"]
    assert [row["hardware"] for row in result["rows"]] == [False, False, True]
    assert all(set(row) >= ROW_KEYS and row["split"] == "person" for row in result["rows"])
    assert result["left_out"][0]["method"] == "gru12-n200" and "70 frames" in result["left_out"][0]["reason"]
    assert result["nearest"][0]["network"] == "least-squares"
    assert "linear cell, least squares" in done.output
    assert "best of all" in done.output
    assert "comparisons" in done.output
    picture = (tmp_path / "out" / "baselines.svg").read_text()
    for words_ in (
        "multiplies a decision",
        "accuracy (%)",
        "eskin puts it into hardware",
        "least-squares",
        "unseen person",
    ):
        assert words_ in picture
    assert (tmp_path / "out" / "baselines.png").stat().st_size > 10_000
    assert archive == ["logistic", "boosting", "least-squares", "gru12-n200"]
    assert call(*words, "--methods", "logistic,forest,boosting").exit_code == 0
    assert archive[4:] == ["forest"]  # the others were kept
    assert call(*words, "--methods", "logistic", "--seed", "5").exit_code == 0 and archive[5:] == ["logistic"]


def test_changed_code_of_a_family_judges_that_family_again(archive, monkeypatch):
    assert call(*"--group person --methods logistic,least-squares".split()).exit_code == 0
    real = baselines_job.code_version
    changed = "study/baselines/simple.py"
    monkeypatch.setattr(
        baselines_job, "code_version", lambda *names: real(*names) + ("changed" if changed in names else "")
    )
    assert call(*"--group person --methods logistic,least-squares".split()).exit_code == 0
    assert archive == ["logistic", "least-squares", "logistic"]


@each_row(
    ("options", "words"),
    [
        (["--methods", "forst"], "--methods forst: is no method"),
        (["--group", "colour"], "no group array 'colour'"),
        (["--shape", "3x3"], "--shape 3x3: is 9 taxels and the recordings have 4"),
        ("--folds 41 --methods svm".split(), "41 folds were asked for and there are 40 recordings"),
    ],
)
def test_bad_usage_trains_nothing_and_writes_nothing(archive, tmp_path, options, words):
    done = call(*options)
    assert isinstance(done.exception, InputError) and words in str(done.exception)
    assert not archive and not (tmp_path / "out").exists()
