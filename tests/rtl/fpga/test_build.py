"""From a model to a bitstream: figures that add up, the same bits from the same seed, and refusals that say
what helps."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from amaranth.hdl import Cat, ClockDomain, ClockSignal, Module, Signal
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out
from amaranth.sim import Simulator

from eskin.golden.core import write_json
from eskin.rtl.fpga import wiring as wired
from eskin.rtl.fpga.implementation import DoesNotFit, place
from eskin.rtl.fpga.synthesis import PoweredOn, synthesise
from eskin.rtl.fpga.targets import TARGETS, target
from eskin.rtl.fpga.wiring import Wiring
from eskin.study.stability.panel import OSCILLATOR
from eskin.training.record import Disturbed, ModeFigure, Nested
from eskin.verbs import build as job
from tests.support import result_case
from tests.support.random_models import random_integer_model
from tests.support.result_case import CONFIG, some
from tests.support.small_designs import SMALL, with_converter
from tests.support.table import each_row, refused

pytestmark = pytest.mark.timeout(1800)  # the tools compile themselves at their first use on a machine


# ---------------------------------------------------------------------- a design of a moment
class Counter(wiring.Component):
    """One block: adds what comes to a register."""

    def __init__(self, bits: int) -> None:
        super().__init__({"step": In(bits), "total": Out(bits)})

    def elaborate(self, platform):
        m = Module()
        m.d.sync += self.total.eq(self.total + self.step)
        return m


class Product(wiring.Component):
    """One block: a product in a register."""

    a: In(16)
    total: Out(32)

    def elaborate(self, platform):
        m = Module()
        m.d.sync += self.total.eq(self.a.as_signed() * self.a[::-1].as_signed())
        return m


class Tiny(wiring.Component):
    """What stands for the accelerator in its harness: a block that counts and one that multiplies behind the
    border, a shift register in front of it."""

    shift_in: In(1)
    capture: In(1)
    shift_out: Out(1)

    def elaborate(self, platform):
        m = Module()
        m.submodules.chain = chain = Module()
        chain.submodules.classifier = count = Counter(8)
        chain.submodules.engine = product = Product()
        shift = Signal(16)
        m.d.sync += shift.eq(Cat(self.shift_in, shift))
        m.d.comb += [product.a.eq(shift), count.step.eq(product.total), self.shift_out.eq(count.total[-1])]
        return m


NO_MULTIPLIERS = replace(
    target("icebreaker"),
    name="small",
    device="iCE40HX1K",
    place=("--hx1k", "--package", "tq144"),
    clock_pin="21",
    pins=tuple("112 113 114 115 116 117 118 119 78".split()),
)
"""A part that lacks what the boards' parts have."""


