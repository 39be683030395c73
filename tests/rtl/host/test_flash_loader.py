"""rtl/host/flash_loader.py: the words come in order, and ``done`` only when all of them were whole."""

import binascii

from eskin.rtl.host.flash_loader import OFFSET, WAKE_S, FlashLoader, image
from tests.support.spi_flash import SpiFlash
from tests.support.stream_bench import Bench
from tests.support.table import each_row

WAKE_CYCLES = 7
WORDS = [8, 0xBEEF, 1, 0x4208, 0x8000, 3]


def load(contents: bytes, *, offset: int = OFFSET, wakes: int = WAKE_CYCLES):
    """(words, done, cycles until the flash is let go, the flash) of a start with ``contents`` in the flash."""
    dut = FlashLoader(len(WORDS), WAKE_CYCLES / WAKE_S)
    bench, heard, ended = Bench(dut), [], []
    flash = SpiFlash(dut.flash, offset, contents, wakes)
    bench._sim.add_testbench(flash.play, background=True)

    async def play(ctx):
        for _ in range(1500):
            await ctx.tick()
            if ctx.get(dut.valid):
                heard.append(ctx.get(dut.word))
            if not ctx.get(dut.flash.cs_n):
                ended[:] = [bench.cycle]
        assert ctx.get(dut.flash.cs_n)
        ended.append(ctx.get(dut.done))

    bench.process(play)
    bench.run()
    last, done = ended
    assert set(flash.commands) <= {0xAB, 0x03}
    return heard, bool(done), last, flash


def mirrored(data: bytes) -> bytes:
    return bytes(int(f"{byte:08b}"[::-1], 2) for byte in data)


def test_the_image_is_the_words_and_their_checksum():
    contents = image(WORDS)
    assert contents[:-4] == b"".join(word.to_bytes(2, "big") for word in WORDS)
    inverted = binascii.crc32(mirrored(contents[:-4])) ^ 0xFFFFFFFF  # what crc32 inverts at the end
    assert int.from_bytes(contents[-4:], "big") == int(f"{inverted:032b}"[::-1], 2)


def test_the_words_come_in_order():
    heard, done, cycles, flash = load(image(WORDS))
    assert heard == WORDS and done and flash.early == 0 and flash.commands == [0xAB, 0x03]
    assert cycles <= 32 + WAKE_CYCLES + 4 * (32 + 16 * len(WORDS) + 32) + 6


@each_row(
    "contents",
    [
        b"",  # erased, or no flash on a line that is pulled up
        bytes(200),
        image(WORDS)[:2] + b"\x3f" + image(WORDS)[3:],  # a flipped bit
        image(WORDS)[:-1] + bytes([image(WORDS)[-1] ^ 1]),  # of the checksum
        image(WORDS[:-1]),
        image([*WORDS, 1]),
        image([WORDS[1], WORDS[0], *WORDS[2:]])[:-4] + image(WORDS)[-4:],
    ],
)
def test_what_is_not_whole_is_never_done(contents):
    heard, done, _, _ = load(contents)
    assert not done and len(heard) == len(WORDS)


def test_at_another_place_or_asleep_there_is_nothing():
    assert not load(image(WORDS), offset=OFFSET + 1)[1]
    _, done, _, flash = load(image(WORDS), wakes=WAKE_CYCLES + 3)
    assert flash.early and not done
