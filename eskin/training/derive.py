"""A first guess at a configuration from an archive, quick and by rules, with the reasons in words.

``inspect`` shows the onsets that it finds. ``train`` and ``run`` without ``--config`` use
``eskin.choose.choice``, which starts from these measurements and judges them, beside the presets of the same
sensor. From at most 64 recordings spread evenly over the classes:

- *settling*: 64 ms, at least 5 and at most 64 frames; their mean is the rest level of each taxel.
- *moving mean*: 4 blocks of the power of two nearest to 8 ms.
- *in contact or not*: the largest moving mean of the lead-in (the first 64 ms after settling, two moving
  means at least), divided by the 99 % quantile over the recording. A median ratio of 0.3 or more means that
  recordings start in contact: the gate opens at once.
- *threshold*: the geometric mean of the noise (90 % quantile of the lead-in's maxima) and the signal (10 %
  quantile of the peaks above three times the noise), at least a quarter of the signal and at least one code.
- *clip*: 1.5 times the median recording's largest deviation, and at least twice the largest peak of a moving
  mean; none if no deviation exceeds it, or if the gate opens at once.
- *hop*: 48 ms (200 ms if the gate opens at once), at least 4 frames, and so short that 20 windows of two hops
  fit three quarters of the recordings after the median onset (shorter recordings are decided by the windows
  that they hold). If even 4 frames are too many, there are fewer steps.

If this rule finds a touch in fewer than half of the recordings, the gate opens at once.
"""

from dataclasses import dataclass

import numpy as np

from eskin.golden.core import AcceleratorConfig, InputError, Record
from eskin.golden.data import Recordings
from eskin.golden.model import find_touches
from eskin.golden.model.pipeline import by_recording

LOOKED_AT = 64
"""Recordings that the rules look at: enough for quantiles, quick for any archive."""

STEPS = 20
"""Recurrent steps of a touch."""

IN_CONTACT = 0.3
"""Median ratio of lead-in to peak from which on recordings count as starting in contact (0.01 on quiet
lead-ins, 0.5 on sliding)."""

CONVERTERS = ("pvdf", "fabric", "synthetic", "thesis")
"""Presets in the order in which they are tried. ``synthetic`` comes before ``thesis``, whose band of fixed
codes suits one converter only."""


def find_onsets(config: AcceleratorConfig, recordings: Recordings) -> np.ndarray:
    """Onset frame of the first touch of each recording (1-based; 0 where the gate opens at once), -1 where
    there is none."""
    touches = find_touches(config, recordings, steps=0)
    return by_recording(touches.onset_frame, touches.first_touch())


def derive_config(recordings: Recordings) -> tuple[AcceleratorConfig, list[str]]:
    """A configuration that works for ``recordings``, and sentences with the choices and their reasons.

    Raises
    ------
    InputError
        Sizes that no accelerator has (fewer than 4 taxels, one class, ...): the sentence names the field.
    """
    if recordings.image_shape:
        raise InputError(
            f"recordings '{recordings.source}', array images: holds images, which this verb does not take; "
            "docs/images.md lists those "
            "that do"
        )
    rate, sample = recordings.sample_rate_hz, recordings.subset(recordings.evenly(LOOKED_AT))
    base, why = sensor_sizes(recordings)
    base["rest_frames"] = settling_frames(rate)
    onset, of_onset, begin = _onset_rule(sample, recordings, base)
    # 20 windows of two hops reach over 21 hops
    available = int(np.quantile(sample.lengths, 0.25, method="lower")) - begin
    fit = available // (STEPS + 1)
    pace_s = 0.2 if onset["onset"] == "immediate" else 0.048
    hop = int(np.clip(min(max(round(pace_s * rate), 4), fit), 1, 65535))
    steps = STEPS if fit >= 1 else max(1, available - 1)
    reasons = [
        *recordings.notes,
        f"{recordings.taxels} taxel{'s' * (recordings.taxels > 1)} at {rate:g} Hz with {recordings.sample_format} "
        "codes: the sizes are derived from the recordings",
        *why,
        *of_onset,
        f"{steps} window{'s' * (steps > 1)} of {2 * hop} frames every {hop} ({1000 * hop / rate:.3g} ms), "
        f"{(steps + 1) * hop / rate:.3g} s in all",
    ]
    windows = {"hop": hop, "window": 2 * hop, "steps": steps}
    return for_recordings(AcceleratorConfig(), recordings, **base | onset | windows), reasons


def fits_sensor(preset: AcceleratorConfig, recordings: Recordings) -> bool:
    """True if the recordings have the preset's taxels and code format, and its rate within 2 %."""
    return (
        preset.sensor.taxels == recordings.taxels
        and preset.sample_format == recordings.sample_format
        and abs(recordings.sample_rate_hz / preset.sensor.sample_rate_hz - 1.0) <= 0.02
    )


def for_recordings(config: AcceleratorConfig, recordings: Recordings, **changes) -> AcceleratorConfig:
    """``config`` with the archive's class names, rate and scale; errors name the archive."""
    try:
        return config.replace(
            class_names=recordings.class_names,
            sample_rate_hz=recordings.sample_rate_hz,
            volt_per_code=recordings.volt_per_code or config.sensor.volt_per_code,
            **changes,
        )
    except InputError as error:
        raise InputError(
            f"recordings '{recordings.source}' do not lead to a working configuration: {error}"
        ) from None


