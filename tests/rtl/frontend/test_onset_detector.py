"""rtl/frontend/onset_detector.py against the golden model, frame by frame."""

import numpy as np
import pytest

from eskin.rtl.frontend.onset_detector import OnsetDetector
from eskin.rtl.frontend.rest_level import exact_reciprocal
from tests.support.front_end_cases import CASES, REST, detect, frame_beats, make_stream, sample_beats
from tests.support.stream_bench import SIDES, Bench, values
from tests.support.table import each_row


def run(config, beats, *, stalls=(0.0, 0.0), seed=0):
    """Beats out, cycles in, and the cycles of the watched flags; ``fault_flags``: the flags at the end."""
    dut = OnsetDetector(config)
    bench = Bench(dut, seed=seed)
    accepted = bench.drive(dut.i, beats, stall=stalls[0])
    out = bench.collect(dut.o, stall=stalls[1])
    flags = {
        name: bench.watch(getattr(dut.status, name))
        for name in ("started", "framing_fault", "armed", "touch")
    }

    async def set_mask(ctx):
        ctx.set(dut.mask, sum(1 << taxel for taxel in config.sensor.masked_taxels))

    bench.process(set_mask)
    bench.run()
    return out, accepted, flags


PAIRS = (
    "thesis 6 taxels",
    "no pretrigger",
    "immediate touch, faults",
    "band clipped, faults",
    "band initial",
    "band tracked",
    "pvdf 64",
    "two taxels",
    "one block",
    "every frame",
    "thesis faults",
    "synthetic faults",
    "pvdf faults",
    "every frame, 5 of 7",
    "fabric",
    "short first window",
)
"""Cases in which every pair of rest level, onset rule, window mode, clip, filter and fault flags meets;
windows are not the detector's."""


@pytest.mark.parametrize("name", PAIRS)
def test_equal_to_the_golden_model_with_stalls(name):
    config = CASES[name]
    stream = make_stream(config, 250, seed=11)
    seen = detect(config, stream)
    # or the test would show little
    assert len(seen.touches) == 1 if config.opens_at_once else len(seen.touches) >= 2
    out, _, flags = run(config, sample_beats(stream), stalls=SIDES[len(name) % 3], seed=1)
    assert values(out) == frame_beats(config, seen)
    onsets = [out[(f or 1) * config.sensor.taxels - 1].cycle for f, *_ in seen.touches]
    assert flags["started"] == onsets and not flags["framing_fault"]


@pytest.mark.parametrize("name", ["thesis", "band tracked", "synthetic", "pvdf"])
def test_full_rate_and_latency(name):
    """One beat a cycle; a block end of the baseline rule costs three cycles; `armed` and `touch` follow each
    frame."""
    config = CASES[name]
    stream = make_stream(config, 120, seed=3)
    seen = detect(config, stream)
    out, accepted, flags = run(config, sample_beats(stream))
    assert values(out) == frame_beats(config, seen)
    latency = {"thesis": 1, "band tracked": 2, "synthetic": 2, "pvdf": 3}[name]
    taxels = config.sensor.taxels
    for index, (cycle, beat) in enumerate(zip(accepted, out, strict=True)):
        frame, taxel = index // taxels + 1, index % taxels
        done = frame if taxel == taxels - 1 else frame - 1
        blocks = done // config.onset_rule.onset_check_frames if config.onset_rule.onset == "baseline" else 0
        assert beat.cycle == index + latency + 3 * blocks
        assert cycle <= beat.cycle - latency
    for name in ("armed", "touch"):
        high = set(flags[name])
        # after a frame's last beat left: its state holds until the next frame's last beat
        after = [int(out[(t + 1) * taxels - 1].cycle + 1 in high) for t in range(len(stream))]
        expected = seen.armed if name == "armed" else [*seen.touch[1:], after[-1]]
        assert after == expected, name


