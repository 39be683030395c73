"""eskin/teach/enrol.py: a shifted mounting is learnt, the configuration stays, what cannot be enrolled is
refused."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from eskin.choose.candidate import best_of, choose
from eskin.choose.choice import search_inside
from eskin.choose.front_ends import FrontEnds
from eskin.cli.common import show
from eskin.golden.data import Recordings
from eskin.golden.model import FloatModel, IntegerModel, load_config, run
from eskin.teach import enrol as enrolling
from eskin.teach.enrol import EnrolmentTrial, enrol, judge, summary, teach_folder
from eskin.training import judge as judging
from eskin.training import prototypes as prototypes_of
from eskin.training.evaluate import evaluate
from eskin.training.formats import with_network
from eskin.training.integers import quantise
from eskin.training.judge import FittedNetwork
from eskin.training.train import train
from tests.support.folder import exchanges
from tests.support.prices import priced
from tests.support.recipes import few_updates
from tests.support.table import each_row, refused
from tests.support.touch_scenes import SMALL, scene

GAINS = np.array([0.4, -0.8, 1.2, 1.6])
"""Of the new mounting, by taxel: one is turned over."""


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    """Fewer updates: this scene is learnt sooner than recordings are."""
    few_updates(monkeypatch, 120)


def mounted(recordings: Recordings, gains: np.ndarray = GAINS, offset: int = 40) -> Recordings:
    """The same touches on a mounting that answers ``gains`` times as much and rests ``offset`` codes
    higher."""
    samples = np.rint(1000 + offset + (recordings.samples - 1000) * gains).astype(np.int32)
    return replace(recordings, samples=samples)


def of_classes(recordings: Recordings, each: int, first: int = 2) -> np.ndarray:
    """``each`` recordings of every class, from recording ``first`` on (0 and 1 show no whole touch)."""
    labels = recordings.labels[first:]
    return np.concatenate([first + np.flatnonzero(labels == label)[:each] for label in range(3)])


OLD, NEW = scene(90, seed=1), mounted(scene(60, seed=2))
FEW = NEW.subset(of_classes(NEW, 2))
REST = NEW.subset(np.setdiff1d(np.arange(2, 60), of_classes(NEW, 2)))


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    folder = tmp_path_factory.mktemp("enrol") / "model"
    train(OLD, SMALL, out=folder)
    quantise(folder, OLD)
    return folder


def accuracy(folder, recordings: Recordings) -> float:
    return run(IntegerModel.load(folder), recordings).accuracy(recordings.labels)


def changed(old, new) -> set[str]:
    """Arrays in which two model folders of one configuration differ."""
    assert load_config(old) == load_config(new)
    before, after = IntegerModel.load(old).arrays, IntegerModel.load(new).arrays
    return {name for name in before if (before[name] != after[name]).any()}


EACH_TWO = {"rise": 2, "fall": 2, "pulse": 2}


@pytest.mark.parametrize("old", [OLD, pytest.param(None, marks=pytest.mark.slow)], ids=["with", "alone"])
def test_a_new_mounting_is_learnt_and_only_weights_change(model, tmp_path, old):
    result = enrol(model, FEW, tmp_path / "m", old=old)
    # else there is nothing to learn
    assert (before := accuracy(model, REST)) < 0.7 and accuracy(tmp_path / "m", REST) > before + 0.1
    arrays = changed(model, tmp_path / "m")
    assert arrays > {"V", "b_y"} and not arrays & {"mean", "scale"}
    assert result.after >= result.before and result.touches == EACH_TWO and result.passed
    assert (result.old_after is None) == (old is None)
    assert old is None or result.old_after >= result.old_before - 0.01


@each_row(
    "new, known, passed",
    [
        ((0.5, 0.6), (0.9, 0.895), True),
        ((0.5, 0.5), (0.9, 0.9), True),
        ((0.5, 0.49), (0.9, 0.95), False),
        ((0.5, 0.6), (0.9, 0.885), False),
        ((0.5, 0.49), None, False),
        ((0.5, 0.6), None, True),
    ],
)
def test_an_enrolment_that_loses_does_not_pass(model, tmp_path, monkeypatch, new, known, passed):
    """By the accuracies (before, after) on the new recordings and on the known ones; at most a hundredth of
    these may be lost."""
    trained = FittedNetwork(FloatModel.load(model), IntegerModel.load(model), None)

    def measure(network, labels, rows):
        shares = new if 0 in rows else known
        return shares[int(network is trained)] if len(rows) else None

    monkeypatch.setattr(enrolling, "fit", lambda *_: [trained])
    monkeypatch.setattr(enrolling, "share_right", measure)
    result = enrol(model, FEW, tmp_path / "m", old=OLD if known else None)
    assert result.passed is passed and (result.before, result.after) == pytest.approx(new)


# ---------------------------------------------------------------------- refusals


@each_row(
    "change, says",
    [
        (lambda: replace(FEW, class_names=("rise", "fall", "wave")), "has recordings of wave"),
        (lambda: replace(FEW, samples=FEW.samples[:, :3]), "has 3 taxels"),
        (lambda: replace(FEW, sample_rate_hz=500.0), "sample_rate_hz"),
        (lambda: FEW.subset(np.flatnonzero(FEW.labels != 2)), "no touch of class pulse"),
        (lambda: replace(FEW, samples=np.full_like(FEW.samples, 1000)), "no touch of class rise"),
    ],
)
def test_what_cannot_be_enrolled_is_refused(model, tmp_path, change, says):
    with refused(says):
        enrol(model, change(), tmp_path / "m")
    assert not (tmp_path / "m").exists()


# ---------------------------------------------------------------------- evaluation
BOTH = replace(
    enrolling.joined(OLD.subset(np.arange(2, 90)), NEW.subset(np.arange(2, 60))),
    groups={"mounting": np.repeat([0, 1], [88, 58])},
)


def trial(**changes) -> EnrolmentTrial:
    usual = {"ks": (1, 2), "configs": (SMALL, SMALL)}
    return EnrolmentTrial(**({"groups": ("mounting",), "seed": 7} | usual | changes))


def test_enrolment_is_judged_on_what_no_training_saw():
    rows = judge(BOTH, trial())
    assert [(row["value"], row["k"]) for row in rows] == [("0", 1), ("1", 1), ("0", 2), ("1", 2)]
    for row in rows:
        members, others = (88, 58) if row["value"] == "0" else (58, 88)
        assert row["recordings"] == members - 2 * 3  # the same judge every k
        assert 0 < row["others"] <= others // 5 + 3
        assert row["after"] > row["before"] + 0.1 and row["others_after"] >= row["others_before"] - 0.1


def test_nothing_of_the_left_out_value_is_learnt_before_it_is_enrolled(monkeypatch):
    """What both trainings are given; the second changes nothing."""
    seen: dict = {}
    fit_first = judging.fit_networks

    def first(data, config, recipe, parts, *rest):
        seen.update(first=parts)
        return fit_first(data, config, recipe, parts, *rest)

    def more(networks, recipe, new, old, *rest):
        seen.update(recording=networks[0].data.touches.recording, new=new, old=old)
        return list(networks)

    monkeypatch.setattr(judging, "fit_networks", first)
    monkeypatch.setattr(enrolling, "fit", more)
    judge(BOTH, trial(ks=(2,)))
    recording, mounting = seen["recording"], BOTH.groups["mounting"]
    aside = enrolling.set_aside(BOTH, enrolling.group_values(BOTH, ["mounting"], (2,)))
    for value in (0, 1):
        before, old, new = (recording[seen[name][value]] for name in ("first", "old", "new"))
        assert (mounting[before] == 1 - value).all() and not aside[before].any() and (old == before).all()
        assert (mounting[new] == value).all() and np.bincount(BOTH.labels[new]).tolist() == [2, 2, 2]


def test_the_summary_weighs_by_recordings():
    def row(value, before, after, recordings):
        others = {"others_before": 1.0, "others_after": None, "others": 4}
        return dict(value=value, k=1, before=before, after=after, recordings=recordings, lacking=[], **others)

    runs = [[row("a", low, high, 30), row("b", 1.0, 1.0, 10)] for low, high in ((0.5, 0.75), (0.7, 0.95))]
    result = summary(["g"], runs)
    first, mean = result["rows"][0], result["mean"]["1"]
    assert first["group"] == "g" and first["before"] == pytest.approx(0.6)
    assert first["others_after"] is None is mean["others_after"]
    assert mean["after"] == pytest.approx(0.85 * 0.75 + 0.25)


def test_front_ends_are_chosen_without_the_values_they_serve(monkeypatch):
    """The labels of a value left out change nothing that is chosen for it; its part's values share one front
    end."""
    monkeypatch.setattr(enrolling, "CHOICES", 2)
    mounting = np.arange(36) // 3 % 3
    three = replace(BOTH.subset(np.arange(36)), groups={"mounting": mounting})
    values = enrolling.group_values(three, ["mounting"], [1])
    configs = enrolling.front_ends_without(three, values, ["mounting"], priced())
    assert configs[0] == configs[2]
    prices, rest = priced(), np.flatnonzero(mounting != 1)
    judged = search_inside(FrontEnds(three), rest, ["mounting"], prices)
    dearer = prices.price(with_network(configs[1], cell="linear")) > prices.price(
        choose(judged, prices).config
    )
    assert dearer and configs[1] == best_of(judged).candidate.front_end
    labels = np.where(mounting == 1, np.random.default_rng(0).permutation(three.labels), three.labels)
    mixed = replace(three, labels=labels)
    assert enrolling.front_ends_without(mixed, values, ["mounting"], priced())[1] == configs[1]


# ---------------------------------------------------------------------- taught, not trained
@pytest.fixture(scope="module")
def taught_ready(model, tmp_path_factory):
    """The model with a prototype a class and person, and three places a class."""
    folder = tmp_path_factory.mktemp("teach") / "model"
    shutil.copytree(model, folder)
    (folder / "config.json").write_text(load_config(folder).replace(decision="last").to_json())
    quantise(folder, OLD, readout={"groups": ["person"]})
    return folder


def test_a_new_mounting_is_taught_and_no_weight_changes(model, taught_ready, tmp_path, monkeypatch):
    rule, written = load_config(taught_ready).readout_rule, exchanges(monkeypatch)
    assert (rule.prototypes, rule.taught, rule.state_code_bits) == (8, 3, 4)
    result = teach_folder(taught_ready, FEW, tmp_path / "m")
    assert written == ["m"]
    before, after = accuracy(taught_ready, REST), accuracy(tmp_path / "m", REST)
    assert before < 0.7 and after > before + 0.1
    assert accuracy(tmp_path / "m", OLD) >= accuracy(model, OLD) - 0.05
    assert changed(taught_ready, tmp_path / "m") == {"taught", "taught_count"}
    assert result.touches == EACH_TWO == result.in_use and result.passed
    judged = evaluate(tmp_path / "m", REST)  # the float network decides by the same prototypes
    assert judged.agreement > 0.9, judged
    assert judged.float_accuracy >= after - 0.02
    with refused("it holds taught touches, which new integers would lose"):
        quantise(tmp_path / "m", OLD, readout="dense")


def test_teaching_is_judged_from_no_touch_on(capsys):
    draws = judge(BOTH, trial(readout="prototypes"))
    rows = summary(["mounting"], [draws])["rows"]
    assert [(row["value"], row["k"]) for row in rows] == [(v, k) for k in (0, 1, 2) for v in ("0", "1")]
    for row in rows:
        assert row["others_after"] >= row["others_before"] - 0.15  # one of nine
        assert row["k"] == 0 or row["after"] > row["before"] + 0.1
    assert judge(BOTH, trial(readout="prototypes", ks=(1,), seed=8)) != [row for row in draws if row["k"] < 2]
    for touch in (1, 0):  # an evaluation that brings something, and one that brings nothing
        of_k = [row for row in rows if row["k"] in (0, touch)]
        said = summary(["mounting"], [of_k])
        show("enrolments", **said, readout="prototypes", seeds=[7])
        assert capsys.readouterr().err.startswith(
            "teach: the most touches" if touch else "do not teach, train further:"
        )


def test_a_class_that_no_recording_shows_is_known_once_it_is_taught(taught_ready, tmp_path):
    """Network and prototypes of rise and fall alone: pulse is the spare class."""
    known = OLD.subset(np.flatnonzero(OLD.labels != 2))
    train(known, SMALL, out=tmp_path / "m")
    model = quantise(tmp_path / "m", known, readout={"groups": ["person"], "spare_classes": 1})
    pulses = OLD.subset(np.flatnonzero(OLD.labels == 2)[2:])
    assert model.config.readout_rule.spare_classes == 1 and not model.arrays["prototypes"][2].any()
    assert not (run(model, OLD).decision == 2).any()
    teach_few = pulses.subset([0, 4, 8])
    taught, _ = prototypes_of.teach_recordings(model, teach_few)
    assert run(taught, pulses).accuracy(pulses.labels) > 0.6
    assert run(taught, known).accuracy(known.labels) > run(model, known).accuracy(known.labels) - 0.2
    with refused("show class pulse, and the last 1 classes are spare"):
        quantise(tmp_path / "m", OLD, readout={"groups": ["person"], "spare_classes": 1})
