"""Distances, ties and unknown touches; teaching, forgetting and refusals: the block against the golden
functions."""

import random

import numpy as np
import pytest
from amaranth.hdl import Const

from eskin.golden.core import AcceleratorConfig
from eskin.golden.model import IntegerModel
from eskin.golden.model.prototypes import class_distances, forget, narrowed, taught_in_use, teach
from eskin.rtl.common import TEACHING, load_lines
from eskin.rtl.decision.prototype_readout import PrototypeReadout
from eskin.rtl.program.memory_map import Memory, memory_images
from eskin.rtl.program.timing import readout_cycles
from tests.support.random_models import random_integer_model
from tests.support.stream_bench import simulate


def small_model(
    seed: int, cell: str = "gru", decision: str = "last", checksum: bool = False, **rule: int
) -> IntegerModel:
    config = AcceleratorConfig.of(
        taxels=4,
        hidden=4,
        steps=3,
        cell=cell,
        decision=decision,
        checksum=checksum,
        class_names=("a", "b", "c"),
        **{"readout": "prototypes", "prototypes": 2, "taught": 2, "state_code_bits": 4, "state_code_shift": 9}
        | rule,
    )
    return random_integer_model(config, seed)


class Player:
    """Drives the block as engine, classifier and host do; ``model`` is what it must have become."""

    def __init__(self, model: IntegerModel, seed: int, stall: float) -> None:
        self.config, self.model, self.rng, self.stall = model.config, model, random.Random(seed), stall
        self.dut = PrototypeReadout(model.config)
        self.last: np.ndarray | None = None  # codes of the touch that ended last, if it was whole
        self.following: int | None = None
        self.refused = self.expected_refused = 0
        self.latencies: set[int] = set()
        self.damage: tuple[int, int, int] | None = None  # step, class, word: of the class's last place in use
        self.wrong = self.left_out = 0

    def run(self, act) -> None:
        async def bench(ctx):
            await self.load(ctx)
            await act(ctx)
            await ctx.tick()  # the watch has seen the last command
            await self.rest(ctx)
            assert self.refused == self.expected_refused

        async def watch(ctx):
            flag = self.dut.wrong if self.config.hardware.checksum else Const(0, 1)
            async for _, _, refused, wrong in ctx.tick().sample(self.dut.commands.refused, flag):
                self.refused += refused
                self.wrong += wrong

        simulate(self.dut, bench, *[watch] * bool(self.config.readout_rule.taught))
        assert self.done

    done = False

    async def load(self, ctx) -> None:
        select = 1 << load_lines(self.config)[Memory.PROTOTYPES]
        image = memory_images(self.config, self.model.arrays)[Memory.PROTOTYPES]
        if self.damage:
            image[self.damage[2]] ^= 1 << self.rng.randrange(self.config.readout_rule.state_code_bits + 1)
        for address, word in enumerate(image):
            for name, value in (("select", select), ("address", address), ("data", word), ("enable", 1)):
                ctx.set(getattr(self.dut.load, name), value)
            await ctx.tick()
        ctx.set(self.dut.load.enable, 0)

    def damaged(self, label: int) -> int:
        """A word of the last place in use of class ``label`` gets another bit when it is loaded; its step."""
        config, rule = self.config, self.config.readout_rule
        places, step = rule.prototypes + rule.taught, self.rng.randrange(config.windows.steps)
        last = (
            label * places + rule.prototypes + int(taught_in_use(self.model)[label])
        )  # the touch's own is one more
        place = step * (1 + config.classes * places) + last
        width = config.trajectory_width
        self.damage = step, label, place * width + self.rng.randrange(width)
        return step

    def distances(self, codes: np.ndarray) -> np.ndarray:
        """(K, C) as the model has them; from the step of a damaged code on without its place."""
        distances = class_distances(self.model, codes[None])[0]
        if self.damage:
            step, label, _ = self.damage
            without = self.model.arrays["taught_count"].copy()
            without[label] -= 1
            arrays = {**self.model.arrays, "taught_count": without}
            rest = class_distances(IntegerModel(self.config, arrays, "a test"), codes[None])[0]
            upto = step + 1 if self.config.network.decision == "vote" else None
            self.left_out += (distances[step:upto] != rest[step:upto]).any()
            distances[step:upto] = rest[step:upto]
        return distances

    async def rest(self, ctx) -> None:
        for _ in range(2000):
            if ctx.get(self.dut.idle):
                self.done = True
                return
            await ctx.tick()
        raise AssertionError("it never becomes idle")

    async def pulse(self, ctx, **signals: int) -> None:
        def port(name: str):
            return getattr(self.dut.commands if name in TEACHING.members else self.dut, name)

        for name, value in signals.items():
            ctx.set(port(name), value)
        await ctx.tick()
        for name in signals:
            if name != "locked":
                ctx.set(port(name), 0)

    async def pause(self, ctx, may: bool = True) -> None:
        while may and self.rng.random() < self.stall:
            await ctx.tick()

    def drawn(self, steps: int, low: int, high: int) -> np.ndarray:
        """A trajectory (steps, values)."""
        width = self.config.trajectory_width
        return np.array([[self.rng.randint(low, high) for _ in range(width)] for _ in range(steps)])

    async def touch(self, ctx, steps: int, *, cut: bool = False) -> None:
        """A touch of ``steps`` steps, as it is decided or (``cut``) as a new recording drops it."""
        dut, config, rule = self.dut, self.config, self.config.readout_rule
        fmt, whole = config.trajectory_format, steps == config.windows.steps
        values = self.drawn(steps, fmt.min_code, fmt.max_code)
        codes = narrowed(config, values)
        distances = self.distances(codes)
        if rule.taught:
            ctx.set(dut.commands.locked, 1)
        for k in range(steps):
            for number, value in enumerate(values[k].tolist()):
                last = number == len(values[k]) - 1
                ctx.set(dut.vector, {"valid": 1, "value": value})
                if not config.recurrent:
                    ctx.set(dut.logit_valid, 1)
                    ctx.set(dut.step_done, last)
                await ctx.tick()
                ctx.set(dut.vector, {"valid": 0, "value": 0})
                ctx.set(dut.logit_valid, 0)
                await self.pause(ctx, not last)
            for number in range(config.classes if config.recurrent else 0):
                ctx.set(dut.logit_valid, 1)
                ctx.set(dut.step_done, number == config.classes - 1)
                await ctx.tick()
                ctx.set(dut.logit_valid, 0)
                await self.pause(ctx, number < config.classes - 1)
            ctx.set(dut.step_done, 0)
            if cut and k == steps - 1:
                for _ in range(self.rng.randrange(readout_cycles(config))):
                    await ctx.tick()
                break
            scores: list[int] = []
            cycles = 0
            while len(scores) < config.classes and cycles < 1000:
                assert not ctx.get(dut.idle)
                if ctx.get(dut.score.valid):
                    scores.append(ctx.get(dut.score.value))
                await ctx.tick()
                cycles += 1
            self.latencies.add(cycles)
            assert scores == (~distances[k]).tolist() and ctx.get(dut.idle)
            if rule.unknown_above:
                assert ctx.get(dut.far) == (distances[k].min() > rule.unknown_above * (k + 1))
            await self.pause(ctx)  # until the decision is taken
        if cut:
            await self.pulse(ctx, clear=1)
            self.last = None
        else:
            await self.pulse(ctx, ended=1)
            self.last = codes if whole else None
            if self.following is not None and whole:
                self.model = teach(self.model, codes, self.following)
            self.expected_refused += self.following is not None and not whole
            self.following = None
        if rule.taught:
            ctx.set(dut.commands.locked, 0)

    async def command(self, ctx) -> None:
        """TEACH or FORGET at random, what cannot be done among them."""
        label, option, kind = self.rng.randrange(4), self.rng.random() < 0.4, self.rng.choice("ttttf")
        locked, busy, known = self.rng.random() < 0.1, not ctx.get(self.dut.idle), label < 3
        allowed = not (locked or busy) and (known or (kind == "f" and option))
        if kind == "t" and not option and self.last is None:
            allowed = False
        name = "teach" if kind == "t" else "forget"
        await self.pulse(ctx, **{name: 1, "label": label, "option": option, "locked": locked})
        self.expected_refused += not allowed
        if allowed and kind == "f":
            self.model = forget(self.model, None if option else label)
        elif allowed and option:
            self.following = label
        elif allowed:
            self.model, self.following = teach(self.model, self.last, label), None
        if self.rng.random() < 0.3:  # a new recording; a touch being written is finished
            await self.pulse(ctx, clear=1, locked=0)
        ctx.set(self.dut.commands.locked, 0)


