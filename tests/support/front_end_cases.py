"""What the golden model makes of a stream, as beats of the front end, and small cases that exercise each rule."""

from types import SimpleNamespace

import numpy as np

from eskin.golden.core import AcceleratorConfig
from eskin.golden.model.preprocess import TouchFinder

REST = 500
"""Rest level of the made streams, codes."""

BASE = dict(taxels=4, sample_bits=12, hidden=4, sample_rate_hz=1000.0, feature_shift=())
BAND = dict(onset="band", band_low=REST - 100, band_high=REST + 100)
TOUCH = dict(
    window_mode="touch", pretrigger_frames=4, touch_frames=40, hop=7, window=15, steps=5, rearm_frames=13
)
FREE = dict(window_mode="free", hop=6, window=12, steps=4, rearm_frames=13)
FAULTS = dict(fault_frames=8, fault_activity=25)
TRACKED = dict(
    rest="tracked",
    rest_frames=8,
    onset="baseline",
    onset_check_frames=4,
    onset_mean_frames=8,
    onset_threshold=30,
)

CASES: dict[str, AcceleratorConfig] = {
    name: AcceleratorConfig.of(name=name, **(BASE | fields))
    for name, fields in {
        "thesis": BAND | TOUCH,
        "thesis 6 taxels": BAND
        | TOUCH
        | dict(taxels=6, pretrigger_frames=7, touch_frames=33, hop=8, window=17, steps=4, rearm_frames=16),
        "two end together": BAND | TOUCH | dict(hop=5, window=11, touch_frames=20, steps=4),
        "three end together": BAND | TOUCH | dict(hop=5, window=11, touch_frames=21, steps=5),
        "even windows together": BAND | TOUCH | dict(hop=5, window=10, touch_frames=21, steps=5),
        "short first window": BAND
        | TOUCH
        | dict(pretrigger_frames=2, hop=9, window=19, touch_frames=10, steps=1, rearm_frames=20),
        "no pretrigger": BAND | TOUCH | dict(pretrigger_frames=0, rearm_frames=9, sample_signed=True),
        "immediate touch": TOUCH | dict(onset="immediate", pretrigger_frames=0, taxels=5),
        "band initial": BAND | FREE | dict(rest="initial", rest_frames=3, clip=77),
        "band tracked": BAND | FREE | dict(rest="tracked", rest_frames=32, sample_signed=True),
        "synthetic": TRACKED | TOUCH | dict(taxels=5, rest_frames=6),
        "pvdf": TRACKED | FREE | dict(taxels=8, clip=60),
        "pvdf 64": TRACKED | FREE | dict(rest_frames=64, clip=60, onset_mean_frames=32, onset_threshold=9),
        "two taxels": TRACKED | FREE | dict(taxels=2, clip=60, rearm_frames=9),
        "one block": TRACKED | FREE | dict(taxels=3, onset_mean_frames=4, rest_frames=1, steps=5),
        "every frame": TRACKED
        | FREE
        | dict(onset_check_frames=1, onset_mean_frames=4, onset_threshold=45, rest_frames=5, clip=200),
        "thesis faults": BAND | TOUCH | FAULTS | dict(taxels=5, onset_hits=2, onset_span=2),
        "two end together, faults": BAND | TOUCH | FAULTS | dict(hop=5, window=11, touch_frames=20, steps=4),
        "immediate touch, faults": TOUCH
        | FAULTS
        | dict(onset="immediate", pretrigger_frames=0, fault_frames=2, fault_activity=1),
        "band clipped, faults": BAND | TOUCH | FAULTS | dict(clip=90, fault_frames=16, masked_taxels=(1,)),
        "synthetic faults": TRACKED | TOUCH | FAULTS | dict(rest_frames=6, onset_hits=3, onset_span=4),
        "pvdf faults": TRACKED | FREE | FAULTS | dict(taxels=8, clip=60, onset_hits=2, onset_span=3),
        "every frame, 5 of 7": TRACKED
        | FREE
        | dict(onset_check_frames=1, onset_mean_frames=2, rest_frames=5, onset_hits=5, onset_span=7),
        "fabric": FREE
        | dict(
            rest="initial", rest_frames=5, onset="immediate", sample_signed=True, taxels=6, sample_bits=16
        ),
    }.items()
}


