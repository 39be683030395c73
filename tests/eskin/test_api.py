"""eskin/api.py, what ``import eskin`` shows: a model in Python, its stream against its predictions."""

import numpy as np
import pytest

import eskin
from eskin.golden.core import AcceleratorConfig
from eskin.golden.model import run
from eskin.training.made_up import random_images
from tests.support.folder import exchanges
from tests.support.image_scenes import random_image_model
from tests.support.random_models import random_integer_model
from tests.support.recipes import few_updates
from tests.support.table import refused
from tests.support.touch_scenes import SMALL, scene


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """Trained on the small scene, and loaded."""
    folder = tmp_path_factory.mktemp("fitted") / "model"
    with pytest.MonkeyPatch.context() as patch:
        few_updates(patch, 200)
        eskin.Model(SMALL, folds=0).fit(scene(60)).save(folder)
    return eskin.Model.load(folder)


def test_every_public_name_is_there_and_no_other():
    for name in eskin.__all__:
        assert getattr(eskin, name) is not None
        assert name == "__version__" or getattr(eskin, name).__doc__
    assert set(eskin.__all__) == set(dir(eskin))
    with pytest.raises(AttributeError, match="has no attribute 'Modell'"):
        _ = eskin.Modell


def test_every_form_of_frames_gives_the_same(model):
    recordings = scene(12, seed=5)
    arrays = [recordings.recording(index) for index in range(len(recordings))]
    expected = model.predict(recordings)
    assert expected.shape == (12,) and expected[0] == -1  # recording 0 of the scene is never touched
    assert np.array_equal(expected, run(model.integer, recordings).decision)
    assert np.array_equal(model.predict(arrays), expected)
    assert np.array_equal(model.predict([array.tolist() for array in arrays[:2]]), expected[:2])
    assert np.array_equal(np.concatenate([model.predict(array) for array in arrays]), expected)
    frames = min(map(len, arrays[2:4]))
    assert len(model.predict(np.stack([array[:frames] for array in arrays[2:4]]))) == 2
    assert np.array_equal(model.predict(recordings, integer=False), run(model.real, recordings).decision)


def test_vectors_are_recordings_of_one_taxel():
    model = eskin.Model()
    model._integer = random_integer_model(AcceleratorConfig.of(taxels=1, sample_rate_hz=100.0), 1)
    vector = np.arange(50)
    assert np.array_equal(model.predict([vector] * 2), model.predict([vector[:, None]] * 2))


def test_scores_are_those_that_decide(model):
    recordings = scene(30, seed=7)
    for integer in (True, False):
        decided = model.predict(recordings, integer=integer)
        scores = model.decision_function(recordings, integer=integer)
        assert np.isnan(scores[decided < 0]).all() and (decided < 0).any()
        assert np.argmax(scores[decided >= 0], axis=1).tolist() == decided[decided >= 0].tolist()
    other = eskin.Model()
    other._integer = type(model.integer)(model.config.replace(decision="last"), dict(model.integer.arrays))
    trace = other.trace(recordings)
    codes = trace.logits[trace.first[2], trace.global_step[trace.first[2]]]
    logits = other.config.formats.logit_format.to_real(codes)
    assert np.array_equal(other.decision_function(recordings)[2], logits)


def test_a_saved_model_is_the_same(model, tmp_path, monkeypatch):
    written = exchanges(monkeypatch)
    model.save(tmp_path / "model")
    assert written == ["model"]
    again = eskin.Model.load(tmp_path / "model")
    recordings = scene(12, seed=5)
    assert again.config == model.config
    assert again.training_["seed"] == 0
    assert again.classes_.tolist() == ["rise", "fall", "pulse"]
    assert np.array_equal(
        again.decision_function(recordings), model.decision_function(recordings), equal_nan=True
    )
    (tmp_path / "model" / "weights.npz").unlink()
    floats = eskin.Model.load(tmp_path / "model")
    assert "not quantised" in repr(floats) and len(floats.predict(recordings, integer=False)) == 12
    with refused("has no integers"):
        floats.predict(recordings)


def test_a_model_of_real_samples_takes_real_samples(tmp_path):
    """Its scale is that of the recordings it was trained on, for predictions and streams alike."""
    whole = scene(30)
    arrays = [whole.recording(index) / 37.0 for index in range(30)]
    eskin.Model(cell="linear", folds=0).fit(arrays, whole.labels, sample_rate_hz=1000).save(tmp_path / "m")
    trained = eskin.Model.load(tmp_path / "m")
    worth, decided = trained.config.sensor.volt_per_code, trained.predict(arrays)
    assert worth > 0 and trained.score(arrays, whole.labels) > 0.6
    codes = [np.rint(array / worth).astype(int) for array in arrays]
    assert np.array_equal(trained.predict(codes), decided)
    stream = trained.stream()
    for array, label in zip(arrays[:6], decided, strict=False):
        stream.arm(), stream.push(array), stream.finish()
        assert stream.decision == label
    arrays[3][5, 1] = np.nan
    for taken, words in ((trained.predict, "holds nan"), (stream.push, "values that are not a number")):
        with refused(words):
            taken(arrays[3])


def test_a_network_for_images_predicts_from_arrays():
    """Of one image, several, or real pixels; streams and stage traces are for recordings."""
    config = AcceleratorConfig.of_image(7, 9, ("conv 3 4", "pool", "dense 3"), ("a", "b", "c"), name="few")
    model = eskin.Model(config)
    model._integer = random_image_model(config, 0)
    images = random_images(config, 6, 1)
    classes = model.predict(images)
    assert len(set(classes.tolist())) > 1 and model.predict(images[2]).tolist() == [classes[2]]
    assert model.predict(images / 255.0).tolist() == classes.tolist()
    assert (model.decision_function(images).argmax(axis=1) == classes).all()
    assert model.score(images, classes) == 1.0 and repr(model) == "Model(few, 3 classes)"
    for wrong, words in (
        (images[:, :6], "images of 6 x 9 pixels and configuration 'few' takes 7 x 9"),
        (images + 0.5, "real pixels lie in 0..1"),
        ([images[0], images[0][:5]], "give images of one size"),
    ):
        with refused(words):
            model.predict(wrong)
    for call in (model.stream, lambda: model.trace(images)):
        with refused("is a network for images"):
            call()
