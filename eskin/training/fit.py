"""Fitting of many networks (folds x seeds) at once: in float, and then in integer arithmetic."""

import contextlib
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import torch
from threadpoolctl import threadpool_limits

from eskin.golden.core import AcceleratorConfig, Arrays, InputError, Record
from eskin.golden.model import FloatModel, IntegerModel
from eskin.training.batches import Batches
from eskin.training.datasets import Dataset
from eskin.training.linear_fit import cut_short, fit_average, fit_least_squares, fit_linear, fit_sturdy
from eskin.training.losses import EpochReporter, Progress, class_loss, descend, teacher_loss
from eskin.training.network import RecurrentClassifier
from eskin.training.quantise import IntegerNetwork, check_given, profile, quantise_model
from eskin.training.recipe import Recipe
from eskin.training.trees import fit_forest

FINE_TUNING_TEACHER = 0.9
"""Share of the float network's class probabilities in the targets of quantisation-aware training; the rest
comes from the labels."""

FINE_TUNING_UPDATES, FINE_TUNING_RATE = 200, 0.005
"""Updates of quantisation-aware training, which starts from the float network, and the largest rate of their
one-cycle schedule."""

Loss = Callable[[torch.Tensor, torch.Tensor, torch.Tensor], torch.Tensor]
"""(networks) loss of features, labels and steps that count, as `Batches.draw` gives them."""

TOGETHER = 256
"""Highest number of networks trained in one batch. Without a limit, memory would grow with the request
(--folds 200 --seeds 100)."""


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Run torch and the linear algebra of numpy and scipy in one thread.

    The operations are small: a second thread gains a third on an idle machine and loses a factor of ten on a
    busy one.
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with threadpool_limits(1):
            yield
    finally:
        torch.set_num_threads(threads)


@one_thread()
def fit_networks(
    data: Dataset,
    config: AcceleratorConfig,
    recipe: Recipe,
    parts: list[np.ndarray],
    seed: int,
    progress: Progress,
    told: EpochReporter | None = None,
) -> list[FloatModel]:
    """One network for each part (rows of the touches to train on), all trained at once; deterministic by
    ``seed``.

    told: receives the losses during training. A linear cell is solved, not trained, and has none.
    """
    for rows in parts:
        if not len(rows):
            raise InputError(
                f"configuration '{config.name}', fields onset_threshold and window: a training part has no touch with a whole "
                "window; use smaller ones, or leave `config` out, so that they are derived"
            )
    generator = torch.Generator().manual_seed(seed)
    if not config.recurrent:
        return _fit_solved(data, config, recipe, parts, generator, progress)
    models, updates = list[FloatModel](), recipe.updates
    shares = [parts[first : first + TOGETHER] for first in range(0, len(parts), TOGETHER)]
    for number, share in enumerate(shares):
        network = RecurrentClassifier(config, batch=(len(share),), generator=generator)
        batches = Batches(data, config, recipe, share, generator)

        def loss_of(network=network, batches=batches) -> torch.Tensor:
            features, labels, counts = batches.draw()
            return class_loss(recipe, network(features), labels, counts)

        def after(done: int, loss: torch.Tensor, network=network, number=number) -> None:
            if recipe.weight_limit:
                with torch.no_grad():
                    for weight in network.parameters():
                        weight.clamp_(-recipe.weight_limit, recipe.weight_limit)
            if told:
                told.note(done, updates, loss)
            progress(number * updates + done, len(shares) * updates)

        rate, cycle = recipe.learning_rate, recipe.one_cycle
        descend(network.parameters(), loss_of, rate, updates, one_cycle=cycle, after=after)
        arrays = network.arrays() | {
            name: np.array([pair[i] for pair in batches.scales]) for i, name in enumerate(("mu", "sigma"))
        }
        models += [
            FloatModel(config, {name: array[m] for name, array in arrays.items()}) for m in range(len(share))
        ]
    return models


