"""Plays recordings through the serial pins of the simulated board and compares its decisions with the golden model's."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from eskin.cosim import runner
from eskin.cosim.scoreboard import DECISION_FIELDS, UNEXPECTED_FAULTS
from eskin.golden.core.config import AcceleratorConfig

HARNESS = Path(__file__).with_name("link_harness.sv")


def pack_decisions(rows: np.ndarray) -> list[int]:
    """32-bit payloads of golden decision rows (columns as eskin.golden.model.pipeline.DECISION_FIELDS)."""
    lows = [low for low, _ in DECISION_FIELDS.values()]
    return [sum(int(value) << low for value, low in zip(row, lows, strict=True)) for row in rows]


def expected_decisions(expected: Mapping[str, np.ndarray]) -> list[list[int]]:
    """Payloads of each recording of eskin.golden.model.vectors.write_vectors."""
    offsets = expected["decision_offsets"]
    return [pack_decisions(expected["decision"][low:high]) for low, high in pairwise(offsets)]


def play_link(
    board: Path,
    config: AcceleratorConfig,
    register_map: Mapping[str, Any],
    loads: Sequence[tuple[int, int]],
    vectors: Path,
    *,
    work: Path,
    builds: Path,
    order: Sequence[int] | None = None,
    corruptions: bool = False,
    seed: int = 1,
    model: str = "fast",
    clocks_per_bit: int = 4,
    limit_s: float = 600.0,
) -> dict[str, Any]:
    """Simulate ``board`` (Verilog, module board_top) and play recordings of ``vectors`` over its serial line.

    Parameters
    ----------
    register_map, loads:
        As registers.json; the writes that load the model.
    order:
        Positions in ``vectors`` to play; default: each once.
    corruptions:
        One in every play but the first of each recording, from ``seed``.
    model:
        ``fast`` or ``cocotbext`` (tests/support/link_bench.py).

    Returns
    -------
    dict
        result.json of tests/support/link_bench.py, and: wrong (plays whose decisions, touches or faults are not
        the golden ones), decisions.

    Raises
    ------
    SimulationError
        The simulator or the bench fails: the link did not recover, say.
    """
    with np.load(vectors) as archive:
        expected = dict(archive)
    parameters = {"CLASSES": config.classes, "CLOCKS_PER_BIT": clocks_per_bit}
    simulator = runner.build("verilator", [board], parameters, builds, harness=HARNESS)
    work.mkdir(parents=True, exist_ok=True)
    settings = {
        "map": register_map,
        "loads": [[int(address), int(word)] for address, word in loads],
        "vectors": str(vectors.resolve()),
        "order": list(range(len(expected["numbers"]))) if order is None else list(order),
        "corruptions": corruptions,
        "seed": seed,
        "model": model,
        "clocks_per_bit": clocks_per_bit,
    }
    (work / "link_bench.json").write_text(json.dumps(settings))
    wall_s = runner.run(simulator, work, {}, limit_s=limit_s, bench="tests.support.link_bench")
    result = json.loads((work / "result.json").read_text())
    wanted = expected_decisions(expected)
    result["wrong"] = [
        played
        for played in result["played"]
        if played["decisions"] != wanted[played["position"]]
        or played["touches"] != expected["touches"][played["position"]]
        or played["faults"] & UNEXPECTED_FAULTS
    ]
    result["decisions"], result["wall_s"] = sum(len(played["decisions"]) for played in result["played"]), wall_s
    return result
