"""rtl/host/taught_log.py beside golden/model/taught_log.py: what is taught and forgotten is there after the power was
off, and the power may go at any byte."""

from __future__ import annotations

import dataclasses
import random
from functools import partial

import numpy as np
import pytest
from amaranth.sim import Simulator
from hypothesis import event, example, given
from hypothesis import strategies as st

from eskin.golden.core import PRESETS, AcceleratorConfig, InputError
from eskin.golden.model import IntegerModel, random_integer_model
from eskin.golden.model.prototypes import forget, taught_in_use, teach
from eskin.golden.model.taught_log import HEAD, played, record, sizes
from eskin.rtl.host.taught_log import TaughtLog
from eskin.rtl.program.flash_image import log_layout, sealed
from eskin.rtl.program.memory_map import (
    Control,
    Memory,
    Register,
    TeachRegister,
    memory_images,
    taught_arrays,
)
from tests.support.fuzz_inputs import damage_bytes
from tests.support.spi_flash import SpiFlash
from tests.support.strategies import examples

NUMBER, WAKE, HALF, OFFSET = 0x5A1234, 7, 64, 256
IMAGE = sealed(NUMBER, [(int(Register.MASK), 0)])
NONE, NEXT, PASS_CYCLES = 0xFFFF, 1 << 7, 40


def tiny_model(**fields: int | bool) -> IntegerModel:
    """A record takes 7 bytes of 8; a half has room for 7 touches, and there are places for 6."""
    rule = {
        "readout": "prototypes",
        "prototypes": 2,
        "taught": 3,
        "state_code_bits": 3,
        "state_code_shift": 9,
    }
    config = AcceleratorConfig.of(taxels=4, cell="linear", steps=2, class_names=("a", "b"), **(rule | fields))
    return random_integer_model(config, 4)


