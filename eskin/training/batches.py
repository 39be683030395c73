"""Training batches: touches drawn from the training part of each network, augmented as the recipe
requires."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import torch

from eskin.golden.core import EXTREMES, AcceleratorConfig
from eskin.golden.model import real_by_input
from eskin.training.datasets import Dataset, scaling
from eskin.training.linear_fit import COMMON, DRIFT, LEVELS, OFFSET, level_kind
from eskin.training.recipe import Recipe

FAULTY_WINDOWS = 3
"""Windows that a stuck taxel spoils before the fault detector masks it: two blocks reach into three windows
at most."""

UNCLIPPED_LIMIT = 10.0
"""Reading of a stuck taxel in training if deviations are not clipped, in standard deviations of the
features."""


class Batches:
    """Augmented training batches, one for every part; scales: (mu, sigma) of each part, codes. ``scales`` and
    ``draw`` replace the scales of the parts and the draws of so many rows from them.
    """

    def __init__(
        self,
        data: Dataset,
        config: AcceleratorConfig,
        recipe: Recipe,
        parts: list[np.ndarray],
        generator: torch.Generator,
        *,
        scales: list[tuple[float, float]] | None = None,
        draw: Callable[[int], torch.Tensor] | None = None,
    ) -> None:
        self._config, self._recipe, self._generator = config, recipe, generator
        touches_of = [data.touches.take(rows) for rows in parts]
        self.scales = scales or [
            scaling(config, data.means[rows, : config.windows.steps], members.completed, members.faults)
            for rows, members in zip(parts, touches_of, strict=True)
        ]
        self._mu, self._sigma = (
            torch.tensor(
                np.array([real_by_input(config, np.asarray(pair[i])) for pair in self.scales]),
                dtype=torch.float32,
            )
            .view(len(parts), 1, 1, -1)
            .expand(-1, 1, 1, config.inputs)
            for i in (0, 1)
        )
        self._means = torch.tensor(data.means, dtype=torch.float32)
        self._means[..., list(config.input_mask)] = 0.0
        self._faults = None if data.faults is None else torch.tensor(data.faults)
        self._live = (~torch.tensor(config.input_mask)).float()
        kind_of = [config.features.feature_kinds[kind] for kind in config.input_kinds]
        self._level, self._integral = (
            torch.tensor([kind in names for kind in kind_of]) for names in (LEVELS, ("integral",))
        )
        self._labels = torch.tensor(data.labels[data.touches.recording])
        self._ends = torch.tensor(data.ends)
        self._parts, self._draw = parts, draw or (lambda batch: drawn_rows(parts, batch, generator))

    def draw(self) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Real features (parts, batch, steps, inputs), labels (parts, batch), and which steps the recording
        holds (parts, batch, steps)."""
        return self._augmented(self._draw(self._recipe.batch))

    def recorded(self) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """The same as `draw`, for every touch of the parts once; all parts must have one size."""
        return self._augmented(torch.tensor(np.stack(self._parts)))

    def _augmented(self, rows: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        recipe, generator = self._recipe, self._generator
        speed = _log_uniform(recipe.warp, rows.shape, generator)
        amplitude = _log_uniform(recipe.gain, rows.shape, generator)
        amplitude = amplitude * speed**recipe.speed_gain
        # a touch at another speed: window k of it lies at k * speed of the recorded one, between two windows;
        # windows that follow the touch stay where they are
        moved = torch.ones_like(speed) if self._config.follows_touch else speed
        position = torch.arange(self._config.windows.steps) * moved[..., None]
        last = (self._ends[rows] - 1)[..., None]
        counts = position <= last
        position = torch.minimum(position, last.float())
        lower = position.floor().long()
        upper = torch.minimum(lower + 1, last)
        part = (position - lower)[..., None]
        means = self._means[rows[..., None], lower]
        if recipe.warp != 1.0:
            means = torch.lerp(means, self._means[rows[..., None], upper], part)
        gain, offset = amplitude[..., None, None], torch.zeros(())
        of_taxel = torch.Size((*rows.shape, 1, self._config.sensor.taxels))  # one value for the whole touch
        kinds = self._config.kinds
        if self._integral.any():  # a faster touch of the same amplitude adds up to less
            gain = torch.where(self._integral, gain / speed[..., None, None], gain)
        if recipe.offset:
            offset = recipe.offset * self._offset(of_taxel).repeat_interleave(kinds, -1)
        features = (self._moved(means, gain, offset) - self._mu) / self._sigma
        if recipe.noise:
            features = features + recipe.noise * torch.randn(features.shape, generator=generator)
        if recipe.channel_dropout:
            lost = torch.rand(of_taxel, generator=generator) < recipe.channel_dropout
            reading = self._lost(of_taxel)
            features = torch.where(lost.repeat_interleave(kinds, -1), reading, features)
        if recipe.taxel_failure:
            features = self._failing(features, of_taxel)
        # last, as in hardware: the features of a masked taxel are 0, whatever it reads
        if self._faults is not None:
            masked = self._faults[rows[..., None], lower] | (
                self._faults[rows[..., None], upper] & (part > 0)
            )
            features = features.masked_fill(masked, 0.0)
        return features * self._live, self._labels[rows], counts

    def _moved(self, means: torch.Tensor, gain: torch.Tensor, offset: torch.Tensor) -> torch.Tensor:
        """Real features of touches whose deviations are ``gain`` times as large and ``offset`` codes higher: of
        an integral the logarithm of the sum of these."""
        moved = means * gain + offset * self._level
        if not self._integral.any():
            return moved
        frames = torch.tensor([last for _, last in self._config.window_spans])[:, None]
        # clamp: 2**60 is far beyond any integral, and 2**128 would be infinite in float32
        sums = gain * torch.sign(means) * (torch.exp2(means.abs().clamp(max=60.0)) - 1)
        sums = sums + offset * frames / 2.0**self._config.features.integral_knee
        return torch.where(self._integral, torch.sign(sums) * torch.log2(1 + sums.abs()), moved)

    def _offset(self, of_taxel: torch.Size) -> torch.Tensor:
        """Codes (parts, batch, steps, taxels) by which one taxel, and all together, are off; codes of all drift."""
        generator, (*touch, _, taxels) = self._generator, of_taxel
        one, all_together, drift = torch.randn((3, *touch, 1, 1), generator=generator)
        steps = self._config.windows.steps
        time = (torch.arange(steps) + 0.5)[:, None] / steps
        off = torch.arange(taxels) == torch.randint(taxels, (*touch, 1, 1), generator=generator)
        unit = self._sigma[..., level_kind(self._config) :: self._config.kinds].amax(-1, keepdim=True)
        return unit * (OFFSET * one * off + COMMON * all_together + DRIFT * drift * time)

    def _lost(self, of_taxel: torch.Size) -> torch.Tensor:
        """Features of lost taxels: of each as often the features of a masked one as of one at rest."""
        if self._config.rest_level.rest == "none":  # a level that is not subtracted remains
            return torch.zeros(())
        masked = torch.rand(of_taxel, generator=self._generator) < 0.5
        masked = masked.repeat_interleave(self._config.kinds, -1)
        return torch.where(masked, 0.0, -self._mu / self._sigma)

    def _stuck(self, level: torch.Tensor, since: torch.Tensor) -> torch.Tensor:
        """Real features (touches, steps, inputs) of taxels that have stood at ``level`` for ``since`` hops and a part of
        one."""
        features, values = self._config.features, []
        for kind in features.feature_kinds:
            if kind == "mean":
                values.append(level)
            elif kind in EXTREMES:  # a taxel has been at rest before
                values.append(level.clamp(**{"min" if kind == "highest" else "max": 0.0}))
            elif kind == "activity":  # a stuck taxel does not change
                values.append(level.abs() * features.activity_block * (features.activity_rule == "sum"))
            else:
                grown = level * self._config.windows.hop * (since + 1).clamp(min=0)
                values.append(torch.sign(grown) * torch.log2(1 + grown.abs() / 2.0**features.integral_knee))
        return torch.stack(values, -1).flatten(-2)

    def _failing(self, features: torch.Tensor, of_taxel: torch.Size) -> torch.Tensor:
        """Some taxels at a limit from a random step on, masked FAULTY_WINDOWS later; the first window may
        hold only part of it."""
        generator, steps, kinds = self._generator, self._config.windows.steps, self._config.kinds
        fails = torch.rand(of_taxel, generator=generator) < self._recipe.taxel_failure
        first = torch.randint(1 - FAULTY_WINDOWS, steps, of_taxel, generator=generator)
        side = torch.randint(0, 2, of_taxel, generator=generator) * 2.0 - 1.0
        begun = torch.rand(of_taxel, generator=generator)
        # touches in which no taxel fails are left as they are
        some = fails.flatten(2).any(-1)
        scale = self._mu, self._sigma, self._limit()
        mu, sigma, limit = (of.expand(-1, fails.shape[1], 1, -1)[some] for of in scale)
        since = torch.arange(steps)[:, None] - first[some]
        share = torch.where(since == 0, begun[some], 1.0)
        stuck = (self._stuck(share * side[some] * limit, since) - mu) / sigma
        for begin, value in ((0, stuck), (FAULTY_WINDOWS, 0.0)):
            failed = (fails[some] & (since >= begin)).repeat_interleave(kinds, -1)
            features[some] = torch.where(failed, value, features[some])
        return features

    def _limit(self) -> torch.Tensor:
        """Codes from rest at which a stuck taxel reads (parts, 1, 1, taxels): the clip, or far beyond the spread of
        the first kind of feature."""
        config, first = self._config, self._sigma[..., :: self._config.kinds]
        if config.rest_level.clip:
            return torch.full_like(first, float(config.rest_level.clip))
        kind = config.features.feature_kinds[0]
        if kind == "integral":
            first = torch.full_like(first, 2.0**config.features.integral_knee / config.last_frame)
        elif kind == "activity":
            first = first / config.features.activity_block
        return UNCLIPPED_LIMIT * first


def _log_uniform(limit: float, shape: torch.Size, generator: torch.Generator) -> torch.Tensor:
    """Factors between 1/limit and limit, log-uniform: as likely below 1 as above."""
    return limit ** (torch.rand(shape, generator=generator) * 2 - 1)


def drawn_rows(parts: Sequence[np.ndarray], batch: int, generator: torch.Generator) -> torch.Tensor:
    """(parts, batch) training rows of every part, at random."""
    places = [torch.randint(len(part), (batch,), generator=generator) for part in parts]
    return torch.stack([torch.tensor(part)[rows] for part, rows in zip(parts, places, strict=True)])
