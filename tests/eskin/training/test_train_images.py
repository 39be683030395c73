"""Training networks for images: batch norm folded, augmentation, formats, few-bit weights, folders, refusals.
Tiny images, few epochs."""

import dataclasses
import itertools

import numpy as np
import pytest
import torch

from eskin.golden.core import AcceleratorConfig
from eskin.golden.model import FloatModel, float_images, images_of, run_images
from eskin.jobs import Jobs
from eskin.memo import Memo
from eskin.training import image_models
from eskin.training.evaluate import evaluate
from eskin.training.image_formats import _scale, equalised, quantised
from eskin.training.image_models import CANDIDATES, _candidate_rows, image_config, train_image_model
from eskin.training.integers import quantise
from eskin.training.judge import folds_of, judge
from eskin.training.made_up import random_images
from eskin.training.record import Split, training_of
from eskin.training.settings import TrainingSettings
from eskin.training.train_images import ImageNetwork, ImageRecipe, augmented, train_network
from tests.support.folder import exchanges
from tests.support.image_scenes import SHAPES, shapes
from tests.support.result_case import some

LAYERS = ("conv 3 4", "pool", "conv 3 6", "pool", "dense 3")
QUICK = ImageRecipe(epochs=30, batch=16, turn=0.0, mirror=False, shift=0.05, zoom=0.0, dropout=0.1)


def config() -> AcceleratorConfig:
    return AcceleratorConfig.of_image(8, 8, LAYERS, SHAPES, name="shapes")


@pytest.fixture(scope="module")
def trained() -> FloatModel:
    scene = shapes(30, 0)
    return train_network(config(), images_of(scene), scene.labels, recipe=QUICK, seed=0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("images") / "model"
    scene = shapes(20, 1)
    request, kept = TrainingSettings(out=out, folds=2), Memo(out.parent / "kept")
    record = train_image_model(scene, config(), request, recipe=QUICK, workers=1, keep=kept)
    return out, scene, record


def test_batch_norm_is_folded_into_what_hardware_computes():
    """Kernels at the border, pools over odd sizes, two layers behind the maps."""
    torch.manual_seed(0)
    layers = ("conv 5 3", "pool", "conv 3 4", "conv 1 2", "pool", "dense 5", "dense 3")
    config = AcceleratorConfig.of_image(7, 10, layers, SHAPES)
    network = ImageNetwork(config, 0.0)
    for norm in network.norms.values():
        for values, least, most in (
            (norm.running_mean, -1, 1),
            (norm.running_var, 0.5, 2),
            (norm.weight, -1, 1),
            (norm.bias, -1, 1),
        ):
            torch.nn.init.uniform_(values, least, most)
    network.eval()
    images = random_images(config, 12, 2)
    folded = float_images(FloatModel(config, network.folded()), images).logits
    direct = network(torch.from_numpy(images.astype(np.float32))[:, None] / 256).detach().numpy()
    assert np.allclose(folded, direct, atol=1e-4) and np.ptp(folded) > 0.1


def test_a_turned_bar_keeps_its_length():
    """Angles are those of the skin, not of a square that the image is stretched to."""
    bar = torch.zeros(200, 1, 30, 60)
    bar[:, 0, 14:16, 15:45] = 1
    generator = torch.Generator().manual_seed(1)
    still = dataclasses.replace(
        ImageRecipe(), turn=30.0, mirror=False, shift=0.0, zoom=0.0, intensity=0.0, noise=0.0
    )
    lengths = []
    for each in augmented(bar, still, generator)[:, 0]:
        ends = [places.max() - places.min() for places in torch.nonzero(each > 0.3, as_tuple=True)]
        lengths.append(float(torch.hypot(*(end.float() for end in ends))))
    assert min(lengths) > 26 and max(lengths) < 33


def test_other_scales_inside_leave_the_function_and_lose_less(trained):
    """Channels whose scales lie far apart, as batch norm may leave them."""
    images = images_of(shapes(40, 5))
    rng = np.random.default_rng(0)
    arrays = {name: array.copy() for name, array in trained.arrays.items()}
    for stage, reader in itertools.pairwise(trained.config.weighted_stages):
        _scale(arrays, stage, reader, 2.0 ** rng.uniform(-3, 3, stage.outputs))
    uneven = FloatModel(trained.config, arrays)
    even = equalised(uneven, images)
    ideal = float_images(trained, images).logits
    assert np.allclose(float_images(even, images).logits, ideal, atol=1e-9)

    def error(model):
        whole = quantised(model, images)
        logits = whole.config.formats.logit_format.to_real(run_images(whole, images).logits)
        return np.square(logits - ideal).mean()

    assert error(even) < 0.2 * error(uneven)


def test_a_folder_is_trained_quantised_and_judged(folder, monkeypatch):
    out, scene, record = folder
    (split,) = record.cross_validation
    assert split.folds == 2 and 0.6 < split.integer_accuracy <= 1 and split.agreement > 0.9
    integer = quantise(out)
    assert integer.config.weight_bits == 8 and training_of(out).ranges.keys() == {"0", "2", "4"}
    result = evaluate(out, scene)
    assert result.recordings == 60 and result.passed and len(result.stages) == 3
    assert result.logit_error.stage in ("0 conv 3 4", "2 conv 3 6", "4 dense 3")
    assert result.logit_error.max > 0
    written = exchanges(monkeypatch)
    coarse = quantise(out, scene, weight_bits=4)
    assert written == ["model"]
    assert coarse.config.weight_bits == 4
    assert evaluate(out, scene).logit_error.mean > 2 * result.logit_error.mean


def test_images_are_judged_by_networks_that_have_not_seen_them(monkeypatch, tmp_path):
    scene, begun = shapes(6, 0, (8, 10)), []

    def judge_fold(shared, fold):
        """The float network knows all, integers the first two classes."""
        begun.append((fold.seed, fold.left_out))
        truth = shared[1][np.array(fold.left_out)]
        return {"float": truth.tolist(), "integer": np.minimum(truth, 1).tolist()}

    monkeypatch.setattr(image_models, "judge_fold", judge_fold)
    config, labels, everything = image_config(scene, "four"), scene.labels, np.arange(len(scene))
    learner = image_models.ImageLearner(scene, config, QUICK, Jobs(workers=1), Memo(tmp_path))
    tests = [everything[start::3] for start in range(3)]
    for _ in range(2):  # the second time nothing is trained
        decisions = judge(learner, folds_of(tests, [4, 5], everything), labels)
    assert begun == [(seed, tuple(test)) for seed in (4, 5) for test in tests]
    assert decisions.shares() == {
        "float_accuracy": 1.0,
        "integer_accuracy": pytest.approx(2 / 3),
        "agreement": pytest.approx(2 / 3),
    }


def test_auto_takes_the_smallest_that_is_level():
    scene = shapes(1, 0, (28, 50))
    candidates = [image_config(scene, name) for name in CANDIDATES]
    for shares, taken in [
        ((0.93, 0.9275, 0.90), "four"),  # one of 400 lost, none won
        ((0.93, 0.90, 0.9275), "tactnet-half"),
        ((0.93, 0.925, 0.90), "tactnet"),
        ((0.96, 0.9, 0.9), "tactnet"),
    ]:
        correct = [(np.arange(400) < 400 * share).astype(float) for share in shares]
        said = [some(Split, float_accuracy=share, agreement=1.0) for share in shares]
        rows = _candidate_rows(candidates, said, correct, 1)
        assert [each.cell for each in rows if each.chosen] == [taken]
