"""rtl/frontend/touch_divider.py: sums of windows that divide a touch, against the golden division of its frames."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from eskin.golden.core import AcceleratorConfig
from eskin.golden.model.preprocess import Ended, divided, window_values
from eskin.rtl.frontend.touch_divider import TouchDivider
from tests.support.front_end_cases import BAND, BASE
from tests.support.strategies import examples
from tests.support.stream_bench import SIDES, play, values


def frame_beats(
    config: AcceleratorConfig, deviations: np.ndarray, loud: np.ndarray, masked: list[int]
) -> list[dict]:
    """Beats of a whole touch."""
    frames, taxels = deviations.shape
    ends = {"end": True, "longest": frames == config.last_frame}
    return [
        {"complement": ~int(value), "touch": 1, "loud": int(loud[t] and taxel == taxels - 1)}
        | {name: int(high and (t, taxel) == (frames - 1, taxels - 1)) for name, high in ends.items()}
        | {"masked": masked[taxel]}
        for t in range(frames)
        for taxel, value in enumerate(deviations[t])
    ]


def window_beats(
    config: AcceleratorConfig, deviations: np.ndarray, loud: np.ndarray, masked: list[int]
) -> list[dict]:
    """What leaves for it."""
    frames = len(deviations)
    spans, lengths, doublings = divided(
        config, Ended(1, max(np.flatnonzero(loud) + 1, default=0), frames, False)
    )
    sums, complete = window_values(config, deviations, 1, spans, doublings)
    return [
        {"complement": ~int(value), "taxel": place // config.kinds, "length": int(lengths[k])}
        | ({"kind": place % config.kinds} if config.kinds > 1 else {})
        | {"final": int(k == config.windows.steps - 1), "partial": int(frames == config.last_frame)}
        | {"masked": masked[place // config.kinds]}
        for k in range(complete)
        for place, value in enumerate(sums[k])
    ]


@examples(10, 400)
@given(
    taxels=st.integers(1, 3),
    hop=st.integers(1, 4),
    steps=st.integers(1, 4),
    store=st.integers(2, 3),
    kinds=st.sampled_from(
        [("mean",), ("mean", "integral", "highest", "lowest"), ("mean", "integral"), ("lowest",)]
    ),
    knee=st.sampled_from([0, 8]),
    stalls=st.sampled_from([(0.0, 0.0), *SIDES]),
    seed=st.integers(0, 1 << 30),
)
def test_any_touches(taxels, hop, steps, store, kinds, knee, stalls, seed):
    """Touches one behind the other, too short for a sum up to the longest, of the largest deviations too."""
    store += steps * store % 2  # sums are added in pairs
    whole = dict(window_mode="whole", rearm_frames=5, decision="last")
    whole |= dict(hop=hop, window=2 * hop, steps=steps, touch_frames=13 * hop * steps)
    whole |= dict(taxels=taxels, store_per_window=store, feature_kinds=kinds, fault_frames=8)
    # with knee 0 a companded integral is wider than any sum that is stored
    whole |= dict(integral_knee=knee, integral_frac=12 - knee // 2, clip=0 if knee else 7)
    config = AcceleratorConfig.of(**(BASE | BAND | whole))
    rng, bound = np.random.default_rng(seed), config.deviation_bound
    given_beats, expected = [], []
    for frames in (*rng.integers(1, config.last_frame, 2), rng.integers(1, hop + 1), config.last_frame):
        deviations = rng.choice(
            [-bound, bound, 0, 3][: 1 if frames == config.last_frame else 4], (frames, taxels)
        )
        touch = (deviations, rng.random(frames) < rng.choice([0.0, 0.3]), rng.integers(0, 2, taxels).tolist())
        given_beats += frame_beats(config, *touch)
        expected += window_beats(config, *touch)
    out, cycles = play(TouchDivider(config), given_beats, stalls=stalls, seed=seed, quiet=500)
    assert values(out) == expected
    assert stalls[0] or taxels < 3 or cycles[2] == cycles[0] + 2, "a beat a cycle"
