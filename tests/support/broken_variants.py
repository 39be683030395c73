"""Broken variants of the failure modes: what each mode must report as failed, a (words of the table, bench -> broken bench) each."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.formats import QFormat, narrow
from eskin.golden.data.recordings import Recordings
from eskin.golden.model import pipeline
from eskin.golden.model.cells import Fixed
from eskin.golden.model.model import IntegerModel, network_formats
from eskin.golden.model.preprocess import Touches, by_input, find_touches, normalise, shifts_by_input
from eskin.golden.stability.core import Bench, rebuilt
from eskin.golden.stability.numeric import changed_tables, elementwise_bits, row_bits
from eskin.golden.training.quantise import profile, quantise_model


# ---------------------------------------------------------------------- parts that are wrong
class Floor(Fixed):
    """Truncates where the specification rounds."""

    @staticmethod
    def _narrow(value, shift: int, fmt: QFormat):
        return np.floor(value * 2.0**-shift).clip(fmt.min_code, fmt.max_code)


class Wrap(Fixed):
    """Keeps the low bits where the specification saturates."""

    @staticmethod
    def _narrow(value, shift: int, fmt: QFormat):
        rounded = np.floor(value * 2.0**-shift + (0.5 if shift else 0.0))
        return (rounded - fmt.min_code) % (1 << fmt.width) + fmt.min_code


class Complement(Fixed):
    """Makes 1 - z by inverting the bits of z: one LSB short."""

    def __init__(self, config: AcceleratorConfig) -> None:
        super().__init__(config)
        self.one = self.one - 1


class Growing(Fixed):
    """An error of the state that doubles every 20 steps."""

    def __init__(self, config: AcceleratorConfig) -> None:
        super().__init__(config)
        self._calls, self._error = 0, 1.0

    def state(self, products):
        self._calls += 1
        if self._calls % 40 == 0:
            self._error = min(2 * self._error, 2.0**20)
        fmt = self._config.formats.state_format
        return np.floor((super().state(products) + self._error).clip(fmt.min_code, fmt.max_code))


class SignOnly(Fixed):
    """A state of one bit: its smallest code or 0."""

    def state(self, products):
        return (super().state(products) < 0).astype(np.float64) * self._config.formats.state_format.min_code


def _one_entry_off(table: np.ndarray, config: AcceleratorConfig) -> np.ndarray:
    table[len(table) // 2 + len(table) // 8] -= len(table)
    return table


def _coarse(table: np.ndarray, config: AcceleratorConfig) -> np.ndarray:
    return np.full_like(table, table[len(table) // 2])


def _coarse_state(bench: Bench) -> Bench:
    """The same bench with a state of 8 bits; weights follow where the products' scale asks for it."""
    return _requantised(bench, state_bits=8)


def _requantised(bench: Bench, **widths: int) -> Bench:
    ranges = profile(bench.real, bench.touches)
    model = quantise_model(bench.real, ranges, **widths)
    return dataclasses.replace(bench, model=model, origin=bench.origin or bench, memo={})


def _loud(bench: Bench) -> Bench:
    """The same bench with all input weights at full scale, which drives every sum over its range."""
    formats = network_formats(bench.config)
    loud = {
        name: np.where(array < 0, formats[name].min_code, formats[name].max_code)
        for name, array in bench.model.arrays.items()
        if name[0] in "WUV"
    }
    return bench.changed(arrays=loud)


def _wrapping_normaliser(config, sums, completed, mean, scale, faults=None):
    which = list(config.length_index[: sums.shape[1]])
    mean, scale, shift = by_input(config, mean)[which], by_input(config, scale)[which], shifts_by_input(config)[which]
    centred = narrow((sums - mean) >> shift, 0, config.centred_format, overflow="WRAP")
    return narrow(centred * scale, config.formats.gate_frac, config.formats.feature_format, overflow="WRAP")


def _last_maximum(config, logits, completed):
    local, margin, decision, lead = pipeline.decide(config, logits[..., ::-1], completed)
    flip = lambda index: np.where(index >= 0, config.classes - 1 - index, index)  # noqa: E731
    return flip(local), margin, flip(decision), lead


def _no_weights(bench: Bench) -> Bench:
    return bench.changed(arrays={name: np.zeros_like(bench.model.arrays[name]) for name in network_formats(bench.config)})


def _unsigned_normaliser(config, sums, completed, mean, scale, faults=None):
    return np.abs(normalise(config, sums, completed, mean, scale, faults))


