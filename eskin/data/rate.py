"""Plausibility of the declared sample rate, from the recordings."""

import numpy as np

from eskin.golden.data.recordings import Recordings

SHORTEST_S, LONGEST_S = 0.05, 1800.0
"""Between these lies the time that a hand, an arm or a machine takes to touch something, with room on both
sides."""
DURATIONS = {"duration_ms": 1e-3, "duration_s": 1.0}
"""Group arrays that tell how long each recording took, and their unit in seconds."""
RATE_ERROR = 0.05
"""Largest deviation of such an array from the declared rate: an oscillator without a crystal is off by as
much."""


def wrong_rate(recordings: Recordings) -> list[str]:
    """A sentence where the declared sample rate cannot be right: by what the recordings say of their
    duration, or by how short or long no touch is."""
    rate, lengths = recordings.sample_rate_hz, recordings.lengths
    follow = "windows, latency and budgets follow the rate"
    for name, unit in DURATIONS.items():
        stated_s = np.asarray(recordings.groups.get(name, []), dtype=float) * unit
        if len(stated_s) and (stated_s > 0).all():
            measured = float(np.median(lengths / stated_s))
            if abs(measured / rate - 1) > RATE_ERROR:
                return [
                    f"the archive declares {rate:.4g} frames a second and its array {name} makes it "
                    f"{measured:.4g}: "
                    f"correct sample_rate_hz or {name}, since {follow}"
                ]
    middle = float(np.median(lengths)) / rate
    if SHORTEST_S <= middle <= LONGEST_S:
        return []
    span = f"only {1000 * middle:.3g} ms" if middle < SHORTEST_S else f"{middle / 60:.3g} minutes"
    return [
        f"at the declared {rate:.4g} frames a second a recording lasts {span}: check sample_rate_hz, since "
        f"{follow}"
    ]
