"""Sturdier front ends, on which networks are tried if they are judged under disturbance.

An onset rule that checks several times, a tracked rest level, a clip near the largest deviations, and a fault detector
cost logic cells and no energy. More scans and more windows cost energy of a touch; they are tried only as far as the rule
allows. No label is used.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from eskin.choose.candidate import CLEAN_LOSS
from eskin.choose.front_ends import LENGTHS, WHOLE, Screen, valid, whole, with_hop
from eskin.golden.core import AcceleratorConfig
from eskin.golden.data.codes import UNEVEN
from eskin.golden.model import find_touches
from eskin.training.derive import settling_frames

if TYPE_CHECKING:
    from eskin.study.stability.panel import Panel

GATES = (
    (1, 1, 1.0),
    (2, 2, 1.0),
    (3, 4, 1.0),
    (6, 6, 1.0),
    (3, 4, 1.1),
    (3, 4, 1.25),
    (3, 4, 1.5),
    (5, 6, 1.5),
    (5, 6, 2.0),
    (5, 6, 3.0),
)
"""Hits and span of a sturdier onset rule, and the ratio of its threshold to the one before. A wrong sample
stays in the rule's mean for four judged frames."""

SELDOM = 0.1
"""Disturbances open a gate seldom if the shares of recordings, one per disturbance, sum to at most this."""

CLIPPED, CLIPS, TIGHT = 0.01, (1.5, 0.75), (0.75, 0.5, 0.25)
"""A tighter clip is a factor times the level that this share of a touch's samples exceeds: with the level of several
frames, and of one."""

STEADY, _ = WHOLE[0]
"""Number of windows that divide the touch: a few windows depend too much on each taxel."""
SPREAD = (10, 20, 31)
"""Numbers of windows over more of a touch."""

BLOCKS, STILL, MARGIN = (16, 32, 64, 128, 256), 16, 4
"""Blocks of a fault detector, frames. A failed taxel changes by a code in so many frames at most; every sound one must
change MARGIN times as much."""


