"""Training: many networks (folds x seeds) at once, cross-validation in float and integer, and the model folder.

The default recipe is chosen by the configuration: ``onset`` where a touch has an onset (noise and time warp), ``contact`` where the gate
opens at once, so that time has no origin to stretch from (noise only). The thesis protocol is an option.
"""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import torch
from threadpoolctl import threadpool_limits

from eskin.golden.core.config import PRESETS, AcceleratorConfig
from eskin.golden.core.errors import InputError
from eskin.golden.data.folds import grouped_folds
from eskin.golden.model.model import FloatModel, IntegerModel, check_model_target, real_by_input
from eskin.golden.model.pipeline import by_recording, decide_touches, step_times
from eskin.golden.model.preprocess import Touches, find_touches, real_features
from eskin.golden.training.derive import fits_sensor
from eskin.golden.training.linear_fit import fit_least_squares, fit_linear
from eskin.golden.training.network import RecurrentClassifier
from eskin.golden.training.quantise import IntegerNetwork, check_widths, profile, quantise_model, range_records

if TYPE_CHECKING:
    from eskin.golden.data.recordings import Recordings

Progress = Callable[[str, int, int], None]
"""Called with (what, updates done, updates in all)."""

WEIGHT_LIMIT = 1.98
"""Below 2 - 2**-6, the largest SQ(2,6) weight."""

FINE_TUNING_TEACHER = 0.9
"""Share of the float network's class probabilities in the targets of quantisation-aware training; the labels are the rest."""

FINE_TUNING_UPDATES, FINE_TUNING_RATE = 200, 0.005
"""Updates of quantisation-aware training, which starts from the float network, and the largest rate of their one-cycle schedule."""


FAULTY_WINDOWS = 3
"""Windows that a taxel which sticks at its limit spoils before the fault detector masks it: two blocks reach into so many at most."""
UNCLIPPED_LIMIT = 10.0
"""Where deviations are not clipped, a stuck taxel reads so many standard deviations of the features in training."""


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """How a network is trained; Adam and cross-entropy throughout, features scaled by one mean and one standard deviation.

    loss: on ``all`` steps (mean) or on the ``last``. updates, batch: gradient steps and touches each; epochs: passes over the training
    part instead of updates (then every touch is used once an epoch, in random order). learning_rate: the largest of a one-cycle
    schedule, or constant. noise: standard deviation added to every feature (1 = that of the training features). warp: a touch runs faster
    by a factor drawn between 1/warp and warp (log-uniform); 1 = none. gain: so is its amplitude, by a factor between 1/gain and gain.
    speed_gain: the amplitude also grows with the warp factor to this power, because a piezoelectric taxel answers to the rate of change.
    taxel_gain: each taxel's amplitude by a factor of its own between 1/taxel_gain and taxel_gain, one for the whole touch; 1 = none.
    taxel_offset: each taxel's features are shifted by a value of its own, normal with this standard deviation (1 = that of the training
    features), one for the whole touch; 0 = none. channel_dropout: probability with which a taxel is masked for the whole touch.
    taxel_failure: probability with which a taxel sticks at a limit in the touch, is found after FAULTY_WINDOWS and masked from there on.
    penalty: of a linear cell, which is fitted as a logistic regression on all windows of a touch (`eskin.golden.training.linear_fit`): the
    inverse penalty
    of its weights on standardised inputs, as scikit-learn has it; loss, epochs, learning_rate, one_cycle and weight_limit say nothing then.
    squares: a linear cell is a ridge regression on the classes' indicators instead, with a penalty chosen by leaving touches out.
    weight_limit: parameters are held within +-this (0 = no limit), so that 8-bit weights need one integer bit beside the sign.
    """

    name: str
    loss: Literal["all", "last"] = "all"
    updates: int = 400
    epochs: int = 0
    batch: int = 64
    learning_rate: float = 0.01
    one_cycle: bool = True
    noise: float = 0.0
    warp: float = 1.0
    gain: float = 1.0
    speed_gain: float = 0.0
    taxel_gain: float = 1.0
    taxel_offset: float = 0.0
    channel_dropout: float = 0.0
    taxel_failure: float = 0.0
    weight_limit: float = 0.0
    penalty: float = 0.0
    squares: bool = False

    @property
    def augments(self) -> bool:
        """True where touches are trained on that differ from the recorded ones."""
        return bool(
            self.noise
            or self.warp > 1
            or self.gain > 1
            or self.taxel_gain > 1
            or self.taxel_offset
            or self.channel_dropout
            or self.taxel_failure
        )


RECIPES = {
    "onset": Recipe(name="onset", learning_rate=0.03, noise=0.3, warp=1.5, gain=1.2, speed_gain=0.5, weight_limit=WEIGHT_LIMIT),
    "contact": Recipe(name="contact", learning_rate=0.03, noise=0.2, updates=800, weight_limit=WEIGHT_LIMIT),
    "robust": Recipe(
        name="robust",
        learning_rate=0.03,
        noise=0.3,
        warp=1.5,
        gain=1.2,
        speed_gain=0.5,
        weight_limit=WEIGHT_LIMIT,
        updates=800,
        channel_dropout=0.1,
        taxel_failure=0.05,
    ),
    "linear": Recipe(name="linear", loss="last", updates=60, noise=0.3, warp=1.5, gain=1.2, speed_gain=0.5, penalty=1.0),
    "thesis": Recipe(name="thesis", loss="last", epochs=96, batch=48, learning_rate=0.001, one_cycle=False),
}
"""The recipes. ``robust`` is ``onset`` for a sensor of which a taxel may fail. ``onset``, ``contact`` and ``robust`` were tuned on the
splits of the two recorded data sets on which they are reported, so unseen sensors may do worse. ``linear`` augments as ``onset`` does, and
not at all where the gate opens at once (which the same splits and biotac_slide's blocks showed); its penalty is scikit-learn's own, not
tuned. ``thesis`` is the published protocol with Adam's usual rate (the thesis names none)."""

SPLITS: dict[str, list[list[str]]] = {
    "pvdf": [["trial"], ["speed"], ["seq"]],
    "fabric": [["label", "force_setting", "velocity_mmps"]],
    "synthetic": [["person"]],
}
"""Splits by preset: names of the group arrays that stay on one side; ``label`` is the class itself."""