# ---------------------------------------------------------------------- the accelerator
@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A working folder with a model, where netlists and placements of this module are kept."""
    path = tmp_path_factory.mktemp("build")
    random_integer_model(CONFIG, seed=2).save(path / "model")
    return path


@pytest.fixture
def call(call, folder, monkeypatch) -> Callable[..., tuple[int, str, str]]:
    """Of ``eskin build model`` in that folder."""
    monkeypatch.chdir(folder)
    monkeypatch.setenv("COLUMNS", "250")
    return lambda *words: call("build", "model", *words)


def test_a_rate_that_a_model_does_not_hold_is_refused_where_its_own_oscillator_scans(
    call, folder, monkeypatch
):
    def stop(*_):
        raise job.BuildError("it would be built")

    monkeypatch.setattr(job, "build", stop)
    words = ("--standalone", "--converter", "ads7953", "--out", "alone")
    for holds, board, error, expected in (
        (None, "icebreaker", 0.01, 1),
        (True, "icebreaker", 0.01, 1),
        (False, "icebreaker", 0.13, 1),  # with a warning
        (False, "icebreaker", 0.12, 2),
        (False, "ulx3s", 0.01, 1),  # its clock never stops
    ):
        record = result_case.training_record(result_case.recordings())
        row = ModeFigure(mode=OSCILLATOR, figure=0.803, bound=0.93, held=bool(holds))
        split = record.cross_validation[0].model_copy(update={"standard_error": error})
        record.cross_validation[0].nested = Nested(
            **split.plain(), disturbed=Disturbed(oscillator=None if holds is None else row), wall_s=1
        )
        write_json(folder / "model/training.json", record)
        status, _, err = call("--target", board, *words)
        assert status == expected, err
        assert ("80.3 % of unseen recordings" in err) == (expected == 2 or error == 0.13), err
    (folder / "model/training.json").unlink()


@pytest.mark.parametrize("tiny", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_a_small_accelerator_becomes_a_bitstream_or_says_what_is_missing(call, folder, monkeypatch, tiny):
    """One test, because all of it stands on one netlist; the accelerator's takes half a minute."""
    if tiny:
        monkeypatch.setattr(job.Wiring, "design", lambda wiring, *_: PoweredOn(Tiny()))
    out = f"small{tiny}"
    status, out_text, err = call("--target", "icebreaker", "--lanes", 1, "--no-link", "--out", out)
    progress = ("synthesis: ", "placements: ", "eskin: first use of ")  # where it takes long
    assert status == 0 and all(line.startswith(progress) for line in err.splitlines()), err
    result = json.loads((folder / out / "build.json").read_text())
    assert {*"target lut ff bram fmax_hz bitstream".split()} <= result.keys()
    assert [result[name] for name in ("device", "seed", "lanes")] == ["iCE40UP5K", 1, 1]
    assert result["lanes_chosen_by"] == "asked" and result["lanes_too_many"] is None
    assert sorted(path.name for path in (folder / out).iterdir()) == [
        "build.json",
        "config.json",
        "load.hex",
        "made_icebreaker.bin",
        "memories",
        "netlist.v",
    ]
    netlist = (folder / out / "netlist.v").read_text()
    used, every = result["utilisation"], result["blocks"]
    # The lane; and the sums of windows and normaliser, which take multipliers that no lane needs.
    multipliers = {"cell": 1} if tiny else {"cell": 1, "normaliser": 1, "windows": 1}
    assert {name: counts["dsp"] for name, counts in every.items() if counts["dsp"]} == multipliers
    assert result["dsp"] == sum(multipliers.values())
    for column, what in (("cells", "logic cells"), ("dsp", "multipliers"), ("bram", "block memories")):
        assert sum(counts[column] for counts in every.values()) == used[what]["used"]
    assert sum(counts["lut"] for counts in every.values()) == netlist.count("SB_LUT4 #(")
    assert sum(counts["ff"] for counts in every.values()) == netlist.count("  SB_DFF")
    # Of the harness: a register for every bit that goes in or out, a multiplexer for those that go out, room
    # between carry chains.
    harness, registers = every["top"], 16 if tiny else 45 + 34
    assert harness["ff"] == registers and registers <= harness["cells"] <= registers + 3
    assert harness["bram"] == harness["dsp"] == 0
    assert result["logic_cells"] == used["logic cells"]["used"] - harness["cells"]
    blocks = "cell classifier" + " onset windows normaliser control" * (not tiny)
    assert {*blocks.split()} <= every.keys()
    words = (f"{result['fmax_hz'] / 1e6:.1f} MHz", result["critical_path"], "(harness)", "budget: decision")
    assert all(word in out_text for word in words)
    _misses_its_clock(call, folder)
    _does_not_fit(result["dsp"])


def _misses_its_clock(call, folder) -> None:
    """The same placement against another clock: status 1, by how much, and a clock that it reaches."""
    status, _, err = call(
        "--target", "icebreaker", "--lanes", 1, "--no-link", "--clock", 200e6, "--out", "fast"
    )
    result = json.loads((folder / "fast" / "build.json").read_text())
    assert status == 1 and not result["clock_met"]
    missing = 100 * (1 - result["fmax_hz"] / 200e6)
    reached = int(result["fmax_hz"] / 1e5) * 100000
    assert err == (
        f"eskin: misses its clock: {result['fmax_hz'] / 1e6:.1f} of 200 MHz, {missing:.1f} % too slow; "
        f"--clock {reached} is a clock it reaches\n"
    )
    assert (
        call("--target", "icebreaker", "--lanes", 1, "--no-link", "--clock", reached, "--out", "fast")[0] == 0
    )


def _does_not_fit(multipliers: int) -> None:
    """The same netlist on a part without multipliers: status 1, the shortfall, and a remedy."""
    model = random_integer_model(CONFIG, seed=2)
    config = model.config.with_lanes(1, job.suited_lane_type(model.config, target("icebreaker")))
    with pytest.raises(job.BuildError) as refused:
        job.build(job.BuildRequest(config=config, arrays=model.arrays, target=NO_MULTIPLIERS, link=False))
    sentence = str(refused.value)
    assert sentence.startswith("without the link, does not fit the iCE40HX1K of small: it needs ")
    assert (
        f"{multipliers} multipliers of 0 ({multipliers} too many)" in sentence
        and "has a larger part" in sentence
    )


BLOCKS_SHORT = [
    ("block memories", "dsp", True),
    ("logic cells", "dsp", False),  # the large memories do not help
    ("block memories", "plain", False),  # nor are they used
]


PLACED = SimpleNamespace(fmax_hz=1.0, bitstream=None, hold_errors=0)


