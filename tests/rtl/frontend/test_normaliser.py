"""rtl/frontend/normaliser.py against the formula, and the four front-end components in a chain against the
golden preprocessing."""

import numpy as np
import pytest
from amaranth.hdl import ResetInserter, Signal

from eskin.golden.core import clamp
from eskin.golden.data import Recordings
from eskin.golden.model import find_touches
from eskin.rtl.frontend.front_end import FrontEnd
from eskin.rtl.frontend.normaliser import Normaliser
from tests.support.front_end_cases import CASES, make_stream, sample_beats
from tests.support.stream_bench import Bench, put, values


def shifted(config, shifts=(2, 0, 1, 3)):
    return config.replace(feature_shift=tuple(shifts[: len(config.window_lengths)]))


def means_of(config, seed=0):
    bound = 1 << config.mean_format.width - 3
    return np.random.default_rng(seed).integers(-bound, bound, len(config.window_lengths)).tolist()


def centred_beats(config, sums, lengths, means, masked=(), faults=None):
    """Expected beats for sums (windows, taxels) with the given length indices; ``final`` on each ``steps``-th
    window. ``faults`` (windows, taxels)."""
    return [
        {
            "value": 0
            if taxel in masked or (faults is not None and faults[k, taxel])
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
            put(ctx, port, address=address, data=word, enable=1)
            await ctx.tick()
        ctx.set(port.enable, 0)

    return load


@pytest.mark.parametrize(
    "name, shifts, loadable, stalls, aligned",
    [
        ("three end together", (0, 1, 0), True, (0.0, 0.0), False),
        ("three end together", (0, 1, 0), False, (0.3, 0.5), False),
        ("fabric", (3,), False, (0.0, 0.0), False),
        ("fabric", (3,), True, (0.3, 0.5), False),
        ("fabric", (3,), False, (0.3, 0.5), True),
        ("three end together", (-2, 1, 0), True, (0.0, 0.0), False),
        ("fabric", (-3,), False, (0.3, 0.5), False),
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
    taken = bench.drive(dut.i, beats, stall=stalls[0], after=40)
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
        assert [beat.cycle for beat in out] == taken  # a beat stays until its result is taken
        assert taken == [taken[0] + 2 * n + n // config.sensor.taxels for n in range(len(beats))]


# ---------------------------------------------------------------------- the chain
def golden_centred(config, streams, means, masked=()):
    """Expected beats and the number of touches, from golden/model/preprocess.py, one recording a stream."""
    recordings = Recordings(
        samples=np.concatenate(streams).astype(np.int32),
        offsets=np.cumsum([0, *map(len, streams)]),
        labels=np.zeros(len(streams), dtype=np.int64),
        class_names=config.network.class_names,
        sample_rate_hz=config.sensor.sample_rate_hz,
    )
    masked = {*masked, *config.sensor.masked_taxels}
    touches = find_touches(config.replace(masked_taxels=tuple(masked)), recordings)
    beats = []
    for index, (sums, completed) in enumerate(zip(touches.sums, touches.completed, strict=True)):
        faults = None if touches.faults is None else touches.faults[index]
        beats += centred_beats(
            config, sums[:completed], config.length_index[:completed], means, masked, faults
        )
    return beats, len(touches)


def run_chain(config, streams, means, *, stalls=(0.0, 0.0), seed=0, masked=(), cuts=()):
    """Centred beats of all recordings in turn, a reset (``arm``) before each. ``cuts``: recordings that stop
    mid-frame, output dropped."""
    dut, reset = FrontEnd(config, None if config.hardware.loadable else means), Signal()
    bench = Bench(ResetInserter(reset)(dut), seed=seed, quiet=200)
    beats, gaps, ends = [], [], []
    for number, stream in enumerate(streams):
        part = sample_beats(stream)[: -2 if number in cuts else None]
        gaps += [400 if number else 40] + [0] * (len(part) - 1)
        beats += part
        ends.append(len(beats))
    taken = bench.drive(
        dut.i, beats, **({"stall": stalls[0]} if len(streams) == 1 else {"gaps": gaps}), after=30
    )
    out = bench.collect(dut.o, stall=stalls[1])
    kept = []

    async def control(ctx):
        ctx.set(dut.mask, sum(1 << taxel for taxel in masked))
        if config.hardware.loadable:
            await loader(dut.load, load_words(config, means))(ctx)
        for number, end in enumerate(ends[:-1]):
            while len(taken) < end:
                await ctx.tick()
            await ctx.tick().repeat(1 if number in cuts else 350)
            if number not in cuts:
                kept.extend(values(out))
            ctx.set(reset, 1)
            await ctx.tick()
            ctx.set(reset, 0)
            out.clear()

    bench.process(control)
    bench.run()
    return kept + values(out)


@pytest.mark.parametrize(
    "name",
    [
        "thesis",
        "fabric",
        "immediate touch, faults",
        "two end together, faults",
        "synthetic faults",
        "pvdf faults",
        "every frame, 5 of 7",
    ],
)
def test_chain_equals_golden(name):
    config = shifted(CASES[name])
    stream, means = make_stream(config, 250, seed=11), means_of(config)
    expected, touches = golden_centred(config, [stream], means)
    assert touches == 1 if config.opens_at_once else touches > 1
    if config.faults.fault_frames:
        assert golden_centred(config.replace(fault_frames=0), [stream], means)[0] != expected
    assert (
        run_chain(config, [stream], means, stalls=(0.3, 0.5), seed=1, masked=config.sensor.masked_taxels)
        == expected
    )


def test_chain_onset_early_late_and_never():
    config = shifted(CASES["thesis"])
    onsets = ([1], [2], [4], [5], [150], [199], [])
    streams, means = [make_stream(config, 200, seed=5, touches=each) for each in onsets], means_of(config)
    expected, touches = golden_centred(config, streams, means)
    assert touches == 6
    assert run_chain(config, streams, means) == expected
