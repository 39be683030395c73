"""The stimulator's frames, byte by byte, and their safety rules (docs/specification_interfaces.md section 14)."""

from amaranth.hdl import Array, Const, Module, Mux, Signal, unsigned
from amaranth.lib import data, stream, wiring

from eskin.golden.core.groups import Interface
from eskin.rtl.common import drive, inputs, outputs

ELECTRODES = (11, 6, 27, 22, 10, 7, 1, 23, 9, 8, 2, 24, 12, 5, 28, 21, 13, 4, 29, 20, 14, 3, 30, 19)
"""Channel of the stimulator for each electrode, row by row of 4."""

BODIES = {"SD": 4, "SF": 2, "SW": 2, "SA": 64, "C1": 16, "C2": 16}
"""Bytes between ``>XX;`` and ``<``, in the order in which a burst has these frames."""
ON, OFF = len(BODIES), len(BODIES) + 1
"""Numbers of the frames ``>ON<`` and ``>OFF<``; the others have their places in `BODIES`."""
OFFS, OFFS_AT_RESET = 2, 16
"""Number of consecutive OFF frames. After a reset the stimulator may be in the middle of a frame of 69 bytes,
and takes the next bytes for its body."""

SETTINGS = {"amplitude": 8, "delay": 16, "frequency": 16, "width": 16}
settings_layout = data.StructLayout({name: unsigned(bits) for name, bits in SETTINGS.items()})
"""Settings that a host may write, within limits."""


class StimulatorFrames(wiring.Component):
    """While ``request`` is high: SD, SF, SW, SA, C1, C2, ON for ``electrode``, then nothing; OFF as soon as
    anything ends it.

    A burst ends when ``request`` falls, the electrode changes, ``fault`` is high, or ``on_cycles`` have passed. The
    current frame is finished first (cut short, it would swallow the OFF), then OFF is sent twice. After a
    fault or the time limit there is no new burst until ``request`` has been low without a fault. After a
    reset OFF is sent 16 times before anything else.

    Settings are held to their limits, constants, and taken when a burst begins, all at once.

    Parameters
    ----------
    interface:
        The limits.
    on_cycles:
        Cycles from a burst's begin until it must end.

    Members
    -------
    request : In(1), electrode : In(range(24)), fault : In(1)
    settings : In(settings_layout)
    byte : Out(stream of 8 bits)
    on : Out(1)
        From a burst's first byte until its first OFF has begun.
    resting : Out(1)
        OFF was the last frame, and no byte of another has been offered.
    """

    def __init__(self, interface: Interface, on_cycles: int):
        self._limits = {name: getattr(interface, f"{name}_limit") for name in SETTINGS}
        self._on_cycles = on_cycles
        super().__init__(
            inputs("request", "fault", electrode=range(24), settings=settings_layout)
            | outputs("on", "resting", byte=stream.Signature(8))
        )

    def elaborate(self, platform):
        m = Module()
        held = Signal(settings_layout)  # what the burst under way has
        # a channel's place in the bodies: its number less 1
        coming = Array([Const(number - 1) for number in ELECTRODES])[self.electrode]
        channel = Signal.like(coming)
        electrode = self.of_burst = Signal.like(self.electrode)
        frame = self.frame = Signal(range(OFF + 1))
        place = self.place = Signal(range(69))
        sending = Signal()
        burst = self.burst = Signal(
            range(ON + 2)
        )  # frames of the burst that have begun; 0: none is under way
        offs = Signal(range(OFFS_AT_RESET + 1), init=OFFS_AT_RESET)  # still to send
        halted = self.halted = Signal()
        locked = self.locked = Signal()
        age = self.age = Signal(range(self._on_cycles + 1))
        too_long = age == self._on_cycles

        # ---------------------------------------------------------------- the byte at a place
        body = Signal(8)
        index = Signal(6)
        m.d.comb += index.eq(place - 4)
        with m.Switch(frame):
            for number, name in enumerate(BODIES):
                with m.Case(number):
                    if name == "SA":
                        m.d.comb += body.eq(Mux(index == channel, channel, 0xFF))
                    elif name in ("C1", "C2"):
                        mine = channel[4] == int(name == "C2")
                        m.d.comb += body.eq(Mux(mine & (index == channel[:4]), held.amplitude, 0))
                    else:
                        value = held[{"SD": "delay", "SF": "frequency", "SW": "width"}[name]]
                        high, low = BODIES[name] - 2, BODIES[name] - 1
                        m.d.comb += body.eq(Mux(index == low, value, Mux(index == high, value[8:], 0)))
        heads = [f">{name};".encode() for name in BODIES] + [b">ON<", b">OFF"]
        head = Array([Array([Const(byte, 8) for byte in text]) for text in heads])[frame][place[:2]]
        lasts = Array([Const(4 + size) for size in BODIES.values()] + [Const(3), Const(4)])
        last = place == lasts[frame]
        drive(m, self.byte, valid=sending, payload=Mux(place < 4, head, Mux(last, ord("<"), body)))
        drive(m, self, on=burst != 0, resting=(frame == OFF) & ~sending & (offs == 0) & (burst == 0))
        with m.If(sending & self.byte.ready):
            m.d.sync += [place.eq(Mux(last, 0, place + 1)), sending.eq(~last)]

        # ---------------------------------------------------------------- what ends a burst
        ends = ~self.request | (self.electrode != electrode) | self.fault | too_long
        m.d.sync += [
            halted.eq((halted | ends) & (burst != 0)),
            locked.eq((locked & self.request) | self.fault | (too_long & (burst != 0))),
            age.eq(Mux(burst == 0, 0, age + ~too_long)),
        ]
        # ---------------------------------------------------------------- between frames
        with m.If(~sending):
            with m.If(burst != 0):
                with m.If(halted | ends):
                    m.d.sync += [burst.eq(0), frame.eq(OFF), sending.eq(1), offs.eq(OFFS - 1)]
                with m.Elif(burst <= ON):
                    m.d.sync += [burst.eq(burst + 1), frame.eq(burst), sending.eq(1)]
            with m.Elif(offs != 0):
                m.d.sync += [frame.eq(OFF), sending.eq(1), offs.eq(offs - 1)]
            with m.Elif(self.request & ~self.fault & ~locked):
                m.d.sync += [
                    burst.eq(1),
                    frame.eq(0),
                    sending.eq(1),
                    electrode.eq(self.electrode),
                    channel.eq(coming),
                ]
                for name, limit in self._limits.items():
                    m.d.sync += held[name].eq(Mux(self.settings[name] > limit, limit, self.settings[name]))
        return m