def _fit_solved(
    data: Dataset,
    config: AcceleratorConfig,
    recipe: Recipe,
    parts: list[np.ndarray],
    generator: torch.Generator,
    progress: Progress,
) -> list[FloatModel]:
    """A linear cell or trees for each part: on touches that the recipe draws from the part, or on the part
    itself if the recipe augments nothing."""
    models: list[FloatModel] = []
    fitted: dict[bytes, FloatModel] = {}  # without augmentation every seed gives the same network
    for number, rows in enumerate(parts):
        model = fitted.get(rows.tobytes()) if not recipe.augments else None
        if model is None:
            batches = Batches(data, config, recipe, [rows], generator)
            draws = recipe.updates if recipe.augments else 0
            drawn = [batches.draw() for _ in range(draws)] or [batches.recorded()]
            features, labels, counts = (
                torch.cat(pieces, dim=1)[0].numpy() for pieces in zip(*drawn, strict=True)
            )
            # C weighs the sum of losses over touches. Touches that are drawn several times are no more data,
            # so it is scaled back.
            penalty = recipe.penalty * len(rows) / len(labels)
            again, ends = cut_short(counts.sum(axis=1), config.windows.steps)
            counts = np.r_[counts, np.arange(config.windows.steps) < ends[:, None]]
            features, labels = np.r_[features, features[again]], np.r_[labels, labels[again]]
            mu, sigma = batches.scales[0]
            sized = config
            if config.is_forest:
                sized, arrays = fit_forest(config, features, counts, labels, generator.initial_seed())
            else:
                features = features * counts[..., None]  # a step that was not recorded adds nothing
                if recipe.sturdy:
                    arrays = fit_sturdy(config, features, counts, labels, (mu, sigma), recipe.sturdy)
                elif recipe.averaged:
                    arrays = fit_average(config, features, labels, len(again), penalty, recipe.ridge)
                elif recipe.squares:
                    arrays = fit_least_squares(config, features, labels, len(again), recipe.ridge)
                else:
                    arrays = fit_linear(config, features, labels, penalty)
            model = FloatModel(sized, arrays | {"mu": np.array(mu), "sigma": np.array(sigma)})
            fitted[rows.tobytes()] = model
        models.append(model)
        progress(number + 1, len(parts))
    return models


def post_training(model: FloatModel, data: Dataset, rows: np.ndarray, widths: Record) -> IntegerModel:
    return quantise_model(model, profile(model, data.touches.take(rows)), **widths)


@one_thread()
def train_integers(
    models: Sequence[FloatModel],
    starts: Sequence[IntegerModel],
    batches_of: Callable[[AcceleratorConfig, list[int]], Batches],
    loss_of: Callable[[IntegerNetwork], Loss],
    updates: int,
    rate: float,
    progress: Progress,
) -> list[tuple[IntegerModel, Arrays]]:
    """Continue the training of each network in its own integer arithmetic, starting from the float network: (the
    integers, their real weights).

    Networks of the same formats train at once; ``batches_of`` gets their configuration and numbers.
    """
    groups: dict[AcceleratorConfig, list[int]] = {}
    for m, start in enumerate(starts):
        if start.config.is_forest:
            raise InputError(
                f"configuration '{start.config.name}', field cell: is 'trees', which have no weights to train further; train "
                "them again with all recordings"
            )
        groups.setdefault(start.config, []).append(m)
    trained: dict[int, tuple[IntegerModel, Arrays]] = {}
    for number, (config, members) in enumerate(groups.items()):
        network = IntegerNetwork([models[m] for m in members], [starts[m] for m in members])
        batches, loss = batches_of(config, members), loss_of(network)

        def after(done: int, _: torch.Tensor, network=network, number=number) -> None:
            network.hold()
            progress(number * updates + done, len(groups) * updates)

        draw = lambda loss=loss, batches=batches: loss(*batches.draw())
        descend(network.parameters(), draw, rate, updates, after=after)
        weights = {name: weight.detach().numpy() for name, weight in network.weights.items()}
        for place, (m, integer) in enumerate(zip(members, network.export(), strict=True)):
            trained[m] = integer, {name: array[place] for name, array in weights.items()}
    return [trained[m] for m in range(len(starts))]


def fine_tune(
    data: Dataset,
    recipe: Recipe,
    parts: list[np.ndarray],
    models: list[FloatModel],
    seed: int,
    widths: Record,
    progress: Progress,
) -> list[IntegerModel]:
    """Quantisation-aware training: trains an integer network from each float network, in integer arithmetic.
    Feature bits that no format could use are refused.

    Formats are chosen once, from the ranges of the network on its part.
    """
    starts = [post_training(model, data, rows, widths) for model, rows in zip(models, parts, strict=True)]
    for start in starts:
        check_given(start.config, widths.get("feature_bits"))

    def batches_of(config: AcceleratorConfig, members: list[int]) -> Batches:
        generator = torch.Generator().manual_seed(seed)
        return Batches(data, config, recipe, [parts[m] for m in members], generator)

    def loss_of(network: IntegerNetwork) -> Loss:
        def loss(features: torch.Tensor, labels: torch.Tensor, counts: torch.Tensor) -> torch.Tensor:
            logits = network(network.feature_codes(features))
            of_teacher = teacher_loss(logits, network.teach(features), counts)
            of_labels = class_loss(recipe, logits, labels, counts)
            return (1 - FINE_TUNING_TEACHER) * of_labels + FINE_TUNING_TEACHER * of_teacher

        return loss

    tuned = train_integers(
        models, starts, batches_of, loss_of, FINE_TUNING_UPDATES, FINE_TUNING_RATE, progress
    )
    return [integer for integer, _ in tuned]