def choose_recipe(config: AcceleratorConfig, protocol: str = "default") -> Recipe:
    """The recipe for a configuration: ``default`` is ``contact`` where the gate opens at once and ``onset`` elsewhere, ``linear`` for a
    linear cell; ``robust`` adds channel dropout and twice the updates; or ``thesis``."""
    if not config.recurrent:
        return _linear_recipe(config, protocol)
    if protocol == "robust" and config.opens_at_once:
        contact = RECIPES["contact"]
        return dataclasses.replace(
            contact,
            name="robust",
            updates=2 * contact.updates,
            channel_dropout=RECIPES["robust"].channel_dropout,
            taxel_failure=RECIPES["robust"].taxel_failure,
        )
    if protocol == "default":
        return RECIPES["contact" if config.opens_at_once else "onset"]
    if protocol in ("robust", "thesis"):
        return RECIPES[protocol]
    raise InputError(f"training, field protocol: is '{protocol}'; use default, robust or thesis")


def _linear_recipe(config: AcceleratorConfig, protocol: str) -> Recipe:
    recipe, robust = RECIPES["linear"], RECIPES["robust"]
    if config.opens_at_once:
        recipe = dataclasses.replace(recipe, noise=0.0, warp=1.0, gain=1.0, speed_gain=0.0)
    if protocol == "robust":
        return dataclasses.replace(
            recipe,
            name="robust linear",
            updates=2 * recipe.updates,
            channel_dropout=robust.channel_dropout,
            taxel_failure=robust.taxel_failure,
        )
    if protocol != "default":
        raise InputError(f"training, field protocol: is '{protocol}' and the cell is linear; use default or robust")
    return recipe


def default_splits(recordings: Recordings, config: AcceleratorConfig) -> list[list[str]]:
    """The splits the configuration names, one that was derived those of the preset of the same sensor, as far as the recordings have the
    groups; without any, one plain split stratified by class."""
    known = {*recordings.groups, "label"}
    name = config.name
    if name == "derived":
        name = next((preset for preset in SPLITS if fits_sensor(PRESETS[preset], recordings)), "")
    splits = [split for split in SPLITS.get(name, []) if known.issuperset(split)]
    return splits or [[]]


def split_folds(recordings: Recordings, groups: Sequence[str], folds: int, seed: int | None) -> list[np.ndarray]:
    """``grouped_folds`` with ``label`` as a group name too."""
    if "label" in groups:
        recordings = dataclasses.replace(recordings, groups={**recordings.groups, "label": recordings.labels})
    return grouped_folds(recordings, groups, folds, seed)


# ---------------------------------------------------------------------- fitting
@dataclass(frozen=True)
class _Dataset:
    """First touches of a set of recordings, ready to train on.

    touches: first touch of each touched recording. index (R): row in touches of each recording, -1 none. means (n, L, D): what the network
    learns from before mu and sigma (`real_features`), beyond the last step where warp needs them. faults (n, L, D), bool: masked by the
    fault detector; None without one. ends (n): windows that the recording holds, up to L.
    """

    touches: Touches
    index: np.ndarray
    labels: np.ndarray
    means: np.ndarray
    faults: np.ndarray | None
    ends: np.ndarray


def _dataset(recordings: Recordings, config: AcceleratorConfig, recipe: Recipe, onsets: np.ndarray | None = None) -> _Dataset:
    further = max(config.windows.steps, int(np.ceil((config.windows.steps - 1) * recipe.warp)) + 1)
    found = find_touches(config, recordings, steps=further, onsets=onsets)
    first = found.first_touch()
    index = np.where(first >= 0, np.cumsum(first >= 0) - 1, -1)
    found = found.take(first[first >= 0])
    touches = found.take(np.arange(len(found)), config.windows.steps)
    return _Dataset(touches, index, recordings.labels, real_features(config, found.sums), found.faults, found.completed)


class Datasets:
    """First touches of one set of recordings under the front ends that were asked for, each found once: networks are not looked at."""

    def __init__(self, recordings: Recordings) -> None:
        self._recordings = recordings
        self._known: dict[str, _Dataset] = {}

    def of(self, config: AcceleratorConfig, recipe: Recipe) -> _Dataset:
        """What a recipe of this time warp trains on under the configuration's front end."""
        front_end = {name: value for name, value in config.to_dict().items() if name != "network"}
        key = json.dumps([front_end, recipe.warp])
        if key not in self._known:
            self._known[key] = _dataset(self._recordings, config, recipe)
        return self._known[key]


def _rows(data: _Dataset, recordings: np.ndarray) -> np.ndarray:
    """Rows of the touches that ``recordings`` have, those with a completed step."""
    rows = data.index[recordings]
    rows = rows[rows >= 0]
    return rows[data.touches.completed[rows] > 0]


QUIETEST = 1 / 16
"""With a scale a taxel: the least sigma of a taxel, as a share of the largest of its kind. What moves less is noise; and 16-bit scales hold
this range (`eskin.golden.model.model.normaliser_constants`)."""


def scaling(config: AcceleratorConfig, means: np.ndarray, completed: np.ndarray, faults: np.ndarray | None = None) -> tuple[Any, Any]:
    """(mu, sigma) of real features (touches, steps, inputs): live taxels, the first ``completed`` (touches) steps only, without what the
    fault detector masks (``faults``, of the shape of ``means``). Numbers, or arrays (constants) with several kinds of feature or a scale a
    taxel; a taxel of which nothing is left has 0 and the largest sigma of its kind.

    Raises
    ------
    InputError
        When the fault detector masks all of it.
    """
    done = np.arange(config.windows.steps) < completed[:, None]
    live = ~np.array(config.input_mask)
    values, sound = means[done][:, live], None if faults is None else ~faults[done][:, live]
    if sound is not None and not sound.any():
        raise InputError(
            f"configuration '{config.name}', field fault_activity: is {config.faults.fault_activity}, with which the fault detector masks "
            "every taxel of every touch; use a smaller one"
        )
    if config.constants == 1:
        values = values if sound is None else values[sound]
        return float(values.mean()), max(float(values.std()), 1e-6)
    constant_of = np.array(config.input_constants)[live]
    mu, sigma = np.zeros(config.constants), np.zeros(config.constants)
    for constant in range(config.constants):
        of_it = values[:, constant_of == constant]
        of_it = of_it if sound is None else of_it[sound[:, constant_of == constant]]
        if of_it.size:
            mu[constant], sigma[constant] = of_it.mean(), max(of_it.std(), 1e-6)
    for kind in range(config.kinds):
        of_kind = slice(kind, None, config.kinds)
        largest = max(sigma[of_kind].max(), 1e-6)
        least = QUIETEST * largest if config.features.feature_scale == "taxel" else 0.0
        sigma[of_kind] = np.where(sigma[of_kind] > 0, np.maximum(sigma[of_kind], least), largest)
    return mu, sigma