@pytest.mark.parametrize(
    "cell, decision, stall, spare, shift",
    [
        ("gru", "last", 0.0, 0, 1),
        ("gru", "last", 0.4, 1, 2),
        ("gru", "vote", 0.4, 0, 1),
        ("gru", "vote", 0.2, 1, 0),
        ("linear", "last", 0.4, 0, 1),
    ],
)
def test_taught_and_forgotten_at_random(cell, decision, stall, spare, shift):
    """With a spare class, which has no prototype until it is taught, and none again when it is forgotten."""
    unknown = {} if decision == "vote" else {"unknown_above": 9 if cell == "linear" else 15}
    unknown |= {"spare_classes": spare, "taught_shift": shift}
    player = Player(small_model(7, cell, decision, **unknown), 11, stall)
    in_use = set()

    async def act(ctx):
        for number in range(16):
            steps = player.rng.choice((1, 2, 3, 3, 3, 3))
            await player.touch(ctx, steps, cut=player.rng.random() < 0.15)
            for _ in range(player.rng.randrange(4)):
                await player.command(ctx)
            await player.rest(ctx)
            in_use.add(int(taught_in_use(player.model).sum()))
            assert ctx.get(player.dut.commands.in_use) == taught_in_use(player.model).sum()
            if number % 12 == 10:  # another model is loaded
                player.model = small_model(number, cell, decision, **unknown)
                await player.load(ctx)

    player.run(act)
    assert player.latencies == {readout_cycles(player.config)}
    assert player.refused and len(in_use) > 2


@pytest.mark.parametrize("decision", ["last", "vote"])
def test_a_damaged_code_is_left_out(decision):
    """From the code on, until the touch ends; what was right of it before counts. Teaching its place anew mends it."""
    model = forget(small_model(7, "gru", decision, checksum=True))
    player = Player(model, 11, 0.2)

    async def act(ctx):
        for number in range(24):
            if number % 4 == 0:
                player.damage = None
                player.model = model
                for label in (0, 1, 1, 2):
                    player.model = teach(player.model, player.drawn(config.windows.steps, -8, 7), label)
                step = player.damaged(number // 4 % 3)
                await player.load(ctx)
            before, steps = player.wrong, player.rng.choice((1, 2, 3, 3))
            await player.touch(ctx, steps)
            await ctx.tick()
            assert player.wrong - before == (steps > step)
        await player.pulse(ctx, forget=1, label=2, option=0)
        player.damage, player.model, before = None, forget(player.model, 2), player.wrong
        for _ in range(3):
            await player.touch(ctx, config.windows.steps)
            await player.pulse(ctx, teach=1, label=2, option=0)
            player.model = teach(player.model, player.last, 2)
            await player.rest(ctx)
        assert player.wrong == before

    config = player.config
    player.run(act)
    assert player.left_out > 4
