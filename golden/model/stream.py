"""A model that takes frames one by one and decides at the same frame as the hardware does.

docs/specification.md, sections 2 to 7. Front end, windows, cell and decision rule come from
``eskin.golden.model.pipeline``; no more than a few touches of frames are kept, so that a stream may last for
ever.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from eskin.golden.core import AcceleratorConfig, Arrays, InputError, array_of
from eskin.golden.model.model import FloatModel, IntegerModel
from eskin.golden.model.pipeline import Decided, decide_touches, early_steps
from eskin.golden.model.preprocess import Ended, Touches, TouchFinder, divided, window_values
from eskin.golden.model.prototypes import check_teachable, class_index, forget, teach, trajectory_codes
from eskin.golden.model.vectors import ARMED, NO_TOUCH, TOUCH


@dataclass(frozen=True)
class Decision:
    """One decision, as it comes out of the classifier.

    Frames count those that are pushed.

    frame: the frame, 1-based since ``arm``, with which it can be given; if the end of the recording caused a
    global decision, the last frame. touch: number of the touch since ``arm``, from 0. step: from 0.
    is_global: it decides the touch, not the step alone. label: class index. margin: largest minus second
    largest logit (or votes), codes of the logit format, real in a float model. partial: the recording ended
    first. unsure: a global decision of a margin below ``margin_threshold``. onset_frame, start_frame: the
    frame in which the touch was found (0: the gate opens at once), and the first of its first window. stages
    (local decisions): ``sum`` (D), ``fault`` (D) with a fault detector, ``feature`` (D), ``state`` (H) and
    ``logit`` (C) of this step, codes or real.
    """

    frame: int
    touch: int
    step: int
    is_global: bool
    label: int
    margin: float
    partial: bool = False
    unsure: bool = False
    onset_frame: int = 0
    start_frame: int = 1
    stages: Arrays = field(default_factory=dict, repr=False, compare=False)

    def row(self) -> tuple[int, ...]:
        """The columns ``eskin.golden.model.pipeline.DECISION_FIELDS`` of an integer model's decision."""
        return (
            int(self.is_global),
            self.step,
            self.label,
            int(self.margin),
            int(self.partial),
            int(self.unsure),
        )


@dataclass
class _Touch:
    """The touch under way. sums (K, D), faults (K, D), lengths (K): of its complete windows. spans, doublings: as
    `window_values` takes them; ended: with ``window_mode`` whole, once it has."""

    number: int
    onset_frame: int
    start_frame: int
    sums: np.ndarray
    faults: np.ndarray
    spans: tuple[tuple[int, int], ...]
    lengths: np.ndarray | None = None
    doublings: int = 0
    ended: Ended | None = None
    completed: int = 0
    decided: bool = False
    """The global decision was given."""


