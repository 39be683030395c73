"""eskin/api.py, what ``import eskin`` shows: a model in Python, its stream against its predictions and the
simulated hardware."""

import numpy as np
import pytest

import eskin
from eskin.data import load_recordings
from eskin.golden.core import PRESETS, AcceleratorConfig
from eskin.golden.model import run
from eskin.training.made_up import random_images
from eskin.verbs.flow import cosimulate
from tests.support.folder import exchanges
from tests.support.image_scenes import random_image_model
from tests.support.touch_scenes import SMALL, scene


@pytest.fixture(scope="module")
def model():
    """Trained on the small scene, as ``eskin.train`` does it."""
    return eskin.train(scene(60), config=SMALL, folds=0)


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
    assert expected.tolist() == run(model.integer, recordings).decision.tolist()
    assert model.predict(arrays).tolist() == expected.tolist()
    assert model.predict([array.tolist() for array in arrays[:2]]).tolist() == expected[:2].tolist()
    assert [model.predict(array).tolist() for array in arrays] == [[label] for label in expected.tolist()]
    longest = max(len(array) for array in arrays)
    held = np.stack(
        [np.pad(array, ((0, longest - len(array)), (0, 0)), mode="edge") for array in arrays[2:4]]
    )
    assert len(model.predict(held)) == 2
    assert model.predict(recordings, integer=False).tolist() == run(model.real, recordings).decision.tolist()


def test_scores_are_those_that_decide(model):
    recordings = scene(30, seed=7)
    for integer in (True, False):
        decided = model.predict(recordings, integer=integer)
        scores = model.decision_function(recordings, integer=integer)
        assert np.isnan(scores[decided < 0]).all() and (decided < 0).any()
        assert np.argmax(scores[decided >= 0], axis=1).tolist() == decided[decided >= 0].tolist()
        ordered = np.sort(scores, axis=1)
        assert np.array_equal(
            model.margin(recordings, integer=integer), ordered[:, -1] - ordered[:, -2], equal_nan=True
        )
    last = SMALL.replace(decision="last")
    arrays = dict(model.integer.arrays)
    other = eskin.Model()
    other._integer = type(model.integer)(model.config.replace(decision=last.network.decision), arrays)
    trace = other.trace(recordings)
    logits = (
        trace.logits[trace.first[2], trace.global_step[trace.first[2]]]
        / 2.0**other.config.formats.logit_format.frac_bits
    )
    assert other.decision_function(recordings)[2].tolist() == logits.tolist()


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
    with pytest.raises(eskin.InputError, match="has no integers"):
        floats.predict(recordings)


def test_a_model_is_fitted_on_arrays():
    recordings = scene(30)
    arrays = [recordings.recording(index) for index in range(30)]
    fitted = eskin.Model(SMALL.replace(class_names=("class0", "class1", "class2")), cell="linear", folds=0)
    assert repr(fitted) == "Model(not fitted)"
    assert fitted.fit(arrays, recordings.labels, sample_rate_hz=1000) is fitted
    assert fitted.score(arrays, recordings.labels) > 0.7
    with pytest.raises(eskin.InputError, match="sample_rate_hz"):  # a configuration would say it
        eskin.Model(cell="linear", folds=0).fit(arrays, recordings.labels)


def test_a_model_of_real_samples_takes_real_samples():
    """Its scale is that of the recordings it was trained on, for predictions and streams alike."""
    whole = scene(30)
    arrays = [whole.recording(index) / 37.0 for index in range(30)]
    trained = eskin.train(arrays, whole.labels, sample_rate_hz=1000, cell="linear", folds=0)
    worth = trained.config.sensor.volt_per_code
    codes = [np.rint(array / worth).astype(int) for array in arrays]
    assert worth > 0
    assert trained.predict(arrays).tolist() == trained.predict(codes).tolist()
    assert trained.score(arrays, whole.labels) > 0.6
    stream = trained.stream()
    for array, label in zip(arrays[:6], trained.predict(arrays[:6]), strict=True):
        stream.arm(), stream.push(array), stream.finish()
        assert stream.decision == label
    arrays[3][5, 1] = np.nan
    with pytest.raises(eskin.InputError, match="holds nan"):
        trained.predict(arrays)
    with pytest.raises(eskin.InputError, match="hold values that are not a number"):
        stream.push(arrays[3])


def check_stream(model, recordings, work, *, one_by_one, simulator="verilator"):
    """Stream, prediction and simulated hardware: the same rows of decisions, and of each recording the same
    class."""
    result = cosimulate(model.integer, recordings, work=work, builds=work / "simulators", simulator=simulator)
    assert result["bit_exact"] and result["recordings"] == len(recordings)
    rows, offsets = run(model.integer, recordings).streams["decision"]
    predicted, stream, compared = model.predict(recordings), model.stream(), 0
    rng = np.random.default_rng(1)
    for index in range(len(recordings)):
        stream.arm()
        samples, decisions = recordings.recording(index), []
        cuts = range(1, len(samples)) if one_by_one(index) else np.sort(rng.integers(1, len(samples), 40))
        for piece in np.split(samples, cuts):
            decisions += stream.push(piece)
        decisions += stream.finish()
        assert stream.decision == predicted[index]
        wanted = rows[offsets[index] : offsets[index + 1]].tolist()
        assert [decision.row() for decision in decisions] == [tuple(row) for row in wanted]
        compared += len(wanted)
    return compared


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_stream_prediction_and_hardware_agree_on_all_real_recordings(shared_data, tmp_path):
    recordings = load_recordings(shared_data / "pvdf_indent" / "recordings.npz", config=PRESETS["pvdf"])
    trained = eskin.train(recordings, config="pvdf", folds=0)
    assert trained.score(recordings) > 0.95  # on what it was trained on: that it is no random network
    assert check_stream(trained, recordings, tmp_path, one_by_one=lambda index: index % 20 == 0) > 6000


def test_a_network_for_images_predicts_from_arrays():
    """Of one image, several, or real pixels; streams and stage traces are for recordings."""
    config = AcceleratorConfig.of_image(7, 9, ("conv 3 4", "pool", "dense 3"), ("a", "b", "c"), name="few")
    model = eskin.Model(config)
    model._integer = random_image_model(config, 0)
    images = random_images(config, 6, 1)
    classes = model.predict(images)
    assert len(set(classes.tolist())) > 1 and model.predict(images[2]).tolist() == [classes[2]]
    assert model.predict(images / 255.0).tolist() == classes.tolist()
    assert (model.decision_function(images).argmax(axis=1) == classes).all() and (
        model.margin(images) >= 0
    ).all()
    assert model.score(images, classes) == 1.0 and "7 x 9 pixels" in repr(model)
    for wrong, words in (
        (images[:, :6], "images of 6 x 9 pixels and configuration 'few' takes 7 x 9"),
        (images + 0.5, "real pixels lie in 0..1"),
        ([images[0], images[0][:5]], "are not all of one size"),
    ):
        with pytest.raises(eskin.InputError, match=words):
            model.predict(wrong)
    for call in (model.stream, lambda: model.trace(images)):
        with pytest.raises(eskin.InputError, match="is a network for images"):
            call()
