"""eskin/live/hub.py: thinning loses no peak, messages are bounded, lost ones are counted, late viewers get what
they need."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.live import hub as module
from eskin.live.feed import Begin, End, Frames, Onset, Result, Tally
from eskin.live.hub import Hub, Thinner, Viewer


def messages(viewer) -> list[dict]:
    return [json.loads(text) for text in viewer.take()]


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    size=st.integers(1, 9),
    pieces=st.lists(st.integers(1, 13), max_size=12),
    sizes=st.lists(st.integers(1, 9), max_size=12),
    seed=st.integers(0, 99),
)
def test_every_frame_is_in_one_bucket_with_its_extremes(size, pieces, sizes, seed):
    rng = np.random.default_rng(seed)
    samples = rng.integers(-999, 999, (sum(pieces), 3))
    thinner, buckets, at = Thinner(size), [], 0
    for number, piece in enumerate(pieces):
        buckets += thinner.add(at + 1, samples[at : at + piece])
        at += piece
        if number < len(sizes):
            thinner.size = sizes[number]  # in the middle of a bucket: smaller than what it holds, say
    buckets += thinner.rest()
    assert thinner.rest() == []
    frame = 1
    for first, count, low, high, last in buckets:
        part = samples[first - 1 : first - 1 + count]
        assert first == frame and len(part) == count > 0
        assert (low, high, last) == (part.min(axis=0).tolist(), part.max(axis=0).tolist(), part[-1].tolist())
        frame += count
    assert frame == len(samples) + 1


@pytest.fixture
def hub() -> Hub:
    return Hub({"name": "made"}, 1000.0, 2)


def frames(first: int, count: int) -> Frames:
    return Frames(first, np.arange(2 * count).reshape(count, 2))


def test_a_viewer_who_does_not_take_fills_no_memory_and_is_counted(hub):
    slow, quick = Viewer(hub), Viewer(hub)
    hub.publish(Begin(0, 0, 0, np.zeros(2)))
    taken = 0
    for number in range(3000):
        hub.publish(frames(10 * number + 1, 10))
        hub.publish(Onset(number, 10 * number, 1))
        taken += sum(len(message["b"]) for message in messages(quick) if message["k"] == "frames")
    got = messages(slow)
    assert len(got) == module.KEPT + 1 and slow.lost == 6001 - module.KEPT
    assert (quick.lost, taken) == (0, 3000)
    assert got[0]["k"] == "hello" and got[-1]["touch"] == 2999, "the newest stay"


def test_a_late_viewer_gets_this_recording_and_the_results_before_it(hub):
    hub.publish(Begin(0, 0, 0, np.zeros(2)))
    hub.publish(frames(1, 500))
    hub.publish(End(1))
    hub.publish(Result(0, 0, 1, 0.5, 0))
    hub.publish(Begin(7, 0, 0, np.ones(2)))
    hub.publish(frames(1, 4000))
    hub.state(paused=True)
    hub.tally(Tally(frames=900))
    late = Viewer(hub)
    got = messages(late)
    kinds = ["hello", "state", "tally", "result", "begin", "frames", "state", "tally"]
    assert [message["k"] for message in got] == kinds and got[4]["number"] == 7
    assert got[2]["frames"] == 900, "after the last recording no other tally comes"
    assert len(got[5]["b"]) == 400 and late.lost == 0
    hub.publish(Result(7, 0, 1, 0.5, 0))
    assert [message["number"] for message in messages(Viewer(hub)) if message["k"] == "result"] == [0, 7]
    hub.tally(Tally(frames=901, mismatches=2))
    result, tally = messages(late)
    assert (result["number"], tally["frames"], tally["mismatches"]) == (7, 901, 2)