class Registers:
    """The registers of a readout and its memory, in the words of docs/specification.md, section 18."""

    def __init__(self, bus, model: IntegerModel, rng: random.Random) -> None:
        config = self.config = model.config
        self.bus, self.rng, self.rule = bus, rng, config.readout_rule
        self.words = memory_images(config, model.arrays)[Memory.PROTOTYPES]
        self.codes, self.width = len(self.words) - config.classes, config.trajectory_width
        self.cycle = self.place = self.odd = self.refused = self.named = self.ready_at = self.given_from = 0
        self.whole = self.following = self.armed = False

    def taught(self, label: int) -> None:
        row, places = self.codes // self.config.windows.steps, self.rule.prototypes + self.rule.taught
        count = self.words[self.codes + label]
        place = 1 + label * places + self.rule.prototypes + count % self.rule.taught
        for own in range(0, self.codes, row):
            at = own + place * self.width
            self.words[at : at + self.width] = self.words[own : own + self.width]
        self.words[self.codes + label] = self.rule.taught if count + 1 == 2 * self.rule.taught else count + 1
        self.ready_at = self.cycle + PASS_CYCLES

    def touch(self, codes: np.ndarray, whole: bool) -> None:
        """One ends."""
        own = memory_words(self.config, codes)
        for k, row in enumerate(range(0, self.codes, self.codes // len(own))):
            self.words[row : row + self.width] = own[k]
        self.whole = whole
        if self.following and whole:
            self.taught(self.named)
        self.refused |= self.following and not whole
        self.following = False

    def write(self, address: int, word: int) -> None:
        free, label = self.cycle >= self.ready_at, word & 0x7F
        if address == TeachRegister.PLACES:
            self.place, self.given_from = word, self.cycle + 2
        elif address == Register.MEMORY_DATA:
            assert free and not self.whole
            self.words[self.place] = word
            self.place += 1
        elif (
            address == TeachRegister.TEACH
            and free
            and label < self.config.classes
            and (word >> 7 or self.whole)
        ):
            self.following, self.named = bool(word & NEXT), label
            if not self.following:
                self.taught(label)
        elif address == TeachRegister.FORGET and free:
            first, last = (0, self.config.classes) if word & NEXT else (label, label + 1)
            self.words[self.codes + first : self.codes + last] = [0] * (last - first)
        elif address in (TeachRegister.TEACH, TeachRegister.FORGET):
            self.refused = 1
        elif address == Register.CONTROL:
            self.armed |= bool(word & Control.ARM)
            self.refused &= not word & Control.CLEAR_FAULTS
        else:
            assert address == Register.MASK

    async def play(self, ctx):
        bus = self.bus
        while True:
            sampled = await ctx.tick().sample(bus.w_stb, bus.r_stb, bus.addr, bus.w_data)
            write, read, address, word = (int(value) for value in sampled[-4:])
            self.cycle += 1
            self.odd ^= self.cycle == self.ready_at
            if write:
                self.write(address, word)
            if read and address == TeachRegister.TAUGHT:
                ctx.set(bus.r_data, self.refused << 8 | self.odd << 9)
            elif read:
                assert address == TeachRegister.PLACES
                given = (
                    self.cycle >= max(self.given_from, self.ready_at) and self.rng.random() < 0.9
                )  # a touch
                ctx.set(bus.r_data, self.words[self.place] | self.place % 128 << 9 if given else NONE)


def memory_words(config: AcceleratorConfig, codes: np.ndarray) -> list[list[int]]:
    """(K, values) as the memory has them."""
    bits = config.readout_rule.state_code_bits
    words = codes & (1 << bits) - 1
    if config.hardware.checksum:
        words |= np.array([[int(word).bit_count() & 1 for word in row] for row in words]) << bits
    return words.tolist()


class Board:
    """A board that is switched on with ``log`` in its flash."""

    def __init__(self, model: IntegerModel, log: bytes, seed: int = 1) -> None:
        self.model = model
        layout = dataclasses.replace(log_layout(model.config), offset=OFFSET, half=HALF)
        self.dut = TaughtLog(NUMBER, 1, log=layout, wake_cycles=WAKE, offset=0)
        self.rng = random.Random(seed)
        self.registers = Registers(self.dut.bus, model, self.rng)
        image, erase = IMAGE.ljust(OFFSET, b"\xff") + log, (layout.erase, HALF)
        self.flash = SpiFlash(self.dut.pins, 0, image, WAKE - 2, erase=erase)

    @property
    def log(self) -> bytes:
        return bytes(self.flash.image[OFFSET:])

    @property
    def holds(self) -> IntegerModel:
        """The model with what is in the memory."""
        words = self.registers.words
        came = taught_arrays(self.model.config, lambda first, count: words[first : first + count])
        return IntegerModel(self.model.config, {**self.model.arrays, **came}, "a board")

    def run(self, act=None) -> Board:
        """``act(board, ctx)`` once the log is played."""

        async def bench(ctx):
            while not ctx.get(self.dut.done):
                await ctx.tick()
                assert self.registers.cycle < 30_000 and not ctx.get(self.dut.failed)
            if act:
                await act(self, ctx)

        simulator = Simulator(self.dut)
        simulator.add_clock(1e-6)
        simulator.add_testbench(self.flash.play, background=True)
        simulator.add_testbench(self.registers.play, background=True)
        simulator.add_testbench(bench)
        simulator.run()
        assert not self.flash.wrong and self.registers.armed
        return self

    async def ask(self, ctx, **request: int) -> None:
        """A request; until all is written."""
        for name, value in request.items():
            ctx.set(getattr(self.dut.request, name), value)
        await ctx.tick()
        for name in request:
            ctx.set(getattr(self.dut.request, name), 0)
        quiet = 0
        for cycle in range(12_000):
            ctx.set(self.dut.request.look, cycle % 200 == 199)
            await ctx.tick()
            quiet = quiet + 1 if ctx.get(self.dut.pins.cs_n) else 0
            if quiet > 450:
                break
        ctx.set(self.dut.request.look, 0)
        await ctx.tick().repeat(4)

    def codes(self) -> np.ndarray:
        config, fmt = self.model.config, self.model.config.state_code_format
        size = config.windows.steps * config.trajectory_width
        drawn = [self.rng.randint(fmt.min_code, fmt.max_code) for _ in range(size)]
        return np.array(drawn, dtype=np.int64).reshape(config.windows.steps, -1)


def by_age(model: IntegerModel) -> list[list[list[int]]]:
    """Of each class what it was taught, the oldest first: a snapshot may turn the places."""
    taught, ages = model.config.readout_rule.taught, []
    for label, used in enumerate(taught_in_use(model)):
        first = int(model.arrays["taught_count"][label]) % taught if used == taught else 0
        ages.append(
            [model.arrays["taught"][label, (first + k) % taught].ravel().tolist() for k in range(used)]
        )
    return ages


ERASED = b"\xff" * 2 * HALF


@pytest.fixture(autouse=True)
def small_halves(monkeypatch):
    monkeypatch.setattr("eskin.golden.model.taught_log.sizes", lambda config: (HALF, sizes(config)[1]))


@pytest.mark.parametrize("checksum", [False, True])
def test_all_is_there_again_whatever_was_asked(checksum):
    """Touches taught, named beforehand, cut short and forgotten, with a power cycle now and then; every answer and
    all that is held as in the golden model."""
    model = tiny_model(checksum=checksum)
    held, log, kinds = model, ERASED, set()

    async def act(board, ctx):
        nonlocal held
        for _ in range(6):
            label, kind = board.rng.randrange(2), board.rng.choice("ttttnnfx")
            codes, whole = board.codes(), board.rng.random() < 0.8
            refused = not whole and kind in "tn"
            if kind == "n":
                await board.ask(ctx, teach=1, option=1, label=label)
            if kind != "f":
                board.registers.touch(codes, whole)
            if kind == "t":
                await board.ask(ctx, teach=1, label=label)
            elif kind == "f":
                await board.ask(ctx, forget=1, label=label)
                held = forget(held, label)
            else:
                await board.ask(ctx)
            if kind in "tn" and whole:
                held = teach(held, codes, label)
            kinds.add((kind, whole))
            if kind in "tnf":
                assert ctx.get(board.dut.request.refused) == refused, kind
            assert by_age(board.holds) == by_age(held)

    for start in range(5):
        board = Board(model, log, seed=start).run()
        assert by_age(board.holds) == by_age(held) == by_age(played(model, log))
        board = Board(model, log, seed=start).run(act)
        log = board.log
    assert len(kinds) == 8


async def teach_one(board, ctx, label: int) -> None:
    board.registers.touch(board.codes(), True)
    await board.ask(ctx, teach=1, label=label)


async def forget_one(board, ctx, label: int) -> None:
    await board.ask(ctx, forget=1, label=label)


def torn(log: bytes, changes: list[tuple[int, int]], rng: random.Random) -> bytes:
    """The power went in the last one of these changes, in which only some bits had changed."""
    data = bytearray(log)
    for at, byte in changes:
        data[at - OFFSET], before = byte, data[at - OFFSET]
    some = rng.randrange(256)
    data[at - OFFSET] = before & ~some | byte & some
    return bytes(data)


def test_the_power_may_go_at_any_byte():
    """Behind it stands all or nothing of what was asked: a touch appended, one that begins or fills a half, all of a
    class forgotten. Whatever bits the last byte was left with, the log goes on."""
    model, log, cuts, rng = tiny_model(), ERASED, 0, random.Random(8)
    held = model
    for number in range(10):
        act, label = (forget_one if number == 8 else teach_one), int(number > 1)
        whole = Board(model, log, number).run(partial(act, label=label))
        before, after = by_age(held), by_age(whole.holds)
        assert before != after and by_age(played(model, whole.log)) == after
        changes = whole.flash.changes
        for count in range(1, len(changes) + 1):
            left = torn(log, changes[:count], rng)
            seen = by_age(played(model, left))
            assert seen in (before, after), (number, count)
            if count % 64 == 6 * number:
                again = Board(model, left, count).run(partial(teach_one, label=0))
                assert by_age(played(model, again.log)) == by_age(again.holds)
                assert by_age(again.holds)[1:] == seen[1:]
        cuts += len(changes)
        log, held = whole.log, whole.holds
    print(cuts, "cuts")
    assert cuts > 200


def forged(model: IntegerModel, rng: random.Random) -> bytes:
    """A log of records that have right checksums and any tag, in any order; some bytes of it damaged."""
    config, log, fmt = model.config, bytearray(ERASED), model.config.state_code_format
    for half, ends in ((0, rng.randrange(9)), (1, rng.randrange(9))):
        for place in range(ends):
            codes = [
                rng.randint(fmt.min_code, fmt.max_code)
                for _ in range(config.windows.steps * config.trajectory_width)
            ]
            tag = rng.choice(
                (HEAD | rng.randrange(4), rng.randrange(3), rng.randrange(3), rng.randrange(256))
            )
            made = record(config, tag if place else HEAD | rng.randrange(4), np.array(codes))
            at = half * HALF + place * sizes(config)[1]
            log[at : at + len(made)] = made
    return (damage_bytes(bytes(log), rng) if rng.randrange(2) else bytes(log))[: len(log)].ljust(
        len(log), b"\xff"
    )


def has_a_gap(model: IntegerModel, log: bytes) -> bool:
    """A record stands behind one that is erased, as no board leaves it: it would be back when that one is written."""
    places = np.frombuffer(log, np.uint8).reshape(2, -1, sizes(model.config)[1])
    erased = (places[..., :7] == 255).all(axis=-1)
    return bool((erased[:, :-1] & ~erased[:, 1:]).any())


@pytest.mark.parametrize("checksum", [False, True])
@examples(4, 150)
@example(rng=random.Random(0))  # has a touch of a class that is not there
@given(rng=st.randoms(use_true_random=False))
def test_any_log_is_played_as_the_golden_model_plays_it(checksum, rng):
    """Then it goes on: another touch is there after the power was off."""
    model = tiny_model(checksum=checksum)
    log = forged(model, rng)
    held = played(model, log)
    event(f"in use {taught_in_use(held).sum()}")
    if has_a_gap(model, log):
        assert by_age(Board(model, log).run().holds) == by_age(held)
        return
    board = Board(model, log, rng.randrange(100)).run(partial(teach_one, label=1))
    assert by_age(board.holds) == by_age(played(model, board.log))
    assert by_age(board.holds)[0] == by_age(held)[0]


def test_sizes_are_those_of_the_golden_model_and_what_has_no_room_is_refused():
    rule = {"readout": "prototypes", "taught": 3, "state_code_bits": 4, "state_code_shift": 9}
    for checksum in (False, True):
        config = PRESETS["pvdf"].with_readout(**rule).replace(checksum=checksum)
        layout = log_layout(config)
        assert (layout.half, layout.stride) == sizes(config) == ((65536, 256) if checksum else (4096, 128))
    with pytest.raises(InputError, match="takes 275 bytes of 256"):
        log_layout(config.replace(steps=36))
