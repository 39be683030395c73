"""Recordings over the serial pins of the simulated board, by the host's own code, undisturbed and with every kind of damage."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from cosim.link_flow import play_link
from golden.config import AcceleratorConfig
from golden.model import random_integer_model
from golden.pipeline import run
from golden.vectors import random_recordings, write_vectors
from rtl.export import export_board
from rtl.generate import boot_writes, register_map

ROOT = Path(__file__).resolve().parent.parent
BUILDS = ROOT / "build" / "simulators"
CONFIG = AcceleratorConfig(
    taxels=4, hidden=4, band_low=25920, band_high=26880, hop=4, window=9, touch_frames=24, steps=5, pretrigger_frames=3,
    rearm_frames=12, decision="vote", lanes=2,
)  # fmt: skip
LENGTHS = (90, 40, 60, 12, 5)
"""Several touches, a partial one, no touch."""


@pytest.fixture(scope="session")
def board(tmp_path_factory):
    """``board(**options)``: the small board played; see play_link."""
    model = random_integer_model(CONFIG, 5)
    folder = tmp_path_factory.mktemp("board")
    recordings = random_recordings(model.config, LENGTHS, seed=4)
    trace = run(model, recordings)
    assert len(trace.streams["decision"][0]) > 10 and trace.partial.any() and (trace.first < 0).any()
    vectors = write_vectors(folder / "vectors.npz", trace, recordings)
    verilog = folder / "board_top.sv"
    verilog.write_text(export_board(model.config, clock_hz=12e6, baud=3e6))

    def play(**options):
        return play_link(
            verilog, model.config, register_map(model.config), boot_writes(model.config, model.arrays), vectors,
            work=folder / "work", builds=BUILDS, **options,
        )  # fmt: skip

    return play


def test_decisions_over_the_pins_are_golden(board):
    result = board()
    assert not result["wrong"] and result["decisions"] > 10
    assert result["repeated"] == result["replayed"] == result["unanswered"] == result["damaged"] == 0
    for played in result["played"]:
        last = played["decisions"][-1] if played["decisions"] else 0
        if last >> 29 & 1:
            assert played["pins"] == last & 31


def check_corruptions(result, count: int) -> None:
    done = Counter((played["done"][0], played["done"][1]) for played in result["played"] if played["done"])
    assert done.total() == count and not result["wrong"]
    print(done, {key: result[key] for key in ("repeated", "replayed", "unanswered", "damaged", "cycles", "wall_s")})
    noticed = Counter(played["done"][0] for played in result["played"] if played["done"] and any(played["noticed"]))
    print(noticed)


def test_every_kind_of_damage_once_or_twice(board):
    count = 60
    check_corruptions(board(order=[*range(5), *(k % 5 for k in range(count))], corruptions=True, seed=3), count)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_thousand_corruptions(board):
    count = 1000
    check_corruptions(board(order=[*range(5), *(k % 5 for k in range(count))], corruptions=True, seed=7), count)


def test_a_model_of_someone_elses_at_the_pins(board):
    result = board(order=[2], model="cocotbext")
    assert not result["wrong"] and result["decisions"] and result["repeated"] == 0
