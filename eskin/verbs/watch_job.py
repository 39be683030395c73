"""`eskin watch`: a source, a player, a hub and a view, put together; the figures of the whole when it is
over."""

import contextlib
import math
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from eskin.cosim.link import Link
from eskin.cosim.serial_port import SerialPort
from eskin.golden.core import InputError, Record
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel
from eskin.live import terminal
from eskin.live.hub import Hub
from eskin.live.player import Controls, Player, hello
from eskin.live.recorder import Recorder
from eskin.live.server import PageServer
from eskin.live.sources import BoardSource, Listener, ModelSource, SimulationSource, Source, on_port
from eskin.pages.watch_page import asked_shape, guessed_shape, page
from eskin.rtl.fpga.export import export
from eskin.rtl.fpga.generate import boot_writes, register_map
from eskin.verbs.replay_job import answer_s

BUILDS = Path("build/simulators")
HOST, PORT = "127.0.0.1", 8765
IMAGE_S = 1.0
"""Between images: the eye takes longer than the sensor."""
END_S = 0.5
"""At most so long between looks at whether the player has ended, so that an interrupt is heard."""


def parsed_speed(text: str) -> float:
    """``--speed X|max``.

    Raises
    ------
    InputError
        It is neither a number from 0.01 to 1000 nor max.
    """
    if text == "max":
        return math.inf
    try:
        speed = float(text)
    except ValueError:
        speed = 0.0
    if not 0.01 <= speed <= 1000:
        raise InputError(f"--speed {text}: is no pace; give 0.01 to 1000 times the sensor's, or max")
    return speed


@contextlib.contextmanager
def opened_source(
    model: IntegerModel, recordings: Recordings | None, *, port: str | None, baud: int | None, simulate: bool
) -> Iterator[Source | Listener]:
    """The source that is asked for; closed in the end.

    Raises
    ------
    InputError
        The port cannot be opened, or what is on it is no board of ours.
    """
    if port is not None:
        assert baud is not None
        transport = SerialPort(port, baud)
        try:
            yield board_source(model, transport, port, baud, recordings is not None)
        finally:
            transport.close()
        return
    source: Source = ModelSource(model)
    if simulate:
        # needs the simulators' packages, which the others do without
        from eskin.cosim.live import LiveSimulator

        config, arrays = model.config, model.arrays
        design = export(config, arrays)
        source = SimulationSource(
            model, LiveSimulator(design, config, register_map(config), boot_writes(config, arrays), BUILDS)
        )
    try:
        yield source
    finally:
        source.close()


def board_source(
    model: IntegerModel, transport: Any, port: str, baud: int, plays: bool
) -> BoardSource | Listener:
    """The board behind ``transport``: loaded and to be given recordings, or listened to as it is."""
    config = model.config
    link = Link(transport, register_map(config), timeout_s=answer_s(config, baud))
    with on_port(port):
        link.connect()
        if not plays:
            return Listener(config, link, port)
        link.load(boot_writes(config, model.arrays))
        return BoardSource(model, link, port)


def watch(
    model: IntegerModel,
    recordings: Recordings | None,
    numbers: Sequence[int],
    *,
    port: str | None = None,
    baud: int | None = None,
    simulate: bool = False,
    host: str = HOST,
    host_port: int = PORT,
    in_terminal: bool = False,
    record: Path | None = None,
    speed: float = 1.0,
    shape: str | None = None,
    once: bool = False,
    console: Console | None = None,
    ready: Callable[[str, Controls], None] = lambda address, controls: None,
) -> Record:
    """Show ``numbers`` of ``recordings`` (None: a board that works by itself) until all is played (``once``,
    ``in_terminal``), or an interrupt.

    Parameters
    ----------
    port, baud:
        The board's serial line.
    simulate:
        The RTL in Verilator beside the model.
    host, host_port:
        Where the page is served.
    record:
        Archive of everything that was shown.
    ready:
        Called with the page's address (empty: none is served) and the controls before the first frame.

    Returns
    -------
    dict
        recordings, frames, touches, labelled, correct, undecided, compared_values, mismatches, mismatch_list,
        display_frames_dropped, recorded (frames), decisions (recording -> class), passed.

    Raises
    ------
    InputError, SimulationError
        What went wrong before or while it was shown; a record is whole all the same.
    """
    config = model.config
    grid = config.interface
    shape_told = (grid.rows, grid.columns) if grid.position else None
    if config.is_image:
        for name, value, why in (
            ("shape", shape, "an image has its own"),
            ("record", record, "images are in an archive already"),
        ):
            if value:
                raise InputError(f"--{name} {value}: is for recordings; {why}: leave it out")
        shape_told = (config.image.height, config.image.width)
    rows, columns = (
        asked_shape(shape, config.sensor.taxels)
        if shape
        else shape_told or guessed_shape(config.sensor.taxels)
    )
    recorder = Recorder(record, config) if record else None
    controls = Controls(speed=speed)
    server: PageServer | None = None
    with contextlib.ExitStack() as signals:
        try:
            with opened_source(model, recordings, port=port, baud=baud, simulate=simulate) as source:
                drawn = {"shape": [rows, columns], "guessed": shape is None and shape_told is None}
                greeting = hello(config, recordings, numbers, source=source.kind, **drawn)
                hub = Hub(
                    greeting, config.sensor.sample_rate_hz, config.sensor.taxels, thins=not config.is_image
                )
                apart_s = IMAGE_S if config.is_image else 0.0
                ends = once or in_terminal
                player = Player(
                    source, recordings, numbers, hub, controls, recorder=recorder, once=ends, apart_s=apart_s
                )
                if not in_terminal:
                    server = PageServer(page(), hub, controls, host=host, port=host_port)
                signals.enter_context(_ending_in_order(controls))
                ready(server.address if server else "", controls)
                _run(player, controls, hub, console or Console(), in_terminal=in_terminal)
        finally:
            if server:
                server.close()
            saved = recorder.close() if recorder else False
    if player.error is not None:
        raise player.error
    return figures(player, hub, saved)


def _run(player: Player, controls: Controls, hub: Hub, console: Console, *, in_terminal: bool) -> None:
    """The player's thread, and this one until it has ended."""
    thread = threading.Thread(target=player.run, name="eskin-watch-player", daemon=True)
    thread.start()
    try:
        if in_terminal:
            terminal.watch(hub, controls, thread, console)
        while thread.is_alive():
            thread.join(END_S)
    finally:
        controls.stop()
        thread.join()


@contextlib.contextmanager
def _ending_in_order(controls: Controls) -> Iterator[None]:
    """An interrupt from the keyboard, or SIGTERM, stops the player; more of them do not keep a record from
    being made."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {
        number: signal.signal(number, lambda *_: controls.stop())
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def figures(player: Player, hub: Hub, saved: bool) -> Record:
    """What was played, for table and JSON."""
    tally = player.tally
    return vars(tally) | {
        "compared_values": tally.compared,
        "mismatch_list": tally.said,
        "display_frames_dropped": hub.dropped,
        "recorded": tally.recorded if saved else 0,
        "decisions": player.decisions,
        "passed": tally.mismatches == 0,
    }


def in_turn(recordings: Recordings, numbers: np.ndarray) -> list[int]:
    """``numbers`` with the classes in turn, so that the first minute shows all of them; within a class as in
    the data."""
    members = [
        [int(number) for number in numbers if recordings.labels[number] == label]
        for label in range(len(recordings.class_names))
    ]
    return [number for turn in zip_longest(*members) for number in turn if number is not None]
