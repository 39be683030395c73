"""rtl/host/bus_shell.py behind each bus: samples in, decisions out, events, an interrupt, other registers."""

import random

import pytest

from eskin.golden.core import PRESETS
from eskin.golden.model.decision_word import NO_DECISION, decision_word
from eskin.rtl.host.decision_queue import DEPTHS
from eskin.rtl.program.memory_map import Control, Event, Register, ShellRegister
from eskin.rtl.top.bus_top import FRONTS
from tests.support.bus_bench import Cpu, ShellBehind
from tests.support.stream_bench import simulate

CONFIG = PRESETS["thesis"].replace(taxels=5, feature_shift=(), margin_threshold=3)
GLOBAL_ONLY, REFUSED = 1 << 8, 1 << 31
NAMES = ("is_global", "step", "class", "margin", "partial", "unsure")


def rows(rng, config, count):
    """Decisions that the configuration can give."""
    votes = config.network.decision == "vote"
    return [
        (
            is_global := rng.randrange(2),
            rng.randrange(config.windows.steps),
            rng.randrange(config.classes),
            rng.randrange(config.windows.steps + 1)
            if votes and is_global
            else rng.choice((0, 3, 65535, rng.randrange(65536))),
            is_global and rng.randrange(2),
            is_global and rng.randrange(2),
        )
        for _ in range(count)
    ]


class World:
    """The accelerator's side: takes samples, offers decisions, answers registers; a chain that stalls while a
    decision is not taken."""

    def __init__(self, dut, decisions, seed, stalls=False):
        self.dut, self.offers, self.stalls = dut, list(decisions), stalls
        self.random = random.Random(seed)
        self.samples, self.taken, self.accesses = [], [], []

    async def run(self, ctx):
        dut, rng = self.dut, self.random
        ticks = aiter(
            ctx.tick().sample(
                dut.frame.valid, dut.frame.ready, dut.frame.payload, dut.decision.valid, dut.decision.ready,
                dut.bus.addr, dut.bus.w_stb, dut.bus.r_stb, dut.bus.w_data,
            )
        )  # fmt: skip
        while True:
            if not ctx.get(dut.decision.valid) and self.offers and rng.random() < 0.1:
                ctx.set(dut.decision.payload, dict(zip(NAMES, self.offers[0], strict=True)))
                ctx.set(dut.decision.valid, 1)
            held = self.stalls and ctx.get(dut.decision.valid)
            ctx.set(dut.frame.ready, rng.random() < 0.6 and not held)
            _, _, offered, ready, sample, valid, take, address, writes, reads, word = await anext(ticks)
            if offered and ready:
                self.samples.append((sample.sample, sample.first, sample.last))
            if valid and take:
                self.taken.append(self.offers.pop(0))
                ctx.set(dut.decision.valid, 0)
            if writes or reads:
                assert not (writes and reads) and address < 0x40
                self.accesses.append((address, word if writes else None))
            if reads:
                ctx.set(dut.bus.r_data, 257 * address & 0xFFFF)


def play(body, bus="wishbone", config=CONFIG, decisions=(), seed=0, stalls=False, **options):
    """Run ``async body(ctx, cpu, dut, world)``."""
    dut = ShellBehind(config, bus, **options)
    world = World(dut, decisions, seed, stalls)

    async def bench(ctx):
        await body(ctx, Cpu(ctx, dut, bus, seed), dut, world)

    simulate(dut, bench, world.run)
    return world


async def feed(cpu, frame, pairs, drain):
    """A frame as the driver writes it: from NEXT_TAXEL on, again after a decision was taken, until it is in."""
    for _ in range(40):
        begin = await cpu.read(ShellRegister.NEXT_TAXEL) & 0xFFFF
        for k in range(begin, len(frame), 2 if pairs else 1):
            high = frame[k + 1] if k + 1 < len(frame) else 0xDEAD
            if pairs:
                await cpu.write(ShellRegister.SAMPLE_PAIR, (frame[k] & 0xFFFF) | (high & 0xFFFF) << 16)
            else:
                await cpu.write(ShellRegister.SAMPLE, (frame[k] & 0xFFFF) | 0xBEEF0000)
        if await cpu.read(ShellRegister.NEXT_TAXEL) == 0:
            return
        await drain()
    raise AssertionError("the frame never is in")


@pytest.mark.parametrize(
    ("bus", "depth", "stalls"),
    [("wishbone", 0, True), ("axi4lite", 2, False), ("wishbone", 4, True), ("axi4lite", 0, True)],
)
def test_frames_and_decisions_go_through_once_and_in_order(bus, depth, stalls):
    rng = random.Random(repr((bus, depth, stalls)))
    decisions, got = rows(rng, CONFIG, 8), []
    low = -(1 << CONFIG.sensor.sample_bits - 1) if CONFIG.sensor.sample_signed else 0
    frames = [
        [rng.randrange(low, low + (1 << CONFIG.sensor.sample_bits)) for _ in range(5)] for _ in range(4)
    ]

    async def body(ctx, cpu, dut, world):
        async def drain():
            while (word := await cpu.read(ShellRegister.DECISION)) != NO_DECISION:
                got.append(word)

        for number, frame in enumerate(frames):
            await feed(cpu, frame, pairs=number % 2, drain=drain)
            if rng.random() < 0.5:
                await drain()
        while world.offers:
            await drain()
        await drain()

    world = play(body, bus, decisions=decisions, seed=3, stalls=stalls, depth=depth)
    assert got == [decision_word(CONFIG, row) for row in decisions]
    assert world.samples == [(code, k == 0, k == 4) for frame in frames for k, code in enumerate(frame)]
    assert not world.accesses


