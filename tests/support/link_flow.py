"""Plays recordings through the serial pins of the simulated board and compares its decisions with the golden
model's."""

import random
import time
from collections.abc import Callable, Mapping, Sequence
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


def pack_decisions(config: AcceleratorConfig, rows: np.ndarray) -> list[int]:
    """32-bit payloads of golden decision rows (columns as eskin.golden.model.pipeline.DECISION_FIELDS)."""
    return [pack_decision(config, row) for row in rows]


def expected_decisions(config: AcceleratorConfig, expected: Mapping[str, np.ndarray]) -> list[list[int]]:
    """Payloads of each recording of eskin.golden.model.vectors.write_vectors."""
    offsets = expected["decision_offsets"]
    return [pack_decisions(config, expected["decision"][low:high]) for low, high in pairwise(offsets)]


def play_link(
    integers: IntegerModel,
    vectors: Path,
    *,
    order: Sequence[int] | None = None,
    corruptions: bool = False,
    seed: int = 1,
    clocks_per_bit: int = 4,
) -> dict[str, Any]:
    """Simulate the board of a model and play recordings of ``vectors`` over its serial line.

    Parameters
    ----------
    order:
        Positions in ``vectors`` to play; default: each once.
    corruptions:
        One in every play but the first of each recording, from ``seed``.

    Returns
    -------
    dict
        What `converse` gives, and: wrong (plays whose decisions, touches or faults are not
        the golden ones), decisions.

    Raises
    ------
    SimulationError
        The simulator or the bench fails: the link did not recover, say.
    """
    with np.load(vectors) as archive:
        expected = dict(archive)
    config = integers.config
    settings = {
        "map": register_map(config),
        "loads": [[int(address), int(word)] for address, word in boot_writes(config, integers.arrays)],
        "vectors": str(vectors.resolve()),
        "order": list(range(len(expected["numbers"]))) if order is None else list(order),
        "corruptions": corruptions,
        "seed": seed,
        "clocks_per_bit": clocks_per_bit,
    }
    begun = time.monotonic()
    device = Device(
        Design(text_of(System(config, clock_hz=12e6, baud=3e6), "board_top"), BUILDS, top="board_top")
    )
    device.put("rx", 1)
    device.reset()

    def pins() -> int:
        return device.get("decision").bit_length() - 1 if device.get("decision_valid") else -1

    result = converse(PinPort(device, clocks_per_bit), settings, pins) | {"cycles": device.state.cycle}
    wall_s = time.monotonic() - begun
    wanted = expected_decisions(config, expected)
    result["wrong"] = [
        played
        for played in result["played"]
        if played["decisions"] != wanted[played["position"]]
        or played["registers"]["TOUCHES"] != expected["touches"][played["position"]]
        or played["registers"]["STATUS"] != expected["status"][played["position"]]
        # flags of taxels, and what the pace alone decides
        or played["registers"]["FAULTS"] & ~(INPUT_STALLED | OVERRUN | 0x40)
    ]
    result["decisions"], result["wall_s"] = (
        sum(len(played["decisions"]) for played in result["played"]),
        wall_s,
    )
    return result


def converse(port, settings: dict, pins: Callable[[], int]) -> dict:
    """The session: the same calls that a board gets."""
    with np.load(settings["vectors"]) as archive:
        samples, offsets = archive["samples"], archive["offsets"]
    rng = random.Random(settings["seed"])
    noisy = NoisyPort(port, settings["seed"], settings["map"]["registers"]["STATUS"])
    link = Link(noisy, settings["map"], timeout_s=TIMEOUT_BYTES)
    link.connect()
    link.load(settings["loads"])
    played = []
    lengths: dict[int, dict[str, int]] = {}  # bytes each way of a recording played undisturbed
    for turn, position in enumerate(settings["order"]):
        kind = (
            NoisyPort.KINDS[turn % len(NoisyPort.KINDS)]
            if settings["corruptions"] and position in lengths
            else None
        )
        noisy.arm(kind or ("none", "none"), rng.randrange(lengths[position][kind[1]]) if kind else 0)
        counts = link.repeated, link.replayed, link.unanswered, link.damaged
        got = link.play(samples[offsets[position] : offsets[position + 1]])
        after = link.repeated, link.replayed, link.unanswered, link.damaged
        if kind is None:
            lengths[position] = dict(noisy.passed)
        played.append(
            {
                "position": position,
                "decisions": got.decisions,
                "registers": got.registers,
                "done": noisy.done,
                "noticed": [new - old for new, old in zip(after, counts, strict=True)],
                "pins": pins(),
                "where": [
                    link.read(name)
                    for name in ("POSITION", "POSITION_PEAK", "POSITIONS")
                    if name in settings["map"]["registers"]
                ],
            }
        )
    return {
        "played": played,
        "repeated": link.repeated,
        "replayed": link.replayed,
        "unanswered": link.unanswered,
        "damaged": link.damaged,
    }