def make_stream(config: AcceleratorConfig, frames: int, seed: int, *, touches=None) -> np.ndarray:
    """Codes (frames, taxels): rest with noise and drift, and now and then (or at frames ``touches``, from 1)
    a touch."""
    rng = np.random.default_rng(seed)
    stream = (
        REST
        + rng.integers(-20, 21, (frames, config.sensor.taxels))
        + np.linspace(0, 12, frames).astype(int)[:, None]
    )
    begins = (
        np.flatnonzero(rng.random(frames) < 0.04) if touches is None else [frame - 1 for frame in touches]
    )
    for begin in begins:
        taxel = rng.integers(config.sensor.taxels)
        length = int(rng.integers(1, 30))
        stream[begin : begin + length, taxel] += int(rng.choice([-1, 1])) * rng.integers(
            120, 480, len(stream[begin : begin + length])
        )
    # one taxel is silent from some frame on, one swings between the ends of the range for a while
    if config.faults.fault_frames:
        silent, swings = rng.permutation(config.sensor.taxels)[:2]
        begin, other = rng.integers(frames // 4, frames // 2, 2)
        stream[begin:, silent] = stream[begin, silent]
        stream[other : other + 3 * config.faults.fault_frames, swings] = 9999
        stream[other : other + 3 * config.faults.fault_frames : 2, swings] = -9999
    low, high = config.sample_format.min_code, config.sample_format.max_code
    extremes = rng.random(stream.shape) < (0.003 if touches is None else 0)
    return np.clip(np.where(extremes, rng.choice([low, high], stream.shape), stream), low, high)


def detect(config: AcceleratorConfig, stream: np.ndarray) -> SimpleNamespace:
    """What the golden model sees of a stream: ``values`` (T, D), ``touches`` as (f, s, e), per-frame flags
    ``onset, touch, end, hop_last, emit``, ``armed`` after each frame, ``masked`` (T, D): out of use in this
    frame, by mask or by flag."""
    finder, frames, hop = TouchFinder(config), len(stream), config.windows.hop
    values, touches, armed = [], [], []
    for frame in stream:
        deviations, begun = finder.push(frame[None, None].astype(np.int32))
        values.append(deviations[0, 0])
        touches += [(onset, start, start - 1 + config.last_frame) for _, onset, start in begun]
        armed.append(int(finder.armed[0]))
    numbers, flagged = np.arange(1, frames + 1), finder.flagged[0]
    free = config.windows.window_mode == "free"
    of_touch = np.isin(numbers, [frame for f, _, e in touches for frame in range(f + 1, e + 1)]).astype(int)
    hop_last = (numbers % hop == 0).astype(int)
    dead = ~np.isin(np.arange(config.sensor.taxels), config.sensor.live)
    return SimpleNamespace(
        values=np.array(values),
        touches=touches,
        armed=armed,
        masked=((flagged > 0) & (flagged <= numbers[:, None])) | dead,
        onset=np.isin(numbers, [f for f, *_ in touches if f]).astype(int),
        touch=of_touch,
        end=np.isin(numbers, [e for *_, e in touches]).astype(int),
        hop_last=hop_last,
        emit=of_touch * hop_last * (numbers > hop) * free,
    )


def sample_beats(stream: np.ndarray) -> list[dict]:
    """The stream as beats of ``eskin.rtl.frontend.onset_detector.sample_layout``."""
    taxels = stream.shape[1]
    return [
        {"sample": int(code), "first": int(taxel == 0), "last": int(taxel == taxels - 1)}
        for frame in stream
        for taxel, code in enumerate(frame)
    ]


def frame_beats(config: AcceleratorConfig, seen: SimpleNamespace) -> list[dict]:
    """Expected beats of ``eskin.rtl.frontend.onset_detector.frame_layout``."""
    names = ("touch",) if config.windows.window_mode == "touch" else ("hop_last", "emit", "end")
    beats = []
    for t, frame in enumerate(seen.values):
        for taxel, value in enumerate(frame):
            last = int(taxel == config.sensor.taxels - 1)
            beat = (
                {"complement": ~int(value)}
                | {name: getattr(seen, name)[t] for name in names}
                | mark(config, seen, t, taxel)
            )
            beats.append(
                beat | ({"onset": seen.onset[t] & last} if config.windows.window_mode == "touch" else {})
            )
    return beats


def mark(config: AcceleratorConfig, seen: SimpleNamespace, t: int, taxel: int) -> dict:
    """``masked`` of a beat of frame t + 1, where there is a fault detector."""
    return {"masked": int(seen.masked[t][taxel])} if config.faults.fault_frames else {}


def touch_beats(config: AcceleratorConfig, seen: SimpleNamespace) -> list[dict]:
    """Expected beats of ``eskin.rtl.common.layouts.touch_layout``: frames s..e of each touch, as far as the
    stream goes."""
    return [
        {"complement": ~int(value)} | mark(config, seen, t, taxel)
        for _, start, end in seen.touches
        for t, frame in enumerate(seen.values[start - 1 : end], start - 1)
        for taxel, value in enumerate(frame)
    ]


def window_beats(config: AcceleratorConfig, seen: SimpleNamespace) -> list[dict]:
    """Expected beats of ``eskin.rtl.common.layouts.window_layout``: what the windows see."""
    if config.windows.window_mode == "free":
        return frame_beats(config, seen)
    taxels, last = config.sensor.taxels, config.last_frame
    return [
        beat | touch_marks(config, number // taxels % last + 1)
        for number, beat in enumerate(touch_beats(config, seen))
    ]


def touch_marks(config: AcceleratorConfig, frame: int) -> dict[str, int]:
    """The marks of a touch's frame, from 1."""
    last = config.last_frame
    return {
        "hop_last": int(frame % config.windows.hop == 0 or frame == last),
        "emit": int(frame in {end for _, end in config.window_spans}),
        "end": int(frame == last),
    }


def sum_beats(config: AcceleratorConfig, seen: SimpleNamespace) -> list[dict]:
    """Expected beats of ``eskin.rtl.frontend.window_averager.sum_layout``, as far as the stream goes."""
    return [
        {
            "complement": ~int(value),
            "taxel": taxel,
            "length": config.length_index[k],
            "final": int(k == config.windows.steps - 1),
        }
        | mark(config, seen, start + last - 2, taxel)
        for _, start, _ in seen.touches
        for k, (first, last) in enumerate(config.window_spans)
        if start - 1 + last <= len(seen.values)
        for taxel, value in enumerate(seen.values[start + first - 2 : start + last - 1].sum(axis=0))
    ]
