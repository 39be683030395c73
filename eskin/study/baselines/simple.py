"""Classifiers without a recurrent cell, on the window means of a touch: what a simpler model would do.

- ``logistic``: logistic regression on the mean and the standard deviation, over the windows of the touch, of
  every input.
- ``svm``: support vectors with a radial basis function, one against one, on all windows of the touch.
- ``forest``, ``boosting``: a random forest and gradient-boosted trees on all windows: no multiplies, many
  comparisons.
- ``cnn``: two 1-D convolutions over the windows, their mean over time, a dense layer; about as many
  parameters as the recurrent network.
- ``kernels``: random convolutions over the windows, of each the largest value and the share of positive ones,
  and a ridge regression of the classes on them (A. Dempster, F. Petitjean, G. Webb 2020, ROCKET).

Penalties are chosen by cross-validation inside each training part; the convolutions of ``cnn`` train as the
networks do (noise, time warp and gain of the recipe). All compute in float.
"""

import numpy as np
import torch

from eskin.choose.yardsticks import fitted, rbf_svm
from eskin.golden.core import AcceleratorConfig
from eskin.study.baselines.method import Fitted, Method
from eskin.study.baselines.scene import Scene
from eskin.training.losses import descend
from eskin.training.recipe import Recipe, choose_recipe

PENALTIES = (0.1, 1.0, 10.0, 100.0)
"""Inverse penalties that the inner cross-validation chooses from."""

KERNEL = 3
"""Windows that one convolution of the CNN sees."""

TREES, STAGES, DEPTH = 200, 60, 3
"""Trees of the forest; stages of the boosting, a tree a class each, and their depth."""

RANDOM_KERNELS, RANDOM_LENGTH = 512, 5
"""Random convolutions, and windows that one sees."""


def _flat(scene: Scene, part: np.ndarray) -> np.ndarray:
    windows = scene.windows(part)
    return windows.reshape(len(windows), -1)


def fit_logistic(scene: Scene, part: np.ndarray, seed: int) -> Fitted:
    """Mean and deviation over the windows."""
    from sklearn.linear_model import LogisticRegression

    windows, config = scene.windows(part), scene.config
    x = np.concatenate([windows.mean(axis=1), windows.std(axis=1)], axis=1)
    x = (x - x[part].mean(axis=0)) / (x[part].std(axis=0) + 1e-9)
    model = fitted(LogisticRegression(max_iter=2000), x[part], scene.labels[part], {"C": PENALTIES}, seed)
    weights = scene.classes * x.shape[1]
    squares = config.windows.steps * config.inputs + config.inputs
    return Fitted(lambda rows: model.predict(x[rows]), weights + scene.classes, weights + squares)


def fit_svm(scene: Scene, part: np.ndarray, seed: int) -> Fitted:
    """Support vectors on all windows."""
    x, sums = _flat(scene, part), scene.classes - 1
    grid = {"C": PENALTIES[1:], "gamma": [scale / x.shape[1] for scale in (0.1, 0.3, 1.0)]}
    model, multiplies = rbf_svm(x[part], scene.labels[part], scene.classes, grid=grid, seed=seed)
    parameters = len(model.support_) * (x.shape[1] + sums) + scene.classes * sums // 2
    return Fitted(lambda rows: model.predict(x[rows]), parameters, multiplies)


def fit_forest(scene: Scene, part: np.ndarray, seed: int) -> Fitted:
    """A random forest; parameters: feature and threshold of every fork, shares of the classes of every
    leaf."""
    from sklearn.ensemble import RandomForestClassifier

    x = _flat(scene, part)
    model = RandomForestClassifier(TREES, random_state=seed).fit(x[part], scene.labels[part])
    forks = sum(int((tree.tree_.feature >= 0).sum()) for tree in model.estimators_)
    leaves = sum(tree.tree_.n_leaves for tree in model.estimators_)
    compared = sum(float(tree.decision_path(x[part]).sum()) / len(part) - 1 for tree in model.estimators_)
    return Fitted(
        lambda rows: model.predict(x[rows]), 2 * forks + scene.classes * int(leaves), 0, round(compared)
    )


def fit_boosting(scene: Scene, part: np.ndarray, seed: int) -> Fitted:
    """Gradient-boosted trees; a leaf holds one value, which the learning rate is part of."""
    from sklearn.ensemble import GradientBoostingClassifier

    x = _flat(scene, part)
    model = GradientBoostingClassifier(
        n_estimators=STAGES, max_depth=DEPTH, max_features="sqrt", random_state=seed
    )
    model.fit(x[part], scene.labels[part])
    trees = [estimator.tree_ for estimator in model.estimators_.ravel()]
    forks = sum(int((tree.feature >= 0).sum()) for tree in trees)
    leaves = sum(int(tree.n_leaves) for tree in trees)
    return Fitted(
        lambda rows: model.predict(x[rows]), 2 * forks + leaves, 0, sum(int(tree.max_depth) for tree in trees)
    )


# ---------------------------------------------------------------------- the CNN
def cnn_channels(config: AcceleratorConfig) -> int:
    """Channels of both convolutions: the most with which the CNN has no more parameters than the recurrent
    network, 2 at least."""
    channels = 2
    while cnn_size(config, channels + 1)[0] <= config.parameter_count:
        channels += 1
    return channels


