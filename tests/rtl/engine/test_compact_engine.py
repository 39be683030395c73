"""The compact engine (one serial lane): its program against golden cells in every format, then the hardware,
its cycles and memories."""

import random
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from amaranth.hdl import Module, ResetInserter
from amaranth.lib import wiring
from hypothesis import given
from hypothesis import strategies as st

from eskin.golden.core import PRESETS, InputError, QFormat, narrow, sigmoid_table, tanh_table
from eskin.golden.model import IntegerModel, random_integer_model
from eskin.rtl.common.load_port import load_lines
from eskin.rtl.engine import compact_engine, compact_sequencer
from eskin.rtl.engine.compact_sequencer import CompactSequencer
from eskin.rtl.program.cells import DENSE, NORMALISE, CellProgram, ElementOp, RowBlock
from eskin.rtl.program.compact_program import CompactProgram, Instruction, Kind, Limit, Op, Use
from eskin.rtl.program.memory_map import Memory, load_words, load_writes, memory_images
from eskin.rtl.program.schedule import schedule
from eskin.rtl.program.timing import is_compact
from tests.rtl.engine.test_engine import beats, check_exact, check_exact_and_cycles, expected, small, windows
from tests.support.small_designs import CELLS, reference
from tests.support.strategies import examples
from tests.support.stream_bench import Bench, put, simulate
from tests.support.table import each_row


def serial(cell: str = "gru", reset: str = "before", **changes):
    """`small` on one serial lane."""
    return small(cell, reset, 1, lane_type="serial", **changes)


def planned(config) -> CompactProgram:
    return schedule(config).compact