@each_row("excess", [0, 1])
@each_row("sign", [-1, 1])
@each_row("name, begin, frames", [("thesis", 0, 0), ("pvdf", 20, 8), ("one block", 1, 3)])
def test_a_band_and_a_threshold_must_be_exceeded(name, begin, frames, sign, excess):
    """A sample at the band's edge or beyond; a moving sum of 8 frames, judged every 4; the first of 4, of which one makes
    the level."""
    config = CASES[name].replace(**dict(rest="initial", clip=0) if frames else {})
    stream, rule = np.full((40, config.sensor.taxels), REST), config.onset_rule
    if frames:
        stream[begin : begin + frames, 2] += sign * rule.onset_threshold
        stream[begin + 1, 2] += sign * (rule.onset_threshold * (rule.onset_mean_frames - frames) + excess)
    else:
        stream[24, 3] += sign * (100 + excess)
    out, _, flags = run(config, sample_beats(stream))
    assert values(out) == frame_beats(config, detect(config, stream))
    assert len(flags["started"]) == excess


def test_every_touch_that_is_followed_may_be_the_longest():
    windows = dict(window_mode="whole", store_per_window=2, touch_frames=16, hop=2, window=4, steps=2)
    config = CASES["thesis"].replace(pretrigger_frames=0, decision="last", **windows)
    stream = np.full((90, 4), REST)
    stream[[*range(5, 30), *range(38, 41), *range(54, 80)]] += 200  # too early for another touch in between
    flags = run(config, sample_beats(stream))[2]
    (pause,) = np.flatnonzero(np.diff(flags["touch"]) > 1) + 1
    assert [pause, len(flags["touch"])] == [16 * 4, 32 * 4]
    assert np.diff(flags["started"]).tolist() == [(54 - 5) * 4]


@each_row("toward", [0, 1])
def test_every_level_between_two_codes(toward):
    """It settles, and shows where it is by the frame in which it has come half of the way to a code."""
    config, taxels = CASES["band tracked"].replace(taxels=20, rest_frames=20), np.arange(20)
    stream = REST + np.vstack([taxels[:, None] < taxels, np.full((12, 20), toward)])
    assert values(run(config, sample_beats(stream))[0]) == frame_beats(config, detect(config, stream))


def repaired(stream, beats_of_frame):
    """The frames the detector makes of broken ones: missing taxels repeat the last sample."""
    rows = [
        list(frame[:count]) + [frame[count - 1]] * (len(frame) - count)
        for frame, count in zip(stream, beats_of_frame, strict=True)
    ]
    return np.array(rows)


@each_row(
    "fault, name, stall",
    [
        ("early first", "thesis", 0.0),
        ("early last", "pvdf", 0.3),
        ("late last", "pvdf", 0.0),
        ("stray beats", "thesis", 0.3),
    ],
)
def test_framing_faults_are_flagged_and_the_next_frame_is_whole(fault, name, stall):
    """Two faults at full rate, two with stalls; two with one rule, two with the other."""
    config = CASES[name]
    stream = make_stream(config, 110, seed=4)
    taxels, whole = config.sensor.taxels, sample_beats(stream)
    counts, beats, faults = [taxels] * len(stream), [], 0
    for t in range(len(stream)):
        frame = [dict(beat) for beat in whole[t * taxels : (t + 1) * taxels]]
        if t % 37 == 30:
            if fault in ("early first", "early last"):
                counts[t] = 1 + t % 3
                frame = frame[: counts[t]]
                frame[-1]["last"] = int(fault == "early last")
                faults += 1
            elif fault == "late last":
                frame[-1]["last"] = 0
                faults += 1
            else:
                frame += [{"sample": 0, "first": 0, "last": int(number == 1)} for number in range(3)]
                faults += 3
        beats += frame
    out, _, flags = run(config, beats, stalls=(stall, stall), seed=9)
    assert values(out) == frame_beats(config, detect(config, repaired(stream, counts)))
    assert len(flags["framing_fault"]) == faults


@each_row("divisor", [3, 5, 6, 7, 48, 100, 4095])
def test_reciprocal_is_exact(divisor):
    largest = 16 * divisor * 65535 + divisor // 2
    factor, shift = exact_reciprocal(divisor, largest)
    multiples = np.arange(0, largest + 1, divisor, dtype=np.int64)
    for number in (multiples, np.minimum(multiples + divisor - 1, largest)):  # where a floor can go wrong
        some = number[:: max(1, len(number) // 5000)]
        assert all(int(n) * factor >> shift == int(n) // divisor for n in [*some, largest])
