"""Watch a model live in the browser: taxels, windows, features, hidden state, logits and decisions.

Example: eskin watch model --data recordings.npz, or eskin watch model --simulate, or eskin watch model
--data recordings.npz --port /dev/ttyUSB1
"""

import contextlib
import dataclasses
import math
import signal
import threading
from collections.abc import Callable, Iterator
from itertools import zip_longest
from pathlib import Path
from typing import Any

from rich.markup import escape

from eskin.cli.common import DATA, ModelOptions, messages, option, recordings_for, show
from eskin.golden.core import InputError, Record
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel
from eskin.live.hub import Hub
from eskin.live.link import Link
from eskin.live.player import Controls, Player, hello
from eskin.live.recorder import GrowingArchive, Recorder
from eskin.live.serial_port import SerialPort
from eskin.live.server import PageServer
from eskin.live.sources import BoardSource, Listener, ModelSource, SensorSource, SimulationSource, on_port
from eskin.pages.views import TEMPLATES
from eskin.rtl.fpga.export import export
from eskin.rtl.fpga.generate import boot_writes, register_map
from eskin.rtl.program.memory_map import Control, InterfaceRegister, Register
from eskin.verbs.build import board_of
from eskin.verbs.replay import answer_s


class WatchRequest(ModelOptions):
    data: str | None = option(f"Recordings to play. {DATA}")
    port: str | None = option("Serial port of a board. Without --data: show its own sensor.")
    record: Path | None = option(
        "With --port: archive (.npz) that touches of the board's own sensor are added to.", metavar="FILE"
    )
    simulate: bool = option("Also simulate the RTL and compare it in lock step.", False, "--simulate")
    host_port: int = option("TCP port of the page; 0: any free one.", 8765, min=0, max=65535)


def command(request: WatchRequest) -> Record:
    if request.port and request.simulate:
        raise InputError("--simulate: cannot be combined with --port; leave one out")
    if request.record and (request.data or not request.port):
        raise InputError("--record: is for a board with its own sensor; add --port, and leave --data out")
    if not (request.data or request.port or request.simulate):
        raise InputError(
            "--data: is missing; name recordings, or a board with --port, or add --simulate for a synthetic "
            "scene"
        )
    baud, lanes, lane_type = board_of(request.model) if request.port else (None, None, None)
    integer = IntegerModel.load(request.model).with_lanes(lanes, lane_type)
    recordings = None
    if request.data or not request.port:
        recordings = recordings_for(request.data or "synthetic", integer.config)
    if request.simulate:
        messages.print("watch: building the simulator, once a design", soft_wrap=True)

    def ready(address: str, _: Controls) -> None:
        messages.print(f"watch: {escape(address)} (stop with Ctrl-C)", soft_wrap=True, highlight=False)

    result = watch(request, integer, recordings, baud, ready)
    show("watch", **result, hardware=bool(request.simulate or (request.port and request.data)))
    return result


BUILDS = Path("build/simulators")
PAGE = TEMPLATES / "watch.html"
"""The page that is served."""
END_S = 0.5
"""Longest time between checks whether the player has ended, so that an interrupt is noticed."""


@contextlib.contextmanager
def opened_source(
    request: WatchRequest, model: IntegerModel, plays: bool, baud: int | None
) -> Iterator[ModelSource | Listener]:
    """The source that is asked for; closed in the end.

    Raises
    ------
    InputError
        The port cannot be opened, or no eskin board answers on it.
    """
    if request.port and baud:
        recorder = Recorder(GrowingArchive(request.record, model.config), model) if request.record else None
        with contextlib.closing(SerialPort(request.port, baud)) as transport:
            yield board_source(model, transport, request.port, baud, plays, recorder)
        return
    source: ModelSource = ModelSource(model)
    if request.simulate:
        # needs the simulators' packages, which the others do without
        from eskin.cosim.device import Accelerator, Design

        config, arrays = model.config, model.arrays
        design = Design(export(config, arrays), BUILDS)
        boot = boot_writes(config, arrays)
        source = SimulationSource(model, Accelerator(design, config, register_map(config), boot))
    with contextlib.closing(source):
        yield source