# ---------------------------------------------------------------------- the program, interpreted
class Interpreter:
    """The program in plain integers, one instruction after the other; the accumulator's width is only
    watched."""

    def __init__(self, model: IntegerModel) -> None:
        self.config, self.code = model.config, planned(model.config)
        images = memory_images(model.config, model.arrays)
        self.data = images[Memory.CONSTANTS] + [0] * (self.code.data_words - self.code.constant_words)
        bits = self.code.weight_word_bits
        self.weights = [
            images[0][k // bits] >> (k + 1) % bits & 1 for k in range(len(self.code.weight_order))
        ]
        self.acc = self.largest = self.plane = self.bit = self.answer = 0
        self.tables = sigmoid_table(model.config).tolist(), tanh_table(model.config).tolist()

    def step(self, sums: list[int], length: int, first: bool) -> tuple[list[int], list[int]]:
        """Hidden state and logits of one window."""
        code, logits = self.code, []
        for executed in code.prologue if first else ():
            self._do(executed.instruction, executed.index, length, logits)
        self.next_weight = iter(self.weights)
        base = code.regions["X"] << code.index_bits
        self.data[base : base + len(sums)] = sums
        for executed in code.step:
            self._do(executed.instruction, executed.index, length, logits)
        assert next(self.next_weight, None) is None
        state = code.regions[f"S.{code.program.hidden}"] << code.index_bits
        return self.data[state : state + self.config.network.hidden], logits

    def _do(self, what: Instruction, index: int, length: int, logits: list[int]) -> None:
        code, place = self.code, what.region << self.code.index_bits
        if what.op == Op.CONTROL and what.clear:
            self.acc, self.plane = code.reset_value, code.first_plane
        if what.op == Op.STORE:
            formats = (
                self.config.index_format,
                self.config.formats.logit_format,
                self.config.formats.state_format,
                self.config.formats.feature_format,
            )
            value = self.answer if what.table else narrow(self.acc, 0, formats[what.kind])
            if what.kind == Kind.INDEX:
                self.answer = self.tables[what.tanh][value + self.config.formats.table_entries // 2]
            elif what.kind == Kind.LOGIT:
                logits.append(int(value))
            else:
                self.data[place + index] = int(value)
        if what.op == Op.MAC:
            for column in range(code.limit(what.limit)) if what.run else [length if what.length else index]:
                word, begins = self.data[place + column], not (what.run and column)
                if begins:
                    self.acc >>= what.shift
                    self.acc = ~self.acc if what.inverted else self.acc
                    self.plane += what.shift
                if what.fetch:
                    self.bit = word >> self.plane & 1
                use = {Use.NEVER: 0, Use.BIT: self.bit, Use.ALWAYS: 1}.get(what.use)
                if next(self.next_weight) if use is None else use:
                    self.acc += word << code.guard
                self.largest = max(self.largest, abs(self.acc))


def interpreted(model: IntegerModel, centred: np.ndarray) -> tuple[list[int], list[int], Interpreter]:
    """Hidden states and logits, flat."""
    machine, states, logits = Interpreter(model), [], []
    for touch in centred:
        for number, sums in enumerate(touch):
            hidden, given_logits = machine.step(sums.tolist(), model.config.length_index[number], number == 0)
            states += hidden
            logits += given_logits
    return states, logits, machine


def formats(draw) -> dict:
    """Any formats: some need bits of the accumulator below what is added, some wide ones, some biases finer
    or coarser than weights."""
    fmt = lambda low, high, whole: QFormat(
        i := draw(st.integers(*whole)), draw(st.integers(max(0, low - i), high - i))
    )
    return {
        "weight_format": fmt(2, 16, (1, 5)),
        "recurrent_format": fmt(2, 16, (1, 5)),
        "dense_format": fmt(2, 16, (1, 5)),
        "bias_format": fmt(2, 16, (1, 8)),
        "dense_bias_format": fmt(2, 16, (1, 8)),
        "feature_format": fmt(4, 16, (2, 6)),
        "state_format": fmt(6, 16, (2, 5)),
        "logit_format": fmt(6, 16, (2, 8)),
        "gate_frac": draw(st.integers(4, 14)),
        "table_entries": draw(st.sampled_from([64, 512, 1024])),
        "gate_activation": draw(st.sampled_from(["sigmoid", "hard_sigmoid"])),
    }


@st.composite
def models(draw) -> IntegerModel:
    """A random model of any cell, size and format that the configuration allows."""
    cell, reset = draw(st.sampled_from(CELLS))
    sizes = {"taxels": draw(st.integers(4, 9)), "hidden": draw(st.integers(4, 9)), "steps": 2}
    names = tuple("abcdefg"[: draw(st.integers(2, 7))])
    for _ in range(50):
        try:
            config = serial(cell, reset, class_names=names, **sizes).replace(**formats(draw))
            return random_integer_model(config, seed=draw(st.integers(0, 10**6)))
        except InputError:
            continue
    return random_integer_model(serial(cell, reset, class_names=names, **sizes), seed=1)


SEEN: set[str] = set()


@examples(40, 400)
@given(model=models())
def check_program(model: IntegerModel) -> None:
    centred = windows(model.config, touches=2, seed=3)
    _, hidden, logits, _ = expected(model, centred)
    states, found, machine = interpreted(model, centred)
    assert (states, found) == (hidden, logits)
    code = machine.code
    assert machine.largest < 1 << code.accumulator_bits - 1
    config = model.config
    widths = {
        config.formats.weight_format.width,
        config.formats.recurrent_format.width,
        config.formats.dense_format.width,
    }
    SEEN.update(
        {"guard"} if code.guard > 1 else (),
        {"wide"} if max(widths) > 12 else (),
        {"mixed"} if len(widths) == 3 else (),
    )


def test_the_program_gives_the_golden_values_in_any_format_and_never_leaves_its_accumulator():
    SEEN.clear()
    check_program()
    assert {"guard", "wide", "mixed"} <= SEEN, "the formats drawn do not cover what they should"


@each_row(("cell", "reset"), CELLS)
def test_the_widest_values_fit_the_accumulator_and_come_near_its_end(cell, reset):
    """Weights, biases and sums at the ends of their formats; states, which tanh holds within 1, stay two bits
    off the end of theirs."""
    config = serial(cell, reset, hidden=12, taxels=16, steps=3)
    model = random_integer_model(config, seed=1)
    largest = 0
    for weight, sums in ((-128, -32768), (127, -32768), (127, 32767)):
        ends = {
            name: np.full_like(array, weight << 8 * (name[0] == "b"))
            for name, array in model.arrays.items()
            if name[0] in "WUVb"
        }
        ends["scale"] = np.full_like(model.arrays["scale"], 32767)
        widest = IntegerModel(model.config, {**model.arrays, **ends})
        centred = np.full((1, config.windows.steps, config.sensor.taxels), sums)
        _, hidden, logits, _ = expected(widest, centred)
        states, found, machine = interpreted(widest, centred)
        assert (states, found) == (hidden, logits)
        largest = max(largest, machine.largest)
    bits = machine.code.accumulator_bits
    assert 1 << bits - 4 < largest < 1 << bits - 1


@each_row(("cell", "reset"), CELLS)
def test_what_the_hardware_relies_on_between_instructions(cell, reset):
    """A sum is finished a cycle after its last MAC; a table answers a cycle after its index; a STORE comes
    after an instruction that does nothing, or after the look-up; jumps have one more instruction; a run is of
    a length that the column counter knows."""
    code = planned(reference(cell, reset, 1, lane_type="serial"))
    for before, after in (*pairwise(code.prologue), *pairwise(code.step)):
        one, two = before.instruction, after.instruction
        assert one.op != Op.MAC or not (two.op in (Op.STORE, Op.JUMP) or two.clear)
        assert not two.table or (one.op, one.kind, one.tanh) == (Op.STORE, Kind.INDEX, two.tanh)
        assert two.op != Op.STORE or two.table or one == Instruction(Op.CONTROL)
        assert not one.run or one.limit in (Limit.HIDDEN, Limit.INPUTS)
        assert one.op != Op.JUMP or (two.op, two.wait) == (Op.CONTROL, 0)
        assert not one.fetch or two.use == Use.BIT
    bits = [one.cycles for one in code.step if one.instruction.use == Use.WEIGHT]
    assert sum(bits) == len(code.weight_order) == len(set(code.weight_order))
    assert (
        code.step[0].instruction.wait
        and code.prologue[0].address == 0
        and code.prologue[-1].address == code.wait - 1
    )


def test_an_operation_waits_for_those_that_read_what_it_replaces():
    """A cell with a look at the old c when it is already known how the new one will be; and two that wait for
    each other."""
    keep, look = ElementOp("keep", (("S.c", "f"),), state="c"), ElementOp("look", (("S.c", "o"),), state="h")
    f, o = (RowBlock(name, ((f"U_{name}", "h"),), "sigmoid", name, f"b_{name}", "sigmoid") for name in "fo")
    peep = CellProgram((), (f, o, DENSE), (NORMALISE, keep, look), ("h", "x", "c"), ("f", "o"), ())
    order = [work.name for work in CompactProgram(serial(), peep).order]
    assert order.index("keep") > order.index("look") > order.index("o")
    swap = ElementOp("swap", (("S.h", "f"),), state="c")
    with pytest.raises(RuntimeError, match="cannot be scheduled"):
        _ = CompactProgram(serial(), replace(peep, elements=(NORMALISE, swap, look))).order


# ---------------------------------------------------------------------- the hardware
@pytest.mark.parametrize(
    ("cell", "reset", "changes"),
    [
        ("gru", "after", {"decision": "last"}),
        (
            "lstm",
            "before",
            {
                "dense_format": QFormat(6, 2),
                "weight_format": QFormat(2, 5),
                "gate_activation": "hard_sigmoid",
            },
        ),
        # so much is rounded away that nothing reaches as far up in the accumulator as the half that it is
        # reset to
        (
            "gru",
            "before",
            {"weight_format": QFormat(1, 11), "recurrent_format": QFormat(1, 11), "table_entries": 64},
        ),
    ],
)
def test_bit_exact_and_cycles_of_the_program(cell, reset, changes):
    check_exact_and_cycles(serial(cell, reset, hidden=4, steps=2, **changes), touches=2)


def test_sums_at_the_ends_of_every_format_are_bit_exact():
    """Sums beyond the index and beyond the state: the table's answer is stored whatever the accumulator
    holds."""
    config = serial(hidden=4, taxels=8, steps=2).replace(state_format=QFormat(2, 12))
    model = random_integer_model(config, seed=2)
    ends = {name: np.sign(array) * 127 for name, array in model.arrays.items() if name[0] in "WUV"}
    model = IntegerModel(
        model.config, {**model.arrays, **ends, "scale": np.full_like(model.arrays["scale"], 32767)}
    )
    centred = np.where(ends["W_r"][:1] < 0, -32768, 32767) * np.ones((1, config.windows.steps, 1), np.int64)
    assert (
        abs(interpreted(model, centred)[2].largest) >> 1 + planned(model.config).guard
        > config.formats.state_format.magnitude
    )
    check_exact(model, centred)


def test_windows_that_come_while_results_are_written_wait():
    """From the second window on every sum is offered in a cycle that stores a result."""
    model = random_integer_model(serial(hidden=4, taxels=4, steps=2), seed=5)
    centred = windows(model.config, touches=2, seed=5)
    dut, seen, refused = (
        compact_engine.make_engine(model.config, memory_images(model.config, model.arrays)),
        [],
        [],
    )
    bench = Bench(dut, quiet=3 * schedule(model.config).step_cycles, max_cycles=60_000)

    async def offer(ctx):
        ctx.set(dut.decider_idle, 1)
        for number, beat in enumerate(beats(model.config, centred)):
            while number >= model.config.sensor.taxels and not any(
                ctx.get(tap.valid) for tap in (dut.feature, dut.state, dut.logit)
            ):
                await ctx.tick()
            put(ctx, dut.i, p=beat, valid=1)
            refused.append(not ctx.get(dut.i.ready))
            while not (await ctx.tick().sample(dut.i.ready))[-1]:
                pass
            ctx.set(dut.i.valid, 0)

    async def monitor(ctx):
        async for _, _, valid, value in ctx.tick().sample(dut.logit.valid, dut.logit.value):
            seen.extend([value] * valid)

    bench._sim.add_testbench(monitor, background=True)
    bench.process(offer)
    bench.run()
    assert seen == expected(model, centred)[2]
    assert all(refused[model.config.sensor.taxels :])


def test_bit_exact_with_stalls():
    """Windows come in any cycle, decisions are held up: a window waits, nothing is lost."""
    model = random_integer_model(serial(hidden=4, steps=2), seed=5)
    centred = windows(model.config, touches=1, seed=5)
    check_exact(model, centred, stall=0.5, seed=5)


def test_every_touch_begins_as_after_a_reset():
    config, starts, ends = serial(hidden=4, taxels=4, steps=2), [], []
    dut = CompactSequencer(config, planned(config))

    async def bench(ctx):
        ctx.set(dut.go, 1)
        while len(starts) < 2:
            if ctx.get(dut.started & dut.first_step):
                starts.append(len(ends))
            ends.append(ctx.get(dut.jump & (dut.fields["limit"] == Limit.STEPS)))
            await ctx.tick()

    simulate(dut, bench)
    last = [cycle for cycle, ended in enumerate(ends) if ended][config.windows.steps - 1]
    assert starts[1] - (last + 1) == starts[0]


class LoadedBench(wiring.Component):
    """The engine as the accelerator holds it while it is loaded, under a reset at every word."""

    def __init__(self, config) -> None:
        self.engine = compact_engine.make_engine(config)
        super().__init__(
            {name: self.engine.signature.members[name] for name in ("i", "load", "decider_idle")}
        )

    def elaborate(self, platform):
        m = Module()
        engine = self.engine
        m.submodules.engine = ResetInserter(self.load.enable)(engine)
        wiring.connect(m, wiring.flipped(self.i), engine.i)
        m.d.comb += [engine.decider_idle.eq(self.decider_idle), engine.load.enable.eq(self.load.enable)]
        m.d.comb += [
            getattr(engine.load, name).eq(getattr(self.load, name)) for name in ("select", "address", "data")
        ]
        return m


def test_words_loaded_at_any_pace_are_there():
    """Between two words the engine begins to clear its state: what the host writes goes first."""
    model = random_integer_model(serial(hidden=4, taxels=4, steps=2).replace(loadable=True), seed=8)
    centred = windows(model.config, touches=1, seed=8)
    dut, rng, seen = LoadedBench(model.config), random.Random(8), []
    bench = Bench(dut, quiet=3 * schedule(model.config).step_cycles, max_cycles=60_000)

    async def load(ctx):
        ctx.set(dut.decider_idle, 1)
        line = load_lines(model.config)
        for select, words in memory_images(model.config, model.arrays).items():
            for address, word in enumerate(words if select != Memory.MEANS else ()):
                for name, value in (
                    ("select", 1 << line[select]),
                    ("address", address),
                    ("data", word % (1 << 16)),
                    ("enable", 1),
                ):
                    ctx.set(getattr(dut.load, name), value)
                await ctx.tick()
                ctx.set(dut.load.enable, 0)
                await ctx.tick().repeat(rng.randrange(1, 40))

    async def monitor(ctx):
        async for _, _, valid, value in ctx.tick().sample(dut.engine.logit.valid, dut.engine.logit.value):
            seen.extend([value] * valid)

    bench._sim.add_testbench(monitor, background=True)
    bench.process(load)
    bench.drive(dut.i, beats(model.config, centred), after=20_000)
    bench.run()
    assert seen == expected(model, centred)[2]


# ---------------------------------------------------------------------- memory contents
@each_row(("cell", "reset"), CELLS[1:])
def test_images_hold_every_parameter(cell, reset):
    config = reference(cell, reset, 1, lane_type="serial")
    model = random_integer_model(config, seed=3)
    code, images = planned(model.config), memory_images(model.config, model.arrays)
    assert is_compact(model.config) and set(images) == {0, Memory.CONSTANTS, Memory.MEANS}
    rebuilt = {name: np.zeros_like(array) for name, array in model.arrays.items() if name[0] in "WUV"}
    for number, (matrix, row, column, plane) in enumerate(code.weight_order):
        word, bit = divmod(number, code.weight_word_bits)
        value = images[0][word] >> (bit + 1) % code.weight_word_bits & 1
        rebuilt[matrix][row, column] += (-value if plane == 7 else value) << plane
    assert all((rebuilt[name] == model.arrays[name]).all() for name in rebuilt)
    for block in code.program.after:
        base = code.regions[f"bias.{block.name}"] << code.index_bits
        bias = model.arrays[block.bias].tolist()
        assert images[Memory.CONSTANTS][base : base + len(bias)] == bias
    assert (
        images[Memory.CONSTANTS][code.regions["scale"] << code.index_bits :] == model.arrays["scale"].tolist()
    )
    assert (
        len(load_writes(model.config, model.arrays))
        == 3 + len(images[0]) + len(images[Memory.CONSTANTS]) + 2 * 2 + 1
    )
    assert load_words(model.config) == len(images[0])


def test_the_thesis_fits_the_memories_of_a_small_part():
    """Words of the thesis's memories: 1 block memory of data, 1 of program, 3 of weights (256 x 16 bits each,
    2048 x 2)."""
    config = PRESETS["thesis"].replace(lanes=1, lane_type="serial")
    code, packed = planned(config), compact_sequencer.Packing(planned(config))
    assert code.data_words <= 256 and len(packed.words) <= 256 and packed.bits <= 16
    assert (code.weight_word_bits, code.weight_words) <= (6, 2048)