def sensor_sizes(recordings: Recordings) -> tuple[Record, list[str]]:
    """Fields that depend on the sensor alone (all except rest level, gate and windows), and the reasons.

    Raises
    ------
    InputError
        Every taxel is constant.
    """
    rate = recordings.sample_rate_hz
    # a power of two of frames, near 8 ms: the detector counts blocks by the lowest bits of its frame number
    check = int(np.clip(2 ** round(np.log2(max(0.008 * rate, 1.0))), 1, 1024))
    fields = dict(
        name="derived",
        taxels=recordings.taxels,
        sample_bits=recordings.sample_bits,
        sample_signed=recordings.sample_signed,
        window_mode="free",
        # 16 cycles a taxel: enough for every kind of feature
        clock_hz=max(12e6, 16.0 * recordings.taxels * rate),
        onset_mean_frames=4 * check,
        onset_check_frames=check,
        rearm_frames=int(np.clip(round(0.16 * rate), 8, 65535)),
    )
    reasons = []
    constant = tuple(
        int(t) for t in np.flatnonzero((recordings.samples == recordings.samples[0]).all(axis=0))
    )
    if len(constant) == recordings.taxels:
        raise InputError(
            f"recordings '{recordings.source}', array samples: every taxel is constant; give recordings "
            "with a signal"
        )
    if constant:
        reasons.append(f"taxel {', '.join(map(str, constant))} never changes and is masked")
    fields["masked_taxels"] = constant
    return fields, reasons


def settling_frames(rate: float) -> int:
    """Number of frames whose mean is the rest level."""
    return int(np.clip(round(0.064 * rate), 5, 64))


@dataclass(frozen=True)
class OnsetRule:
    """Measures for an onset rule, codes: noise (90 % quantile of the lead-ins' largest moving mean), signal
    (10 % quantile of the clear peaks), threshold between them, clip (0: none); ratio: median of lead-in to
    peak; largest: each recording's largest deviation."""

    noise: float
    signal: float
    threshold: int
    clip: int
    ratio: float
    largest: np.ndarray


def measure_onset(recordings: Recordings, settle: int, mean_frames: int) -> OnsetRule | None:
    """The rule that the module describes; None where recordings have no room for settling, lead-in and as much
    again."""
    lead_frames = max(2 * mean_frames, int(0.064 * recordings.sample_rate_hz))
    rows = []
    for index in range(len(recordings)):
        samples = recordings.recording(index).astype(np.float64)
        if len(samples) < settle + 2 * lead_frames:
            continue
        deviation = samples - samples[:settle].mean(axis=0)
        # moving sums as differences of running ones
        total = np.vstack([np.zeros(deviation.shape[1]), np.cumsum(deviation[settle:], axis=0)])
        moving = np.abs(total[mean_frames:] - total[:-mean_frames]).max(axis=1) / mean_frames
        quiet = moving[: lead_frames - mean_frames + 1].max()
        rows.append((quiet, np.quantile(moving, 0.99), np.abs(deviation).max()))
    if not rows:
        return None
    lead, peak, largest = np.array(rows).T
    noise = float(np.quantile(lead, 0.9))
    clear = peak[peak > 3 * noise]  # a recording without a touch must not count as one with a weak touch
    signal = float(np.quantile(clear if len(clear) else peak, 0.1))
    # the geometric mean is as many times above the noise as below the signal
    threshold = int(np.clip(round(max(np.sqrt(noise * signal), signal / 4)), 1, 65535))
    clip = int(np.ceil(max(1.5 * np.median(largest), 2 * peak.max())))
    ratio = float(np.median(lead / np.maximum(peak, 1e-9)))
    return OnsetRule(
        noise, signal, threshold, clip if clip < min(largest.max(), 65536) else 0, ratio, largest
    )


def _onset_rule(sample: Recordings, recordings: Recordings, base: Record) -> tuple[Record, list[str], int]:
    """Fields of the onset rule, the reasons, and the median onset frame (0 where the gate opens at once)."""
    at_once = dict(onset="immediate", rest="initial", clip=0)
    mean_frames = base["onset_mean_frames"]
    rule = measure_onset(sample, base["rest_frames"], mean_frames)
    if rule is None:
        return at_once, ["recordings are too short for an onset rule, so the gate opens at once"], 0
    if rule.ratio >= IN_CONTACT:
        how_far = f"their first moments already move {rule.ratio:.2f} times as far as their peak"
        return at_once, [f"recordings start in contact ({how_far}), so the gate opens at once"], 0

    fields = dict(onset="baseline", rest="tracked", onset_threshold=rule.threshold, clip=rule.clip)
    onsets = find_onsets(
        for_recordings(AcceleratorConfig(), recordings, **base, **fields, hop=1, window=2, steps=1), sample
    )
    touched = onsets >= 0
    rule_text = (
        f"a taxel's mean over {mean_frames} frames leaves its tracked rest level by more than "
        f"{rule.threshold} codes"
    )
    outcome = f"found in {touched.sum()} of {len(sample)} recordings looked at"
    if touched.mean() < 0.5:
        return at_once, [f"no onset rule works ({rule_text}: {outcome}), so the gate opens at once"], 0
    reasons = [
        f"onset when {rule_text} (noise {rule.noise:.3g}, weakest signals {rule.signal:.3g} codes): {outcome}"
    ]
    if rule.clip:
        reasons.append(
            f"single samples are clipped at {rule.clip} codes from rest: some reach {rule.largest.max():.0f} "
            f"codes, and the median recording reaches {np.median(rule.largest):.0f}"
        )
    if touched.mean() < 0.9:
        reasons.append(
            "many recordings have no onset: leave out those without a touch, or give your own configuration"
        )
    return fields, reasons, int(np.median(onsets[touched]))
