"""Image of a model in a board's SPI flash: the host's writes, between a head and a checksum
(docs/specification.md section 16).

Plain Python (no Amaranth), so that command line and benches can share it.
"""

import binascii
import hashlib
import json

from eskin.golden.core import AcceleratorConfig, Arrays
from eskin.rtl.program.memory_map import load_words, load_writes, memory_words, words_per_entry

FLASH_OFFSET = 1 << 20
"""Byte of the flash at which the image starts: after the bitstream of every board."""
MAGIC = int.from_bytes(b"ESK", "big")
UNIT_BYTES = 3
"""Bytes of the two units of the head and of each write: register, then word."""
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
