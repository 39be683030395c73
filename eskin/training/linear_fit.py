"""Multinomial logistic regression on all windows of a touch, as the weights and bias of a linear cell."""

import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.linalg import solve

from eskin.golden.core import EXTREMES, AcceleratorConfig
from eskin.golden.model import real_by_input

MOST_ITERATIONS = 300
"""Highest number of iterations of the solver. If it has not converged by then, it is very close to the best
weights."""

QUIETEST = 1 / 32
"""Least spread of an input, as a share of the largest: the largest share that lost nothing on biotac_slide
with blocks left out."""


def fit_linear(
    config: AcceleratorConfig, features: np.ndarray, labels: np.ndarray, penalty: float
) -> dict[str, np.ndarray]:
    """Weights and bias of the linear cell that is a logistic regression on ``features``.

    Every input is standardised for the fit, so that the penalty affects all inputs alike; the spread of the
    quietest counts as QUIETEST of the largest. The weights returned are those for the features as given. With
    one set of weights for all windows the inputs are the features' sums over the windows. The solver is
    scikit-learn's.

    Parameters
    ----------
    features:
        (touches, K, D), 0 where a touch has no such step.
    labels:
        (touches) class indices; a class without a touch gets weights of 0 and a bias below all others.
    penalty:
        Inverse penalty (scikit-learn's C).

    Returns
    -------
    V (sets, C, D) and b_y (C), float64.
    """
    from sklearn.linear_model import LogisticRegression

    inputs = _inputs(config, features)
    mean, spread = inputs.mean(axis=0), inputs.std(axis=0)
    # An input that hardly moves is noise. Its weight is divided by its spread: without a bound the quietest
    # inputs got the largest weights, and with them all bits of the format.
    spread = np.maximum(spread, QUIETEST * max(spread.max(), 1e-9))
    present = np.unique(labels)
    weights, bias = np.zeros((config.classes, inputs.shape[1])), np.zeros(config.classes)
    if len(present) > 1:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # not converged; few touches of each of many classes
            fitted = LogisticRegression(C=penalty, max_iter=MOST_ITERATIONS).fit(
                (inputs - mean) / spread, labels
            )
        rows, offsets = fitted.coef_, fitted.intercept_
        if len(present) == 2:  # scikit-learn gives one row then, the difference of the two
            rows, offsets = np.concatenate([-rows, rows]) / 2, np.concatenate([-offsets, offsets]) / 2
        weights[present] = rows / spread
        bias[present] = offsets - weights[present] @ mean
    missing = np.setdiff1d(np.arange(config.classes), present)
    bias[missing] = bias[present].min() - 1  # with weights of 0 it never wins
    return _arrays(config, weights, bias)


COPIES = 3
"""Number of shortened touches that are added for each touch that its recording cut short, as long as there
are others."""