def at_scan_rate(model: IntegerModel) -> IntegerModel:
    """The model for the frames that a board's sensor gives, which are those that the chain takes."""
    config = model.config
    sensor = {"sample_rate_hz": config.sensor.scan_rate_hz, "scan_every": 1}
    return dataclasses.replace(model, config=config.replace(**sensor))


def board_source(
    model: IntegerModel, transport: Any, port: str, baud: int, plays: bool, recorder: Recorder | None = None
) -> BoardSource | SensorSource | Listener:
    """The board behind ``transport``: loaded and to be given recordings, asked for its frames by a recorder, or listened
    to as it is.

    Raises
    ------
    InputError
        No eskin board answers; it does not send frames.
    """
    config, map_ = model.config, register_map(model.config)
    map_["registers"] |= {"FRAMES": int(InterfaceRegister.FRAMES)}
    link = Link(transport, map_, timeout_s=answer_s(config, baud))
    with on_port(port):
        link.connect()
        if recorder:
            link.write([(Register.CONTROL, Control.ARM), (InterfaceRegister.FRAMES, 1)])
            if link.read("FRAMES") != 1:
                raise InputError(
                    f"--record: the board on {port} sends no frames; build it with --converter NAME --frames"
                )
            return SensorSource(model, link, port, recorder)
        if not plays:
            return Listener(config, link, port)
        link.load(boot_writes(config, model.arrays))
        return BoardSource(model, link, port)


def watch(
    request: WatchRequest,
    model: IntegerModel,
    recordings: Recordings | None,
    baud: int | None,
    ready: Callable[[str, Controls], None],
) -> Record:
    """Show ``recordings``, alternating between classes (None: a stand-alone board), until an interrupt.

    Parameters
    ----------
    baud:
        Of the board's serial line.
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
    model = at_scan_rate(model) if request.record else model
    config, controls = model.config, Controls()
    numbers = [] if recordings is None else in_turn(recordings)
    shape = recordings.grid if recordings is not None and recordings.grid else None
    shape = (config.interface.rows, config.interface.columns) if config.interface.position else shape
    drawn = {"shape": list(shape or guessed_shape(config.sensor.taxels)), "guessed": shape is None}
    with opened_source(request, model, recordings is not None, baud) as source:
        greeting = hello(config, recordings, numbers, source=source.kind, **drawn)
        hub = Hub(greeting, config.sensor.sample_rate_hz, config.sensor.taxels)
        player = Player(source, recordings, numbers, hub, controls)
        with (
            _ending_in_order(controls),
            contextlib.closing(
                PageServer(PAGE.read_bytes(), hub, controls, port=request.host_port)
            ) as server,
        ):
            ready(server.address, controls)
            _run(player, controls)
    if player.error is not None:
        raise player.error
    tally, hardware = player.tally, source.kind in ("simulation", "board")
    return vars(tally) | {
        "compared_values": tally.compared,
        "mismatch_list": tally.sentences,
        "decisions": player.decisions,
        "passed": tally.mismatches == 0 and (tally.compared > 0 or not hardware),
    }


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


def guessed_shape(taxels: int) -> tuple[int, int]:
    """(rows, columns) of an array with this number of taxels, if the configuration has no shape: the squarest rectangle that they fill,
    no longer than ``LONGEST`` to 1; where there is none, the smallest square grid that holds them, with cells
    left over."""
    for rows in range(math.isqrt(taxels), 0, -1):
        if taxels % rows == 0 and taxels // rows <= LONGEST * rows:
            return rows, taxels // rows
    rows = math.isqrt(taxels)
    return rows, -(-taxels // rows)
