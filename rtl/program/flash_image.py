"""What a board's SPI flash holds of a model: the host's writes, between a head and a checksum
(docs/specification.md section 16).

Plain Python (no Amaranth), so that command line and benches can share it.
"""

import binascii
import hashlib
import json
from dataclasses import dataclass

from eskin.golden.core import AcceleratorConfig, Arrays, InputError
from eskin.rtl.program.memory_map import (
    load_words,
    load_writes,
    memory_words,
    prototype_words,
    words_per_entry,
)

FLASH_OFFSET = 1 << 20
"""Byte of the flash at which the image begins: behind the bitstream of every board."""
MAGIC = int.from_bytes(b"ESK", "big")
UNIT_BYTES = 3
"""Of the head's two units, and of each write: register, then word."""
CHECK_BYTES = 4


def design_number(config: AcceleratorConfig) -> int:
    """24 bits that identify the design of an image.

    A hash of the configuration without its name, and of the sizes of its memories.
    """
    fields = json.loads(config.to_json())
    fields.pop("name", None)
    sizes = {
        select: count * words_per_entry(config, select) for select, count in memory_words(config).items()
    }
    text = json.dumps([fields, sorted(sizes.items()), load_words(config)], sort_keys=True)
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:UNIT_BYTES], "big")


def checksum(data: bytes) -> int:
    """CRC-32/MPEG-2: x^32 + x^26 + ... + 1 (0x04C11DB7), highest bit first, starts with ones, nothing
    inverted at the end."""
    mirrored = bytes(int(f"{byte:08b}"[::-1], 2) for byte in data)
    return int(f"{binascii.crc32(mirrored) ^ 0xFFFFFFFF:032b}"[::-1], 2)


def sealed(number: int, writes: list[tuple[int, int]]) -> bytes:
    """The image of (register, word) writes for the design ``number``."""
    body = b"".join(
        int(register).to_bytes(1, "big") + (int(word) & 0xFFFF).to_bytes(2, "big")
        for register, word in writes
    )
    image = MAGIC.to_bytes(UNIT_BYTES, "big") + number.to_bytes(UNIT_BYTES, "big") + body
    return image + checksum(image).to_bytes(CHECK_BYTES, "big")


def flash_image(config: AcceleratorConfig, arrays: Arrays) -> bytes:
    """The image of an integer model, for ``FLASH_OFFSET``."""
    return sealed(design_number(config), load_writes(config, arrays))


def write_count(config: AcceleratorConfig) -> int:
    """Writes of an image of this configuration, whatever the weights."""
    words = sum(1 + count * words_per_entry(config, select) for select, count in memory_words(config).items())
    return words + -(-config.sensor.taxels // 16)


# ---------------------------------------------------------------------- what the board was taught
PAGE_BYTES = 256
"""What a flash programs with one command."""
ERASES = {4096: 0x20, 65536: 0xD8}
"""Bytes that a flash erases at once, with which command."""


@dataclass(frozen=True, kw_only=True)
class LogLayout:
    """The log of taught touches in the flash.

    offset: its first byte. half, stride: bytes of each half, and from record to record, powers of two. erase:
    the command that erases a half. tag_bits: of what a record begins with, so that it has whole bytes. The
    rest is the memory PROTOTYPES: steps, values a step, bits a word, prototypes and places for taught touches
    a class, words of codes.
    """

    offset: int
    half: int
    stride: int
    erase: int
    tag_bits: int
    steps: int
    values: int
    bits: int
    classes: int
    prototypes: int
    taught: int
    words: int


def log_layout(config: AcceleratorConfig) -> LogLayout | None:
    """That of a design which reads its model out of the flash; None where nothing can be taught.

    Raises
    ------
    InputError
        A touch is larger than a page, or there are too many of them.
    """
    rule = config.readout_rule
    if not rule.taught:
        return None
    bits, steps, values = (
        rule.state_code_bits + config.hardware.checksum,
        config.windows.steps,
        config.trajectory_width,
    )
    tag_bits = 8 + -(steps * values * bits) % 8
    record = (tag_bits + steps * values * bits) // 8 + CHECK_BYTES
    stride, places = 1 << (record - 1).bit_length(), config.classes * rule.taught
    half = next((size for size in ERASES if size // stride > 2 * places), None)
    if stride > PAGE_BYTES or half is None:
        raise InputError(
            f"--flash: a taught touch takes {record} bytes of {PAGE_BYTES}, and there are places for {places} of "
            f"{max(ERASES) // (2 * stride)}; quantise with fewer --taught, or leave places out with --taught 0"
        )
    image = UNIT_BYTES * (2 + write_count(config)) + CHECK_BYTES
    return LogLayout(
        offset=FLASH_OFFSET + -(-image // (2 * half)) * 2 * half,
        half=half,
        stride=stride,
        erase=ERASES[half],
        tag_bits=tag_bits,
        steps=steps,
        values=values,
        bits=bits,
        classes=config.classes,
        prototypes=rule.prototypes,
        taught=rule.taught,
        words=prototype_words(config),
    )


def flash_contents(config: AcceleratorConfig, arrays: Arrays) -> bytes:
    """`flash_image`, with an erased log behind it where there is one: another model's touches are gone."""
    image, log = flash_image(config, arrays), log_layout(config)
    return image.ljust(log.offset - FLASH_OFFSET + 2 * log.half, b"\xff") if log else image
