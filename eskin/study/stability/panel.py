"""A short list of the suite's modes on recordings that a network has not seen: what `train` and `run` choose by,
beside the accuracy on sound ones.

The features of disturbed recordings do not depend on the network. So each front end plays the
panel once, and every network on it decides what it holds.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from eskin.choose.candidate import mean_told
from eskin.choose.first_touches import GATE_BATCH
from eskin.golden.core import AcceleratorConfig, InputError
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel, Touches, decide_touches
from eskin.study.stability.core import Experiment, Mode, Played, Scene, rebuilt, why_not
from eskin.study.stability.table import MODES
from eskin.study.touch_ends import touches_and_ends
from eskin.training.datasets import front_end_key
from eskin.training.judge import Decisions, FittedNetwork, Fold
from eskin.training.record import Disturbed, ModeFigure

PANEL = (
    "one-sample glitch before the touch",
    "motor burst before the touch",
    "slow ramp through the band",
    "mains hum",
    "drift of all taxels",
    "touch near the end of the stream",
    "a touch while one is decided",
    "wrong sample rate",
    "one dead taxel, worst",
    "one taxel stuck high from power-on",
    "one noisy taxel",
    "gains of all taxels within 20 %",
    "offset of one taxel by one deviation up",
    "offset of all taxels at the onset",
    "spikes",
)
"""Modes that are judged, at the suite's own levels."""

EXPERIMENTS = {name: (mode, mode.run) for name, mode in MODES.items() if isinstance(mode.run, Experiment)}
"""Modes that play recordings, and how."""
OSCILLATOR = "a rate off by 10 %"
"""Of a part's own oscillator that scans (`eskin.rtl.top.standby`); figures of `Panel.unseen` alone judge it."""
_RATE, _OFF = EXPERIMENTS["wrong sample rate"]
EXPERIMENTS[OSCILLATOR] = replace(_RATE, name=OSCILLATOR), replace(_OFF, nominal=0.1)

RECORDINGS, MOST = 60, 400
"""Recordings that are disturbed at most, spread evenly over the classes, and under the last candidates of a choice."""

LOUDER = ("mains hum", "one noisy taxel")
"""Modes that can open a gate and change decisions, too."""

TURNS = 8
"""Taxels that are disturbed in turn at most."""

BRIEF, BRIEF_TURNS = 16, 4
"""The same inside folds, and to look at gates."""

SEED, OTHER_SEED = 3, 2
"""Seeds of the disturbances of a choice, and of those that no choice meets. The suite has another one."""


