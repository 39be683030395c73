"""rtl/host/flash_loader.py: the image's writes, in order; nothing is done from one that is not whole."""

from eskin.golden.core import PRESETS
from eskin.rtl.host.flash_loader import FlashLoader
from eskin.rtl.program.flash_image import (
    FLASH_OFFSET,
    checksum,
    design_number,
    flash_image,
    sealed,
    write_count,
)
from eskin.rtl.program.memory_map import Control, Register, load_writes
from tests.support.random_models import random_integer_model
from tests.support.spi_flash import SpiFlash
from tests.support.stream_bench import Bench
from tests.support.table import each_row

NUMBER, WAKE_CYCLES = 0x5A1234, 7
WRITES = [(8, 0), (9, 0xBEEF), (9, 1), (8, 0x42), (9, 0x8000), (16, 3)]
ARM = (int(Register.CONTROL), int(Control.ARM))


def load(image: bytes, *, offset: int = FLASH_OFFSET, wakes: int = WAKE_CYCLES - 2):
    """(writes on the bus, done, failed, cycles, the flash) of a start with ``image`` in the flash."""
    dut = FlashLoader(NUMBER, len(WRITES), wake_cycles=WAKE_CYCLES)
    bench, heard, ended = Bench(dut), [], []
    flash = SpiFlash(dut.flash, offset, image, wakes)
    bench._sim.add_testbench(flash.play, background=True)

    async def play(ctx):
        for cycle in range(2000):
            await ctx.tick()
            if ended and cycle > ended[0] + 150:
                break
            if ctx.get(dut.bus.w_stb):
                heard.append((ctx.get(dut.bus.addr), ctx.get(dut.bus.w_data)))
            if not ended and (ctx.get(dut.done) or ctx.get(dut.failed)):
                ended.append(bench.cycle)
        ended.append((ctx.get(dut.done), ctx.get(dut.failed), ctx.get(dut.flash.cs_n)))

    bench.process(play)
    bench.run()
    cycles, (done, failed, cs_n) = ended
    assert cs_n and done + failed == 1 and set(flash.commands) <= {0xAB, 0x03}
    return heard, bool(done), cycles, flash


def test_the_writes_come_in_order_and_arm_behind_them():
    heard, done, cycles, flash = load(sealed(NUMBER, WRITES))
    assert heard == [*WRITES, ARM] and done and flash.early == 0 and flash.commands == [0xAB, 0x03]
    assert cycles <= 32 + WAKE_CYCLES + 4 * (32 + 48 + 24 * len(WRITES) + 32) + 6


@each_row(
    "image, written",
    [
        (b"", 0),  # erased, or no flash on a line that is pulled up
        (bytes(200), 0),
        (b"ESX" + sealed(NUMBER, WRITES)[3:], 0),  # another head
        (sealed(NUMBER + 1, WRITES), 0),  # of another design
        (sealed(NUMBER, WRITES[:-1]), 6),  # too short
        (sealed(NUMBER, [*WRITES, (9, 1)]), 6),
        # exchanged
        (sealed(NUMBER, [WRITES[1], WRITES[0], *WRITES[2:]])[:-4] + sealed(NUMBER, WRITES)[-4:], 6),
    ],
)
def test_what_is_no_whole_image_of_this_design_is_refused(image, written):
    heard, done, _, _ = load(image)
    assert not done and len(heard) == written and ARM not in heard


def test_at_another_place_or_asleep_there_is_nothing():
    assert not load(sealed(NUMBER, WRITES), offset=FLASH_OFFSET + 1)[1]
    heard, done, _, flash = load(sealed(NUMBER, WRITES), wakes=WAKE_CYCLES + 3)
    assert flash.early and not done and not heard


def test_an_image_is_the_hosts_writes_and_tells_its_design():
    model = random_integer_model(PRESETS["thesis"], 1)
    image = flash_image(model.config, model.arrays)
    assert (
        len(image)
        == 3 * (2 + write_count(model.config)) + 4
        == 3 * (2 + len(load_writes(model.config, model.arrays))) + 4
    )
    assert checksum(b"123456789") == 0x0376E6E7  # the catalogue's check value of CRC-32/MPEG-2
    other = random_integer_model(PRESETS["thesis"].replace(hidden=model.config.network.hidden + 1), 1)
    assert design_number(other.config) != design_number(model.config)
    assert design_number(model.config.replace(name="another")) == design_number(model.config)
