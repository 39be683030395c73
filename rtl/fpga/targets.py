"""The boards that `eskin build` knows: part, package, clock and pins, taken from amaranth-boards."""

from dataclasses import dataclass
from importlib import import_module
from typing import Any, NamedTuple

from eskin.golden.core import InputError, Record
from eskin.rtl.fpga.synthesis import ECP5, GOWIN, ICE40, Family


class Room(NamedTuple):
    """Logic cells, block memories and multipliers of a part, as nextpnr reports them."""

    cells: int
    blocks: int
    multipliers: int


@dataclass(frozen=True, kw_only=True)
class Target:
    """A board.

    device: the part's name. room: what it has; None: no estimate there. family: for Yosys. place: nextpnr's
    options for part and package; pack: the packer's. clock_pin, clock_hz: the board's oscillator (the
    upduino's is on a separate pin, 20, behind a solder jumper). uart: (rx, tx) as the FPGA sees them. led:
    a lamp, or a free pin. pins: further free pins, in the order in which they are given out.
    """

    name: str
    device: str
    room: Room | None
    family: Family
    place: tuple[str, ...]
    clock_pin: str
    clock_hz: float
    uart: tuple[str, str]
    led: str
    pins: tuple[str, ...]
    pack: tuple[str, ...] = ()


_PARTS: dict[tuple[str, str], tuple[Family, Room | None, tuple[str, ...]]] = {
    ("iCE40UP5K", "SG48"): (ICE40, Room(5280, 30, 8), ("--up5k", "--package", "sg48")),
    ("LFE5U-25F", "BG381"): (ECP5, Room(24288, 56, 28), ("--25k", "--package", "CABGA381", "--speed", "6")),
    ("GW1NR-9C", "QN88P"): (GOWIN, None, ("--device", "GW1NR-LV9QN88PC6/I5", "--vopt", "family=GW1N-9C")),
}
_PACK = {"GW1NR-9C": ("-d", "GW1N-9C", "-o")}


def _target(
    name: str,
    module: str,
    platform: str,
    connector: tuple[str, ...],
    uart: tuple[str, ...] = (),
    led: str | None = None,
) -> Target:
    """Read a board off amaranth-boards. ``connector``: free pins; ``uart``, ``led``: pins (rx, tx) where the
    board has none."""
    board: Any = getattr(import_module(f"amaranth_boards.{module}"), platform)()
    device = (
        getattr(board, "device", None) or board.family
    )  # the latter on Gowin parts, whose family is a name
    family, room, place = _PARTS[device, board.package]
    clock = board.lookup("clk12" if board.default_clk == "SB_HFOSC" else board.default_clk, 0)

    def pins(resource: str, *names: str) -> tuple[str, ...]:
        of = {part.name: part.ios[0].names[0] for part in board.lookup(resource, 0).ios}
        return tuple(of[name] for name in names)

    def sites(names: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(board._conn_pins.get(name, name) for name in names)

    rx, tx = sites(uart) or pins("uart", "rx", "tx")
    return Target(
        name=name,
        device=device,
        room=room,
        family=family,
        place=place,
        clock_pin=clock.ios[0].names[0],
        clock_hz=clock.clock.frequency,
        uart=(rx, tx),
        led=sites((led,))[0] if led else board.lookup("led", 0).ios[0].names[0],
        pins=sites(connector),
        pack=_PACK.get(device, ()),
    )


_PMODS = tuple(f"pmod_{number}:{pin}" for number in (0, 1) for pin in (1, 2, 3, 4, 7, 8, 9, 10))

_BOARDS: dict[str, Record] = {
    "icebreaker": dict(module="icebreaker", platform="ICEBreakerPlatform", connector=_PMODS),
    # The USB side of this board is no UART of the FPGA: an adapter goes to the pins that are called 2 and 47
    # on it.
    "upduino": dict(
        module="upduino_v3",
        platform="UpduinoV3Platform",
        uart=("j_1:20", "j_1:18"),
        led="j_1:16",
        connector=tuple(f"j_0:{pin}" for pin in range(7, 21)),
    ),
    "ulx3s": dict(
        module="ulx3s",
        platform="ULX3S_25F_Platform",
        connector=tuple(f"gpio_0:{pin}{side}" for pin in range(14) for side in "+-"),
    ),
    # Pins at 3.3 V along the board's edges that nothing else on it uses but a display's connector.
    "tangnano9k": dict(
        module="tang_nano_9k",
        platform="TangNano9kPlatform",
        connector=tuple("25 26 27 28 29 30 33 34 40 35 41 42 31 32 49 48".split()),
    ),
}
"""Arguments of `_target` for each board."""

TARGETS = tuple(_BOARDS)
"""Names of the boards: UP5K (2), ECP5-25F, GW1NR-9C."""


def target(name: str) -> Target:
    """The board called ``name``.

    Raises
    ------
    InputError
        No such board.
    """
    if name not in _BOARDS:
        raise InputError(f"`target` {name}: is not a known board; use one of {', '.join(TARGETS)}")
    return _target(name, **_BOARDS[name])