@pytest.mark.parametrize("bus", FRONTS)
def test_accelerators_registers_are_reached_and_others_are_not(bus):
    async def body(ctx, cpu, dut, world):
        for address in range(0x80):
            value = await cpu.read(address)
            if address < 0x40:
                assert value == 257 * address & 0xFFFF
            elif address not in (ShellRegister.DECISION, ShellRegister.EVENTS):
                assert value == 0, hex(address)
            await cpu.write(address if address not in (0x40, 0x41) else 0x43, 0xA5000000 | address)
        await cpu.write(Register.MASK, 1, select=0b0011)
        await cpu.write(ShellRegister.ENABLE, 0xF, select=0b0111)
        assert await cpu.read(ShellRegister.ENABLE) == ShellRegister.ENABLE & 0xF

    world = play(body, bus)
    assert world.accesses == [(k, word) for k in range(0x40) for word in (None, k)]


LOCAL, GLOBAL = (0, 1, 2, 100, 0, 0), (1, 1, 2, 7, 1, 1)


@pytest.mark.parametrize("depth", DEPTHS)
def test_events_raise_the_interrupt_as_enabled(depth):
    async def body(ctx, cpu, dut, world):
        async def settled(events):
            await ctx.tick().repeat(60)
            assert await cpu.read(ShellRegister.EVENTS) & ~Event.SPACE == events
            for enable in range(16):
                await cpu.write(ShellRegister.ENABLE, enable)
                await ctx.tick().repeat(3)
                assert enable & Event.SPACE or ctx.get(dut.irq) == bool(enable & events)
            await cpu.write(ShellRegister.ENABLE, Event.SPACE)
            await ctx.tick().repeat(3)
            risen = [(await ctx.tick().sample(dut.irq, dut.frame.ready))[2:] for _ in range(20)]
            assert [ready for _, ready in risen[:-1]] == [irq for irq, _ in risen[1:]]

        await settled(0)
        world.offers.append(LOCAL)
        await settled(Event.DECISION)
        world.offers.append(GLOBAL)
        both = Event.DECISION | Event.GLOBAL
        await settled(both if depth else Event.DECISION)
        assert await cpu.read(ShellRegister.DECISION) == decision_word(CONFIG, LOCAL)
        await settled(both)
        ctx.set(dut.any_fault, 1)
        await settled(both | Event.FAULT)
        assert await cpu.read(ShellRegister.DECISION) == decision_word(CONFIG, GLOBAL)
        await settled(Event.FAULT)

    play(body, depth=depth)


@pytest.mark.parametrize("depth", [0, DEPTHS[-1]])
def test_global_only_drops_local_ones(depth):
    decisions = rows(random.Random(depth), CONFIG, 8)

    async def body(ctx, cpu, dut, world):
        await cpu.write(ShellRegister.ENABLE, GLOBAL_ONLY)
        assert await cpu.read(ShellRegister.ENABLE) == GLOBAL_ONLY
        got = []
        while world.offers or await cpu.read(ShellRegister.EVENTS) & Event.DECISION:
            word = await cpu.read(ShellRegister.DECISION)
            got += [word] * (word != NO_DECISION)
        assert got == [decision_word(CONFIG, row) for row in decisions if row[0]]

    play(body, decisions=decisions, depth=depth)


@pytest.mark.parametrize("depth", [0, DEPTHS[-1]])
def test_arm_begins_anew(depth):
    """Decisions that wait are gone, the next sample is taxel 0, and samples are no longer refused."""

    async def body(ctx, cpu, dut, world):
        world.offers += [LOCAL] * depth
        await ctx.tick().repeat(300)
        await cpu.write(ShellRegister.SAMPLE, 1)
        await cpu.write(ShellRegister.SAMPLE_PAIR, 1)
        assert await cpu.read(ShellRegister.NEXT_TAXEL) == 3
        world.stalls, world.offers = True, [GLOBAL]
        await ctx.tick().repeat(100)
        await cpu.write(ShellRegister.SAMPLE, 1)
        assert await cpu.read(ShellRegister.NEXT_TAXEL) == 3 | REFUSED
        assert not await cpu.read(ShellRegister.EVENTS) & Event.SPACE
        assert await cpu.read(ShellRegister.NEXT_TAXEL) == 3
        await cpu.write(ShellRegister.SAMPLE, 1)
        await cpu.write(Register.CONTROL, Control.FINISH)
        world.offers = []  # as `arm` withdraws it
        ctx.set(dut.decision.valid, 0)
        await cpu.write(Register.CONTROL, Control.ARM)
        assert await cpu.read(ShellRegister.NEXT_TAXEL) == 0
        assert await cpu.read(ShellRegister.DECISION) == NO_DECISION
        await cpu.write(ShellRegister.SAMPLE, 1)
        assert await cpu.read(ShellRegister.NEXT_TAXEL) == 1

    play(body, depth=depth)
