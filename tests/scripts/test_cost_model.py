"""The constants of the cost model follow from the counted netlists in the documents, and good to 10 %."""

import contextlib
from collections import defaultdict

import numpy as np
import pytest
from amaranth.hdl import Fragment

from eskin.golden.core import AcceleratorConfig, InputError, QFormat
from eskin.golden.core.images import network
from eskin.rtl.fpga import block_memories
from eskin.rtl.fpga.targets import target
from eskin.rtl.program.schedule import decision_cycles, mean_frame_cycles
from eskin.study import energy
from eskin.verbs.cost import CELLS, blocks_of, by_lanes, cost_of, fits, on_board, sizes
from scripts import ROOT
from scripts.cost_model import DESIGNS, TOGGLES, errors, fit, read_rows, without_it
from tests.support.table import each_row


@pytest.fixture(scope="module")
def counted():
    return read_rows((ROOT / "docs/figures.md").read_text())


def test_the_constants_are_those_of_the_counted_netlists(counted):
    toggles, cells = fit(counted)
    assert np.round(toggles).tolist() == [getattr(energy, name) for name in TOGGLES]
    assert list(CELLS.values()) == [round(float(count), 1) for count in cells]


def test_the_designs_are_at_most_a_tenth_off(counted):
    """Energy also with constants that the design did not give."""
    assert len(counted) == len(DESIGNS) == 21
    off = errors(counted, fit(counted))
    assert max(abs(off).max(), abs(without_it(counted)[0]).max()) < 0.1
    for (name, row), joule, cells in zip(counted.iterrows(), *off, strict=True):
        estimated = cost_of(DESIGNS[name])
        assert estimated.energy_touch_j == pytest.approx(1e-6 * row["counted uJ"] * (1 + joule), rel=0.02)
        scheduled, _ = mean_frame_cycles(DESIGNS[name])
        assert scheduled == pytest.approx(row["cycles a frame"], rel=0.013), name
        assert estimated.cells == pytest.approx(row["LUT"] * (1 + cells), rel=0.01), name


def test_block_memories_are_those_of_the_netlists(counted):
    for name, row in counted.iterrows():
        assert blocks_of(DESIGNS[name]) == row["block memories"], name


LINEAR = "8 taxels, mean + activity, linear, P = 2"
LSTM = "12 taxels, mean + integral, LSTM 6, at once, P = 2"
CHANGES = {LINEAR: ("dense", "feature", "logit"), LSTM: ("weight", "recurrent", "feature", "state")}


@each_row("name", CHANGES)
def test_designs_of_the_same_sizes_have_the_same_memories(name):
    """One format after another is moved by a bit, and made a bit narrower."""
    config, found, moved = DESIGNS[name], defaultdict(list), 0
    variants = [config, config.replace(gate_frac=config.formats.gate_frac - 1)]
    for field in CHANGES[name]:
        fmt = getattr(config.formats, f"{field}_format")
        for other in (QFormat(fmt.int_bits + 1, fmt.frac_bits - 1), QFormat(fmt.int_bits, fmt.frac_bits - 1)):
            with contextlib.suppress(InputError):
                variants.append(config.replace(**{f"{field}_format": other}))
    for variant in variants:
        found[sizes(variant)].append(
            list(block_memories._blocks(Fragment.get(block_memories._accelerator(variant), "ice40")))
        )
    for same in found.values():
        assert all(other == same[0] for other in same)
        moved += len(same) > 1
    assert moved and len(found) > 1


def test_lanes_are_at_most_those_that_the_board_has_multipliers_for():
    config = DESIGNS["16 taxels, mean, GRU 8, P = 4"].with_lanes(8, "dsp")
    made = {name: on_board(config, target(name)).hardware for name in ("icebreaker", "ulx3s", "tangnano9k")}
    assert [(of.lanes, of.lane_type) for of in made.values()] == [(7, "dsp"), (8, "plain"), (8, "plain")]
    assert cost_of(config) == cost_of(config.with_lanes(7)) != cost_of(config.with_lanes(6))
    assert fits(config, "ulx3s") and not fits(config, "tangnano9k")


def test_a_network_is_priced_on_every_number_of_lanes():
    config = DESIGNS["16 taxels, mean, GRU 8, P = 4"]
    rows = by_lanes(config)
    assert [row.lanes for row in rows] == list(range(1, 8))
    cost = cost_of(config)
    assert [rows[3].latency_s, rows[3].cells] == [cost.latency_s, cost.cells]
    cells, times = ([row.cells for row in rows], [row.latency_s for row in rows])
    assert cells == sorted(set(cells)) and times == sorted(times, reverse=True)
    assert by_lanes(config.replace(cell="trees", decision="last")) == []


COUNTED = {
    "tactnet": (1253, 1286, 1361, 1551),
    "four": (1291, None, 1414, 1352),
    "tactnet-half": (1186, 1198, 1240, 1360),
}
"""LUT4 of networks for images of 28 x 50 pixels and 22 classes, 8 bits, on 1, 2, 4 and 8 lanes, synthesised."""


def test_cells_of_networks_for_images_are_within_9_percent_of_the_counted():
    for name, counted_cells in COUNTED.items():
        classes = [f"class{number}" for number in range(22)]
        config = AcceleratorConfig.of_image(28, 50, network(name, 22), classes, name=name)
        weights = len(config.weighted_stages)
        config = config.replace(
            weight_formats=(QFormat(1, 7),) * weights,
            map_formats=(QFormat(3, 5, signed=False),) * (weights - 1),
            logit_format=QFormat(8, 8),
        )
        rows = by_lanes(config)
        assert [row.lanes for row in rows] == [1, 2, 4, 8]
        assert rows[-1].latency_s == decision_cycles(config.with_lanes(8)) / 12e6 < rows[0].latency_s / 6
        for row, cells in zip(rows, counted_cells, strict=True):
            assert cells is None or row.cells == pytest.approx(cells, rel=0.09)
