"""The live view in a terminal: the hub's messages drawn with `rich`, keys in place of buttons. No server, no
port."""

import contextlib
import json
import math
import select
import sys
import termios
import threading
import tty
from collections.abc import Iterator, Sequence
from typing import Any

from markupsafe import Markup
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from eskin.golden.core import Record
from eskin.golden.model.position import DIRECTIONS
from eskin.live.hub import Hub, Viewer
from eskin.live.player import SPEEDS, Controls
from eskin.pages.views import screen

REFRESH_S = 0.1
PALETTE = ("#2a8fd0", "#E69F00", "#00b383", "#CC79A7", "#56B4E9", "#f0702b", "#a78bd0", "#9a9a9a")
LEVELS = " ▁▂▃▄▅▆▇█"
TRACE_COLUMNS = 120


class Screen:
    """What the terminal shows, made of the hub's messages. ``feed`` them, then ``draw``."""

    def __init__(self) -> None:
        self.hello: Record = {}
        self.state: Record = {}
        self.tally: Record = {}
        self.dropped = 0
        self.lines: list[str] = []
        """A sentence for each recording that is over, not printed yet."""
        self._fresh()

    def _fresh(self) -> None:
        self.begin: Record = {"number": -1, "label": -1, "frames": 0, "level": []}
        self.frame, self.scale = 0, 1.0
        self.last: Sequence[int] = []
        self.rows: dict[int, Sequence[int]] = {}
        """Of an image, those that have come."""
        self.activity: list[float] = []
        self.onset: Record | None = None
        self.said: str = ""
        self.where: Record | None = None
        self._touch()

    def _touch(self) -> None:
        self.steps: list[Record] = []
        self.hardware: dict[int, bool] = {}
        self.decided: Record | None = None

    def feed(self, message: Record) -> None:
        """Take one message of the hub."""
        match message["k"]:
            case "hello" | "begin" as kind:
                self._fresh()
                setattr(self, kind, message)
            case "frames":
                self._frames(message["b"])
            case "onset":
                self.onset = message
                self._touch()
            case "step":
                if self.steps and message["touch"] != self.steps[-1]["touch"]:
                    self._touch()
                self.steps.append(message)
            case "hardware":
                wrong = any(stage["wrong"] for stage in message["stages"].values())
                if not message["closing"]:
                    self.hardware[message["step"]] = not wrong
            case "said":
                self.said = message["sentence"]
                self.lines.append(f"recording {self.begin['number']}: {self.said}")
            case "result":
                self.lines.append(self._sentence(message))
            case "where" | "decided" | "state" | "tally" as kind:
                setattr(self, kind, message)

    def _frames(self, buckets: list[list[Any]]) -> None:
        for first, count, low, high, last in buckets:
            level = self.begin["level"] or last
            moved = max(
                (max(abs(lo - z), abs(hi - z)) for lo, hi, z in zip(low, high, level, strict=True)), default=0
            )
            self.scale, self.last, self.frame = max(self.scale, moved), last, first + count - 1
            self.activity.append(moved)
            if self.hello.get("image"):
                self.rows[first - 1] = last
        if len(self.activity) > 4 * TRACE_COLUMNS:
            self.activity = [max(pair) for pair in zip(self.activity[::2], self.activity[1::2], strict=False)]

    def _name(self, label: int) -> str:
        classes = self.hello.get("classes", [])
        return classes[label] if 0 <= label < len(classes) else "unknown"

    def _sentence(self, result: Record) -> str:
        label, decision = result["label"], result["decision"]
        sentence = "no touch" if decision < 0 else self._name(decision)
        if label >= 0:
            sentence += ", as labelled" if label == decision else f", labelled {self._name(label)}"
        if result["since"] >= 0:
            sentence += f", {result['since']:.3f} s after the onset"
        if result["wrong"]:
            sentence += f", HARDWARE DIFFERS in {result['wrong']} values"
        elif self.hello["source"] in ("simulation", "board"):
            sentence += ", hardware the same"
        return f"recording {result['number']}: {sentence}"

    # ------------------------------------------------------------ drawing
    def draw(self) -> RenderableType:
        """All of it."""
        if not self.hello:
            return Text("waiting for the source")
        width, most = max(1, math.ceil(len(self.activity) / TRACE_COLUMNS)), len(LEVELS) - 1
        tops = (max(self.activity[at : at + width]) for at in range(0, len(self.activity), width))
        values = vars(self) | {
            "image": self.hello.get("image"),
            "trace": "".join(LEVELS[min(most, round(top / self.scale * most))] for top in tops),
            "directions": DIRECTIONS,
            "name": self._name,
            "swatch": swatch,
            "tint": tint,
        }

        def part(name: str) -> Text:
            return Text.from_markup(screen(name, **values), emoji=False)

        def panel(name: str) -> Panel:
            return Panel(part(name), title=name, title_align="left")

        top = Table.grid(padding=(0, 2), expand=True)
        top.add_column()
        top.add_column(ratio=1)
        top.add_row(panel("image" if values["image"] else "taxels"), panel("decision"))
        return Group(part("head"), top, panel("touch"), part("foot"))