def cnn_size(config: AcceleratorConfig, channels: int) -> tuple[int, int]:
    """(parameters, multiplies of a decision)."""
    kernels = KERNEL * channels * (config.inputs + channels)
    parameters = kernels + 2 * channels + config.classes * (channels + 1)
    return parameters, kernels * config.windows.steps + config.classes * channels


def cnn_network(config: AcceleratorConfig) -> torch.nn.Sequential:
    """The CNN for windows (touches, inputs, steps)."""
    channels = cnn_channels(config)
    return torch.nn.Sequential(
        torch.nn.Conv1d(config.inputs, channels, KERNEL, padding="same"),
        torch.nn.ReLU(),
        torch.nn.Conv1d(channels, channels, KERNEL, padding="same"),
        torch.nn.ReLU(),
        torch.nn.AdaptiveAvgPool1d(1),
        torch.nn.Flatten(),
        torch.nn.Linear(channels, config.classes),
    )


def fit_cnn(scene: Scene, part: np.ndarray, seed: int) -> Fitted:
    """Two convolutions, trained by the recipe of the recurrent network."""
    config = scene.config
    x = torch.tensor(scene.windows(part), dtype=torch.float32)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        network = cnn_network(config)
        _train_cnn(network, x[part], torch.tensor(scene.labels[part]), choose_recipe(config))

    def decide(rows: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            return network(x[rows].transpose(1, 2)).argmax(dim=1).numpy()

    return Fitted(decide, *cnn_size(config, cnn_channels(config)))


def _train_cnn(
    network: torch.nn.Module, features: torch.Tensor, labels: torch.Tensor, recipe: Recipe
) -> None:
    """``recipe`` on whole touches: features (touches, steps, inputs). Windows after the last are its
    copies."""
    steps = features.shape[1]

    def loss_of() -> torch.Tensor:
        rows = torch.randint(len(features), (recipe.batch,))
        speed, gain = (limit ** (2 * torch.rand(recipe.batch, 1) - 1) for limit in (recipe.warp, recipe.gain))
        position = (torch.arange(steps) * speed).clamp(max=steps - 1)
        lower = position.floor().long()
        upper = (lower + 1).clamp(max=steps - 1)
        row = rows[:, None]
        batch = torch.lerp(features[row, lower], features[row, upper], (position - lower)[..., None])
        batch = batch * (gain * speed**recipe.speed_gain)[..., None]
        batch = batch + recipe.noise * torch.randn(batch.shape)
        return torch.nn.functional.cross_entropy(network(batch.transpose(1, 2)), labels[rows])

    descend(network.parameters(), loss_of, recipe.learning_rate, recipe.updates)


# ---------------------------------------------------------------------- random convolutions
def fit_kernels(scene: Scene, part: np.ndarray, seed: int) -> Fitted:
    """Random convolutions of all inputs; a kernel's bias is what it gives at a random window of a random
    touch of the training part."""
    from sklearn.linear_model import RidgeClassifierCV

    config, windows = scene.config, scene.windows(part)
    steps = config.windows.steps
    spread = [2**k for k in range(16) if (RANDOM_LENGTH - 1) * 2**k < steps] or [1]
    per_gap = -(-RANDOM_KERNELS // len(spread))
    rng = np.random.default_rng(seed)
    kernels = rng.normal(size=(len(spread), per_gap, config.inputs, RANDOM_LENGTH))
    kernels -= kernels.mean(axis=-1, keepdims=True)
    filters = [torch.tensor(kernel, dtype=torch.float32) for kernel in kernels]

    def convolved(rows: np.ndarray) -> np.ndarray:
        x = torch.tensor(windows[rows], dtype=torch.float32).transpose(1, 2)
        with torch.no_grad():
            responses = [
                torch.nn.functional.conv1d(x, kernels_of_gap, padding="same", dilation=gap)
                for kernels_of_gap, gap in zip(filters, spread, strict=True)
            ]
        return torch.cat(responses, dim=1).numpy()

    response = convolved(part)
    count = response.shape[1]
    bias = response[rng.integers(len(part), size=count), np.arange(count), rng.integers(steps, size=count)]

    def features(outcome: np.ndarray) -> np.ndarray:
        above = outcome - bias[:, None]
        return np.concatenate([above.max(axis=2), (above > 0).mean(axis=2)], axis=1)

    x = features(response)
    middle, scale = x.mean(axis=0), x.std(axis=0) + 1e-9
    model = RidgeClassifierCV(np.logspace(-1, 4, 6)).fit((x - middle) / scale, scene.labels[part])
    outputs = len(model.coef_)
    parameters = count * (config.inputs * RANDOM_LENGTH + 1) + outputs * (2 * count + 1)
    multiplies = count * steps * config.inputs * RANDOM_LENGTH + outputs * 2 * count
    return Fitted(
        lambda rows: model.predict((features(convolved(rows)) - middle) / scale), parameters, multiplies
    )


SIMPLE = (
    Method("logistic", "logistic regression, mean and deviation", "simple", fit_logistic),
    Method("svm", "RBF-SVM, window means", "simple", fit_svm),
    Method("forest", "random forest, window means", "simple", fit_forest),
    Method("boosting", "gradient boosting, window means", "simple", fit_boosting),
    Method("cnn", "1-D CNN, window means", "simple", fit_cnn),
    Method("kernels", "random convolution kernels, window means", "simple", fit_kernels),
)
