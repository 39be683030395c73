"""Recordings through the serial pins of the simulated board, its decisions beside the golden model's."""

import random
from collections.abc import Sequence
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from eskin.cosim.device import Design, Device
from eskin.cosim.scoreboard import INPUT_STALLED, OVERRUN
from eskin.golden.core import AcceleratorConfig
from eskin.golden.model import IntegerModel
from eskin.live.link import Link
from eskin.rtl.fpga.export import verilog as text_of
from eskin.rtl.fpga.generate import boot_writes, pack_decision, register_map
from eskin.rtl.top.system import System
from tests.support.noisy_port import NoisyPort
from tests.support.pin_port import PinPort

BUILDS = Path("build/simulators")
TIMEOUT_BYTES = 60
"""Byte times to wait for an answer: a packet of decision and one of answer, and the cycles in between, take
half of that."""
COUNTS = ("repeated", "replayed", "unanswered", "damaged")
"""What the link notices."""
POSITIONS = ("POSITION", "POSITION_PEAK", "POSITIONS")


def pack_decisions(config: AcceleratorConfig, rows: np.ndarray) -> list[int]:
    """32-bit payloads of golden decision rows (columns as eskin.golden.model.pipeline.DECISION_FIELDS)."""
    return [pack_decision(config, row) for row in rows]


@cache
def board_of(config: AcceleratorConfig) -> Design:
    """The board, to be simulated."""
    return Design(text_of(System(config, clock_hz=12e6, baud=3e6), "board_top"), BUILDS, top="board_top")


def play_link(
    integers: IntegerModel,
    vectors: Path,
    *,
    order: Sequence[int] | None = None,
    corruptions: bool = False,
    seed: int = 1,
) -> dict[str, Any]:
    """Simulate the board of a model and play recordings of ``vectors`` over its serial line, by the same calls that a
    board gets.

    Parameters
    ----------
    order:
        Positions in ``vectors`` to play; default: each once.
    corruptions:
        One in every play but the first of each recording, from ``seed``.

    Returns
    -------
    dict
        played: of each play its decisions and registers, the damage done, what the link noticed, the class on the
        pins, the registers of positions. wrong: plays whose decisions, touches or faults are not the golden ones.
        decisions: their number; repeated, replayed, unanswered, damaged: counts of the link.

    Raises
    ------
    SimulationError
        The simulator or the bench fails: the link did not recover, say.
    """
    with np.load(vectors) as archive:
        golden = dict(archive)
    config, recordings = integers.config, [*pairwise(golden["offsets"])]
    mapped = register_map(config)
    device = Device(board_of(config))
    device.put("rx", 1)
    device.reset()
    rng = random.Random(seed)
    noisy = NoisyPort(PinPort(device, clocks=4), seed, mapped["registers"]["STATUS"])
    link = Link(noisy, mapped, timeout_s=TIMEOUT_BYTES)
    link.connect()
    link.load(boot_writes(config, integers.arrays))
    played: list[dict[str, Any]] = []
    wrong = []
    lengths: dict[int, dict[str, int]] = {}  # bytes each way of a recording played undisturbed

    def counts() -> tuple[int, ...]:
        return tuple(getattr(link, name) for name in COUNTS)

    for turn, position in enumerate(range(len(recordings)) if order is None else order):
        noise = corruptions and position in lengths
        kind = NoisyPort.KINDS[turn % len(NoisyPort.KINDS)] if noise else ("none", "none")
        noisy.arm(kind, rng.randrange(lengths[position][kind[1]]) if noise else 0)
        before = counts()
        got = link.play(golden["samples"][slice(*recordings[position])])
        if not noise:
            lengths[position] = dict(noisy.passed)
        where = [link.read(name) for name in POSITIONS if name in mapped["registers"]]
        lit = device.get("decision").bit_length() - 1 if device.get("decision_valid") else -1
        play = {"decisions": got.decisions, "done": noisy.done, "pins": lit, "where": where}
        played.append(play | {"noticed": np.subtract(counts(), before).tolist()})
        low, high = golden["decision_offsets"][position : position + 2]
        faults = got.registers["FAULTS"] & ~(
            INPUT_STALLED | OVERRUN | 0x40
        )  # flags of taxels, and of the pace alone
        if (
            got.decisions != pack_decisions(config, golden["decision"][low:high])
            or got.registers["TOUCHES"] != golden["touches"][position]
            or got.registers["STATUS"] != golden["status"][position]
            or faults
        ):
            wrong.append(play | got.registers)
    decisions = sum(len(play["decisions"]) for play in played)
    return {
        "played": played,
        "wrong": wrong,
        "decisions": decisions,
        **dict(zip(COUNTS, counts(), strict=True)),
    }
