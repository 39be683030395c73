"""rtl/frontend/normaliser.py against the formula."""

import numpy as np
import pytest

from eskin.golden.core import clamp
from eskin.rtl.frontend.normaliser import Normaliser
from tests.support.front_end_cases import CASES
from tests.support.stream_bench import Bench, put, values


def shifted(config, shifts=(2, 0, 1, 3)):
    return config.replace(feature_shift=tuple(shifts[: len(config.window_lengths)]))


def means_of(config, seed=0):
    bound = 1 << config.mean_format.width - 3
    return np.random.default_rng(seed).integers(-bound, bound, len(config.window_lengths)).tolist()


def centred_beats(config, sums, lengths, means, masked):
    """Expected beats for sums (windows, taxels) with the given length indices; ``final`` on each ``steps``-th
    window."""
    return [
        {
            "value": 0
            if taxel in masked
            else clamp(
                ((int(d) << config.mean_frac) - means[q])
                >> config.features.feature_shift[q] + config.mean_frac,
                config.centred_format,
            ),
            "length": q,
            "first": int(taxel == 0),
            "last": int(taxel == config.sensor.taxels - 1),
            "final": int((k + 1) % config.windows.steps == 0),
        }
        for k, (window, q) in enumerate(zip(sums, lengths, strict=True))
        for taxel, d in enumerate(window)
    ]


def load_words(config, means):
    """Address and 16-bit word of every load, in the order of the port's description."""
    words = config.mean_words
    return [
        (q * words + word, mean >> 16 * word & 0xFFFF)
        for q, mean in enumerate(means)
        for word in range(words)
    ]


def loader(port, words):
    async def load(ctx):
        for address, word in words:
            put(ctx, port, select=-1, address=address, data=word, enable=1)
            await ctx.tick()
        ctx.set(port.enable, 0)

    return load


@pytest.mark.parametrize(
    "name, shifts, loadable, stalls, aligned",
    [
        ("three end together", (0, 1, 0), True, (0.0, 0.0), False),
        ("three end together", (0, 1, 0), False, (0.3, 0.5), False),
        ("fabric", (3,), False, (0.0, 0.0), False),
        ("fabric", (3,), True, (0.3, 0.0), False),
        ("fabric", (3,), False, (0.0, 0.5), True),
        ("three end together", (-2, 1, 0), True, (0.0, 0.0), False),
        ("fabric", (-3,), False, (0.3, 0.5), True),
    ],
    ids=[
        "full rate",
        "ROM, stalls",
        "ROM, full rate",
        "stalls",
        "ROM, aligned means",
        "means of fractions",
        "ROM, fractions",
    ],
)
def test_equal_to_the_formula(name, shifts, loadable, stalls, aligned):
    """``aligned``: means without the bits that the shift drops, which no register has."""
    config = shifted(CASES[name], shifts).replace(loadable=loadable, aligned_means=aligned)
    means, rng = means_of(config), np.random.default_rng(4)
    if aligned:
        means = [mean & -1 << shifts[0] + config.mean_frac for mean in means]
    span = (1 << config.sum_bits - 1) - 1
    lengths = [config.length_index[k % config.windows.steps] for k in range(30)]
    sums = np.stack(
        [
            rng.integers(-span, span, config.sensor.taxels)
            if k % 3
            else (middle := means[q] >> config.mean_frac)
            + rng.integers(-40000 >> config.mean_frac, 40000 >> config.mean_frac, config.sensor.taxels).clip(
                -span - middle, span - middle
            )
            for k, q in enumerate(lengths)
        ]
    )
    sums[0, 0], sums[1, 1] = span, -span - 1
    beats = [
        {
            "complement": ~int(d),
            "taxel": taxel,
            "length": q,
            "final": int((k + 1) % config.windows.steps == 0),
        }
        for k, (window, q) in enumerate(zip(sums, lengths, strict=True))
        for taxel, d in enumerate(window)
    ]
    masked = (2,)
    dut = Normaliser(config, None if loadable else means)
    bench = Bench(dut, seed=6)
    if loadable:
        bench.process(loader(dut.load, load_words(config, means)))
    accepted = bench.drive(dut.i, beats, stall=stalls[0], after=40)
    out = bench.collect(dut.o, stall=stalls[1])

    async def set_mask(ctx):
        ctx.set(dut.mask, sum(1 << taxel for taxel in masked))

    bench.process(set_mask)
    bench.run()
    expected = centred_beats(config, sums, lengths, means, masked)
    assert values(out) == expected
    numbers = {beat["value"] for beat in expected}
    assert {-32768, 32767} <= numbers and len(numbers) > 20  # both ends of SAT and what lies between
    if stalls == (0.0, 0.0):
        assert [beat.cycle for beat in out] == accepted  # a beat stays until its result is taken
        assert accepted == [accepted[0] + 2 * n + n // config.sensor.taxels for n in range(len(beats))]