@dataclass(frozen=True, eq=False)
class Hardening:
    """Sturdier front ends for networks that are judged under disturbance.

    stress: the disturbances. screen: the touches of front ends; None: the front end was asked for and stays.
    """

    stress: Panel
    screen: Screen | None = None
    _known: dict[AcceleratorConfig, list[AcceleratorConfig]] = field(default_factory=dict, repr=False)
    _blocks: dict[int, int] = field(default_factory=dict, repr=False)

    def sturdier(self, config: AcceleratorConfig) -> list[AcceleratorConfig]:
        """Result of ``_sturdier``, cached because folds ask again."""
        if config not in self._known:
            self._known[config] = self._sturdier(config)
        return self._known[config]

    def _sturdier(self, config: AcceleratorConfig) -> list[AcceleratorConfig]:
        """``config`` with a tracked rest level, a clip near the largest deviations, and the gates of GATES that disturbances
        before the touch SELDOM open, each less than the last, up to the first that they never do (else up to the gate that
        they open least). Compared with ``config``, a gate may miss the touch in a share CLEAN_LOSS more of the recordings
        at most. If ``config`` opens at once, only each of CLIPS is tried, and each of TIGHT with the level of one frame: a
        spike in any frame of the level moves the whole touch."""
        if self.screen is None or config.onset_rule.onset == "band":
            return []
        level = config if config.opens_at_once else valid(config, rest="tracked")
        if level is None or not len(touches := self.screen.touches(level)):
            return []
        # with rest none the samples still contain their level, so fewer of them may be clipped
        share = CLIPPED / 10 if config.rest_level.rest == "none" else CLIPPED
        deviations, before = np.abs(np.concatenate(touches.touched)), config.rest_level.clip
        most, spans = np.quantile(deviations, 1 - share), np.quantile(deviations, 1 - share, axis=0)

        def at(factor: float) -> int:
            # of columns of different kinds one clip would only affect those with the largest codes
            uneven = spans.max() > UNEVEN**2 * max(spans.min(), 1)
            return before if uneven else min(max(int(np.ceil(factor * most)), 1), before or 65535)

        if config.opens_at_once:
            frames = config.rest_level.rest_frames
            limits = [(frames, at(factor)) for factor in CLIPS]
            limits += [(1, at(factor)) for factor in TIGHT if config.rest_level.rest == "initial"]
            found = [valid(level, clip=clip, rest_frames=count) for count, clip in limits]
        else:
            fewest = len(self.screen.touches(config)) - CLEAN_LOSS * len(self.screen.recordings)
            found = list(self._gates(level, at(CLIPS[0]), fewest))
        return [one for one in dict.fromkeys(found) if one and one != config.replace(name=one.name)]

    def false_onsets(self, gate: AcceleratorConfig, threshold: int) -> float:
        """As `Panel.false_onsets`; frames before a single onset at ``threshold`` codes are quiet."""
        return self.stress.false_onsets(
            gate, valid(gate, onset_hits=1, onset_span=1, onset_threshold=threshold)
        )

    def _gates(self, level: AcceleratorConfig, clip: int, fewest: float) -> Iterator[AcceleratorConfig]:
        """``level`` with this clip and gates that disturbances open less and less, if they find enough touches."""
        assert self.screen is not None
        rule, best, least = level.onset_rule, None, np.inf
        for hits, span, over in GATES:
            threshold = max(1, round(over * rule.onset_threshold))
            gate = dict(onset_hits=hits, onset_span=span, onset_threshold=threshold)
            one = valid(level, clip=clip and max(clip, 2 * threshold), **gate)
            if one is None or len(self.screen.touches(one)) < fewest:
                continue  # its windows tell nothing
            if (opened := self.false_onsets(one, rule.onset_threshold)) < least:
                if best and least <= SELDOM:
                    yield best
                best, least = one, opened
            if not least:
                break
        if best:
            yield best

    def means(self, config: AcceleratorConfig) -> list[AcceleratorConfig]:
        """The two sturdiest of ``config`` and `sturdier`, with means alone, which a spike moves least; the sturdiest last."""
        if self.screen is None:
            return []
        sturdy = [config, *self.sturdier(config)][-2:]
        means = (valid(on, feature_kinds=("mean",), activity_block=1) for on in sturdy)
        return [on for on in means if on]

    def denser(self, config: AcceleratorConfig) -> list[AcceleratorConfig]:
        """``config`` with twice the scans and means alone, which use more samples before an onset and cost
        about as much; or an empty list."""
        every, kinds = config.sensor.scan_every, config.features.feature_kinds
        if self.screen is None or every == 1 or "mean" not in kinds or config.windows.window_mode == "touch":
            return []
        hop, frames = 2 * config.windows.hop, config.rest_level.rest_frames
        one = valid(
            config,
            scan_every=every // 2,
            rest_frames=2 * frames if frames > 1 else frames,
            **{name: min(2 * config.value(name), 65535) for name in LENGTHS},
            hop=hop,
            window=2 * hop,
            feature_kinds=("mean",),
        )
        return [one] if one else []

    def dividing(self, config: AcceleratorConfig) -> list[AcceleratorConfig]:
        """``config`` with means of windows that divide the whole touch, the level of the first frames subtracted, a
        tight clip, and as many scans, twice and four times as many."""
        if self.screen is None or config.windows.window_mode == "touch":
            return []
        denser = self.denser(config)
        denser = [config, *denser, *(on for twice in denser for on in self.denser(twice))]
        found = list[AcceleratorConfig]()
        for base in denser:
            if base.opens_at_once:
                settle = settling_frames(self.screen.recordings.sample_rate_hz / base.sensor.scan_every)
                level = dict(rest="initial", rest_frames=settle) if base.rest_level.rest == "none" else {}
                base = valid(base, clip=0, **level) or base  # a clip would hide the largest deviations
            for on in whole(base, self.screen.longest):
                if on.windows.steps == STEADY:
                    clipped = self.sturdier(on) if on.opens_at_once else []
                    of_one = [each for each in clipped if each.rest_level.rest_frames == 1]
                    found += of_one[:2] or clipped[-1:] or [on]
        return found

    def guarded(self, config: AcceleratorConfig) -> AcceleratorConfig | None:
        """``config`` with a fault detector of the shortest of BLOCKS that masks no taxel of the recordings, even if it asks for
        MARGIN times as much activity. None: there is none of at most half a touch, or ``config`` has a detector."""
        if self.screen is None or config.faults.fault_frames:
            return None
        every = config.sensor.scan_every
        if every not in self._blocks:
            self._blocks[every] = next((frames for frames in BLOCKS if not self._masks(config, frames)), 0)
        frames = self._blocks[every]
        if not 0 < 2 * frames <= config.last_frame:
            return None
        return valid(config, fault_frames=frames, fault_activity=frames // STILL)

    def _masks(self, config: AcceleratorConfig, frames: int) -> bool:
        """A detector with this block and MARGIN masks taxels of the recordings, or there is no such detector."""
        strict = valid(config, fault_frames=frames, fault_activity=MARGIN * frames // STILL)
        if strict is None:
            return True
        flagged = find_touches(strict, self.stress.everything, steps=0).flagged
        return flagged is None or bool(flagged.any())

    def spread(self, config: AcceleratorConfig) -> list[AcceleratorConfig]:
        """``config`` with each of SPREAD windows of its hop or shorter, which nearly all touches complete: with its
        kinds of feature, and with means alone."""
        if self.screen is None or config.windows.window_mode != "free":
            return []
        longest = self.screen.ends(self.screen.touches(config), config.sensor.scan_every)[0]
        own, kinds = config.windows.hop, config.features.feature_kinds
        found: list[AcceleratorConfig | None] = []
        for some in dict.fromkeys((kinds, ("mean",))):
            for steps in SPREAD:
                for hop in dict.fromkeys((min(own, longest // (steps + 1)), longest // (steps + 1))):
                    hop -= hop % (8 if hop >= 32 else 4 if hop >= 8 else 1)
                    found += [with_hop(config, hop, steps=steps, feature_kinds=some)] if hop else []
        return [one for one in dict.fromkeys(found) if one]
