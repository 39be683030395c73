"""Broken variants of the failure modes: what each mode must report as failed; a bench with another configuration or
arrays, or a part of the golden model that is patched."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from eskin.golden.core import AcceleratorConfig, QFormat, Record, narrow
from eskin.golden.data import Recordings
from eskin.golden.model import Fixed, Touches, find_touches, model, pipeline, preprocess
from eskin.golden.model.pipeline import decide
from eskin.golden.model.preprocess import by_input, shifts_by_input
from eskin.study.stability.core import Bench, rebuilt
from eskin.study.stability.table import MODES
from tests.support import stability_case
from tests.support.stability_case import changed


# ---------------------------------------------------------------------- parts that are wrong
class Wrap(Fixed):
    """Keeps the low bits where the specification saturates."""

    @staticmethod
    def _narrow(value, shift: int, fmt: QFormat):
        rounded = np.floor(value * 2.0**-shift + (0.5 if shift else 0.0))
        return (rounded - fmt.min_code) % (1 << fmt.width) + fmt.min_code


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


def _wrapping_normaliser(config, sums, completed, mean, scale, faults=None, lengths=None):
    which = list(config.length_index[: sums.shape[1]]) if lengths is None else lengths
    mean, scale, shift = (
        by_input(config, mean)[which],
        by_input(config, scale)[which],
        shifts_by_input(config)[which],
    )
    centred = narrow((sums - mean) >> shift, 0, config.centred_format, overflow="WRAP")
    return narrow(centred * scale, config.formats.gate_frac, config.formats.feature_format, overflow="WRAP")


def last_sample_windows(config: AcceleratorConfig, recordings: Recordings, **options) -> Touches:
    """A broken front end: a window is its last frame times its length, so nothing is averaged."""
    streams = [recordings.recording(i) for i in range(len(recordings))]
    hop = config.windows.hop
    cases = [
        stream[np.minimum(np.arange(len(stream)) // hop * hop + hop - 1, len(stream) - 1)]
        for stream in streams
    ]
    # which would take it for a taxel that sticks
    return find_touches(config.replace(fault_frames=0), rebuilt(recordings, cases), **options)


def lowest_bits(config, logits, completed):
    """A broken decision: by the lowest bits of the last logits, so that any change shows."""
    local, margin, _, lead = decide(config, logits, completed)
    last = logits[np.arange(len(logits)), np.maximum(completed - 1, 0)]
    return local, margin, last.sum(axis=-1) % config.classes, lead


def _sensitive(bench: Bench) -> Bench:
    """A broken onset rule: one sample one code off is a touch."""
    config = bench.config
    if config.onset_rule.onset == "band":
        level = (config.onset_rule.band_low + config.onset_rule.band_high) // 2
        return changed(bench, {"band_low": level, "band_high": level})
    return changed(
        bench, {"onset_threshold": 1, "onset_mean_frames": config.onset_rule.onset_check_frames, "clip": 0}
    )


def full_scale(bench: Bench) -> Bench:
    """A normaliser with the largest scale and the smallest mean: every feature is at full scale."""
    sums = QFormat(bench.config.sum_bits, 0)
    return changed(
        bench,
        arrays={
            "scale": np.full_like(bench.model.arrays["scale"], bench.config.scale_format.max_code),
            "mean": np.full_like(bench.model.arrays["mean"], sums.min_code),
        },
    )


def _as_recorded(config: AcceleratorConfig, recordings: Recordings, **options: Any) -> Touches:
    """A broken search: it looks into the recording as it was, told by its first frames."""
    clean = stability_case.bench().clean
    numbers = {clean.recording(i)[:8].tobytes(): i for i in range(len(clean))}
    which = [numbers[recordings.recording(i)[:8].tobytes()] for i in range(len(recordings))]
    return find_touches(config, clean.subset(which), **options)


def _last_step_only(config, logits, completed):
    local, margin, decision, lead = decide(config, logits, completed)
    return local, margin, np.where(completed == config.windows.steps, decision, -1), lead


def _carried(config: AcceleratorConfig, recordings: Recordings, **options) -> Touches:
    touches = find_touches(config, recordings, **options)
    sums, again = touches.sums.copy(), np.flatnonzero(np.diff(touches.recording) == 0) + 1
    sums[again] += touches.sums[again - 1]
    return dataclasses.replace(touches, sums=sums)


def _thinned(config, recordings, **options):
    made = rebuilt(recordings, [recordings.recording(i)[::8] for i in range(len(recordings))])
    return last_sample_windows(config, made, **options)


def _one_listener(bench: Bench, *, deaf: bool = False) -> Bench:
    """A network that hears one taxel only, or none."""
    heard = bench.live[0]
    arrays = {}
    for gate in bench.config.gates:
        arrays[f"W_{gate}"] = np.zeros_like(bench.model.arrays[f"W_{gate}"])
        if not deaf:
            arrays[f"W_{gate}"][:, heard] = bench.model.arrays[f"W_{gate}"][:, heard]
    return changed(bench, arrays=arrays)


def _undefended(bench: Bench) -> Bench:
    """No detector, no clip, and a network that hears one taxel."""
    return changed(_one_listener(bench), {"fault_frames": 0, "clip": 0})


# ---------------------------------------------------------------------- the variants
Variant = Callable[[Bench], Bench]
PARTS_OF: dict[Variant, Record] = {}
"""Parts of the golden model that are replaced, too."""


def _with(config=None, **parts) -> Variant:
    """The same bench with fields of the configuration replaced, and parts of the golden model."""
    variant = lambda bench: changed(bench, config)
    PARTS_OF[variant] = parts
    return variant


def _frozen_rest(bench: Bench) -> Bench:
    tracked = bench.config.rest_level.rest == "tracked"
    return changed(
        bench, {"rest": "initial"} if tracked else {"band_low": bench.config.onset_rule.band_low + 1}
    )


def _noise_is_silence(bench: Bench) -> Bench:
    frames = max(bench.config.faults.fault_frames, bench.config.onset_rule.onset_check_frames, 16)
    return changed(bench, {"fault_frames": frames, "fault_activity": 65535})


BY_VARIANT: dict[Variant, tuple[str, ...]] = {
    _with(Fixed=Growing): ("state error without reset",),
    # logits and states wrap
    _with(Fixed=Wrap, normalise=_wrapping_normaliser): ("touches outside the profiled range",),
    # one sample, one code off, is a touch
    _sensitive: ("no touch", "motor burst before the touch", "one-sample glitch before the touch"),
    # the network answers after the last step only
    _with(decide=_last_step_only): ("touch near the end of the stream",),
    # the sums of a touch go on into the next
    _with(find_touches=_carried): ("two touches",),
    # the rest level is frozen after settling
    _frozen_rest: ("slow ramp through the band",),
    # the touch is still there
    _with(find_touches=_as_recorded): ("class without the touch",),
    # every feature at full scale
    full_scale: (
        "weight bits",
        "state bits",
        "feature bits",
        "drift of all taxels",
        "gain of one taxel 20 % high",
        "gain of one taxel 20 % low",
        "gains of all taxels within 20 %",
        "offset of all taxels at the onset",
        "clipped signals",
        "one noisy taxel",
    ),
    # a window is one sample and seven of eight frames are lost
    _with(find_touches=_thinned): (
        "frames lost",
        "frames repeated",
        "a gap in the touch",
        "wrong sample rate",
    ),
    # a network that hears one taxel
    _one_listener: (
        "one dead taxel, mean",
        "one dead taxel, worst",
        "one taxel stuck at full scale, masked, mean",
        "one taxel stuck at full scale, masked, worst",
        "one taxel stuck high from power-on",
        "two taxels dead",
        "offset of one taxel by one deviation up",
        "offset of one taxel by one deviation down",
    ),
    # a network that hears nothing
    lambda bench: _one_listener(bench, deaf=True): ("two taxels exchanged",),
    # no detector, and a network that hears one taxel
    _undefended: (
        "one taxel sticks high in the touch",
        "one taxel sticks low in the touch",
        "one taxel sticks high at the onset",
        "one taxel sticks high before the touch",
    ),
    # no detector
    _with({"fault_frames": 0}): ("failed taxels not found",),
    # a detector that takes rest noise for silence
    _noise_is_silence: ("sound taxels masked",),
}
"""A variant, and the modes that must report it as failed."""

BROKEN: dict[str, Variant] = dict.fromkeys(
    (name for name, mode in MODES.items() if callable(mode.run)), _with(decide=lowest_bits)
)
BROKEN |= {name: variant for variant, names in BY_VARIANT.items() for name in names}
"""The broken variant of each mode, by the mode's name; where none is named, the lowest bits of the last logits
decide."""


def broken(name, bench, patch) -> Bench:
    """A mode's broken variant of a bench; ``patch`` as of pytest's monkeypatch: setattr."""
    other, places = BROKEN[name](bench), {"Fixed": model, "find_touches": preprocess}
    for part, replacement in PARTS_OF.get(BROKEN[name], {}).items():
        patch(places.get(part, pipeline), part, replacement)
    return other
