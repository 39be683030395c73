"""`eskin watch`: a source, a player, a hub and a view, put together; the figures of the whole when it is
over."""

import contextlib
import math
import signal
import threading
from collections.abc import Callable, Iterator
from itertools import zip_longest
from pathlib import Path
from typing import Any

from eskin.golden.core import Record
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel
from eskin.live.hub import Hub
from eskin.live.link import Link
from eskin.live.player import Controls, Player, hello
from eskin.live.serial_port import SerialPort
from eskin.live.server import PageServer
from eskin.live.sources import BoardSource, Listener, ModelSource, SimulationSource, on_port
from eskin.pages.views import TEMPLATES
from eskin.rtl.fpga.export import export
from eskin.rtl.fpga.generate import boot_writes, register_map
from eskin.verbs.replay_job import answer_s

BUILDS = Path("build/simulators")
PORT = 8765
END_S = 0.5
"""Longest time between checks whether the player has ended, so that an interrupt is noticed."""


@contextlib.contextmanager
def opened_source(
    model: IntegerModel, recordings: Recordings | None, *, port: str | None, baud: int | None, simulate: bool
) -> Iterator[ModelSource | Listener]:
    """The source that is asked for; closed in the end.

    Raises
    ------
    InputError
        The port cannot be opened, or no eskin board answers on it.
    """
    if port is not None:
        assert baud is not None
        with contextlib.closing(SerialPort(port, baud)) as transport:
            yield board_source(model, transport, port, baud, recordings is not None)
        return
    source: ModelSource = ModelSource(model)
    if simulate:
        # needs the simulators' packages, which the others do without
        from eskin.cosim.device import Accelerator, Design

        config, arrays = model.config, model.arrays
        design = Design(export(config, arrays), BUILDS)
        boot = boot_writes(config, arrays)
        source = SimulationSource(model, Accelerator(design, config, register_map(config), boot))
    with contextlib.closing(source):
        yield source


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
    *,
    port: str | None = None,
    baud: int | None = None,
    simulate: bool = False,
    host_port: int = PORT,
    ready: Callable[[str, Controls], None] = lambda address, controls: None,
) -> Record:
    """Show ``recordings``, alternating between classes (None: a stand-alone board), until an interrupt.

    Parameters
    ----------
    port, baud:
        The board's serial line.
    simulate:
        The RTL in Verilator beside the model.
    host_port:
        Where the page is served.
    ready:
        Called with the page's address and the controls before the first frame.

    Returns
    -------
    dict
        recordings, frames, touches, labelled, correct, undecided, compared_values, mismatches, mismatch_list,
        decisions (recording -> class), passed.

    Raises
    ------
    InputError, SimulationError
        What went wrong before or while it was shown.
    """
    config, controls = model.config, Controls()
    numbers = [] if recordings is None else in_turn(recordings)
    shape = (config.interface.rows, config.interface.columns) if config.interface.position else None
    drawn = {"shape": list(shape or guessed_shape(config.sensor.taxels)), "guessed": shape is None}
    with opened_source(model, recordings, port=port, baud=baud, simulate=simulate) as source:
        greeting = hello(config, recordings, numbers, source=source.kind, **drawn)
        hub = Hub(greeting, config.sensor.sample_rate_hz, config.sensor.taxels)
        player = Player(source, recordings, numbers, hub, controls)
        with (
            _ending_in_order(controls),
            contextlib.closing(PageServer(page(), hub, controls, port=host_port)) as server,
        ):
            ready(server.address, controls)
            _run(player, controls)
    if player.error is not None:
        raise player.error
    return figures(player)


def _run(player: Player, controls: Controls) -> None:
    """The player's thread, and this one until it has ended."""
    thread = threading.Thread(target=player.run, name="eskin-watch-player", daemon=True)
    thread.start()
    try:
        while thread.is_alive():
            thread.join(END_S)
    finally:
        controls.stop()
        thread.join()


@contextlib.contextmanager
def _ending_in_order(controls: Controls) -> Iterator[None]:
    """An interrupt from the keyboard, or SIGTERM, stops the player."""
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


def figures(player: Player) -> Record:
    """Figures of the recordings played, for table and JSON."""
    tally = player.tally
    return vars(tally) | {
        "compared_values": tally.compared,
        "mismatch_list": tally.said,
        "decisions": player.decisions,
        "passed": tally.mismatches == 0,
    }


def in_turn(recordings: Recordings) -> list[int]:
    """Every recording's number, the classes in turn, so that the first minute shows all of them; within a
    class as in the data."""
    members = [
        [number for number, found in enumerate(recordings.labels) if found == label]
        for label in range(len(recordings.class_names))
    ]
    return [number for turn in zip_longest(*members) for number in turn if number is not None]


LONGEST = 4
"""Columns a row at most, of a shape that is guessed."""


def page() -> bytes:
    """The page as it is served."""
    return (TEMPLATES / "watch.html").read_bytes()


def guessed_shape(taxels: int) -> tuple[int, int]:
    """(rows, columns) of an array with this number of taxels, if the configuration has no shape: the squarest rectangle that they fill,
    no longer than ``LONGEST`` to 1; where there is none, the smallest square grid that holds them, with cells
    left over."""
    for rows in range(math.isqrt(taxels), 0, -1):
        if taxels % rows == 0 and taxels // rows <= LONGEST * rows:
            return rows, taxels // rows
    rows = math.isqrt(taxels)
    return rows, -(-taxels // rows)