def stand_ins(monkeypatch, place, made=lambda config: None, result=lambda *_: some(job.Build)) -> None:
    """In place of synthesis ``made(config)``, of placement ``place``, of the record ``result``."""
    monkeypatch.setattr(
        job, "cached_netlist", lambda design, *_, **__: (SimpleNamespace(verilog=None), design())
    )
    monkeypatch.setattr(job.Wiring, "design", lambda wiring, *_: made(wiring.config))
    monkeypatch.setattr(job, "_placement", place)
    monkeypatch.setattr(job, "_result", result)


def asked_for(config, **options) -> job.BuildRequest:
    return job.BuildRequest(config=config, arrays={}, target=target("icebreaker"), **options)


FEWER = [  # shortage by lanes, asked, lanes tried
    ({4: {"multipliers": (9, 8)}}, False, [4, 3]),
    ({4: {"multipliers": (10, 8)}, 2: {"logic cells": (6000, 5280)}}, False, [4, 2, 1]),
    ({4: {"multipliers": (9, 8)}}, True, [4]),
    ({n: {"logic cells": (6000, 5280)} for n in (1, 2)}, False, [2, 1]),
]


@each_row("short, requested, tried", FEWER)
def test_lanes_that_do_not_fit_become_fewer_unless_asked_for(short, requested, tried, monkeypatch):
    made: list[int] = []
    request = asked_for(CONFIG.with_lanes(tried[0], "plain"), lanes_asked=requested)

    def place(*_: object):
        if made[-1] in short:
            raise DoesNotFit(short[made[-1]])
        return PLACED

    lanes = lambda config, *_: some(job.Build, lanes=config.hardware.lanes)
    stand_ins(monkeypatch, place, lambda config: made.append(config.hardware.lanes), lanes)
    if tried[-1] in short:
        with pytest.raises(job.BuildError, match="too many") as refused:
            job.build(request)
        assert ("--lanes" in str(refused.value)) == requested
    else:
        result = job.build(request)[0]
        assert result.lanes == tried[-1] and result.lanes_chosen_by == "fit"
        what, (needed, available) = next(iter(short[tried[0]].items()))
        assert result.lanes_too_many.lanes == tried[0]
        assert f"{needed} {what} of {available}" in result.lanes_too_many.needs
    assert made == tried


SHORT_PATHS = [  # paths that are too short by seed (0: no route), seeds asked, seeds that count
    ({}, 2, [1, 2]),
    ({1: 8, 3: 9}, 2, [2, 4]),
    ({1: 0, 2: 3}, 1, [3]),
    ({seed: 1 for seed in range(1, 11)}, 1, []),
]


@each_row("errors, seeds, chosen", SHORT_PATHS)
def test_a_placement_with_a_path_that_is_too_short_or_missing_is_not_taken(
    errors, seeds, chosen, monkeypatch
):
    def place(netlist, key, target, pins, border, seed, cache):
        if errors.get(seed) == 0:
            raise job.NoRoute
        return SimpleNamespace(
            fmax_hz=99.0 - seed, bitstream=seed, seed=seed, hold_errors=errors.get(seed, 0)
        )

    taken_by = lambda *given: some(job.Build, seeds=[placement.seed for placement in given[4]])
    stand_ins(monkeypatch, place, result=taken_by)
    request = asked_for(CONFIG, seeds=seeds)
    if not chosen:
        with pytest.raises(
            job.BuildError, match=r"no seed from 1 to 10 .*\(seed 1: 1 paths .*--seeds 20 tries"
        ):
            job.build(request)
        return
    result, bitstream, *_ = job.build(request)
    assert result.seeds == chosen and bitstream == chosen[0]
    assert {seed: why[0] for seed, why in result.not_taken.items()} == {
        str(seed): str(count or "n") for seed, count in errors.items()
    }


@pytest.mark.slow
def test_a_gowin_part_gets_a_bitstream(tmp_path):
    """Blocks add up as on the other parts; a memory's LUTs and the LUTs in front of flip-flops are no LUTs of the
    design."""
    board = target("tangnano9k")
    design = PoweredOn(Tiny())
    netlist = synthesise(design, board.family, tmp_path / "net", top="tiny")
    pins = dict(
        zip(("clk", "shift_in", "capture", "shift_out"), (board.clock_pin, *board.pins), strict=False)
    )
    result = place(netlist, board, pins, tmp_path / "placed", seed=1)
    assert {name: counts["ff"] for name, counts in result.blocks.items()} == {
        "cell": 8,
        "classifier": 8,
        "top": 16,
    }
    for column, what in (("cells", "logic cells"), ("ff", "flip-flops")):
        assert sum(counts[column] for counts in result.blocks.values()) == result.utilisation[what][0] > 0
    luts = sum(count for name, count in netlist.cells.items() if name.startswith("LUT"))
    assert sum(counts["lut"] for counts in result.blocks.values()) == luts
    assert "to classifier" in result.path and result.utilisation["logic cells"][1] == 8640
    constraints = (tmp_path / "placed" / "pins.cst").read_text()
    assert constraints.startswith('IO_LOC "clk" 52;\nIO_PORT "clk" IO_TYPE=LVCMOS33;\n')
    lines = result.bitstream.read_text().splitlines()
    # 5 words of head, the part's own number among them (0x1100481b, as its programmer asks for)
    assert (
        "0000011000000000000000000000000000010001000000000100100000011011" in lines[:8] and len(lines) > 700
    )


