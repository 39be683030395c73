"""Damaged inputs, odd command lines and odd calls from Python: no traceback, no hang, nothing written
elsewhere, no input changed, memory bounded. A few here, 10 000 with ``make fuzz``; then, that the fuzzer sees
each kind of defect, and what it found."""

import functools
import resource
import zipfile
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import event, example, given, note
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

import eskin
from eskin.cli import common as reader
from eskin.data import load_recordings, turns
from eskin.golden.core import ArchiveError, InputError, read_arrays
from eskin.golden.core.files import MOST_UNPACKED_BYTES
from scripts import ROOT
from tests.support import doors, watched
from tests.support.fuzz_inputs import commands, damaged, header, make_case, make_corpus
from tests.support.result_case import CONFIG
from tests.support.strategies import LONG, examples
from tests.support.table import refused
from tests.support.traffic_case import judge, meddling, recovery, small_case

SHARES = {commands: (8, 400, 8), damaged: (16, 400, 16)}
"""Examples in ``make test``; in ``make fuzz``, and in how many parts."""
BUILDS = Path("build/simulators")


@pytest.fixture(scope="module")
def corpus(tmp_path_factory):
    return make_corpus(tmp_path_factory.mktemp("corpus"))


@pytest.fixture(scope="module", autouse=True)
def one_scene():
    """The synthetic scene is made once, not in every child."""
    with pytest.MonkeyPatch.context() as patch:
        made = functools.cache(turns.turn_recordings)
        patch.setattr(turns, "turn_recordings", made)
        patch.setattr("eskin.data.load.turn_recordings", made)
        yield


def judged(corpus, tmp_path_factory, make, rng, run=watched.watched) -> str:
    """How the input that ``make`` makes of ``rng`` ends."""
    case = tmp_path_factory.mktemp("case")
    make_case(corpus, case)
    words = make(case, rng)
    note(f"in {case}: eskin {' '.join(map(repr, words))}")
    verdict = run(case, words)
    event(verdict.outcome)
    assert verdict.outcome in watched.ENDS.values(), verdict
    return verdict.outcome


@pytest.mark.timeout(0 if LONG else 600)
@pytest.mark.parametrize(
    "make, part",
    [(make, part) for make, (_, _, parts) in SHARES.items() for part in range(parts if LONG else 1)],
)
def test_every_input_ends_well(corpus, tmp_path_factory, make, part):
    quick, long, _ = SHARES[make]
    ends = Counter()

    @examples(quick, long)
    @given(rng=st.randoms(use_true_random=False))
    def check(rng):
        ends[judged(corpus, tmp_path_factory, make, rng)] += 1

    check()
    expected = {"refused", "long work"} if LONG else {"refused"}  # a dozen may meet no long command
    assert expected <= ends.keys(), f"the inputs no longer reach every end: {ends}"


@pytest.mark.timeout(0 if LONG else 600)
@examples(1, 200)
@given(seed=st.integers(0, 10**6))
def test_traffic_on_the_bus_does_no_lasting_harm(tmp_path_factory, seed):
    """Rubbish, then a good host; and harmless traffic in the middle of a recording."""
    case, folder = small_case(), tmp_path_factory.mktemp("traffic")
    for script in (recovery(case, str(seed)), meddling(case, str(seed), case.open_frames(folder))):
        assert judge(script, case, folder, BUILDS)[1] == []


@pytest.mark.timeout(0 if LONG else 180)
@examples(40, 2000)
@given(rng=st.randoms(use_true_random=False))
def test_a_recorders_file_gives_what_was_recorded_or_is_refused(tmp_path_factory, rng):
    """Of every class the same samples in the same order, at the same rate."""
    numbers = np.random.default_rng(rng.randrange(1 << 30))
    level = rng.choice((0.0, 1.8))
    signals = [np.round(numbers.normal(level, 0.3, (numbers.integers(24, 60), 3)), 4) for _ in range(6)]
    labels = [rng.choice(("felt", "silk")) for _ in range(4)] + ["felt", "silk"]
    path, reading = doors.drawn_form(signals, labels, tmp_path_factory.mktemp("form"), rng)
    note(f"{path}: {reading}")
    try:
        read = load_recordings(path, reading=reading)
    except InputError as error:
        event("refused")
        assert "--" in str(error)
        return
    event(path.suffix)
    assert read.class_names == ("felt", "silk") and read.sample_rate_hz == 100 and read.taxels == 3
    for label, name in enumerate(read.class_names):
        right = np.concatenate([signal for signal, of in zip(signals, labels, strict=True) if of == name])
        got = np.concatenate([read.recording(index) for index in np.flatnonzero(read.labels == label)])
        assert got.shape == right.shape and np.abs(got * read.volt_per_code - right).max() < 1e-3