def cut_short(completed: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Touches that the fit also uses in a shortened copy: (their rows, steps of each copy). ``completed``
    (n): steps of each touch, out of ``steps``.

    A linear cell sees all windows at once. If few touches end early, the fit would not learn to classify by
    the first windows alone. So other touches are cut to the lengths of these.
    """
    short, whole = np.flatnonzero(completed < steps), np.flatnonzero(completed >= steps)
    count = min(COPIES * len(short), len(whole))
    rows = whole[np.linspace(0, max(len(whole) - 1, 0), count).astype(int)]
    return rows, completed[np.resize(short, count)]


def discriminants(fitted: np.ndarray, indicators: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(turn (C, C), bias (C)): ``fitted @ turn + bias`` is largest for the class of the nearest mean among
    the linear discriminants of ``fitted`` (n, C), the values of a ridge regression of ``indicators`` (n, C).

    The largest value of the regression itself misses a class that lies between others (T. Hastie, R.
    Tibshirani, A. Buja 1994, Flexible discriminant analysis by optimal scoring, whose scores these are): of
    sign_glove's 24 classes it finds 53 % where the discriminants find 86 %. Classes without a touch lose.
    Several regressions, ``fitted`` (..., n, C), give as many results.
    """
    return discriminants_of(indicators.T @ fitted / len(indicators), indicators.sum(axis=0))


def discriminants_of(both: np.ndarray, count: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """``discriminants`` by the mean products ``both`` (..., C, C) of indicators and fitted values, and the touches of
    each class."""
    share = np.maximum(count, 0.5) / count.sum()
    root = np.sqrt(share)
    between = (both + np.swapaxes(both, -1, -2)) / 2 / root[:, None] / root
    unit = root / np.linalg.norm(root)
    apart = np.eye(len(share)) - np.outer(unit, unit)  # without the part that all classes have in common
    explained, vectors = np.linalg.eigh(apart @ between @ apart)
    useful = explained > 1e-6
    weight = useful / np.where(useful, explained * np.maximum(1 - explained, 1e-6), 1.0)
    scores = vectors / root[:, None]
    means = both @ scores / share[:, None]
    weight = weight[..., None, :]
    turn = scores * weight @ np.swapaxes(means, -1, -2)
    bias = np.log(share) - (means**2 * weight).sum(axis=-1) / 2
    size = np.abs(turn).max(axis=(-1, -2), keepdims=True)
    size[size == 0] = 1.0
    bias[..., count == 0] = bias[..., count > 0].min(axis=-1, keepdims=True) - size[..., 0]
    return turn / size, bias / size[..., 0]


PENALTIES = (1e-1, 1e-2, 1e-3, 1e-4)
"""Ridge penalties tried, as shares of the mean squared length of a touch's inputs."""


def fit_least_squares(
    config: AcceleratorConfig, features: np.ndarray, labels: np.ndarray, copies: int = 0, penalty: float = 0.0
) -> dict[str, np.ndarray]:
    """Weights and bias of the linear cell that is the `discriminants` of a ridge regression of the classes'
    indicators on ``features``.

    With few touches for the number of inputs it decides unseen ones better than the logistic regression: it
    is the fit for classes with one common covariance (T. Hastie, A. Buja, R. Tibshirani 1995). The penalty is
    the member of PENALTIES with the most touches classified correctly when each is left out in turn (closed
    form; of equals the largest).

    Parameters
    ----------
    features, labels:
        As for ``fit_linear``; features at their own scales, as the normaliser gives them.
    copies:
        Number of touches at the end that are copies of others (``cut_short``); they do not choose the
        penalty.
    penalty:
        Penalty to use in place of the chosen one; 0: none.

    Returns
    -------
    V (sets, C, D) and b_y (C), float64.
    """
    from sklearn.linear_model import Ridge, RidgeCV

    # RidgeCV calls it with the predictions of every touch by the fit that left it out
    def right(_, left_out: np.ndarray, indicators: np.ndarray) -> int:
        turn, bias = discriminants(left_out, indicators)
        return int(((left_out @ turn + bias).argmax(axis=1) == indicators.argmax(axis=1)).sum())

    inputs = _inputs(config, features)
    unit, own = max(float(inputs.var(axis=0).sum()), 1e-12), len(labels) - copies
    indicators = (labels[:, None] == np.arange(config.classes)).astype(float)
    ridge = RidgeCV([share * unit for share in ([penalty] if penalty else PENALTIES)], scoring=right)
    ridge.fit(inputs[:own], indicators[:own])
    if copies:
        ridge = Ridge(ridge.alpha_ * len(labels) / own).fit(inputs, indicators)
    turn, bias = discriminants(ridge.predict(inputs), indicators)
    return _arrays(config, turn.T @ ridge.coef_, ridge.intercept_ @ turn + bias)


def fit_average(
    config: AcceleratorConfig,
    features: np.ndarray,
    labels: np.ndarray,
    copies: int,
    penalty: float,
    ridge: float,
) -> dict[str, np.ndarray]:
    """The mean of ``fit_linear`` with ``penalty`` and ``fit_least_squares`` with ``ridge``, whose logits are
    scaled to the same deviation between classes as the first. The mean is one linear cell and costs
    no more.

    The logistic regression depends on touches near other classes, least squares on the means and covariance
    of all, so they misclassify different touches of a new session.
    """
    inputs, present = _inputs(config, features), np.unique(labels)
    odds = fit_linear(config, features, labels, penalty)
    squares = fit_least_squares(config, features, labels, copies, ridge)

    def deviation(fit: dict[str, np.ndarray]) -> float:
        logits = inputs @ fit["V"].swapaxes(0, 1).reshape(config.classes, -1).T + fit["b_y"]
        logits = logits[:, present]  # the other classes only have to lose
        return float((logits - logits.mean(axis=1, keepdims=True)).std())

    scale = deviation(odds) / max(deviation(squares), 1e-12)
    return {name: (odds[name] + scale * squares[name]) / 2 for name in odds}


LOST = 8.0
"""Weight of the loss of one taxel, as often as any other, beside the recorded touches."""
CUT, HALVED = 0.2, 0.2
"""Share of the touches that the fit assumes to end after any step from half of the steps on, and after half of them. A fit
that assumes few lengths decides between them wrongly: on biotac_slide, fitted with 0.4, 0.6 and 0.8, 98 % at 0.6 and 62 % at
0.5."""
RATE, RATES = 0.1, (0.94, 1.07)
"""Share of the touches that are fitted as sampled at each of RATES."""
OVERLAP, OVERLAP_AFTER = 0.1, 0.7
"""Share of the touches that are fitted with the beginning of another one over their windows from there on."""
OFFSET, COMMON, DRIFT = 0.3, 0.06, 0.1
"""Variances of an offset of one taxel, of all together and of their drift in a touch, in variances of the means."""
LEVELS = ("mean", *EXTREMES)
"""Kinds of feature that an offset of a taxel moves by itself."""
SPIKED = 0.02
"""Share of the samples that are fitted as beyond the clip."""
LEVEL_SPIKED = 0.05
"""Weight of a taxel's offset by the clip, for each frame of a level that begins with the touch: a spike there moves all
windows."""
SMOOTH = 0.1
"""Ridge penalty, which stands for noise and spikes, as a share of the mean squared length of a touch's inputs."""


Moments = tuple[np.ndarray, np.ndarray, np.ndarray]


def level_kind(config: AcceleratorConfig) -> int:
    """Place in ``feature_kinds`` of the first one that an offset moves by itself; 0 where there is none."""
    kinds = config.features.feature_kinds
    return next((number for number, kind in enumerate(kinds) if kind in LEVELS), 0)


def fit_sturdy(
    config: AcceleratorConfig,
    features: np.ndarray,
    counts: np.ndarray,
    labels: np.ndarray,
    scales: tuple[Any, Any],
    strength: float,
) -> dict[str, np.ndarray]:
    """Weights and bias of the least-squares linear cell for recorded and disturbed touches, in closed form:
    expected products of inputs under the disturbances are added to the recorded ones.

    Shares CUT and HALVED of the touches end early, RATE are sampled at another rate, and OVERLAP end with the beginning
    of another touch. What the loss of a taxel (which then reads rest, or is masked), an offset, a drift, spikes at the
    clip and noise add to the logits is penalised by its expected square.

    Parameters
    ----------
    features, labels:
        As for ``fit_least_squares``.
    counts:
        (touches, K): the steps that a touch has.
    scales:
        (mu, sigma) of the normaliser.
    strength:
        Factor for these penalties.
    """
    (touches, steps, width), kinds = features.shape, config.kinds
    mu, sigma = (real_by_input(config, np.asarray(scale)) + np.zeros(width) for scale in scales)
    taxel_of = np.arange(width) // kinds
    indicators = (labels[:, None] == np.arange(config.classes)).astype(float)

    def shaped(values: np.ndarray) -> np.ndarray:
        """(touches, inputs) of (touches, K, D)."""
        return _inputs(config, values * counts[..., None])

    def by_taxel(values: np.ndarray) -> np.ndarray:
        """Values given for each of D, for each input."""
        return np.tile(values, config.sets if config.sets > 1 else 1)

    def moments_of(values: np.ndarray) -> Moments:
        """Mean products, mean, and mean products with the classes, of (touches, inputs)."""
        return values.T @ values / touches, values.mean(axis=0), values.T @ indicators / touches

    x, taxel = shaped(features), by_taxel(taxel_of)
    alike = taxel[:, None] == taxel
    (gram, sums, cross), of_class = moments_of(x), indicators.mean(axis=0)
    live = (~np.array(config.input_mask)).astype(float)
    # a level that is not subtracted remains when nothing moves
    at_rest = features.mean(axis=0) if config.rest_level.rest == "none" else -mu / sigma * live
    rest = shaped(np.broadcast_to(at_rest, features.shape)).mean(axis=0)
    number = max(len(config.sensor.live), 1)

    def ways() -> Iterator[tuple[float, Moments]]:
        """Shares of the touches, and their moments; one at a time, because a matrix may be large."""
        half = max(round(steps / 2), 1)
        if config.follows_touch:  # its windows divide what there is of it
            for part, share in ((0.5, HALVED), (0.75, CUT)):
                yield share, moments_of(shaped(_at_rate(features, part)))
        else:
            for last in range(half, steps):
                share = CUT / (steps - half) + HALVED * (last == half)
                if config.sets == 1:
                    yield share, moments_of(shaped(features * (np.arange(steps) < last)[:, None]))
                else:
                    begun = np.arange(len(sums)) < last * width
                    yield share, (gram * np.outer(begun, begun), sums * begun, cross * begun[:, None])
            for factor in RATES:
                yield RATE, moments_of(shaped(_at_rate(features, factor)))
        late = min(max(round(OVERLAP_AFTER * steps), 1), steps)
        still = features[:, :1] if config.rest_level.rest == "none" else at_rest
        over = np.zeros_like(features)
        over[:, late:] = (features - still)[:, : steps - late]
        added, moved, _ = moments_of(shaped(over))
        across = np.outer(sums, moved)
        yield OVERLAP, (gram + across + across.T + added, sums + moved, cross + np.outer(moved, of_class))

    weight, (total, moments, targets) = 1.0, (gram.copy(), sums.copy(), cross.copy())
    for of, parts in ways():
        weight += of
        for whole, part in zip((total, moments, targets), parts, strict=True):
            whole += of * part
    for whole in (total, moments, targets):
        whole /= weight
    centred = total
    centred -= np.outer(moments, moments)
    levels = [level - moments for level in (rest, np.zeros_like(rest))]
    lost = centred + sum(np.outer(level, level) for level in levels) / 2
    # what one deviation of the means does to each input
    slopes = np.zeros_like(features)
    kind_of = np.arange(width) % kinds
    of_level = {*LEVELS} & {*config.features.feature_kinds}
    of_mean = sigma[kind_of == level_kind(config)].max() if of_level else 1.0
    for kind, name in enumerate(config.features.feature_kinds):
        columns = kind_of == kind
        if name in LEVELS:
            slopes[..., columns] = of_mean / sigma[columns]
        elif name == "integral":
            real = np.abs(features[..., columns] * sigma[columns] + mu[columns])
            frames = np.array([last for _, last in config.window_spans])[:, None]
            grown = 2.0 ** (config.features.integral_knee + np.minimum(real, 40.0)) * np.log(2)
            slopes[..., columns] = of_mean * frames / grown / sigma[columns]
    slopes *= live
    time = (np.arange(steps) + 0.5)[:, None]
    offset, drift = shaped(slopes), shaped(slopes * time / steps)
    common = offset.T @ offset / touches
    penalty = np.where(alike, LOST * lost + OFFSET * common, 0.0) / number
    penalty += COMMON * common + DRIFT * drift.T @ drift / touches
    unit = max(float(x.var(axis=0).sum()), 1e-12)
    noise = np.full(len(centred), SMOOTH * unit / touches)
    if config.rest_level.clip:
        if config.opens_at_once and config.rest_level.rest == "initial":
            end = shaped(np.broadcast_to(config.rest_level.clip / sigma * live, features.shape)).mean(axis=0)
            penalty += np.where(alike, LEVEL_SPIKED * config.rest_level.rest_frames * np.outer(end, end), 0.0)
        # a window's mean loses one of its frames; an extreme is lost where a spike of its sign is likely in a touch
        frames_of = dict.fromkeys(EXTREMES, max(SPIKED, 2 / config.last_frame))
        frames_of["mean"] = config.window_lengths[-1] if config.follows_touch else config.windows.window
        spread = np.array([frames_of.get(kind, np.inf) for kind in config.features.feature_kinds])[kind_of]
        noise += SPIKED * by_taxel((config.rest_level.clip / sigma) ** 2) / by_taxel(spread)
    penalty[np.diag_indices_from(penalty)] += noise
    weights = solve(centred + strength * penalty, targets - np.outer(moments, of_class), assume_a="pos")
    bias = of_class - moments @ weights
    turn, other = discriminants_of(targets.T @ weights + np.outer(of_class, bias), indicators.sum(axis=0))
    return _arrays(config, turn.T @ weights.T, bias @ turn + other)


def _at_rate(features: np.ndarray, factor: float) -> np.ndarray:
    """(touches, K, D) for windows ``factor`` times as far apart, interpolated between two windows."""
    position = np.minimum(np.arange(features.shape[1]) * factor, features.shape[1] - 1)
    lower = position.astype(int)
    upper, part = np.minimum(lower + 1, features.shape[1] - 1), (position - lower)[:, None]
    return features[:, lower] * (1 - part) + features[:, upper] * part


def _inputs(config: AcceleratorConfig, features: np.ndarray) -> np.ndarray:
    """(touches, inputs): the features of all windows, or their sums where one set of weights serves all."""
    inputs = features if config.sets > 1 else features.sum(axis=1)
    return inputs.reshape(len(features), -1).astype(np.float64)


def _arrays(config: AcceleratorConfig, weights: np.ndarray, bias: np.ndarray) -> dict[str, np.ndarray]:
    """The cell's arrays from weights (classes, inputs)."""
    return {
        "V": weights.reshape(config.classes, config.sets, config.inputs).swapaxes(0, 1).copy(),
        "b_y": bias,
    }
