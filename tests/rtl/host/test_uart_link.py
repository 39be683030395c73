"""The serial link alone, at its pins: packets in, frames and bus accesses out, and the other way round;
damage of every kind."""

import random
from types import SimpleNamespace

from hypothesis import given
from hypothesis import strategies as st

from eskin.golden.core import PRESETS
from eskin.live import link
from eskin.rtl.common import decision_layout
from eskin.rtl.host.uart import UartReceiver, uart_divisor
from eskin.rtl.host.uart_link import UartLink
from eskin.rtl.interface.stimulation import STIMULATOR_BAUD
from tests.support.pin_port import decoded
from tests.support.strategies import examples
from tests.support.stream_bench import pack, put, simulate
from tests.support.table import each_row, refused

CONFIG = PRESETS["thesis"].replace(taxels=4)


def frame(number: int, samples) -> bytes:
    return link.ordered_packet(number, link.FRAME, samples)


def write(number: int, address: int, word: int) -> bytes:
    return link.ordered_packet(number, address, [word])


def bits_of(byte: int) -> list[int]:
    """With its start bit."""
    return [0, *(byte >> k & 1 for k in range(8))]


def play(
    line, *, divisor=4, config=CONFIG, decisions=(), until=0, quiet=40, read_value=lambda address: 0, sent=()
):
    """What the link makes of ``line``: bytes, or ``None`` (10 bits of idle). until: cycles before frames are taken. sent:
    words of each frame to the host.

    frames: complete lists of samples. writes, reads: bus accesses. bodies: of packets it sent. expected, damaged.
    """
    dut = UartLink(config, divisor, bool(sent))
    seen, levels = SimpleNamespace(frames=[], writes=[], reads=[], expected=0, errors=[]), bytearray()

    async def talk(ctx):
        ctx.set(dut.rx, 1)
        for byte in line:
            for bit in [1] * 10 if byte is None else [*bits_of(byte), 1]:
                ctx.set(dut.rx, bit)
                await ctx.tick().repeat(divisor)
        ctx.set(dut.rx, 1)
        await ctx.tick().repeat(quiet * 10 * divisor)
        seen.expected = ctx.get(dut.expected)

    async def hear(ctx):
        async for _, _, level in ctx.tick().sample(dut.tx):
            levels.append(level)

    async def sink(ctx):
        beats = []
        strobes = (dut.frame.valid, dut.bus.w_stb, dut.bus.r_stb)
        while True:
            while not any(ctx.get(strobe) for strobe in strobes):
                await ctx.changed(*strobes)
            valid, w_stb, r_stb, is_ready, beat, address, word = (
                await ctx.tick().sample(
                    *strobes, dut.frame.ready, dut.frame.payload, dut.bus.addr, dut.bus.w_data
                )
            )[2:]
            if valid and is_ready:
                if beat.first != (not beats):
                    seen.errors.append(f"first flag of beat {len(beats)}")
                beats.append(beat.sample)
                if beat.last:
                    seen.frames.append(beats)
                    beats = []
            if w_stb:
                seen.writes.append((address, word))
            if r_stb:
                seen.reads.append(address)
                ctx.set(dut.bus.r_data, read_value(address))

    async def become_ready(ctx):
        if until:
            await ctx.tick().repeat(until)
        ctx.set(dut.frame.ready, 1)

    async def decide(ctx):
        for fields in decisions:
            if callable(fields):
                await fields(ctx, dut)
                continue
            put(ctx, dut.decision, payload=fields, valid=1)
            await ctx.tick().until(dut.decision.ready)
            ctx.set(dut.decision.valid, 0)

    async def send(ctx):
        for words in sent:
            for place, word in enumerate(words, 1):
                put(ctx, dut.words, payload={"word": word, "last": place == len(words)}, valid=1)
                await ctx.tick().until(dut.words.ready)
                ctx.set(dut.words.valid, 0)
            await ctx.tick().repeat(5)

    simulate(dut, talk, hear, sink, become_ready, decide, *[send] * bool(sent))
    unpacker = link.Unpacker()
    seen.bodies = unpacker.feed(decoded(bytes(levels), divisor)[0])
    seen.damaged = unpacker.damaged
    assert not seen.errors
    return seen


def test_frames_writes_and_reads():
    samples = [[1, 2, 3, 4], [0x7E7E, 0x7D7D, 0x5E7D, 0xFFFF], [0, 0x7D5D, 0x8000, 0x7E]]
    line = frame(0, samples[0]) + write(1, 0x02, 0x7D7E) + frame(2, samples[1]) + link.read_packet(0x13)
    seen = play(
        [*line, *[None] * 20, *frame(3, samples[2]), *write(4, 0x3F, 0xABCD)],
        read_value=lambda address: 0x7E00 | address,
    )
    assert seen.frames == samples
    assert seen.writes == [(2, 0x7D7E), (0x3F, 0xABCD)] and seen.reads == [0x13]
    assert [link.parse(body) for body in seen.bodies] == [
        link.Answer(0x13, 0x7E13, 3, 0)
    ] and not seen.damaged
    assert seen.expected == 5