NUMBER = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3)
ODD = st.one_of(
    NUMBER,
    st.binary(max_size=3),
    st.recursive(NUMBER, lambda inner: st.lists(inner, max_size=3), max_leaves=6),
    arrays(
        st.sampled_from(["f8", "f2", "i8", "u8", "c16", "?", "U2", "M8[s]", "i4,f8"]),
        array_shapes(min_dims=0, max_dims=4, max_side=5),
    ),
    st.just(np.array([[None, {}]])),
    st.dictionaries(st.text(max_size=2), NUMBER, max_size=1),
)
FRAMES = np.full((60, CONFIG.sensor.taxels), 1000)
TOUCHES = [FRAMES, FRAMES]
recordings = functools.partial(eskin.Recordings.of, sample_rate_hz=500)
CALLS = {
    "predict": lambda model, odd: model.predict(odd),
    "predict of a list": lambda model, odd: model.predict([FRAMES, odd]),
    "push": lambda model, odd: model.stream().push(odd),
    "score": lambda model, odd: model.score([FRAMES], odd),
    "frames": lambda model, odd: recordings([FRAMES, odd], [0, 1]),
    "labels": lambda model, odd: recordings(TOUCHES, odd),
    "rate": lambda model, odd: recordings(TOUCHES, [0, 1], sample_rate_hz=odd),
    "names": lambda model, odd: recordings(TOUCHES, [0, 1], class_names=odd),
    "groups": lambda model, odd: recordings(TOUCHES, [0, 1], groups={"person": odd}),
    "load": lambda model, odd: eskin.load(odd),
    "Model.load": lambda model, odd: eskin.Model.load(odd),
    "config": lambda model, odd: eskin.Model(odd),
    "groups of a model": lambda model, odd: eskin.Model(groups=odd),
    "folds": lambda model, odd: eskin.Model(folds=odd),
    "cell": lambda model, odd: eskin.Model(cell=f"x{odd}").fit([FRAMES] * 4, [0, 1] * 2, sample_rate_hz=500),
}


@pytest.fixture
def bounded_memory():
    limits, used = (
        resource.getrlimit(resource.RLIMIT_AS),
        int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize(),
    )
    resource.setrlimit(resource.RLIMIT_AS, (used + watched.MEMORY_BYTES, limits[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, limits)


@pytest.mark.timeout(0 if LONG else 180)
@pytest.mark.parametrize("call", CALLS)
@examples(15, 1000)
@given(odd=ODD)
@example(odd=[None, []])  # found by make fuzz: rows of several lengths have no size
def test_an_odd_argument_from_python_is_refused_in_a_sentence(corpus, bounded_memory, call, odd):
    try:
        CALLS[call](eskin.Model.load(corpus / "model"), odd)
    except InputError as error:
        event("refused")
        assert str(error)


BREAKS = {
    "traceback": "def broken(*a, **k): return 1 / 0\n",
    "wrote outside": f"def broken(*a, **k): open({str(ROOT)!r} + '/README.md', 'a').close(); raise "
    "SystemExit(2)\n",
    "hang": "def broken(*a, **k):\n    while True: pass\n",
    "long work": "def broken(*a, **k):\n    for done in range(1, 3): print(f'recordings: {done} of 9', flush=True)\n"
    "    while True: pass\n",
    "long work, in processes": "def broken(*a, **k):\n    from eskin.jobs import Jobs\n    "
    "Jobs(workers=2).results(divmod, {'a': 1, 'b': 2}, 7)\n",
    "too much memory": "def broken(*a, **k): return bytearray(3 << 30)\n",
    "odd status": "def broken(*a, **k): raise SystemExit(7)\n",
    "no sentence": "def broken(*a, **k): raise SystemExit(2)\n",
    "left behind": "def broken(*a, **k): open('.half.tmp', 'w').close(); raise InputError('no')\n",
    "unpickled": "def broken(*a, **k): import pickle; pickle.loads(b'cos\\nsep\\n.'); raise "
    "InputError('no')\n",
    "written by a refused command": "def broken(*a, **k): open('keep', 'w').close(); raise "
    "InputError('no')\n",
    # past Python, so that no audit event tells of it
    "input changed": "def broken(path, **k):\n    import ctypes\n    "
    "ctypes.CDLL(None).truncate(path.encode(), 5)\n    raise SystemExit(0)",
}


@pytest.mark.parametrize("defect", BREAKS)
def test_the_fuzzer_sees(corpus, tmp_path, monkeypatch, defect):
    """The reader of recordings broken in one way."""
    names = {"InputError": InputError}
    exec(BREAKS[defect], names)
    monkeypatch.setattr(reader, "load_recordings", names["broken"])
    monkeypatch.setattr(watched, "PROCESSOR_S", 1)
    make_case(corpus, tmp_path / "case")
    assert (
        watched.watched(tmp_path / "case", ["inspect", "../in/recordings.npz"]).outcome
        == defect.partition(",")[0]
    )


# ---------------------------------------------------------------------- what it found


@pytest.mark.parametrize("model", ["model", "image_model"])
def test_a_board_without_a_host_needs_a_converter(corpus, tmp_path, model):
    make_case(corpus, tmp_path / "case")
    words = ["build", f"../in/{model}", "--target", "icebreaker", "--standalone"]
    verdict = watched.watched(tmp_path / "case", words)
    assert verdict.outcome == "refused" and "add --converter NAME" in verdict.detail


def test_a_picture_does_not_take_the_place_of_a_network(corpus, tmp_path):
    """Nor of anything else that is no picture; a file that a command line names for what it writes is written."""
    make_case(corpus, tmp_path / "case")
    for place, outcome in (("../in/network.pt", "refused"), ("../in/look.png", "done")):
        assert (
            watched.watched(
                tmp_path / "case", ["inspect", "../in/recordings.npz", "--out", place], True
            ).outcome
            == outcome
        )


def test_a_bomb_is_refused_before_it_is_unpacked(tmp_path, monkeypatch):
    monkeypatch.setattr("eskin.golden.core.files.MOST_UNPACKED_BYTES", 1000)
    np.savez_compressed(tmp_path / "bomb.npz", samples=np.zeros(10_000, dtype=np.int32))
    with refused("unpacks to"):
        load_recordings(tmp_path / "bomb.npz")
    assert MOST_UNPACKED_BYTES == 4 << 30
    with zipfile.ZipFile(tmp_path / "lie.npz", "w") as archive:
        archive.writestr("samples.npy", header((2**40, 4)))
    with pytest.raises(ArchiveError, match="damaged"):
        read_arrays(tmp_path / "lie.npz")