def _fit(
    data: _Dataset,
    config: AcceleratorConfig,
    recipe: Recipe,
    parts: list[np.ndarray],
    seed: int,
    progress: Callable[[int, int], None],
    curves: LossCurves | None = None,
) -> list[FloatModel]:
    """One network for each part (rows of the touches to train on), all trained at once; deterministic by ``seed``.

    curves: gets their losses on the way; a linear cell, which is solved and not trained, leaves them empty.
    """
    for rows in parts:
        if not len(rows):
            raise InputError("training: no touch was found in a training part; check the onset rule with 'eskin inspect'")
    with one_thread():
        return _fit_in_one_thread(data, config, recipe, parts, seed, progress, curves)


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Torch and the linear algebra of numpy and scipy in one thread: the operations are small, a second thread gains a third on an idle
    machine and loses a factor of ten on a busy one."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with threadpool_limits(1):
            yield
    finally:
        torch.set_num_threads(threads)


def _fit_in_one_thread(
    data: _Dataset,
    config: AcceleratorConfig,
    recipe: Recipe,
    parts: list[np.ndarray],
    seed: int,
    progress: Callable[[int, int], None],
    curves: LossCurves | None,
) -> list[FloatModel]:
    generator = torch.Generator().manual_seed(seed)
    if not config.recurrent:
        return _fit_linear(data, config, recipe, parts, generator, progress)
    models: list[FloatModel] = []
    shares = [slice(first, first + TOGETHER) for first in range(0, len(parts), TOGETHER)]
    some = [curves.of(share) for share in shares] if curves else [None] * len(shares)
    for number, (share, curve) in enumerate(zip(shares, some, strict=True)):
        told = lambda done, total, number=number: progress(number * total + done, len(shares) * total)  # noqa: E731
        models += _fit_together(data, config, recipe, parts[share], generator, told, curve)
    if curves:
        curves.join([curve for curve in some if curve])
    return models


