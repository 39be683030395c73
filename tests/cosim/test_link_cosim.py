"""Recordings over the serial pins of the simulated board, by the host's own code, undisturbed and with every
kind of damage."""

from collections import Counter
from pathlib import Path

import pytest

from eskin.golden.model import run, write_vectors
from eskin.golden.model.position import PositionStream
from eskin.rtl.fpga.export import verilog as text_of
from eskin.rtl.fpga.generate import boot_writes, register_map
from eskin.rtl.top.board import Board
from eskin.training.made_up import random_recordings
from tests.support.link_flow import play_link
from tests.support.noisy_port import NoisyPort
from tests.support.random_models import random_integer_model
from tests.support.small_designs import SMALL

ROOT = Path(__file__).resolve().parents[2]
BUILDS = ROOT / "build" / "simulators"
CONFIG = SMALL.replace(
    hop=4,
    window=9,
    touch_frames=24,
    steps=5,
    pretrigger_frames=3,
    rearm_frames=12,
    fault_frames=8,
    fault_activity=60,
    margin_threshold=3,
)
LENGTHS = (90, 40, 60, 12, 5)
"""Several touches, a partial one, no touch."""


def boarded(folder: Path, model, recordings):
    """``play(**options)``: the board of ``model`` played with ``recordings``, see play_link; and the golden
    trace."""
    trace = run(model, recordings)
    vectors = write_vectors(folder / "vectors.npz", trace, recordings)
    verilog = folder / "board_top.sv"
    verilog.write_text(text_of(Board(model.config, clock_hz=12e6, baud=3e6), "board_top"))

    def play(**options):
        return play_link(
            verilog,
            model.config,
            register_map(model.config),
            boot_writes(model.config, model.arrays),
            vectors,
            work=folder / "work",
            builds=BUILDS,
            **options,
        )

    return play, trace


@pytest.fixture(scope="session")
def board(tmp_path_factory):
    """The small board."""
    model = random_integer_model(CONFIG, 5)
    play, trace = boarded(
        tmp_path_factory.mktemp("board"), model, random_recordings(model.config, LENGTHS, seed=5)
    )
    assert len(trace.streams["decision"][0]) > 10 and trace.partial.any() and (trace.first < 0).any()
    # unsure ones too
    assert (
        set(trace.global_margin < CONFIG.network.margin_threshold) == {False, True}
        and trace.touches.faults.any()
    )
    return play


def test_decisions_over_the_pins_are_golden(board):
    result = board()
    assert not result["wrong"] and result["decisions"] > 10
    assert result["repeated"] == result["replayed"] == result["unanswered"] == result["damaged"] == 0
    for played in result["played"]:
        last = played["decisions"][-1] if played["decisions"] else 0
        if last >> 29 & 1:
            assert played["pins"] == last & 31


@pytest.mark.slow
def test_positions_of_the_hosts_frames_are_read_over_the_link(tmp_path):
    """Golden ones behind every recording: how many since ARM, and the last."""
    one = dict(taxels=16, position=True, position_rest=28000, position_threshold=20, slide_least=2)
    model = random_integer_model(CONFIG.replace(**one), 5)
    recordings = random_recordings(model.config, LENGTHS, seed=5)
    play, _ = boarded(tmp_path, model, recordings)
    result = play()
    assert not result["wrong"]
    told = 0
    for number, played in enumerate(result["played"]):
        golden = PositionStream(model.config).push(recordings.recording(number))
        told += len(golden)
        assert played["where"][2] == len(golden)
        if golden:
            last = golden[-1]
            assert played["where"][:2] == [
                last.x | last.y << 8,
                last.peak | last.direction << 8 | last.ended << 11,
            ]
    assert told > 50


def check_corruptions(result, count: int) -> None:
    """At least ``count`` were done, every recording's decisions are golden, and most were noticed: the line
    was really damaged."""
    done = [played for played in result["played"] if played["done"]]
    kinds = Counter(tuple(played["done"][:2]) for played in done)
    assert len(done) >= count and len(kinds) == len(NoisyPort.KINDS) and not result["wrong"]
    noticed = sum(any(played["noticed"]) for played in done)
    assert noticed > 0.7 * len(done)
    print(
        f"{len(done)} corruptions, {noticed} noticed, {result['decisions']} decisions, {result['repeated']} "
        "packets repeated, "
        f"{result['replayed']} recordings played again, {result['cycles']} cycles in {result['wall_s']:.0f} s"
    )


def test_every_kind_of_damage_once_or_twice(board):
    count = 2 * len(NoisyPort.KINDS)
    check_corruptions(
        board(order=[*range(5), *(k % 5 for k in range(count))], corruptions=True, seed=3), count
    )


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_a_thousand_corruptions(board):
    count = 1000
    # A few are aimed at a packet that their recording does not come to.
    check_corruptions(
        board(order=[*range(5), *(k % 5 for k in range(count + 10))], corruptions=True, seed=7), count
    )


@pytest.mark.slow
def test_a_model_of_someone_elses_at_the_pins(board):
    result = board(order=[2], model="cocotbext")
    assert not result["wrong"] and result["decisions"] and result["repeated"] == 0