@each_row("fields, at", [({}, 0x3C), ({"prototypes": 1, "taught": 1}, 0x48)])
def test_a_window_reaches_the_registers_of_teaching(fields, at):
    """Without taught places every address stays; every other address stays with them, too."""
    config = CONFIG.with_readout(readout="prototypes", **fields) if fields else CONFIG
    addresses = (0, 0x3B, *range(0x3C, 0x40))
    line = [byte for number, address in enumerate(addresses) for byte in write(number, address, 7)]
    seen = play([*line, *link.read_packet(0x3E), *[None] * 20], config=config)
    assert [address for address, _ in seen.writes] == [0, 0x3B, *range(at, at + 4)]
    assert seen.reads == [at + 2] and link.parse(seen.bodies[0]).address == 0x3E
    assert [link.link_address(number) for number in (0x3B, *range(0x48, 0x4C))] == [*range(0x3B, 0x40)]


@each_row("divisor", [4, 5, 13])
def test_divisors_and_decisions(divisor):
    decisions = [
        {"class": 3, "margin": 0x7E7D, "step": 0x7D, "is_global": 0, "partial": 1},
        {"class": 31, "margin": 0xFFFF, "step": 255, "is_global": 1, "partial": 0, "unsure": 1},
    ]
    seen = play([*frame(0, [9, 8, 7, 6]), *[None] * 5], divisor=divisor, decisions=decisions)
    payloads = [pack(decision_layout(CONFIG), fields) for fields in decisions]
    assert [link.parse(body) for body in seen.bodies] == [
        link.Decision(k, payload) for k, payload in enumerate(payloads)
    ]
    assert seen.frames == [[9, 8, 7, 6]]


@each_row("divisor", [4, 13])
def test_frames_to_the_host_between_decisions_and_answers(divisor):
    """Flags and escapes among their bytes, two taxels (whose packet is as long as 6 bytes) and four; a decision goes before a
    frame that waits, and one that is withdrawn breaks no frame off."""
    frames = [(1, 0x7E7D, 0x7E), (0x7D7E, 0xFFFF, 0), (3, *range(4)), (0x7E7E, 0x5D7D, 0x5E, 0x207D, 0x8000)]
    decisions = [{"class": 3, "margin": 0x7E7D, "step": k} for k in range(3)]

    async def withdrawn(ctx, dut):
        ctx.set(dut.decision.valid, 1)
        await ctx.tick().repeat(15 * divisor)
        ctx.set(dut.decision.valid, 0)
        await ctx.tick().repeat(40 * divisor)

    line = [byte for _ in range(3) for byte in [*link.read_packet(0x13), *[None] * 60]]
    seen = play(
        line, divisor=divisor, decisions=[*decisions, withdrawn], read_value=lambda _: 0x7E7D, sent=frames
    )
    parsed = [link.parse(body) for body in seen.bodies]
    heard = [message for message in parsed if isinstance(message, link.SensorFrame)]
    assert [(frame.number, *frame.words.tolist()) for frame in heard] == frames
    payloads = [pack(decision_layout(CONFIG), fields) for fields in decisions]
    assert [message for message in parsed if isinstance(message, link.Decision)] == [
        link.Decision(k, payload) for k, payload in enumerate(payloads)
    ]
    assert [message.value for message in parsed if isinstance(message, link.Answer)] == [0x7E7D] * 3
    assert len(parsed) == len(frames) + 6 and isinstance(parsed[0], link.Decision)


@examples(200, 2000)
@given(
    bodies=st.lists(
        st.binary(min_size=1, max_size=40)
        | st.lists(st.sampled_from(b"\x7d\x7e\x5d\x5e\x20"), min_size=1).map(bytes)
    ),
    cut=st.integers(0, 200),
)
def test_packets_survive_the_line_in_any_pieces(bodies, cut):
    stream = b"".join(map(link.pack, bodies))
    assert stream.count(0x7E) == 2 * len(bodies)
    unpacker = link.Unpacker()
    assert unpacker.feed(stream[:cut]) + unpacker.feed(stream[cut:]) == bodies and unpacker.damaged == 0


SAMPLES = [[0x7E00 + k, 0x7D7D - k, k << 12, 0x1234 * k & 0xFFFF] for k in range(5)]
PACKETS = [
    frame(0, SAMPLES[0]),
    write(1, 2, 0x7E7D),
    frame(2, SAMPLES[1]),
    frame(3, SAMPLES[2]),
    write(4, 0xB, 7),
]


def flipped(packet: bytes) -> bytes:
    """The packet with a bit flipped, once in each of its bytes."""
    rng = random.Random(6)
    return b"".join(
        packet[:at] + bytes([packet[at] ^ 1 << rng.randrange(8)]) + packet[at + 1 :]
        for at in range(1, len(packet) - 1)
    )


