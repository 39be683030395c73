"""The log of taught touches in a board's flash (docs/specification.md, section 18): what a board makes of one
when it is switched on."""

import numpy as np

from eskin.golden.core import AcceleratorConfig
from eskin.golden.model.model import IntegerModel
from eskin.golden.model.prototypes import forget, teach

POLYNOMIAL, HEAD = 0x04C11DB7, 0x80


def remainder(bits: list[int]) -> int:
    """CRC-32/MPEG-2 of bits."""
    crc = 0xFFFFFFFF
    for bit in bits:
        crc = (crc << 1 & 0xFFFFFFFF) ^ (POLYNOMIAL if crc >> 31 ^ bit else 0)
    return crc


def _bits(value: int, count: int) -> list[int]:
    return [value >> place & 1 for place in reversed(range(count))]


def _lead(config: AcceleratorConfig) -> int:
    """Zeros before the tag, so that a record has whole bytes."""
    width = config.readout_rule.state_code_bits + config.hardware.checksum
    return -config.windows.steps * config.trajectory_width * width % 8


def record(config: AcceleratorConfig, tag: int, codes: np.ndarray) -> bytes:
    """A record. codes: (K, values)."""
    width = config.readout_rule.state_code_bits
    bits = _bits(tag, 8 + _lead(config))
    for code in np.ravel(codes).tolist():
        word = _bits(code, width)
        bits += [sum(word) % 2, *word] if config.hardware.checksum else word
    return np.packbits(bits + _bits(remainder(bits), 32)).tobytes()


def _length(config: AcceleratorConfig) -> int:
    return len(record(config, 0, np.zeros((config.windows.steps, config.trajectory_width), dtype=np.int64)))


def sizes(config: AcceleratorConfig) -> tuple[int, int]:
    """Bytes of a half, and from record to record."""
    length, stride = _length(config), 1
    while stride < length:
        stride *= 2
    # the head, every place once after an erasure, and as many touches until the next one
    needed = 1 + 2 * config.classes * config.readout_rule.taught
    return (4096 if needed * stride <= 4096 else 65536), stride


def _read(config: AcceleratorConfig, bits: np.ndarray) -> tuple[int, np.ndarray] | None:
    """(tag, codes) of a record; None where its checksum is wrong."""
    width, parity, first = config.readout_rule.state_code_bits, int(config.hardware.checksum), _lead(config)
    if remainder(bits.tolist()):  # over a record with its CRC it is 0
        return None
    words = bits[first + 8 : -32].reshape(-1, parity + width)[:, parity:].astype(np.int64)
    words[:, 0] *= -1  # two's complement
    codes = words @ (1 << np.arange(width)[::-1])
    shape = config.windows.steps, config.trajectory_width
    return int(np.packbits(bits[first : first + 8])[0]), codes.reshape(shape)


def played(model: IntegerModel, log: bytes) -> IntegerModel:
    """What a board holds that starts with ``model`` and has this log, both halves of it."""
    config = model.config
    (half, stride), length = sizes(config), _length(config)
    every = np.frombuffer(log, dtype=np.uint8).reshape(-1, stride)[:, :length]
    records = [*np.unpackbits(every, axis=1)]
    halves = records[: half // stride], records[half // stride :]
    heads = [_read(config, of_half[0]) for of_half in halves]
    first, second = (head[0] & 3 if head and head[0] & HEAD else None for head in heads)
    if first is None and second is None:
        return model
    model = forget(model)
    for bits in halves[second is not None and (first is None or second == (first + 1) % 4)][1:]:
        if bits.all():  # erased flash: no record was written from here on
            break
        touch = _read(config, bits)
        if touch and touch[0] < config.classes:
            model = teach(model, touch[1], touch[0])
    return model
