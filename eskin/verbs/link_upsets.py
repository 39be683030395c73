"""Upsets in the serial link: after each, does the device still answer, and send its decisions?"""

from pathlib import Path

import numpy as np

from eskin.cosim import link, upsets
from eskin.cosim.device import Design, Device
from eskin.cosim.pin_port import decoded, levels
from eskin.golden.core import AcceleratorConfig, Record
from eskin.rtl.fpga.upsets import link_with_upsets

PAYLOAD, VALUE = 0x12345678, 0x2BCD
"""Of every decision and of every register."""
DIVISOR = 4
PAUSE = 800
"""Cycles in which an answer or a decision is out, escapes and all."""


def waveform(config: AcceleratorConfig) -> tuple[np.ndarray, int, int]:
    """(levels, first cycle after the last upset, cycle of the last read): frames, writes, reads and
    decisions; a rest; flags, a read, and then a read and a decision that must come through. A host does no
    more after a fault: it reads, and goes on with the number it is told.
    """
    parts: list[np.ndarray] = []

    def send(data: bytes, pause: int = 0, decision: bool = False) -> None:
        parts.append(np.append(levels(data, DIVISOR), np.ones(pause, np.uint8)))
        parts[-1][:1] |= 2 * decision

    samples = np.arange(config.sensor.taxels) * 1001 & (1 << config.sensor.sample_bits) - 1
    send(link.ordered_packet(0, link.FRAME, samples), decision=True)
    send(link.read_packet(3), pause=PAUSE)
    send(link.ordered_packet(1, 2, [0x7D7E]))
    send(link.ordered_packet(2, link.FRAME, samples))
    send(link.read_packet(4), pause=PAUSE // 2, decision=True)
    hit = sum(map(len, parts))
    send(b"", pause=2 * PAUSE)
    send(b"\x7e" * 2 + link.read_packet(5), pause=PAUSE)
    last = sum(map(len, parts))
    send(link.read_packet(6), pause=2 * PAUSE, decision=True)
    return np.concatenate(parts), hit, last


def heard(sent: bytes) -> list[link.Answer | link.Decision]:
    """What is in a sending line's levels."""
    packets = map(link.parse, link.Unpacker().feed(decoded(sent, DIVISOR)[0]))
    return [packet for packet in packets if packet is not None]


def played(design: Design, line: np.ndarray, register: int = 0, bit: int = 0, cycle: int = -1) -> bytes:
    """The sending line's levels with one upset; from power-on."""
    device = Device(design)
    for name, value in (
        ("rx", 1),
        ("decision__payload", PAYLOAD),
        ("frame__ready", 1),
        ("bus__r_data", VALUE),
    ):
        device.put(name, value)
    device.reset()
    device.poke(device.state.cycle + cycle, upset_register=register, upset_bit=bit)
    return device.line(line)


def upset_link(config: AcceleratorConfig, count: int, seed: int, *, builds: Path) -> list[Record]:
    """``count`` upsets, every flip-flop bit equally often: {register, bit, cycle, answers, decides}: whether
    the last read is answered and the last decision sent.

    Raises
    ------
    RuntimeError
        Even without an upset they are not.
    """
    text, sites = link_with_upsets(config, DIVISOR)
    design = Design(text, builds, upsets.PURPOSE)
    line, hit, last = waveform(config)
    rng = np.random.default_rng(seed)
    bits = [(site, bit) for site in sites if not site.words for bit in range(site.width)]
    order = [bits[i] for _ in range(-(-count // len(bits))) for i in rng.permutation(len(bits))][:count]
    chosen = [(site, bit, int(rng.integers(0, hit))) for site, bit in order]

    def alive(sent: bytes) -> tuple[bool, bool]:
        events = heard(sent[last:])
        answers = any(
            isinstance(event, link.Answer) and (event.address, event.value) == (6, VALUE) for event in events
        )
        return answers, any(isinstance(event, link.Decision) and event.payload == PAYLOAD for event in events)

    if alive(played(design, line)) != (True, True):
        raise RuntimeError("without an upset the link does not answer")
    outcomes = [alive(played(design, line, site.number, bit, cycle)) for site, bit, cycle in chosen]
    return [
        {"register": site.name, "bit": bit, "cycle": cycle, "answers": answers, "decides": decides}
        for (site, bit, cycle), (answers, decides) in zip(chosen, outcomes, strict=True)
    ]