class Stream:
    """Frames in, decisions out.

    Parameters
    ----------
    model:
        An integer model, which gives the hardware's value at every stage, or a float one.
    scanned:
        True: frames are those that the chain takes. False: they are all that the source makes, of which the
        chain takes every ``scan_every``-th.

    Examples
    --------
    >>> stream = Stream(model)                                  # doctest: +SKIP
    >>> for frame in frames:                                    # (taxels) each
    ...     for decision in stream.push(frame):
    ...         print(decision.frame, decision.label)
    >>> stream.finish()                                         # decides a touch that the end cuts short
    >>> stream.decision                                         # as `predict` decides this recording
    """

    def __init__(self, model: IntegerModel | FloatModel, *, scanned: bool = False) -> None:
        self.model = model
        self._last: np.ndarray | None = None
        """Codes (K, values) of the touch that ended last, if it was whole."""
        self._following: int | None = None
        """Class of the touch that ends next."""
        config = model.config
        self._every = 1 if scanned else config.sensor.scan_every
        self._spans = config.window_spans
        block = config.features.activity_block if "activity" in config.features.feature_kinds else 0
        self._before = max(config.windows.pretrigger_frames, 2 * config.windows.hop) + block
        """Frames before an onset that its touch may need: of the pre-trigger ring, or of hops, and the block
        of an activity before them."""
        self._piece = config.last_frame
        """Number of frames processed together. Onsets lie further apart, because rearming takes longer than
        the pre-trigger ring reaches back; a touch that ends by itself lasts as long as rearming."""
        if config.follows_touch:
            self._piece = min(self._piece, config.onset_rule.rearm_frames)
        self.arm()

    @property
    def config(self) -> AcceleratorConfig:
        """The model's configuration."""
        return self.model.config

    def arm(self) -> None:
        """Begin a new recording: the next frame is frame 1, and no touch is open."""
        config = self.config
        self._front = TouchFinder(config)
        self._frames = 0  # of the source
        # deviations of frames base + 1 ...
        frames = self._before + config.last_frame + 3 * self._piece
        self._kept = np.zeros((frames, config.sensor.taxels), dtype=np.int32)
        self._base = 0
        # the hardware has overwritten half of the touch before with the current one: neither can be taught
        if getattr(self, "_touch", None):
            self._last = None
        self._touch: _Touch | None = None
        self._touches = 0
        self.decision = -1
        """Class of the recording so far: the global decision of its first touch, -1 none."""

    @property
    def frame(self) -> int:
        """Frames taken since ``arm``."""
        return self._frames

    def _pushed(self, frame: int) -> int:
        """The frame that was pushed as the chain's ``frame``, both from 1; 0 is none."""
        return (frame - 1) * self._every + 1 if frame else 0

    @property
    def state(self) -> str:
        """The detector's: ``settling`` (the rest level is being measured), ``armed``, ``touch``, or ``rearm``
        until a touch may begin."""
        if self._front.frames < self.config.rest_level.rest_frames:
            return "settling"
        if self._front.armed[0]:
            return "armed"
        return "touch" if self._touch or self.frame == 0 else "rearm"

    @property
    def status(self) -> int:
        """Register STATUS after the frames so far, once all that they bring is decided."""
        return ARMED * bool(self._front.armed[0]) | TOUCH * bool(self._touch) | NO_TOUCH * (not self._touches)

    @property
    def flagged(self) -> np.ndarray:
        """(taxels), bool: fault flags."""
        return self._front.flagged[0] > 0

    @property
    def touches(self) -> int:
        """Touches begun since ``arm``."""
        return self._touches

    @property
    def onset_frame(self) -> int | None:
        """The frame in which the onset of the current touch was found (0: the gate opens at once); None
        between touches."""
        return self._pushed(self._touch.onset_frame) if self._touch else None

    @property
    def start_frame(self) -> int | None:
        """The first frame of the current touch (before its onset if earlier frames count); None between
        touches."""
        return self._pushed(self._touch.start_frame) if self._touch else None

    def push(self, frames: Any) -> list[Decision]:
        """Take one frame (taxels) or several (frames, taxels): codes, or real samples if the configuration
        has a value per code (``volt_per_code``). Returns their decisions in the order of the hardware.

        Raises
        ------
        InputError
            Other taxels than the model's, no whole numbers, or codes outside the sample format.
        """
        samples = self._checked(frames)
        first, self._frames = -self._frames % self._every, self._frames + len(samples)
        samples = samples[first :: self._every]
        pieces = (samples[first : first + self._piece] for first in range(0, len(samples), self._piece))
        return [decision for piece in pieces for decision in self._take(piece)]

    def finish(self) -> list[Decision]:
        """The end of the recording: the global decision of a touch that it cuts short after one step or
        more."""
        touch = self._touch
        if touch is None:
            return []
        if self.config.follows_touch:
            self._front.finish(np.array([self._front.frames]))
            return self._go_on()
        decided = self._decided(touch) if touch.completed else None
        self._end(touch, decided)
        if decided is None or touch.decided:
            return []
        return [self._global(touch, decided, self.frame, partial=True)]

    def teach(self, label: int | str, *, following: bool = False) -> None:
        """Teach the touch that ended last (``following``: the next one that ends) as class ``label``: from
        then on it is a prototype of the class, and `model` includes it.

        Raises
        ------
        InputError
            The model cannot be taught, a touch is under way, or no whole touch has ended since the model was
            made. A ``following`` touch that is cut short teaches nothing.
        """
        check_teachable(self._integer().config)
        label = class_index(self.config, label)
        if self._touch:
            raise InputError("teach: a touch is under way; wait until it ends")
        if following:
            self._following = label
        elif self._last is None:
            raise InputError(
                "teach: there is no whole touch yet; touch first, or give following=True before the touch"
            )
        else:
            self.model, self._following = teach(self._integer(), self._last, label), None

    def forget(self, label: int | str | None = None) -> None:
        """Remove the taught touches of class ``label``; None: of every class.

        Raises
        ------
        InputError
            As `teach`.
        """
        if self._touch:
            raise InputError("forget: a touch is under way; wait until it ends")
        self.model = forget(self._integer(), label)

    def _integer(self) -> IntegerModel:
        """The integer model, the only kind that can be taught."""
        if not isinstance(self.model, IntegerModel):
            raise InputError("teach: needs the integer model; leave integer=False out")
        return self.model

    def _end(self, touch: _Touch, decided: Decided | None) -> None:
        """End the touch. From now on it can be taught if it is whole."""
        self._touch = None
        if decided is None or not isinstance(self.model, IntegerModel) or not self.config.has_prototypes:
            return
        whole = touch.completed == len(self._spans)
        codes = trajectory_codes(self.config, decided.hidden, decided.logits)[0]
        self._last = codes if whole else None
        if whole and self._following is not None:
            self.model = teach(self._integer(), codes, self._following)
        self._following = None

    def _checked(self, frames: Any) -> np.ndarray:
        samples = array_of(frames, "frames")
        samples = samples[None] if samples.ndim == 1 else samples
        taxels, fmt = self.config.sensor.taxels, self.config.sample_format
        if samples.ndim != 2 or samples.shape[1] != taxels:
            raise InputError(
                f"frames: have shape {np.shape(frames)}; the model takes ({taxels},) for one frame, "
                f"(frames, {taxels}) for many"
            )
        worth = self.config.sensor.volt_per_code
        if samples.dtype.kind == "f" and worth:
            # float16 cannot hold the codes, float64 not every long double: infinities are clipped below
            with np.errstate(over="ignore"):
                real = samples.astype(np.float64) / np.array(worth)
            if np.isnan(real).any():
                raise InputError("frames: hold values that are not a number; give samples that are finite")
            samples = np.clip(np.rint(real), fmt.min_code, fmt.max_code).astype(np.int32)
        if samples.dtype.kind not in "iu":
            raise InputError(
                f"frames: hold {samples.dtype}, not integers; give the A/D codes that the model was trained "
                "on"
            )
        if len(samples) and (samples.min() < fmt.min_code or samples.max() > fmt.max_code):
            span = f"{fmt.min_code}..{fmt.max_code}"
            raise InputError(
                f"frames: run from {samples.min()} to {samples.max()}; the model's converter gives {span}"
            )
        return samples.astype(np.int32)

    def _take(self, samples: np.ndarray) -> list[Decision]:
        deviations, begun = self._front.push(samples[:, None])
        self._keep(deviations[:, 0])
        # first the touch under way: one that begins in these frames comes after its end
        decisions = self._go_on()
        for _, onset, start in begun:
            shape = (self.config.windows.steps, self.config.inputs)
            self._touch = _Touch(
                self._touches,
                onset,
                start,
                np.zeros(shape, np.int64),
                np.zeros(shape, dtype=bool),
                self._spans,
            )
            self._touches += 1
            decisions += self._go_on()
        return decisions

    def _keep(self, deviations: np.ndarray) -> None:
        """Append the deviations, and drop those that no touch can need any more when the buffer is full."""
        stop = self._front.frames - self._base
        if stop > len(self._kept):
            before = self._front.frames - len(deviations)
            needed = (
                min(before, self._touch.start_frame - 1 if self._touch else before)
                - self._before
                - self._base
            )
            excess = before - self._base - needed
            self._kept[:excess] = self._kept[needed : needed + excess].copy()
            self._base += needed
            stop -= needed
        self._kept[stop - len(deviations) : stop] = deviations

    def _go_on(self) -> list[Decision]:
        """Decisions of the windows that are complete by now; the touch ends with its last window."""
        touch, decisions = self._touch, []
        if touch and self.config.follows_touch:
            touch.ended = self._front.ended.pop((0, touch.start_frame), None)
            if touch.ended is None:
                return []
            touch.spans, touch.lengths, touch.doublings = divided(self.config, touch.ended)
        while touch and self._touch:
            last = touch.start_frame - 1 + touch.spans[touch.completed][1]
            if last > self._front.frames:
                break
            decisions += self._step(touch, last)
            if touch.completed == len(self._spans):
                self._end(touch, self._decided(touch) if self.config.has_prototypes else None)
        if touch and touch.ended and self._touch:  # without a window
            self._end(touch, None)
        return decisions

    def _step(self, touch: _Touch, last: int) -> list[Decision]:
        """The decisions of the touch's next window, whose last frame is ``last``."""
        config, k, start = self.config, touch.completed, touch.start_frame - self._base
        frames, spans = self._kept[: last - self._base], touch.spans[: k + 1]
        touch.sums[k] = window_values(config, frames, start, spans, touch.doublings)[0][k]
        last = touch.ended.end if touch.ended else last
        flagged = self._front.flagged[0]
        touch.faults[k] = np.repeat((flagged > 0) & (flagged <= last), config.kinds)
        touch.completed = k + 1
        decided = self._decided(touch)
        stages = {
            "sum": touch.sums[k].copy(),
            "feature": decided.features[0, k],
            "state": decided.hidden[0, k],
            "logit": decided.logits[0, k],
        }
        if config.faults.fault_frames:
            stages["fault"] = touch.faults[k] | np.array(config.input_mask)
        # a window that ends before the onset is replayed from the ring: it is complete with the onset
        frame = self._pushed(max(last, touch.onset_frame))
        begun = self._pushed(touch.onset_frame), self._pushed(touch.start_frame)
        decisions = [
            Decision(
                frame,
                touch.number,
                k,
                False,
                int(decided.local[0, k]),
                decided.margin[0, k].item(),
                False,
                False,
                *begun,
                stages,
            )
        ]
        early = early_steps(config, decided.local, decided.margin, np.array([k + 1]))[1][0]
        if not touch.decided and (early or touch.completed == len(self._spans)):
            partial = touch.ended is not None and touch.ended.partial(config) and not early
            decisions.append(self._global(touch, decided, frame, partial=partial))
        return decisions

    def _decided(self, touch: _Touch) -> Decided:
        """Decisions of the model from the windows that are complete."""
        # a linear cell has weights for each step, so it gets them all; open windows are 0 and do not count
        steps = touch.completed if self.config.recurrent else self.config.windows.steps
        single = Touches(
            recordings=1,
            recording=np.zeros(1, dtype=np.int64),
            onset_frame=np.array([touch.onset_frame]),
            start_frame=np.array([touch.start_frame]),
            completed=np.array([touch.completed]),
            partial=np.zeros(1, dtype=bool),
            sums=touch.sums[None, :steps],
            faults=touch.faults[None, :steps] if self.config.faults.fault_frames else None,
            lengths=None if touch.lengths is None else touch.lengths[None, :steps],
        )
        return decide_touches(self.model, single)

    def _global(self, touch: _Touch, decided: Decided, frame: int, *, partial: bool) -> Decision:
        touch.decided = True
        label, margin = int(decided.decision[0]), decided.lead[0].item()
        if touch.number == 0:
            self.decision = label
        unsure = bool(decided.unsure[0])
        begun = self._pushed(touch.onset_frame), self._pushed(touch.start_frame)
        return Decision(
            frame, touch.number, int(decided.step[0]), True, label, margin, partial, unsure, *begun
        )