def _late_windows(config: AcceleratorConfig, recordings, **options) -> Touches:
    moved = [recordings.recording(i)[np.minimum(np.arange(n) + 1, n - 1)] for i, n in enumerate(recordings.lengths)]
    return find_touches(config, rebuilt(recordings, moved), **options)


def _exchanged(model: IntegerModel) -> dict[str, np.ndarray]:
    one, other = model.config.gates[:2]
    arrays = model.arrays
    return {f"{kind}_{gate}": arrays[f"{kind}_{source}"] for kind in "WUb" for gate, source in ((one, other), (other, one))}


def last_sample_windows(config: AcceleratorConfig, recordings: Recordings, **options) -> Touches:
    """A broken front end: a window is its last frame times its length, so nothing is averaged."""
    streams = [recordings.recording(i) for i in range(len(recordings))]
    hop = config.windows.hop
    held = [stream[np.minimum(np.arange(len(stream)) // hop * hop + hop - 1, len(stream) - 1)] for stream in streams]
    return find_touches(config.replace(fault_frames=0), rebuilt(recordings, held), **options)  # which would take it for a taxel that sticks


def lowest_bits(config, logits, completed):
    """A broken decision: by the lowest bits of the last logits, so that any change shows."""
    local, margin, _, lead = pipeline.decide(config, logits, completed)
    last = logits[np.arange(len(logits)), np.maximum(completed - 1, 0)]
    return local, margin, last.sum(axis=-1) % config.classes, lead


def _sensitive(bench: Bench) -> Bench:
    """A broken onset rule: one sample one code off is a touch."""
    config = bench.config
    if config.onset_rule.onset == "band":
        level = (config.onset_rule.band_low + config.onset_rule.band_high) // 2
        return bench.changed({"band_low": level, "band_high": level})
    return bench.changed({"onset_threshold": 1, "onset_mean_frames": config.onset_rule.onset_check_frames, "clip": 0})


def full_scale(bench: Bench) -> Bench:
    """A normaliser with the largest scale and the smallest mean: every feature is at full scale."""
    sums = QFormat(bench.config.sum_bits, 0)
    return bench.changed(
        arrays={
            "scale": np.full_like(bench.model.arrays["scale"], bench.config.scale_format.max_code),
            "mean": np.full_like(bench.model.arrays["mean"], sums.min_code),
        }
    )


def _last_step_only(config, logits, completed):
    local, margin, decision, lead = pipeline.decide(config, logits, completed)
    return local, margin, np.where(completed == config.windows.steps, decision, -1), lead


def _thinned(config, recordings, **options):
    made = rebuilt(recordings, [recordings.recording(i)[::8] for i in range(len(recordings))])
    return last_sample_windows(config, made, **options)


def _unsettled(config, recordings, **options):
    long = rebuilt(recordings, [np.repeat(recordings.recording(i), config.last_frame * 2, axis=0) for i in range(len(recordings))])
    return find_touches(
        config.replace(
            onset="immediate",
            rest="none",
            rest_frames=0,
            window_mode="free",
            window=2 * config.windows.hop,
            pretrigger_frames=0,
            feature_shift=(),
        ),
        long,
        **options,
    )


def _one_listener(bench: Bench, *, deaf: bool = False) -> Bench:
    """A network that hears one taxel only, or none."""
    heard = bench.live[0]
    arrays = {}
    for gate in bench.config.gates:
        arrays[f"W_{gate}"] = np.zeros_like(bench.model.arrays[f"W_{gate}"])
        if not deaf:
            arrays[f"W_{gate}"][:, heard] = bench.model.arrays[f"W_{gate}"][:, heard]
    return bench.changed(arrays=arrays)


def _undefended(bench: Bench) -> Bench:
    """No detector, no clip, and a network that hears one taxel."""
    return _one_listener(bench).changed({"fault_frames": 0, "clip": 0})


# ---------------------------------------------------------------------- the variants
def _with(**changes: Any) -> Callable[[Bench], Bench]:
    """The same bench with other parts."""
    return lambda bench: bench.changed(**changes)


def _slow_clock(bench: Bench) -> Bench:
    return bench.changed({"clock_hz": 2.0 * bench.config.inputs * bench.config.sensor.sample_rate_hz, "lanes": 1})


def _other_window(bench: Bench) -> Bench:
    arrays = bench.model.arrays
    return bench.changed(arrays={"mean": arrays["mean"] + 8 * bench.config.windows.window, "scale": arrays["scale"]})


def _frozen_rest(bench: Bench) -> Bench:
    tracked = bench.config.rest_level.rest == "tracked"
    return bench.changed({"rest": "initial"} if tracked else {"band_low": bench.config.onset_rule.band_low + 1})


def _noise_is_silence(bench: Bench) -> Bench:
    frames = max(bench.config.faults.fault_frames, bench.config.onset_rule.onset_check_frames, 16)
    return bench.changed({"fault_frames": frames, "fault_activity": 65535})


GROWING = ("an error of the state that doubles every 20 steps", _with(arithmetic=Growing))
FLOOR = ("floor instead of nearest", _with(arithmetic=Floor))
COARSE_STATE = ("a state of 8 bits", _coarse_state)
WRAP = ("wrap instead of saturate", _with(arithmetic=Wrap))
LOUD_WRAP = ("wrap instead of saturate, every weight at full scale", lambda bench: _loud(bench.changed(arithmetic=Wrap)))
WRAPPING_NORMALISER = ("centred sums keep their low 16 bits", lambda bench: bench.changed({"clip": 0}, normalise=_wrapping_normaliser))
WRAPS_EVERYWHERE = ("logits and states wrap", _with(arithmetic=Wrap, normalise=_wrapping_normaliser))
NARROW_ACCUMULATOR = (
    "one bit less than the bound",
    _with(accumulator_bits=lambda config: row_bits(config) - 1, elementwise_bits=lambda config: elementwise_bits(config) - 1),
)
NARROW_SUM = ("one bit less than the worst sum needs", _with(sum_bits=lambda config: config.sum_bits - 1))
ONE_ENTRY_OFF = ("one entry off", _with(arithmetic=changed_tables(_one_entry_off)))
ONE_VALUE_TABLE = ("a table of one value", _with(arithmetic=changed_tables(_coarse)))
COMPLEMENT = ("1 - z made by inverting bits", _with(arithmetic=Complement))
LAST_OF_EQUALS = ("the last of equal classes", _with(decide=_last_maximum))
NO_WEIGHTS = ("every weight 0", _no_weights)
SIGN_ONLY = ("the state keeps its sign only", _with(arithmetic=SignOnly))
UNSIGNED = ("features lose their sign", _with(normalise=_unsigned_normaliser))
OTHER_WINDOW = ("the mean of another window length", _other_window)
LATE_WINDOWS = ("every window a frame late", _with(find_touches=_late_windows))
GATES_EXCHANGED = ("two gates exchanged", lambda bench: bench.changed(arrays=_exchanged(bench.model)))
UNIT_SCALE = ("a scale of one", lambda bench: bench.changed(arrays={"scale": np.full_like(bench.model.arrays["scale"], 1)}))

SHOWS_EVERYTHING = ("the lowest bits of the last logits decide", _with(decide=lowest_bits))
"""For modes in which little changes."""
ANY_CODE = ("one code off is a touch", _sensitive)
ONE_SAMPLE = ("one sample is enough", _sensitive)
LAST_STEP_ONLY = ("the network answers after the last step only", _with(decide=_last_step_only))
CARRIED = ("the state is not cleared", _with(carry=True))
FROZEN_REST = ("the rest level is frozen after settling", _frozen_rest)
FULL_SCALE = ("every feature at full scale", full_scale)
THINNED = ("a window is one sample and seven of eight frames are lost", _with(find_touches=_thinned))
UNSETTLED = ("no settling", _with(find_touches=_unsettled))
SLOW_CLOCK = ("a clock of two cycles a sample", _slow_clock)

ONE_LISTENER = ("a network that hears one taxel", _one_listener)
DEAF = ("a network that hears nothing", lambda bench: _one_listener(bench, deaf=True))
UNDEFENDED = ("no detector, and a network that hears one taxel", _undefended)
NO_AVERAGE = ("a window is one sample", lambda bench: bench.changed({"clip": 0}, find_touches=last_sample_windows))
NO_DETECTOR = ("no detector", lambda bench: bench.changed({"fault_frames": 0}))
NOISE_IS_SILENCE = ("a detector that takes rest noise for silence", _noise_is_silence)

BROKEN: dict[str, Callable[[Bench], Bench]] = dict(value for name, value in list(globals().items()) if name.isupper())
"""What makes each of them, by its words."""
