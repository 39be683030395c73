"""Classifiers without a recurrent cell, on the same touches, windows, splits and seeds as the networks: what a simpler model would do.

- ``logistic``: logistic regression on the mean and the standard deviation, over the windows of the touch, of every taxel.
- ``svm``: support vectors with a radial basis function, one against one, on all window means of the touch.
- ``cnn``: two 1-D convolutions over the windows, their mean over time, a dense layer; about as many parameters as the recurrent network.

The penalties of the first two are chosen by cross-validation inside each training part; the convolutions train as the networks do (noise,
time warp and gain of the recipe). All compute in float.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch

from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.data.recordings import Recordings
from eskin.golden.model.model import real_by_input
from eskin.golden.model.preprocess import find_touches, real_features
from eskin.golden.training.train import Recipe, choose_recipe, scaling, split_folds

BASELINES = {"logistic": "logistic regression, mean and deviation", "svm": "RBF-SVM, window means", "cnn": "1-D CNN, window means"}
"""Names, and what charts call them."""

PENALTIES = (0.1, 1.0, 10.0, 100.0)
"""Inverse penalties that the inner cross-validation chooses from."""

KERNEL = 3
"""Windows that one convolution sees."""


def judge_baseline(
    name: str, recordings: Recordings, config: AcceleratorConfig, splits: Sequence[Sequence[str]], seeds: Sequence[int], folds: int
) -> dict[str, Any]:
    """Train and judge one of ``BASELINES`` on every fold of every split with every seed; no touch or no completed step counts as wrong.

    Returns
    -------
    label; parameters and multiplies_decision (means over the trained models: support vectors differ; exponentials, normalisation and
    square roots are not counted); splits: {groups, accuracy, by_seed, per_fold: {held_out recordings, accuracy}} each.
    """
    touches = find_touches(config, recordings)
    first = touches.first_touch()
    usable = np.flatnonzero((first >= 0) & (touches.completed[first] > 0))
    touches = touches.take(first[usable])
    means, completed = real_features(config, touches.sums), touches.completed
    where = np.full(len(recordings), -1)
    where[usable] = np.arange(len(usable))
    labels = recordings.labels[usable]
    train = {"logistic": _logistic, "svm": _svm, "cnn": _cnn}[name]
    sizes, found = [], []
    for groups in splits:
        correct = np.zeros((len(seeds), len(recordings)))
        tests = split_folds(recordings, groups, folds, None)
        for test in tests:
            part = where[np.setdiff1d(np.arange(len(recordings)), test)]
            part, asked = part[part >= 0], where[test]
            known = touches.take(part)
            mu, sigma = scaling(config, means[part], known.completed, known.faults)
            features = (means - real_by_input(config, mu)) / real_by_input(config, sigma)
            if touches.faults is not None:
                features[touches.faults] = 0.0
            features[np.arange(config.windows.steps) >= completed[:, None]] = 0.0
            for s, seed in enumerate(seeds):
                decided, size = train(features, labels, part, asked[asked >= 0], config, int(seed))
                correct[s, test[asked >= 0]] = decided == labels[asked[asked >= 0]]
                sizes.append(size)
        per_fold = [{"recordings": len(test), "accuracy": float(correct[:, test].mean())} for test in tests]
        found.append(
            {"groups": list(groups), "accuracy": float(correct.mean()), "by_seed": correct.mean(axis=1).tolist(), "per_fold": per_fold}
        )
    parameters, multiplies = np.mean(sizes, axis=0)
    return {
        "label": BASELINES[name],
        "parameters": round(float(parameters)),
        "multiplies_decision": round(float(multiplies)),
        "splits": found,
    }


def _chosen(model, grid: dict[str, Sequence[float]], x: np.ndarray, y: np.ndarray, seed: int):
    """``model`` with the penalties that an inner 3-fold cross-validation likes best, fitted on all of ``x``."""
    from sklearn.model_selection import GridSearchCV, StratifiedKFold

    smallest = int(np.bincount(y)[np.unique(y)].min())
    if smallest < 2:
        return model.fit(x, y)
    inner = StratifiedKFold(min(3, smallest), shuffle=True, random_state=seed)
    return GridSearchCV(model, grid, cv=inner).fit(x, y).best_estimator_


def _logistic(features, labels, part, asked, config: AcceleratorConfig, seed: int):
    from sklearn.linear_model import LogisticRegression

    x = np.concatenate([features.mean(axis=1), features.std(axis=1)], axis=1)
    scale = x[part].std(axis=0) + 1e-9
    x = (x - x[part].mean(axis=0)) / scale
    model = _chosen(LogisticRegression(max_iter=2000), {"C": PENALTIES}, x[part], labels[part], seed)
    weights = config.classes * x.shape[1]
    squares = config.windows.steps * config.inputs + config.inputs
    return model.predict(x[asked]), (weights + config.classes, weights + squares)


def _svm(features, labels, part, asked, config: AcceleratorConfig, seed: int):
    from sklearn.svm import SVC

    x = features.reshape(len(features), -1)
    grid = {"C": PENALTIES[1:], "gamma": [scale / x.shape[1] for scale in (0.1, 0.3, 1.0)]}
    model = _chosen(SVC(), grid, x[part], labels[part], seed)
    vectors, sums = len(model.support_), config.classes - 1
    parameters = vectors * (x.shape[1] + sums) + config.classes * sums // 2
    return model.predict(x[asked]), (parameters, vectors * (x.shape[1] + 1 + sums))


def cnn_channels(config: AcceleratorConfig) -> int:
    """Channels of both convolutions: the most with which the CNN has no more parameters than the recurrent network, 2 at least."""
    channels = 2
    while _cnn_size(config, channels + 1)[0] <= config.parameter_count:
        channels += 1
    return channels


def _cnn_size(config: AcceleratorConfig, channels: int) -> tuple[int, int]:
    """(parameters, multiplies of a decision)."""
    kernels = KERNEL * channels * (config.inputs + channels)
    parameters = kernels + 2 * channels + config.classes * (channels + 1)
    return parameters, kernels * config.windows.steps + config.classes * channels


def _cnn(features, labels, part, asked, config: AcceleratorConfig, seed: int):
    recipe, channels = choose_recipe(config), cnn_channels(config)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        network = torch.nn.Sequential(
            torch.nn.Conv1d(config.inputs, channels, KERNEL, padding="same"),
            torch.nn.ReLU(),
            torch.nn.Conv1d(channels, channels, KERNEL, padding="same"),
            torch.nn.ReLU(),
            torch.nn.AdaptiveAvgPool1d(1),
            torch.nn.Flatten(),
            torch.nn.Linear(channels, config.classes),
        )
        _train_cnn(network, torch.tensor(features[part], dtype=torch.float32), torch.tensor(labels[part]), recipe)
        with torch.no_grad():
            logits = network(torch.tensor(features[asked], dtype=torch.float32).transpose(1, 2))
    return logits.argmax(dim=1).numpy(), _cnn_size(config, channels)


def _train_cnn(network: torch.nn.Module, features: torch.Tensor, labels: torch.Tensor, recipe: Recipe) -> None:
    """``recipe`` on whole touches: features (touches, steps, inputs). Windows after the last are its copies."""
    steps = features.shape[1]
    optimiser = torch.optim.Adam(network.parameters(), lr=recipe.learning_rate)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, recipe.learning_rate, total_steps=recipe.updates)
    for _ in range(recipe.updates):
        rows = torch.randint(len(features), (recipe.batch,))
        speed, gain = (limit ** (2 * torch.rand(recipe.batch, 1) - 1) for limit in (recipe.warp, recipe.gain))
        position = (torch.arange(steps) * speed).clamp(max=steps - 1)
        lower = position.floor().long()
        upper = (lower + 1).clamp(max=steps - 1)
        row = rows[:, None]
        batch = torch.lerp(features[row, lower], features[row, upper], (position - lower)[..., None])
        batch = batch * (gain * speed**recipe.speed_gain)[..., None]
        batch = batch + recipe.noise * torch.randn(batch.shape)
        loss = torch.nn.functional.cross_entropy(network(batch.transpose(1, 2)), labels[rows])
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