def _fit_together(
    data: _Dataset,
    config: AcceleratorConfig,
    recipe: Recipe,
    parts: list[np.ndarray],
    generator: torch.Generator,
    progress: Callable[[int, int], None],
    curves: LossCurves | None,
) -> list[FloatModel]:
    """A recurrent network for each part, all in one batch of networks."""
    network = RecurrentClassifier(config, batch=(len(parts),), generator=generator)
    batches = _Batches(data, config, recipe, parts, generator)
    updates = max(1, recipe.epochs * -(-max(len(rows) for rows in parts) // recipe.batch)) if recipe.epochs else recipe.updates

    optimiser = torch.optim.Adam(network.parameters(), lr=recipe.learning_rate, foreach=True)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, recipe.learning_rate, total_steps=updates) if recipe.one_cycle else None
    for update in range(updates):
        features, labels, counts = batches.draw()
        loss = _loss(recipe, network(features), labels, counts)
        optimiser.zero_grad()
        loss.sum().backward()  # the networks share nothing, so the sum trains each by its own loss
        optimiser.step()
        if recipe.weight_limit:
            with torch.no_grad():
                for weight in network.parameters():
                    weight.clamp_(-recipe.weight_limit, recipe.weight_limit)
        if schedule:
            schedule.step()
        if curves:
            curves.note(update + 1, updates, loss.detach(), network, batches.scales)
        progress(update + 1, updates)
    arrays = network.arrays() | {name: np.array([pair[i] for pair in batches.scales]) for i, name in enumerate(("mu", "sigma"))}
    return [FloatModel(config, {name: array[m] for name, array in arrays.items()}) for m in range(len(parts))]


def _fit_linear(
    data: _Dataset,
    config: AcceleratorConfig,
    recipe: Recipe,
    parts: list[np.ndarray],
    generator: torch.Generator,
    progress: Callable[[int, int], None],
) -> list[FloatModel]:
    """A logistic regression for each part, on what the recipe draws of it, or on the part as it is where the recipe augments nothing."""
    models: list[FloatModel] = []
    known: dict[bytes, FloatModel] = {}  # without augmentation every seed gives the same
    for number, rows in enumerate(parts):
        model = known.get(rows.tobytes()) if not recipe.augments else None
        if model is None:
            batches = _Batches(data, config, recipe, [rows], generator)
            if recipe.augments:
                drawn = [batches.draw() for _ in range(recipe.updates)]
                features, labels, counts = (torch.cat(each, dim=1)[0].numpy() for each in zip(*drawn, strict=True))
            else:
                features, labels, counts = (each[0].numpy() for each in batches.recorded())
            penalty = recipe.penalty * len(rows) / len(labels)  # the touches are drawn several times, and are no more for that
            features = features * counts[..., None]
            arrays = fit_least_squares(config, features, labels) if recipe.squares else fit_linear(config, features, labels, penalty)
            mu, sigma = batches.scales[0]
            model = FloatModel(config, arrays | {"mu": np.array(mu), "sigma": np.array(sigma)})
            known[rows.tobytes()] = model
        models.append(model)
        progress(number + 1, len(parts))
    return models


def _loss(recipe: Recipe, logits: torch.Tensor, labels: torch.Tensor, counts: torch.Tensor) -> torch.Tensor:
    """(models) loss of logits (models, batch, steps, C), over the steps that count."""
    losses = torch.nn.functional.cross_entropy(
        logits.flatten(0, -2), labels[..., None].expand(counts.shape).flatten(), reduction="none"
    ).view(counts.shape)
    if recipe.loss == "last":
        last = counts.sum(-1, keepdim=True) - 1
        return losses.gather(-1, last).mean(dim=(1, 2))
    return (losses * counts).sum(dim=(1, 2)) / counts.sum(dim=(1, 2))


TOGETHER = 256
"""Networks trained in one batch at most: with more, memory would grow by what was asked for (--folds 200 --seeds 100)."""
CURVE_POINTS = 20
"""Points of a training curve at most."""
CURVE_TOUCHES = 64
"""Touches on which a point's loss of unseen recordings is taken: drawn once, so that points differ by the network alone."""


class LossCurves:
    """Losses of networks while they are trained, at ``CURVE_POINTS`` points.

    updates: the gradient steps done at each point. losses: (points, networks, 2); first on what was trained on, augmented, mean since the
    point before; then on touches that the network has not seen, as they were recorded (nan where its part of the test has none).

    Parameters
    ----------
    tests:
        Rows of the touches that each network has not seen.
    """

    def __init__(self, data: _Dataset, config: AcceleratorConfig, recipe: Recipe, tests: list[np.ndarray]) -> None:
        self._data, self._config, self._recipe = data, config, recipe
        generator = torch.Generator().manual_seed(0)  # its own: training draws what it would without a curve
        self._unseen = torch.tensor([bool(len(rows)) for rows in tests])
        draws = [torch.randint(max(len(rows), 1), (CURVE_TOUCHES,), generator=generator).numpy() for rows in tests]
        self._rows = [rows[drawn] if len(rows) else drawn for rows, drawn in zip(tests, draws, strict=True)]
        self._touches: tuple[torch.Tensor, torch.Tensor, torch.Tensor] | None = None
        self._trained: list[torch.Tensor] = []
        self.updates: list[int] = []
        self.losses = np.zeros((0, len(tests), 2))

    def of(self, share: slice) -> LossCurves:
        """Empty curves of some of the networks, on the same touches."""
        made = copy.copy(self)
        made._unseen, made._rows, made._trained, made.updates = self._unseen[share], self._rows[share], [], []
        made.losses = np.zeros((0, len(made._rows), 2))
        return made

    def join(self, shares: Sequence[LossCurves]) -> None:
        """Take over what was noted of all networks, share by share."""
        self.updates, self.losses = shares[0].updates, np.concatenate([share.losses for share in shares], axis=1)

    def note(self, done: int, total: int, loss: torch.Tensor, network: RecurrentClassifier, scales: list[tuple[float, float]]) -> None:
        """After each update: its ``loss`` (networks); at a point also that on unseen touches, scaled as the training part is."""
        self._trained.append(loss)
        if done * CURVE_POINTS // total == (done - 1) * CURVE_POINTS // total:
            return
        if self._touches is None:
            plain = dataclasses.replace(
                self._recipe, noise=0.0, warp=1.0, gain=1.0, taxel_gain=1.0, taxel_offset=0.0, channel_dropout=0.0, taxel_failure=0.0
            )
            generator = torch.Generator()
            pool = _Pool(self._rows, generator)
            self._touches = _Batches(self._data, self._config, plain, self._rows, generator, scales=scales, pool=pool).recorded()
        features, labels, counts = self._touches
        with torch.no_grad():
            unseen = _loss(self._recipe, network(features), labels, counts).where(self._unseen, torch.nan)
        point = torch.stack([torch.stack(self._trained).mean(0), unseen], dim=-1).double().numpy()
        self.updates.append(done)
        self.losses = np.concatenate([self.losses, point[None]])
        self._trained = []


def _distance(logits: torch.Tensor, teacher: torch.Tensor, counts: torch.Tensor) -> torch.Tensor:
    """(models) cross-entropy of the teacher's class probabilities, over the steps that count."""
    losses = -(teacher.double().softmax(-1) * logits.log_softmax(-1)).sum(-1)
    return (losses * counts).sum(dim=(1, 2)) / counts.sum(dim=(1, 2))


class _Batches:
    """Augmented training batches, one for every part; scales: (mu, sigma) of each part, codes.

    ``scales``, ``pool``: in place of those of the parts and of draws from them.
    """

    def __init__(
        self,
        data: _Dataset,
        config: AcceleratorConfig,
        recipe: Recipe,
        parts: list[np.ndarray],
        generator: torch.Generator,
        *,
        scales: list[tuple[float, float]] | None = None,
        pool: _Pool | None = None,
    ) -> None:
        self._config, self._recipe, self._generator = config, recipe, generator
        taken = [data.touches.take(rows) for rows in parts]
        self.scales = scales or [
            scaling(config, data.means[rows, : config.windows.steps], some.completed, some.faults)
            for rows, some in zip(parts, taken, strict=True)
        ]
        self._mu, self._sigma = (
            torch.tensor(np.array([real_by_input(config, np.asarray(pair[i])) for pair in self.scales]), dtype=torch.float32).view(
                len(parts), 1, 1, -1
            )
            for i in (0, 1)
        )
        self._means = torch.tensor(data.means, dtype=torch.float32)
        self._means[..., list(config.input_mask)] = 0.0
        self._faults = None if data.faults is None else torch.tensor(data.faults)
        self._live = (~torch.tensor(config.input_mask)).float()
        self._integral = torch.tensor([config.features.feature_kinds[kind] == "integral" for kind in config.input_kinds])
        self._labels = torch.tensor(data.labels[data.touches.recording])
        self._ends = torch.tensor(data.ends)
        self._pool = pool or _Pool(parts, generator)

    def draw(self) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Real features (parts, batch, steps, inputs), labels (parts, batch), and which steps the recording holds (parts, batch, steps)."""
        return self._augmented(self._pool.draw(self._recipe.batch, in_order=bool(self._recipe.epochs)))

    def recorded(self) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """The same of every touch of the parts, each once; parts must be of one size."""
        return self._augmented(torch.stack(self._pool.parts))

    def _augmented(self, rows: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        recipe, generator = self._recipe, self._generator
        speed, amplitude = _log_uniform(recipe.warp, rows.shape, generator), _log_uniform(recipe.gain, rows.shape, generator)
        amplitude = amplitude * speed**recipe.speed_gain
        position = torch.arange(self._config.windows.steps) * speed[..., None]
        last = (self._ends[rows] - 1)[..., None]
        counts = position <= last
        position = torch.minimum(position, last.float())
        lower = position.floor().long()
        upper = torch.minimum(lower + 1, last)
        part = (position - lower)[..., None]
        means = torch.lerp(self._means[rows[..., None], lower], self._means[rows[..., None], upper], part)
        gain = amplitude[..., None, None]
        of_taxel = torch.Size((*rows.shape, 1, self._config.sensor.taxels))  # one value for the whole touch
        kinds = self._config.kinds
        if self._integral.any():  # a faster touch of the same amplitude adds up to less
            gain = torch.where(self._integral, gain / speed[..., None, None], gain)
        if recipe.taxel_gain > 1:
            gain = gain * _log_uniform(recipe.taxel_gain, of_taxel, generator).repeat_interleave(kinds, -1)
        features = (self._amplified(means, gain) - self._mu) / self._sigma
        if recipe.taxel_offset:
            features = features + recipe.taxel_offset * torch.randn((*rows.shape, 1, self._config.inputs), generator=generator)
        if recipe.noise:
            features = features + recipe.noise * torch.randn(features.shape, generator=generator)
        if recipe.channel_dropout:
            features = features * (torch.rand(of_taxel, generator=generator) >= recipe.channel_dropout).repeat_interleave(kinds, -1)
        if recipe.taxel_failure:
            features = self._failing(features, of_taxel)
        if self._faults is not None:
            masked = self._faults[rows[..., None], lower] | (self._faults[rows[..., None], upper] & (part > 0))
            features = features.masked_fill(masked, 0.0)
        return features * self._live, self._labels[rows], counts

    def _amplified(self, means: torch.Tensor, gain: torch.Tensor) -> torch.Tensor:
        """Real features of touches whose deviations are ``gain`` times as large: of an integral the logarithm of the amplified sum."""
        if not self._integral.any():
            return means * gain
        logarithms = torch.sign(means) * torch.log2(1 + gain * (torch.exp2(means.abs().clamp(max=60.0)) - 1))
        return torch.where(self._integral, logarithms, means * gain)

    def _stuck(self, side: torch.Tensor, limit: torch.Tensor, since: torch.Tensor, share: torch.Tensor) -> torch.Tensor:
        """Real features of a taxel that has stood ``side`` * ``limit`` codes from rest for ``since`` + ``share`` hops."""
        config = self._config
        if config.features.feature_kinds == ("mean",):
            return share * side * limit
        level = share * side * limit
        still = config.features.activity_rule == "change"  # what stands still does not change
        activity = torch.zeros_like(level) if still else (level * config.features.activity_block).abs()
        grown = level * config.windows.hop * (since + 1).clamp(min=0)
        kinds = {"mean": level, "activity": activity, "integral": grown}
        columns = []
        for number, kind in enumerate(config.features.feature_kinds):
            value = kinds[kind][..., number :: config.kinds]
            knee = config.features.integral_knee if kind == "integral" else config.features.compand_knee
            if kind == "integral" or config.features.compand == "log":
                frames = 1 if kind == "integral" else config.windows.window
                value = torch.sign(value) * torch.log2(1 + value.abs() * frames / 2.0**knee)
            columns.append(value)
        return torch.stack(columns, -1).flatten(-2)

    def _failing(self, features: torch.Tensor, of_taxel: torch.Size) -> torch.Tensor:
        """Some taxels at a limit from a random step on, masked FAULTY_WINDOWS later; the first window may hold only part of it."""
        recipe, generator, steps = self._recipe, self._generator, self._config.windows.steps
        kinds = self._config.kinds

        def each(of_one_taxel: torch.Tensor) -> torch.Tensor:
            """For every kind of feature what was drawn for the taxel."""
            return of_one_taxel.repeat_interleave(kinds, -1)

        fails = each(torch.rand(of_taxel, generator=generator) < recipe.taxel_failure)
        first = each(torch.randint(1 - FAULTY_WINDOWS, steps, of_taxel, generator=generator))
        side = each(torch.randint(0, 2, of_taxel, generator=generator) * 2.0 - 1.0)
        since = torch.arange(steps)[:, None] - first
        share = torch.where(since == 0, each(torch.rand(of_taxel, generator=generator)), torch.ones(()))
        stuck = (self._stuck(side, self._limit(), since, share) - self._mu) / self._sigma
        return torch.where(fails & (since >= FAULTY_WINDOWS), 0.0, torch.where(fails & (since >= 0), stuck, features))

    def _limit(self) -> torch.Tensor:
        """Codes from rest at which a taxel stands that is stuck: the clip, or far beyond what the first kind of feature spreads over."""
        config = self._config
        if config.rest_level.clip:
            return torch.full_like(self._sigma, float(config.rest_level.clip))
        kind = config.features.feature_kinds[0]
        if kind == "integral":
            return UNCLIPPED_LIMIT * torch.full_like(self._sigma, 2.0**config.features.integral_knee / config.last_frame)
        first = self._sigma[..., :: config.kinds] if self._sigma.shape[-1] > 1 else self._sigma
        first = first / (config.features.activity_block if kind == "activity" else 1)
        return UNCLIPPED_LIMIT * (first.repeat_interleave(config.kinds, -1) if first.shape[-1] > 1 else first)


def _fine_tune(
    data: _Dataset,
    recipe: Recipe,
    parts: list[np.ndarray],
    models: list[FloatModel],
    seed: int,
    widths: dict[str, Any],
    progress: Callable[[int, int], None],
) -> list[IntegerModel]:
    """Quantisation-aware training: an integer network from each trained float one, trained on in integer arithmetic.

    Formats are chosen once, from the ranges of the network on its own part; networks of the same formats train at once.
    """
    starts = [_post_training(model, data, rows, widths) for model, rows in zip(models, parts, strict=True)]
    groups: dict[AcceleratorConfig, list[int]] = {}
    for m, start in enumerate(starts):
        groups.setdefault(start.config, []).append(m)
    total = FINE_TUNING_UPDATES * len(groups)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        for g, members in enumerate(groups.values()):
            network = IntegerNetwork([models[m] for m in members], [starts[m] for m in members])
            batches = _Batches(data, network.config, recipe, [parts[m] for m in members], torch.Generator().manual_seed(seed))
            optimiser = torch.optim.Adam(network.parameters(), lr=FINE_TUNING_RATE, foreach=True)
            schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, FINE_TUNING_RATE, total_steps=FINE_TUNING_UPDATES)
            for update in range(FINE_TUNING_UPDATES):
                features, labels, counts = batches.draw()
                logits = network(network.feature_codes(features))
                taught = _distance(logits, network.teach(features), counts)
                loss = (1 - FINE_TUNING_TEACHER) * _loss(recipe, logits, labels, counts) + FINE_TUNING_TEACHER * taught
                optimiser.zero_grad()
                loss.sum().backward()
                optimiser.step()
                schedule.step()
                network.hold()
                progress(g * FINE_TUNING_UPDATES + update + 1, total)
            for m, integer in zip(members, network.export(), strict=True):
                starts[m] = integer
    finally:
        torch.set_num_threads(threads)
    return starts


def _log_uniform(limit: float, shape: torch.Size, generator: torch.Generator) -> torch.Tensor:
    """Factors between 1/limit and limit, as likely below 1 as above."""
    return limit ** (torch.rand(shape, generator=generator) * 2 - 1)


class _Pool:
    """Draws training rows for every part: at random, or in shuffled passes over the part."""

    def __init__(self, parts: list[np.ndarray], generator: torch.Generator) -> None:
        self.parts = [torch.tensor(rows) for rows in parts]
        self._generator = generator
        self._waiting = [torch.empty(0, dtype=torch.long) for _ in parts]

    def draw(self, batch: int, *, in_order: bool) -> torch.Tensor:
        """(parts, batch) rows."""
        return torch.stack([self._next(m, batch) if in_order else self._any(m, batch) for m in range(len(self.parts))])

    def _any(self, m: int, batch: int) -> torch.Tensor:
        return self.parts[m][torch.randint(len(self.parts[m]), (batch,), generator=self._generator)]

    def _next(self, m: int, batch: int) -> torch.Tensor:
        while len(self._waiting[m]) < batch:
            again = self.parts[m][torch.randperm(len(self.parts[m]), generator=self._generator)]
            self._waiting[m] = torch.cat([self._waiting[m], again])
        rows, self._waiting[m] = self._waiting[m][:batch], self._waiting[m][batch:]
        return rows


# ---------------------------------------------------------------------- cross-validation
def cross_validate(
    recordings: Recordings,
    config: AcceleratorConfig,
    splits: Sequence[Sequence[str]],
    seeds: Sequence[int] = (0, 1, 2),
    *,
    folds: int = 5,
    recipe: Recipe | None = None,
    widths: dict[str, Any] | None = None,
    quantisation_aware: bool = False,
    datasets: Datasets | None = None,
    progress: Progress | None = None,
) -> list[dict[str, Any]]:
    """Accuracy on recordings that a network has not seen, float and integer, for every split; all folds and seeds train at once.

    Every fold's network is quantised after training, with ranges profiled on its own training part. A recording without a touch, or
    without the step in question, counts as wrong.

    Parameters
    ----------
    splits:
        Group names for each split (``label`` is the class); empty: stratified by class.
    seeds:
        A network for each fold and seed; figures are means over seeds of the share of recordings.
    widths:
        Bits, as ``eskin.golden.training.quantise.choose_formats`` takes them.
    quantisation_aware:
        The integer networks are trained on in integer arithmetic; False: quantised after training. Float figures are the same.
    datasets:
        Touches that were found before.

    Returns
    -------
    A record for each split: groups, folds, seeds, float_accuracy, integer_accuracy, agreement, float_spread and integer_spread
    (standard deviation over folds x seeds), float_by_seed and integer_by_seed (accuracy over all folds), per_step (step, time_s since the
    onset, float_accuracy, integer_accuracy), decision_time_s (of the global decision since the onset, mean, integer; None: no decision),
    logit_error (mean and max of how far integer logits are from float ones over all completed steps; None: no step),
    training_curve (updates, training_loss and held_out_loss of the float networks on their way, means over folds and seeds; None: linear),
    per_fold (held_out, recordings, float_accuracy, integer_accuracy, agreement, by_seed), confusion (integer model, summed over seeds: rows
    = true class, columns = decided, last column = none), per_class (integer accuracy).
    """
    recipe = recipe or choose_recipe(config)
    work = Folds(recordings, config, recipe, splits, seeds, folds, datasets)
    models = work.fit(progress)
    integers = work.fine_tune(models, widths or {}, progress) if quantisation_aware else work.quantise(models, widths or {})
    return work.records(models, integers)


class Folds:
    """The networks of a cross-validation, all folds of all splits for every seed: trained, quantised and judged, in one order."""

    def __init__(
        self,
        recordings: Recordings,
        config: AcceleratorConfig,
        recipe: Recipe,
        splits: Sequence[Sequence[str]],
        seeds: Sequence[int],
        folds: int,
        datasets: Datasets | None = None,
    ) -> None:
        self._recordings, self._config, self._recipe = recordings, config, recipe
        self._splits, self._seeds = [list(groups) for groups in splits], list(map(int, seeds))
        self.data = (datasets or Datasets(recordings)).of(config, recipe)
        self._jobs: list[tuple[int, int, np.ndarray]] = []
        self._names: list[list[str]] = []
        for number, groups in enumerate(self._splits):
            tests = split_folds(recordings, groups, folds, None)
            self._names.append([_held_out(recordings, groups, test) for test in tests])
            self._jobs += [(number, fold, test) for fold, test in enumerate(tests)]
        everything = np.arange(len(recordings))
        parts = [_rows(self.data, np.setdiff1d(everything, test)) for _, _, test in self._jobs]
        self.parts = [part for _ in self._seeds for part in parts]
        self._curves: LossCurves | None = None

    def fit(self, progress: Progress | None) -> list[FloatModel]:
        """A float network for each part."""
        unseen = [_rows(self.data, test) for test in self.tests]
        self._curves = LossCurves(self.data, self._config, self._recipe, unseen)
        report = _named(progress, "cross-validation")
        return _fit(self.data, self._config, self._recipe, self.parts, self._seeds[0], report, curves=self._curves)

    def quantise(self, models: list[FloatModel], widths: dict[str, Any]) -> list[IntegerModel]:
        """Post-training integers of each, ranges profiled on its own training part."""
        return [_post_training(model, self.data, rows, widths) for model, rows in zip(models, self.parts, strict=True)]

    def fine_tune(self, models: list[FloatModel], widths: dict[str, Any], progress: Progress | None) -> list[IntegerModel]:
        """Integers of each by quantisation-aware training on its own part."""
        report = _named(progress, "quantisation-aware training")
        return _fine_tune(self.data, self._recipe, self.parts, models, self._seeds[0], widths, report)

    @property
    def tests(self) -> list[np.ndarray]:
        """For each network the recordings it has not seen."""
        return [test for _ in self._seeds for _, _, test in self._jobs]

    @property
    def trainings(self) -> list[np.ndarray]:
        """For each network the recordings it was trained on."""
        everything = np.arange(len(self._recordings))
        return [np.setdiff1d(everything, test) for test in self.tests]

    @property
    def split_numbers(self) -> list[int]:
        """For each network the index of its split."""
        return [number for _ in self._seeds for number, _, _ in self._jobs]

    def judge_on(self, recordings: Recordings, onsets: np.ndarray | None = None) -> None:
        """From now on ``records`` judges on ``recordings``, which stand for those trained on, one for one.

        onsets: forced, as for ``eskin.golden.model.preprocess.find_touches``.
        """
        self.data = _dataset(recordings, self._config, self._recipe, onsets)

    def records(self, models: list[FloatModel], integers: list[IntegerModel]) -> list[dict[str, Any]]:
        """A record for each split, as ``cross_validate`` returns them."""
        return self.records_of(self.decided(models, integers))

    def decided(self, models: list[FloatModel], integers: list[IntegerModel]) -> list[Decided]:
        """What each network decided on the recordings it has not seen (``tests``)."""
        runs = [_judge(model, integer, self.data, test) for model, integer, test in zip(models, integers, self.tests, strict=True)]
        if not self._curves or not self._curves.updates:
            return runs
        updates = tuple(self._curves.updates)
        return [dataclasses.replace(run, updates=updates, losses=self._curves.losses[:, m]) for m, run in enumerate(runs)]

    def records_of(self, runs: Sequence[Decided]) -> list[dict[str, Any]]:
        """A record for each split from what each network ``decided``."""
        decided: dict[tuple[int, int], list[Decided]] = {}
        for m, run in enumerate(runs):
            decided.setdefault(self._jobs[m % len(self._jobs)][:2], []).append(run)
        times = step_times(self._config, self.data.touches)
        return [
            split_record(
                groups,
                self._names[number],
                [test for n, _, test in self._jobs if n == number],
                [decided[number, fold] for fold in range(len(self._names[number]))],
                self._recordings,
                self._seeds,
                times,
            )
            for number, groups in enumerate(self._splits)
        ]


def _named(progress: Progress | None, what: str) -> Callable[[int, int], None]:
    return (lambda done, total: progress(what, done, total)) if progress else (lambda done, total: None)


@dataclass(frozen=True)
class Decided:
    """Decisions of one network on its test part: global (r) and local (r, K), -1 none, float and integer; the step (r) after which the
    integer global one was given, -1 none; how far integer logits are from float ones (values of completed steps); its losses (points, 2) in
    training after so many updates (``LossCurves``), none of a linear cell."""

    float_global: np.ndarray
    float_local: np.ndarray
    integer_global: np.ndarray
    integer_local: np.ndarray
    integer_step: np.ndarray
    logit_error: np.ndarray
    updates: tuple[int, ...] = ()
    losses: np.ndarray | None = None


def _post_training(model: FloatModel, data: _Dataset, rows: np.ndarray, widths: dict[str, Any]) -> IntegerModel:
    return quantise_model(model, profile(model, data.touches.take(rows)), **widths)


def _judge(model: FloatModel, integer: IntegerModel, data: _Dataset, test: np.ndarray) -> Decided:
    rows = data.index[test]
    touches = data.touches.take(rows[rows >= 0])
    placed = np.where(rows >= 0, np.cumsum(rows >= 0) - 1, -1)
    real = decide_touches(model, touches, config=integer.config)
    exact = decide_touches(integer, touches)
    found = (by_recording(values, placed) for values in (real.decision, real.local, exact.decision, exact.local, exact.step))
    done = np.arange(exact.logits.shape[1]) < touches.completed[:, None]
    return Decided(*found, np.abs(integer.config.formats.logit_format.to_real(exact.logits) - real.logits)[done].ravel())


def _held_out(recordings: Recordings, groups: Sequence[str], test: np.ndarray) -> str:
    """What a fold leaves out, in words: ``speed 300``; the number of groups where there are many."""
    if not groups:
        return f"{len(test)} recordings"
    columns = [recordings.labels if name == "label" else recordings.groups[name] for name in groups]
    values = sorted({tuple(str(column[i]) for column in columns) for i in test})
    return f"{' '.join(groups)} {', '.join(' '.join(value) for value in values)}" if len(values) <= 3 else f"{len(values)} groups"


def split_record(groups, names, tests, decided, recordings, seeds, times) -> dict[str, Any]:
    """The record of one split, as training.json has it, of what each network (a list a fold, one a seed) decided on the part left out."""
    classes = len(recordings.class_names)
    confusion = np.zeros((classes, classes + 1), dtype=np.int64)
    per_fold = []
    steps_float, steps_integer = np.zeros(len(times)), np.zeros(len(times))
    total = len(recordings) * len(seeds)
    for name, test, runs in zip(names, tests, decided, strict=True):
        labels = recordings.labels[test]
        for run in runs:
            np.add.at(confusion, (labels, run.integer_global), 1)  # -1, no decision, is the last column
            steps_float += (run.float_local == labels[:, None]).sum(axis=0) / total
            steps_integer += (run.integer_local == labels[:, None]).sum(axis=0) / total
        shares = {
            "float_accuracy": [float(np.mean(run.float_global == labels)) for run in runs],
            "integer_accuracy": [float(np.mean(run.integer_global == labels)) for run in runs],
            "agreement": [float(np.mean(run.float_global == run.integer_global)) for run in runs],
        }
        per_fold.append(
            {"held_out": name, "recordings": len(test), "by_seed": shares} | {key: float(np.mean(values)) for key, values in shares.items()}
        )
    weights = [len(test) for test in tests]

    def overall(key: str) -> float:
        return float(np.average([fold[key] for fold in per_fold], weights=weights))

    def spread(key: str) -> float:
        return float(np.std([value for fold in per_fold for value in fold["by_seed"][key]]))

    given = np.concatenate([run.integer_step[run.integer_step >= 0] for runs in decided for run in runs])

    errors = np.concatenate([run.logit_error for runs in decided for run in runs])

    def by_seed(key: str) -> list[float]:
        return np.average([fold["by_seed"][key] for fold in per_fold], axis=0, weights=weights).tolist()

    return {
        "groups": groups,
        "folds": len(tests),
        "seeds": seeds,
        **{key: overall(key) for key in ("float_accuracy", "integer_accuracy", "agreement")},
        "float_spread": spread("float_accuracy"),
        "integer_spread": spread("integer_accuracy"),
        "float_by_seed": by_seed("float_accuracy"),
        "integer_by_seed": by_seed("integer_accuracy"),
        "per_step": [
            {"step": k + 1, "time_s": float(times[k]), "float_accuracy": float(steps_float[k]), "integer_accuracy": float(steps_integer[k])}
            for k in range(len(times))
        ],
        "per_fold": per_fold,
        "decision_time_s": float(np.mean(np.asarray(times)[given])) if len(given) else None,
        "logit_error": {"mean": float(errors.mean()), "max": float(errors.max())} if len(errors) else {"mean": None, "max": None},
        "training_curve": _training_curve([run for runs in decided for run in runs]),
        "confusion": confusion.tolist(),
        "per_class": {name: float(confusion[c, c] / max(confusion[c].sum(), 1)) for c, name in enumerate(recordings.class_names)},
    }


def _training_curve(runs: Sequence[Decided]) -> dict[str, Any] | None:
    """{updates, training_loss, held_out_loss (None: nothing to judge)}, means over networks; None of a linear cell."""
    losses = [run.losses for run in runs if run.losses is not None]
    if not losses:
        return None
    trained, unseen = np.moveaxis(np.array(losses), -1, 0)
    judged = unseen[~np.isnan(unseen).any(axis=1)]
    return {
        "updates": list(runs[0].updates),
        "training_loss": trained.mean(axis=0).tolist(),
        "held_out_loss": judged.mean(axis=0).tolist() if len(judged) else None,
    }


# ---------------------------------------------------------------------- the verb
@dataclass(frozen=True, kw_only=True)
class TrainingRequest:
    """How a network of a configuration is cross-validated and trained.

    Parameters
    ----------
    folds:
        Folds of the cross-validation; 0 = none. With no more groups than folds each is left out in turn.
    splits:
        Group names of each split; None: every split the configuration names (``default_splits``).
    seed, seeds:
        First seed, that of the network written; number of seeds the cross-validation averages over.
    protocol:
        ``default``, ``robust`` (``choose_recipe``) or ``thesis`` (last-step loss, Adam, 96 epochs of batch 48; splits stratified by
        class).
    recipe:
        Instead of that of the protocol.
    quantisation_aware:
        Train the float network on in integer arithmetic and write weights.npz too (a later ``quantise`` replaces it by post-training
        integers of the float network).
    widths:
        Bits, as ``eskin.golden.training.quantise.choose_formats`` takes them: of the cross-validation's integers, and of those written.
    known:
        Records of splits that this network, recipe and seeds were cross-validated over before; they are not done again.
    """

    folds: int = 5
    splits: Sequence[Sequence[str]] | None = None
    seed: int = 0
    seeds: int = 3
    protocol: str = "default"
    recipe: Recipe | None = None
    quantisation_aware: bool = False
    widths: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    known: Sequence[dict[str, Any]] = ()


def train(
    recordings: Recordings,
    config: AcceleratorConfig,
    request: TrainingRequest | None = None,
    *,
    out: str | Path,
    datasets: Datasets | None = None,
    notes: Callable[[dict[str, Any]], dict[str, Any]] | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Cross-validate, fit a network on ALL recordings, and write the model folder (config.json, float.npz, training.json).

    Parameters
    ----------
    request:
        None: as `TrainingRequest` has it by default.
    out:
        A new folder, or a model folder, which is replaced.
    datasets:
        Touches that were found before.
    notes:
        Called with the record before it is written; what it returns is added.

    Returns
    -------
    The training record, as written to training.json: seed, recipe, config, data, recordings, touched, parameters, ranges,
    cross_validation (``cross_validate``), versions, wall_s.

    Raises
    ------
    InputError
        Before any work: a folder that must not be replaced, an unknown group, a network or protocol that does not exist.
    """
    begin = time.perf_counter()
    check_model_target(out)
    request = request or TrainingRequest()
    recipe, seed, widths = request.recipe or choose_recipe(config, request.protocol), request.seed, dict(request.widths)
    check_widths(config, **widths)
    if tuple(recordings.class_names) != config.network.class_names:
        raise InputError(
            f"recordings '{recordings.source}': their classes are {', '.join(recordings.class_names)} and configuration '{config.name}', "
            f"field class_names, has {', '.join(config.network.class_names)}; use recordings and a configuration of one task"
        )
    datasets = datasets or Datasets(recordings)
    results = _cross_validation(recordings, config, request, recipe, datasets, progress) if request.folds else []

    data = datasets.of(config, recipe)
    rows = _rows(data, np.arange(len(recordings)))
    (model,) = _fit(data, config, recipe, [rows], seed, _named(progress, "training on all recordings"))
    integer = None
    if request.quantisation_aware:
        report = _named(progress, "quantisation-aware training on all recordings")
        (integer,) = _fine_tune(data, recipe, [rows], [model], seed, widths, report)
    ranges = profile(model, data.touches)
    record = {
        "seed": seed,
        "recipe": dataclasses.asdict(recipe),
        "config": config.to_dict(),
        "data": str(recordings.source),
        "recordings": len(recordings),
        "touched": int((data.index >= 0).sum()),
        "parameters": model.parameter_count,
        "quantisation_aware": request.quantisation_aware,
        "widths": widths,
        "ranges": range_records(integer.config if integer else config, ranges),
        "cross_validation": results,
        "versions": {"torch": torch.__version__, "numpy": np.__version__},
        "wall_s": time.perf_counter() - begin,
    }
    if notes:
        record |= notes(record)
        record["wall_s"] = time.perf_counter() - begin
    record = json.loads(json.dumps(record))  # what the file will hold: lists, not tuples
    model.save(out, record)
    if integer:
        integer.save(out)
    return record


def _cross_validation(
    recordings: Recordings,
    config: AcceleratorConfig,
    request: TrainingRequest,
    recipe: Recipe,
    datasets: Datasets,
    progress: Progress | None,
) -> list[dict[str, Any]]:
    """A record for each split of the request, in its order."""
    splits = request.splits
    if splits is None:
        splits = [[]] if request.protocol == "thesis" else default_splits(recordings, config)
    for groups in splits:
        split_folds(recordings, groups, request.folds, None)  # refuses before the work begins
    done = {tuple(record["groups"]): record for record in request.known}
    left = [list(groups) for groups in splits if tuple(groups) not in done]
    if left:
        fresh = cross_validate(
            recordings,
            config,
            left,
            range(request.seed, request.seed + request.seeds),
            folds=request.folds,
            recipe=recipe,
            widths=dict(request.widths),
            quantisation_aware=request.quantisation_aware,
            datasets=datasets,
            progress=progress,
        )
        done |= {tuple(record["groups"]): record for record in fresh}
    return [done[tuple(groups)] for groups in splits]