WORDS = {n: link.ordered_packet(0, link.FRAME, SAMPLES[0][:n] + [0] * (n - 4)) for n in (3, 5)}
# As long as the count of words could go round by, with a frame's beginning wherever it does.
ENDLESS = link.ordered_packet(0, 0, [link.FRAME << 8 if word % 8 == 7 else 9 for word in range(36)])
LENGTHS = [
    *WORDS.values(),
    link.pack(bytes([0, link.FRAME]) + bytes(9)),
    link.ordered_packet(0, 2, [1, 2]),
    link.pack(bytes([0, 2])),
    ENDLESS,
    link.pack(b"") + b"\x7e\x7e",
]
# Its last six bytes look like a write that is due, and the check sequence is the whole packet's.
EARLY = frame(1, [7, 7, 0x0201, 0x1111])
LINES = {
    "the first packet after a reset needs no flag in front": (PACKETS[0][1:], 0, SAMPLES[:1], [], 1),
    "a flipped bit makes a frame or a write nothing": (
        flipped(PACKETS[0]) + flipped(write(0, 2, 5)) + frame(0, SAMPLES[1]),
        0,
        SAMPLES[1:2],
        [],
        1,
    ),
    "a number that is not due does nothing": (
        PACKETS[1] + PACKETS[2] + frame(255, SAMPLES[0]) + PACKETS[0] + PACKETS[0] + PACKETS[2],
        0,
        SAMPLES[:1],
        [],
        1,
    ),
    "lengths are exact": (b"".join(LENGTHS) + PACKETS[0], 0, SAMPLES[:1], [], 1),
    "an escape before a flag breaks a packet off": (
        PACKETS[0][:-1] + b"\x7d\x7e" + frame(0, SAMPLES[1]),
        0,
        SAMPLES[1:2],
        [],
        1,
    ),
    "what comes while a frame waits is dropped, and taken when sent again": (
        [*b"".join(PACKETS[:3]), *[None] * 20, *PACKETS[1], *PACKETS[2]],
        10 * 4 * sum(map(len, PACKETS[:3])),
        SAMPLES[:2],
        [(2, 0x7E7D)],
        3,
    ),
    "the rest of a packet that came too early is not taken for one": (
        [*PACKETS[0], *EARLY, *[None] * 2],
        10 * 4 * (len(PACKETS[0]) + 7) + 15,
        SAMPLES[:1],
        [],
        1,
    ),
}
"""Of each: the line, cycles until the accelerator is ready, frames, writes and the count that they make."""


@each_row("name", LINES)
def test_what_becomes_of_a_line(name):
    line, until, frames, writes, expected = LINES[name]
    seen = play(line, until=until, quiet=5)
    assert (seen.frames, seen.writes, seen.expected) == (frames, writes, expected)


@each_row("after", [1, 270, 305])
def test_a_decision_withdrawn_on_its_way_does_not_count(after):
    """Broken off it is no packet; when its last byte was under way it is one, and the next decision has the
    same number."""
    payload = {"class": 3, "margin": 0x1234, "step": 7, "is_global": 1, "partial": 0}
    others = {"class": 1, "margin": 0, "step": 0, "is_global": 0, "partial": 0}

    async def offer_and_withdraw(ctx, dut):
        put(ctx, dut.decision, payload=payload, valid=1)
        await ctx.tick().repeat(after)
        put(ctx, dut.decision, valid=0, payload=others)
        await ctx.tick().repeat(600)

    seen = play([*[None] * 50, *link.read_packet(4)], quiet=30, decisions=[offer_and_withdraw, others])
    whole = pack(decision_layout(CONFIG), others)
    bodies = [link.parse(body) for body in seen.bodies]
    assert bodies[-2:] == [link.Decision(0, whole), link.Answer(4, 0, 0, 1)]
    assert bodies[:-2] == ([link.Decision(0, pack(decision_layout(CONFIG), payload))] if after > 290 else [])


def test_rates():
    assert uart_divisor(12e6, 2e6) == 6 and uart_divisor(47_981_000, STIMULATOR_BAUD) == 417
    with refused("use 1.92308e"):
        uart_divisor(25e6, 2e6)
    with refused("use at most 3e"):
        uart_divisor(12e6, 6e6)


def received(divisor: int, line) -> list[int]:
    """The bytes in ``line``, levels with the bits that they last; edges fall between clocks too."""
    dut, data = UartReceiver(divisor), []

    async def talk(ctx):
        for level, bits in line:
            ctx.set(dut.rx, level)
            await ctx.delay(bits * divisor * 1e-6)
        await ctx.delay(divisor * 4e-6)

    async def hear(ctx):
        async for _, _, byte, valid in ctx.tick().sample(dut.data, dut.valid):
            if valid:
                data.append(byte)

    simulate(dut, talk, hear)
    return data


@each_row("divisor, error", [(4, -0.02), (6, 0.02), (25, -0.02), (25, 0.02)])
def test_bytes_of_a_sender_two_percent_off(divisor, error):
    sent = [0x00, 0xFF, 0x55, 0xAA, 0x01, 0x80] * 2
    line = []
    for index, byte in enumerate(sent):
        line += [(bit, 1 + error) for bit in bits_of(byte)] + [(1, 1 + error + 0.13 * index / divisor)]
    assert received(divisor, line) == sent