def panel_of(recordings: Recordings, asked: str) -> Panel | None:
    """The panel that was asked for: ``on``, ``off``, or a JSON file of modes and their weights. None: off, or
    for images, which have none.

    Raises
    ------
    InputError
        A file that is not such a table, or as `Panel`.
    """
    if asked == "off" or recordings.image_shape:
        return None
    weights: Any = None
    if asked != "on":
        try:
            weights = json.loads(Path(asked).read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise InputError(
                f"`stress` {asked}: is neither on nor off, nor a JSON file ({error}); give one of these"
            ) from None
        if not isinstance(weights, dict) or any(type(each) not in (int, float) for each in weights.values()):
            raise InputError(
                f'`stress` {asked}: holds no table of failure modes and weights; write one as {{"spikes": 1}}'
            )
    return Panel(recordings, weights)


@dataclass(frozen=True, eq=False)
class _OnFrontEnd:
    """The panel under one front end.

    modes: of each case. wrong (cases, recordings): 1 where no touch is found or the gate opens when it must not,
    0 else, NaN where a case has no such recording. found: first touches, with the numbers of the recordings that
    were disturbed, and the case of each.
    """

    modes: list[str]
    wrong: list[np.ndarray]
    found: list[tuple[Touches, np.ndarray]]


class Panel:
    """The panel on one set of recordings.

    everything: the recordings. rows: those that are disturbed. weights: of the modes in a mean. seed: of the
    disturbances.

    Raises
    ------
    InputError
        A weight of an unknown mode, or of one that is not an experiment; a weight below 0; none above 0.
    """

    def __init__(
        self,
        recordings: Recordings,
        weights: Mapping[str, float] | None = None,
        count: int = RECORDINGS,
        turns: int = TURNS,
        seed: int = SEED,
    ) -> None:
        weights = dict.fromkeys(PANEL, 1.0) if weights is None else weights
        for name, weight in weights.items():
            if name not in EXPERIMENTS:
                known = ", ".join(EXPERIMENTS)
                raise InputError(f"`stress`, mode '{name}': is unknown here; the modes are {known}")
            if weight < 0:
                raise InputError(f"`stress`, mode '{name}': has the weight {weight}; give 0 or more")
        self.weights = {name: weight for name, weight in weights.items() if weight > 0}
        if not self.weights:
            raise InputError("`stress`: gives no mode a weight above 0; give one, or `stress` off")
        self.everything, self._turns, self._seed = recordings, turns, seed
        self.rows = recordings.evenly(count)
        self._recordings = recordings.subset(self.rows)
        self._known: dict[str, _OnFrontEnd] = {}
        self._gates: dict[Any, float] = {}

    def _modes(self, config: AcceleratorConfig) -> Iterator[tuple[Mode, Experiment]]:
        """The modes that apply to a front end."""
        modes = (EXPERIMENTS[name] for name in self.weights)
        return (pair for pair in modes if not why_not(pair[0], config))

    def _scene(self, config: AcceleratorConfig) -> Scene:
        return Scene(config=config, recordings=self._recordings, turns=self._turns, seed=self._seed)

    def _on(self, config: AcceleratorConfig) -> _OnFrontEnd:
        key = front_end_key(config)
        if key not in self._known:
            self._known[key] = self._played(config)
        return self._known[key]

    def _played(self, config: AcceleratorConfig) -> _OnFrontEnd:
        scene = self._scene(config)
        on = _OnFrontEnd([], [], [])
        waiting: list[tuple[int, Played]] = []

        def find() -> None:
            if waiting:
                on.found.append(_first_touches(waiting))
                waiting.clear()

        for mode, experiment in self._modes(config):
            for played in experiment.cases(scene).values():
                played = replace(played, rows=self.rows[played.rows])
                wrong = np.full(len(self.everything), np.nan)
                wrong[played.rows] = experiment.opened(scene, played) if experiment.gate_only else 1.0
                if not experiment.gate_only:
                    size = sum(one.recordings.samples.size for _, one in waiting)
                    if size > GATE_BATCH or (waiting and waiting[0][1].config != played.config):
                        find()
                    waiting.append((len(on.modes), played))
                on.modes.append(mode.name)
                on.wrong.append(wrong)
        find()
        return on

    def false_onsets(self, config: AcceleratorConfig, loosest: AcceleratorConfig | None = None) -> float:
        """Sum over modes of the shares of recordings in which the gate opens when it must not: rows of gates
        alone, and those that make taxels louder all along. All recordings of the panel are looked at if the gate stays
        shut on the recordings of ``brief``. The windows hardly matter, so gates are looked at once.

        Parameters
        ----------
        loosest:
            The gate that finds touches first; frames before its onsets are quiet for all gates compared. None:
            ``config``.
        """
        loosest = loosest or config
        gates = config, loosest
        key = tuple((on.rest_level, on.onset_rule, on.sensor.scan_every) for on in gates)
        if key not in self._gates:
            opened = self.brief._opened(config, loosest, self._turns)
            if not opened and len(self.rows) > len(self.brief.rows):
                opened = self._opened(config, loosest, self._turns)
            self._gates[key] = opened
        return self._gates[key]

    def _opened(self, config: AcceleratorConfig, loosest: AcceleratorConfig, turns: int) -> float:
        """The sum of ``false_onsets`` on the recordings of this panel."""
        # every taxel in turn: any single taxel may open the gate
        scene, total = replace(self._scene(loosest), turns=turns), 0.0
        for mode, experiment in self._modes(config):
            if experiment.gate_only or mode.name in LOUDER:
                cases = [replace(played, config=config) for played in experiment.cases(scene).values()]
                total += max(float(np.mean(experiment.opened(scene, played))) for played in cases)
        return total

    @cached_property
    def brief(self) -> Panel:
        """The same on fewer recordings, half of all at most."""
        return Panel(self.everything, self.weights, min(BRIEF, -(-len(self.everything) // 2)), BRIEF_TURNS)

    @cached_property
    def whole(self) -> Panel:
        """The same on all recordings, MOST at most."""
        if len(self.rows) == len(self.everything):
            return self
        return Panel(self.everything, self.weights, MOST, self._turns, self._seed)

    def unseen(self, decisions: Decisions) -> Disturbed:
        """Figures of networks that `brief` chose, on test recordings that it does not have, under disturbances
        drawn anew.

        Parameters
        ----------
        decisions:
            Of these networks without a disturbance.
        """
        parts, wrong = list[tuple[np.ndarray, np.ndarray]](), dict[str, list[np.ndarray]]()
        off_right, off_wrong = list[np.ndarray](), list[np.ndarray]()
        folds = dict[int, list[tuple[Fold, FittedNetwork]]]()
        for fitted in decisions.fitted:
            folds.setdefault(fitted[0].number, []).append(fitted)
        correct = decisions.correct.reindex(range(len(self.everything)), fill_value=0.0).to_numpy()
        for networks in folds.values():
            config = networks[0][1].real.config
            if not len(rows := np.setdiff1d(networks[0][0].test, self.brief.rows)):
                continue
            count, fold = -(-RECORDINGS // len(folds)), self.everything.subset(rows)
            panel = Panel(fold, self.weights, count, self._turns, OTHER_SEED)
            right = correct[rows[panel.rows]]
            if not right.any():  # perhaps no touch is found, and then none can be disturbed
                parts.append((right, right))
                continue
            share = np.mean([panel.wrong(config, one.integer, panel.rows) for _, one in networks], axis=0)
            parts.append((right, panel.stressed(config, share)))
            for name, cases in panel.cases(config, share).items():
                wrong.setdefault(name, []).append(cases)
            off = Panel(fold, {OSCILLATOR: 1.0}, len(rows), self._turns, OTHER_SEED)  # a board depends on it
            off_share = np.mean([off.wrong(config, each.integer, off.rows) for _, each in networks], axis=0)
            for cases in off.cases(config, off_share).values():
                off_right.append(correct[rows[off.rows]])
                off_wrong.append(cases)
        clean, stressed = map(np.concatenate, zip(*parts, strict=True))
        accuracy = float(clean.mean())
        # front ends may mask other taxels, so a fold may have fewer cases than another
        pooled = {
            name: np.array([*map(np.concatenate, zip(*of_folds, strict=False))])
            for name, of_folds in wrong.items()
        }
        figures = self.figures(pooled, accuracy)
        if off_wrong:
            cases, unturned = np.concatenate(off_wrong, axis=1), float(np.concatenate(off_right).mean())
            (figures.oscillator,) = self.figures({OSCILLATOR: cases}, unturned).stress
        figures.stressed_accuracy, figures.undisturbed_accuracy = mean_told(stressed), accuracy
        figures.stress_held = sum(row.held for row in figures.stress)
        figures.stress_modes = len(figures.stress)
        return figures

    def wrong(self, config: AcceleratorConfig, model: IntegerModel, test: np.ndarray) -> np.ndarray:
        """(cases, tests) 1 where the network is wrong on a disturbed recording, NaN where it is not disturbed.

        Parameters
        ----------
        config:
            As the network's front end was before it was quantised.
        test:
            Recordings that it has not seen.
        """
        on = self._on(config)
        wrong = np.array(on.wrong).reshape(-1, len(self.everything))
        for touches, case in on.found:
            asked = np.isin(touches.recording, test)
            some = touches.take(asked)
            some = replace(some, sums=some.sums.astype(np.int64))
            right = decide_touches(model, some).decision == self.everything.labels[some.recording]
            wrong[case[asked], some.recording] = ~right
        return wrong[:, test]

    def cases(self, config: AcceleratorConfig, wrong: np.ndarray) -> dict[str, np.ndarray]:
        """The rows of ``wrong`` of each mode that applies."""
        modes = np.array(self._on(config).modes)
        return {name: wrong[modes == name] for name in self.weights if name in modes}

    def stressed(self, config: AcceleratorConfig, wrong: np.ndarray, gates: bool = False) -> np.ndarray:
        """(recordings) the share of disturbances under which each was decided rightly, NaN where it was not
        disturbed. gates: a gate that stays shut, where no decision is looked at, counts as well. wrong (cases,
        recordings): as of ``wrong``, or a mean over networks."""
        right, total = np.zeros(wrong.shape[1]), np.zeros(wrong.shape[1])
        for name, cases in self.cases(config, wrong).items():
            if gates or not EXPERIMENTS[name][1].gate_only:
                told = ~np.isnan(cases).all(axis=0)
                right[told] += self.weights[name] * (1 - np.nanmean(cases[:, told], axis=0))
                total += self.weights[name] * told
        return np.where(total > 0, right / np.maximum(total, 1e-12), np.nan)

    def figures(self, wrong: Mapping[str, np.ndarray], accuracy: float) -> Disturbed:
        """The figure of each mode. wrong: as of ``cases``. accuracy: on undisturbed recordings."""
        decisions, gates = list[ModeFigure](), list[ModeFigure]()
        for name, cases in wrong.items():
            mode, experiment = EXPERIMENTS[name]
            cases = cases[~np.isnan(cases).all(axis=1)]
            if not len(cases):  # a fold may have none of the recordings
                continue
            figure = experiment.figure(np.nanmean(cases, axis=1))
            bound = mode.bound(SimpleNamespace(clean_accuracy=accuracy))
            row = ModeFigure(mode=name, figure=figure, bound=bound, held=mode.holds(figure, bound))
            (gates if experiment.gate_only else decisions).append(row)
        return Disturbed(stress=decisions, gate_modes=gates)


def _first_touches(cases: Sequence[tuple[int, Played]]) -> tuple[Touches, np.ndarray]:
    """The first touches of cases under one configuration, and the case of each. A taxel that is masked is masked as
    the fault detector does, so that one model decides all cases."""
    config, parts = cases[0][1].config, [played.recordings for _, played in cases]
    streams = [part.recording(number) for part in parts for number in range(len(part))]
    together = rebuilt(parts[0], streams, np.zeros(len(streams), dtype=np.int64))  # labels are not looked at
    touches, _ = touches_and_ends(config, together, most=GATE_BATCH)
    faults = np.zeros(touches.sums.shape, dtype=bool) if touches.faults is None else touches.faults
    case = np.concatenate([np.full(len(played.rows), number) for number, played in cases])
    row = np.concatenate([played.rows for _, played in cases])
    of = touches.recording
    touches = replace(
        touches,
        recording=row[of],
        sums=touches.sums.astype(np.int32),
        faults=faults | np.array(config.input_mask),
    )
    return touches, case[of]