@each_row("what, lane_type, again", BLOCKS_SHORT)
@each_row("enough", [True, False])
def test_weights_go_into_large_memories_where_block_memories_run_out(
    what, lane_type, again, enough, monkeypatch
):
    config, tried = CONFIG.with_lanes(2, lane_type), []
    request = asked_for(config, lanes_asked=True)

    def place(*_: object):
        if not (enough and tried[-1].hardware.spare_blocks):
            raise DoesNotFit({what: (37, 30)})
        return PLACED

    stand_ins(monkeypatch, place, tried.append)
    if again and enough:
        job.build(request)
    else:
        with pytest.raises(job.BuildError, match=f"37 {what} of 30"):
            job.build(request)
    assert tried == [config, config.replace(spare_blocks=True)][: 1 + again]


# ---------------------------------------------------------------------- boards
@each_row("name", TARGETS)
def test_a_boards_pins_are_told_apart(name):
    board = target(name)
    pins = Wiring(config=CONFIG.replace(class_names=tuple("abcdefg")), target=board, link=True).sites()
    assert len(set(pins.values())) == len(pins) == 4 + 1 + 7
    assert board.clock_hz in (12e6, 25e6, 27e6)


def test_a_converter_is_on_the_first_pins_and_too_many_are_refused():
    board, fields = (
        target("icebreaker"),
        with_converter("ads7953", taxels=8, sample_rate_hz=1000.0, clock_hz=3e6),
    )
    wiring = Wiring(config=SMALL.replace(stimulator="decisions", **fields), target=board, sensing=True)
    pins, ports = wiring.sites(), ("cs_n", "mosi", "miso", "sclk")
    assert [pins[f"pins__{port}"] for port in ports] == [*board.pins[:4]]
    assert len(set(pins.values())) == len(pins)
    row = {"port": "stim_tx", "site": board.pins[8], "to": "stimulator, RX (115200 baud)"}
    assert row in wiring.table()
    crowded = wiring.config.replace(**with_converter("ad7476", taxels=16))
    with refused("has 16 free pins, and 24 are needed; use another board or converter"):
        replace(wiring, config=crowded).sites()


class Program(wiring.Component):
    """Fetches in every cycle, as the sequencer does: ``wrong`` when a block memory that reads 0 for ``blind``
    cycles was believed."""

    def __init__(self, blind: int) -> None:
        self._blind = blind
        super().__init__({"count": Out(16), "wrong": Out(1)})

    def elaborate(self, platform):
        m = Module()
        m.domains.memory = ClockDomain(reset_less=True, local=True)
        since = Signal(16)
        m.d.comb += ClockSignal("memory").eq(ClockSignal())
        m.d.memory += since.eq(since + 1)
        m.d.sync += [self.count.eq(self.count + 1), self.wrong.eq(self.wrong | (since < self._blind))]
        return m


@each_row("name", TARGETS)
@each_row("clock_hz", [None, 48e6])
def test_nothing_is_fetched_before_block_memories_read(name, clock_hz, monkeypatch):
    """An iCE40's read 0 for microseconds after configuration; the design stays in its reset for 15 us and
    then runs for good."""
    board = target(name)
    clock = clock_hz or board.clock_hz
    blind = math.ceil(15e-6 * clock) if board.family.name == "ice40" else 0
    monkeypatch.setattr(wired, "System", lambda *_, **__: Program(blind))
    design = Wiring(config=CONFIG, target=board, link=True).design(None, clock, 1e6)
    counts = []

    async def bench(ctx):
        for level in [1, 0] * (3 * blind + 9):
            ctx.set(design.clk, level)
            await ctx.delay(1e-8)
            counts.append(ctx.get(design.count))
        assert not ctx.get(design.wrong)

    sim = Simulator(design)
    sim.add_testbench(bench)
    sim.run()
    counts = counts[::2]
    zeros = counts.count(0)
    assert blind <= zeros <= 2 * blind + 1 and counts[zeros:] == list(range(1, len(counts) - zeros + 1))
