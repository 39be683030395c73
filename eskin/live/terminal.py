"""The live view in a terminal: the hub's messages drawn with `rich`, keys in place of buttons. No server, no
port."""

from __future__ import annotations

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

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from eskin.golden.model.position import DIRECTIONS
from eskin.live.hub import Hub, Viewer
from eskin.live.player import SPEEDS, Controls

REFRESH_S = 0.1
PALETTE = ("#2a8fd0", "#E69F00", "#00b383", "#CC79A7", "#56B4E9", "#f0702b", "#a78bd0", "#9a9a9a")
KEYS = "space pause · n next · + - pace · c class · q end"
LEVELS = " ▁▂▃▄▅▆▇█"
TRACE_COLUMNS = 120


def where_words(where: dict[str, Any]) -> str:
    """A position in words: cells counted from the middle of column and row 0."""
    centre = f"x {where['x'] / 16:.2f}, y {where['y'] / 16:.2f}, most at {where['peak']}"
    if not where["ended"]:
        return f"touched at {centre}"
    return f"last at {centre}" + (f", slid {DIRECTIONS[where['direction']]}" if where["direction"] else "")


class Screen:
    """What the terminal shows, made of the hub's messages. ``feed`` them, then ``draw``."""

    def __init__(self) -> None:
        self.hello: dict[str, Any] = {}
        self.state: dict[str, Any] = {}
        self.tally: dict[str, Any] = {}
        self.dropped = 0
        self.lines: list[str] = []
        """A sentence for each recording that is over, not printed yet."""
        self._fresh()

    def _fresh(self) -> None:
        self.begin: dict[str, Any] = {"number": -1, "label": -1, "frames": 0, "level": []}
        self.frame, self.scale = 0, 1.0
        self.last: Sequence[int] = []
        self.rows: dict[int, Sequence[int]] = {}
        """Of an image, those that have come."""
        self.activity: list[float] = []
        self.onset: dict[str, Any] | None = None
        self.said: str = ""
        self.where: dict[str, Any] | None = None
        self._touch()

    def _touch(self) -> None:
        self.steps: list[dict[str, Any]] = []
        self.hardware: dict[int, bool] = {}
        self.decided: dict[str, Any] | None = None

    def feed(self, message: dict[str, Any]) -> None:
        """Take one message of the hub."""
        match message["k"]:
            case "hello":
                self.hello = message
                self._fresh()
            case "begin":
                self._fresh()
                self.begin = message
            case "frames":
                self._frames(message["b"])
            case "onset":
                self.onset = message
                self._touch()
            case "where":
                self.where = message
            case "step":
                if self.steps and message["touch"] != self.steps[-1]["touch"]:
                    self._touch()
                self.steps.append(message)
            case "decided":
                self.decided = message
            case "hardware":
                wrong = any(stage["wrong"] for stage in message["stages"].values())
                if not message["closing"]:
                    self.hardware[message["step"]] = not wrong
            case "said":
                self.said = message["sentence"]
                self.lines.append(f"recording {self.begin['number']}: {self.said}")
            case "result":
                self.lines.append(self._sentence(message))
            case "state":
                self.state = message
            case "tally":
                self.tally = message

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

    def _sentence(self, result: dict[str, Any]) -> str:
        label, decision = result["label"], result["decision"]
        said = "no touch" if decision < 0 else self._name(decision)
        known = (
            "" if label < 0 else ", as labelled" if label == decision else f", labelled {self._name(label)}"
        )
        since = f", {result['since']:.3f} s after the onset" if result["since"] >= 0 else ""
        compared = self.hello["source"] in ("simulation", "board")
        checked = (
            ""
            if not compared
            else f", HARDWARE DIFFERS in {result['wrong']} values"
            if result["wrong"]
            else ", hardware the same"
        )
        return f"recording {result['number']}: {said}{known}{since}{checked}"

    # ------------------------------------------------------------ drawing
    def draw(self) -> RenderableType:
        """All of it."""
        if not self.hello:
            return Text("waiting for the source")
        top = Table.grid(padding=(0, 2), expand=True)
        top.add_column()
        top.add_column(ratio=1)
        image = self.hello.get("image")
        top.add_row(
            Panel(
                self._image() if image else self._heat(),
                title="image" if image else "taxels",
                title_align="left",
            ),
            Panel(self._decision(), title="decision", title_align="left"),
        )
        return Group(self._head(), top, Panel(self._below(), title="touch", title_align="left"), self._foot())

    def _head(self) -> Text:
        hello, text = self.hello, Text()
        taxels = f"{hello['taxels']} taxels at {hello['rate']:g} Hz"
        size = "{} x {} pixels".format(*hello["image"]) if hello.get("image") else taxels
        text.append("eskin watch ", style="bold")
        text.append(f"{hello['name']} · {hello['network']} · {size} · ")
        pace = (
            "as fast as possible"
            if not self.state.get("speed", 1)
            else f"{self.state.get('speed', 1):g} × the sensor's pace"
        )
        text.append(
            "paused" if self.state.get("paused") else "all played" if self.state.get("ended") else pace,
            style="bold",
        )
        label = self.state.get("label", -1)
        if label >= 0:
            text.append(f" · only {self._name(label)}")
        return text

    def _heat(self) -> Text:
        rows, columns = self.hello["shape"]
        level, text = self.begin["level"] or self.last, Text()
        wide = 6 if columns <= 8 else 2
        for row in range(rows):
            for column in range(columns):
                taxel = row * columns + column
                if taxel >= len(self.last):
                    text.append(" " * wide)
                    continue
                moved = self.last[taxel] - level[taxel]
                red, green, blue = shade(moved / self.scale)
                words = f"{moved:^6.0f}" if wide == 6 else "  "
                dark = red + green + blue < 380
                text.append(
                    words[:wide], style=f"{'white' if dark else 'black'} on rgb({red},{green},{blue})"
                )
            text.append("\n")
        text.append(f"full colour ±{self.scale:.0f} codes", style="dim")
        if self.where:
            text.append("\n" + where_words(self.where), style="bold red" if self.where["wrong"] else "")
        return text

    def _image(self) -> Text:
        height, width = self.hello["image"]
        text = Text()
        for row in range(height):
            for value in self.rows.get(row, [0] * width):
                red, green, blue = shade(value / 255)
                text.append("  ", style=f"on rgb({red},{green},{blue})")
            text.append("\n")
        return text

    def _decision(self) -> Text:
        text, shown = Text(), self.decided or (self.steps[-1] if self.steps else None)
        if shown is None:
            thing = "an image" if self.hello.get("image") else "a touch"
            text.append(
                f"waiting for {thing}\n" if self.onset is None else f"{thing[2:].strip()}\n", style="dim"
            )
        else:
            text.append(self._name(shown["label"]), style=f"bold {tint(shown['label'])}")
            text.append(" decided" if self.decided else " so far", style="dim")
            if self.decided and self.decided["unsure"]:
                text.append(", unsure", style="red")
            votes = self.decided is not None and self.hello["decision"] == "vote"
            margin = (
                f"{shown['margin']} votes"
                if votes
                else f"{shown['margin'] / self.hello['unit']['logit']:.2f}"
            )
            text.append(f"\nmargin {margin}\n")
        rate = self.hello["rate"]
        if self.decided and self.decided["since"] >= 0:
            text.append(f"{self.decided['since']:.3f} s after the onset\n")
        elif self.onset:
            text.append(f"{(self.frame - self.onset['frame']) / rate:.3f} s since the onset\n")
        label = self.begin["label"]
        if label >= 0:
            right = self.decided and self.decided["label"] == label
            text.append(
                f"labelled {self._name(label)}", style="green" if right else "red" if self.decided else ""
            )
        if self.hardware:
            same = all(self.hardware.values())
            text.append(
                f"\nhardware {'the same' if same else 'DIFFERS'}", style="green" if same else "bold red"
            )
        return text

    def _below(self) -> Text:
        text, unit = Text(), self.hello["unit"]
        columns = max(1, min(TRACE_COLUMNS, len(self.activity)))
        width = max(1, math.ceil(len(self.activity) / columns))
        text.append("strongest taxel ", style="dim")
        for at in range(0, len(self.activity), width):
            share = max(self.activity[at : at + width]) / self.scale
            text.append(LEVELS[min(len(LEVELS) - 1, round(share * (len(LEVELS) - 1)))])
        text.append("\nlocal decisions ", style="dim")
        for step in self.steps:
            text.append("■ ", style=tint(step["label"]))
        text.append("· " * (self.hello["steps"] - len(self.steps)), style="dim")
        if self.hardware:
            text.append("\nhardware        ", style="dim")
            for _, same in sorted(self.hardware.items()):
                text.append("= " if same else "✗ ", style="green" if same else "bold red")
        last = self.steps[-1] if self.steps else {"logits": [], "features": [], "hidden": []}
        if last["logits"]:
            text.append("\nlogits          ", style="dim")
            for label, logit in enumerate(last["logits"][:12]):
                text.append(f"{self._name(label)} {logit / unit['logit']:.2f}  ", style=tint(label))
        for name, title, kind in (("features", "features", "feature"), ("hidden", "hidden state", "state")):
            if last[name]:
                text.append(f"\n{title:<16}", style="dim")
                top = max(1, max(abs(value) for value in last[name]))
                for value in last[name][:TRACE_COLUMNS]:
                    red, green, blue = shade(value / top)
                    text.append("  ", style=f"on rgb({red},{green},{blue})")
                text.append(f" ±{top / unit[kind]:.2f}", style="dim")
        return text

    def _foot(self) -> Text:
        tally = self.tally
        known = f"{tally['correct']} of {tally['labelled']} as labelled · " if tally.get("labelled") else ""
        compared = (
            f"{tally['mismatches']} of {tally['compared']} hardware values differ · "
            if tally.get("compared")
            else ""
        )
        recorded = f"{tally['recorded']} frames recorded · " if tally.get("recorded") else ""
        of = f" of {self.begin['frames']}" if self.begin["frames"] else ""
        text = Text(f"recording {self.begin['number']}, frame {self.frame}{of} · {known}{compared}{recorded}")
        text.append(f"{tally.get('frames_per_s', 0)} frames/s · {self.dropped} display frames dropped\n")
        if self.said:
            text.append(self.said + "\n", style="red")
        text.append(KEYS, style="dim")
        return text


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
