"""Cost against taxels and classes: memory bits against the generated Verilog, weights against the network,
files against the figures."""

import csv
import json
import re
from pathlib import Path

from amaranth.hdl import Module
from amaranth.lib import wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from eskin.golden.core import PRESETS, AcceleratorConfig
from eskin.rtl.fpga.export import export
from eskin.rtl.program.microcode import Microcode
from eskin.rtl.program.schedule import schedule
from eskin.rtl.views import complexity
from eskin.rtl.views.complexity import MEMORIES, cost, flat_rows, memories, memory_bits
from eskin.rtl.views.schedule_view import resized
from tests.support.table import each_row

VARIANTS = [
    ("thesis", {"lane_type": "dsp"}),
    ("synthetic", {"taxels": 6, "hidden": 5, "lanes": 3}),
    ("fabric", {"cell": "lstm", "lanes": 1}),
]


def variant(preset: str, changes: dict) -> AcceleratorConfig:
    return PRESETS[preset].replace(**changes)


@each_row(("preset", "changes"), VARIANTS)
def test_memories_are_those_of_the_verilog_and_each_counts_once_under_a_name(preset, changes):
    config = variant(preset, changes)
    bits, plan = memory_bits(config), schedule(config)
    sizes = memories(config).values()
    assert list(bits) == [name for name, _ in MEMORIES]
    assert sum(bits.values()) == sum(width * words for width, words in sizes)
    assert bits["weights"] == config.hardware.lanes * len(plan.weight_words) * config.weight_bits
    assert bits["addends"] == plan.addend_words * config.accumulator_bits
    assert bits["program"] > 20 * len(Microcode(plan).words)
    ring = config.ring_frames * config.sensor.taxels * config.deviation_bits
    free = config.windows.window_mode == "free"
    assert bits["pre-trigger ring"] >= ring * (not free) and (bits["pre-trigger ring"] == 0) == free
    assert (bits["onset detector"] == 0) == (preset == "thesis")
    if preset == "synthetic":
        text = export(config.replace(feature_shift=(0,) * len(config.window_lengths)))
        declared = re.findall(r"^ *reg (?:\[(\d+):0\] )?\\?\w+ +\[(\d+):0\];$", text, re.MULTILINE)
        assert sorted((int(high or 0) + 1, int(last) + 1) for high, last in declared) == sorted(sizes)


def test_a_memory_without_a_name_counts_under_its_path(monkeypatch):
    monkeypatch.setattr(complexity, "MEMORIES", MEMORIES[1:])
    bits = memory_bits(PRESETS["thesis"])
    assert "weights" not in bits and sum(bits.values()) == sum(
        width * words for width, words in memories(PRESETS["thesis"]).values()
    )
    assert bits["engine.weights_0"] == 8 * 264


@each_row(("taxels", "classes"), [(4, 32), (160, 3)])
def test_cost_is_the_schedules_and_the_networks(taxels, classes):
    config = resized(PRESETS["thesis"], taxels=taxels, hidden=12, classes=classes)
    point, plan = cost(config), schedule(config)
    assert (point["taxels"], point["classes"]) == (taxels, classes)
    assert (point["step_cycles"], point["decision_cycles"]) == (plan.step_cycles, plan.decision_cycles)
    assert (point["ideal_cycles"], point["multiplies"]) == (config.step_ideal, config.multiplies)
    assert point["weight_bits"] == (config.parameter_count - 3 * 12 - classes) * config.weight_bits
    assert point["memory_bits_total"] == sum(point["memory_bits"].values())


def test_the_verb_writes_what_was_counted(call, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(complexity, "TAXELS", (4, 20))
    monkeypatch.setattr(complexity, "CLASSES", (2, 9))
    status, shown, _ = call("schedule", "fabric", "--complexity", "--lanes", 6, "--out", "cost")
    assert not status
    assert sorted(path.name for path in Path("cost").iterdir()) == [
        f"complexity.{kind}" for kind in ("csv", "json", "png", "svg")
    ]
    sweeps = json.loads(Path("cost/complexity.json").read_text())
    points = [(name, point["taxels"], point["classes"]) for name, sweep in sweeps.items() for point in sweep]
    assert points == [("taxels", 4, 7), ("taxels", 20, 7), ("classes", 16, 2), ("classes", 16, 9)]
    assert sweeps["classes"][1] == cost(
        resized(PRESETS["fabric"].replace(lanes=6), taxels=16, hidden=12, classes=9)
    )
    with Path("cost/complexity.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert rows == [{key: str(value) for key, value in row.items()} for row in flat_rows(sweeps)]
    assert sum(int(value) for key, value in rows[0].items() if key.endswith(" bits")) == int(
        rows[0]["memory_bits_total"]
    )
    assert all(str(point["step_cycles"]) in shown for sweep in sweeps.values() for point in sweep)


def test_block_memories_are_those_that_synthesis_makes(monkeypatch):
    """A 24-bit memory takes two blocks of 256 x 16, one of 300 words too; two readers double it; of a ROM
    columns that stay take nothing, a short one is made of LUTs; few bits become flip-flops unless a block is asked for."""

    class Small(wiring.Component):
        def __init__(self):
            super().__init__({"i": In(5), "o": Out(9)})

        def elaborate(self, platform):
            m = Module()
            attributes = [{}, {}, {}, {}, {"ram_style": "block"}, {"ram_style": "huge"}]
            shapes = [(24, 16), (9, 300), (16, 5), (16, 4), (16, 4), (16, 600)]
            for number, ((width, depth), asked) in enumerate(zip(shapes, attributes, strict=True)):
                m.submodules[f"memory_{number}"] = memory = Memory(
                    shape=width, depth=depth, init=[], attrs=asked
                )
                memory.read_port()
                memory.write_port()
            memory.read_port()  # the huge one
            rom = Memory(shape=40, depth=128, init=[(word << 8) | (word << 20) | 5 for word in range(128)])
            m.submodules.rom = rom
            rom.read_port()
            m.submodules.short = short = Memory(shape=40, depth=64, init=range(64))
            short.read_port()
            two = Memory(shape=16, depth=32, init=[])
            m.submodules.two = two
            two.write_port()
            two.read_port(), two.read_port()
            return m

    monkeypatch.setattr(complexity, "_accelerator", lambda config: Small())
    shapes = ((256, 16), (512, 8), (1024, 4), (2048, 2))
    assert complexity.block_memories(PRESETS["pvdf"], "ice40", shapes) == 2 + 2 + 1 + 0 + 1 + 0 + 1 + 2