def swatch(share: float, words: str = "  ") -> Markup:
    """``words`` on the colour of a share, legible."""
    red, green, blue = shade(share)
    dark = red + green + blue < 380
    return Markup(f"[{'white' if dark else 'black'} on rgb({red},{green},{blue})]{words}[/]")


def tint(label: int) -> str:
    """A class's colour."""
    return PALETTE[label % len(PALETTE)] if label >= 0 else "dim"


def shade(share: float) -> tuple[int, int, int]:
    """Blue below 0, dark at 0, orange above; -1 and 1 in full."""
    amount = min(1.0, abs(share)) ** 0.7
    to = (40, 140, 220) if share < 0 else (240, 120, 20)
    red, green, blue = (round(30 + (value - 30) * amount) for value in to)
    return red, green, blue


def watch(hub: Hub, controls: Controls, player: threading.Thread, console: Console) -> None:
    """Show until the player's thread has ended. Where ``console`` is no terminal: a line a recording."""
    screen, viewer = Screen(), hub.attach()
    try:
        if not console.is_terminal:
            while player.is_alive():
                player.join(REFRESH_S)
                _lines(screen, viewer, console)
            _lines(screen, viewer, console)
            return
        with (
            _keys(),
            Live(console=console, auto_refresh=False, screen=False, vertical_overflow="crop") as live,
        ):
            while player.is_alive():
                _pressed(controls, len(screen.hello.get("classes", [])), REFRESH_S)
                _lines(screen, viewer, None)
                live.update(screen.draw(), refresh=True)
    finally:
        hub.detach(viewer)


def _lines(screen: Screen, viewer: Viewer, console: Console | None) -> None:
    for text in viewer.take():
        screen.feed(json.loads(text))
    screen.dropped = viewer.dropped
    if console:
        for line in screen.lines:
            console.print(line, markup=False, highlight=False, soft_wrap=True)
    screen.lines.clear()


@contextlib.contextmanager
def _keys() -> Iterator[None]:
    """Keys one by one, unseen; as before afterwards."""
    if not sys.stdin.isatty():
        yield
        return
    before = termios.tcgetattr(sys.stdin)
    try:
        tty.setcbreak(sys.stdin)
        yield
    finally:
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)


def _pressed(controls: Controls, classes: int, timeout_s: float) -> None:
    """Obey the keys that are pressed within ``timeout_s``."""
    if not sys.stdin.isatty():
        threading.Event().wait(timeout_s)
        return
    ready, _, _ = select.select([sys.stdin], [], [], timeout_s)
    if ready:
        press(controls, sys.stdin.read(1), classes)


def press(controls: Controls, key: str, classes: int) -> None:
    """Do what a key asks."""
    at = min(range(len(SPEEDS)), key=lambda place: abs(min(SPEEDS[place], 1e9) - min(controls.speed, 1e9)))
    match key:
        case " ":
            controls.pause(not controls.paused)
        case "n":
            controls.next()
        case "+" | "=":
            controls.pace(SPEEDS[min(at + 1, len(SPEEDS) - 1)])
        case "-":
            controls.pace(SPEEDS[max(at - 1, 0)])
        case "c":
            controls.choose(controls.label + 1 if controls.label + 1 < classes else -1)
        case "q":
            controls.stop()
