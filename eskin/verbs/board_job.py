"""Verbs that play recordings frame by frame. `eskin replay`: to a board over its serial line, its decisions
against the golden model's. `eskin watch`: a source, a player, a hub and a view, put together."""

import contextlib
import math
import signal
import threading
import time
from collections.abc import Callable, Iterator
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from eskin.cosim.scoreboard import Mismatch, Recording, Scoreboard
from eskin.golden.core import AcceleratorConfig, Arrays, InputError, Progress, Record
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel, Stream, images_of, run_images
from eskin.golden.model.pipeline import DECISION_FIELDS
from eskin.golden.model.prototypes import check_teachable, taught_in_use
from eskin.live.hub import Hub
from eskin.live.link import BURST, Link
from eskin.live.player import Controls, Player, hello
from eskin.live.serial_port import SerialPort
from eskin.live.server import PageServer
from eskin.live.sources import BoardSource, Listener, ModelSource, SimulationSource, on_port
from eskin.pages.views import TEMPLATES
from eskin.requests import ReplayRequest, WatchRequest
from eskin.rtl.fpga.export import export
from eskin.rtl.fpga.generate import boot_writes, register_map
from eskin.rtl.program.memory_map import TeachRegister, taught_arrays
from eskin.teach.taught import load_taught, save_taught

ANSWER_S = 0.5
"""To wait for an answer once the line is free: far more than a serial adapter holds bytes back."""


def answer_s(config: AcceleratorConfig, baud: int) -> float:
    """Seconds to wait for an answer behind a burst of frames whose every byte is escaped."""
    return ANSWER_S + 10 * BURST * 2 * (2 * config.sensor.taxels + 8) / baud


def replay(
    request: ReplayRequest, model: IntegerModel, recordings: Recordings, baud: int, progress: Progress
) -> Record:
    """Load ``model`` into the board on ``request.port`` and play ``recordings``.

    Parameters
    ----------
    request:
        teach: each recording's last touch is taught as this class, when it is over; one that is not whole is not.
        save_taught: what this file holds is loaded, and then what the board holds in the end goes into it.
    model:
        With the lanes that the board's bitstream has.

    Returns
    -------
    dict
        port, baud, lanes, recordings, frames, decisions, compared_values, mismatches, bit_exact, passed,
        mismatch_list (sentences, the first ones), repeated (packets sent again), replayed (recordings played
        again), unanswered (questions asked again), damaged (packets from the board), wall_s, frames_per_s,
        in_use (class name -> touches, where a class is taught or touches are kept), taught_equal (what the
        board was taught is what the model was).

    Raises
    ------
    InputError
        No such port or class; no answer, another design than eskin's, a board that goes away; a model that cannot be
        taught, or a file of another one.
    """
    kept, classes = request.save_taught, model.config.network.class_names
    if request.teach not in (None, *classes):
        raise InputError(
            f"--teach {request.teach}: is not a class of the model; there are {', '.join(classes)}"
        )
    if request.teach or kept:
        check_teachable(model.config)
    if kept and kept.exists():
        model = load_taught(model, kept)
    config = model.config
    recordings = recordings.scanned(config.sensor.scan_every)
    stream = None if config.is_image else Stream(model, scanned=True)
    decided = _of_images(model, recordings) if stream is None else _streamed(stream, recordings)
    differences: list[Mismatch] = []
    compared = decisions = 0
    held: Record = {"in_use": None, "taught_equal": True}
    with contextlib.closing(SerialPort(request.port, baud)) as transport, on_port(request.port):
        link = Link(transport, register_map(config), timeout_s=answer_s(config, baud))
        begin = time.monotonic()
        progress("loading the model over the line", 0, 0)
        link.connect()
        link.load(boot_writes(config, model.arrays))
        for number, (arrays, look) in enumerate(decided):  # which heeds what is taught below
            before = int(recordings.offsets[number])

            def report(taken: int, before: int = before) -> None:
                progress("frames played", before + taken, recordings.frames)

            got = link.play(recordings.recording(number), report, look)
            ends = {"numbers": np.array([number]), "decision_offsets": np.array([0, len(arrays["decision"])])}
            scoreboard = Scoreboard(config, link.map, probes=False)
            scoreboard.begin(Recording({**arrays, **ends}, 0))
            try:
                scoreboard.check("decision", np.array(got.decisions, np.uint32))
                for behind, status in got.looks.items():
                    scoreboard.look(behind, status)
                scoreboard.end(got.registers)
            except Mismatch as found:
                differences.append(found)
            compared += scoreboard.compared.total()
            decisions += len(got.decisions)
            if stream is not None and request.teach and stream.touches:
                with contextlib.suppress(InputError):  # not whole
                    stream.teach(teach := classes.index(request.teach))
                    link.write([(TeachRegister.TEACH, teach)])
                    link.settle()
        if stream is not None and (request.teach or kept):
            assert isinstance(stream.model, IntegerModel)
            held = _held(link, stream.model, kept)
        wall_s = time.monotonic() - begin
    counts = {name: getattr(link, name) for name in ("repeated", "replayed", "unanswered", "damaged")}
    exact = not differences and compared > 0
    return counts | {
        "port": request.port,
        "baud": baud,
        "lanes": config.hardware.lanes,
        "recordings": len(recordings),
        "frames": recordings.frames,
        "decisions": decisions,
        "compared_values": compared,
        "mismatches": len(differences),
        "bit_exact": exact,
        "passed": exact and decisions > 0 and held["taught_equal"],
        **held,
        "mismatch_list": [str(mismatch) for mismatch in differences],
        "wall_s": round(wall_s, 3),
        "frames_per_s": round(recordings.frames / wall_s),
    }


def _held(link: Link, model: IntegerModel, kept: Path | None) -> Record:
    """Taught touches of the board, read out, against ``model``; written to ``kept``."""
    arrays = taught_arrays(model.config, link.places)
    held = IntegerModel(model.config, {**model.arrays, **arrays}, "the board")
    in_use, names = taught_in_use(held), model.config.network.class_names
    equal = (arrays["taught_count"] == model.arrays["taught_count"]).all() and all(
        (places[:count] == aim[:count]).all()
        for places, aim, count in zip(arrays["taught"], model.arrays["taught"], in_use, strict=True)
    )
    if kept:
        save_taught(held, kept)
    return {"in_use": dict(zip(names, in_use.tolist(), strict=True)), "taught_equal": bool(equal)}


Expected = Iterator[tuple[Arrays, int]]
"""Of each recording the arrays of `eskin.golden.model.write_vectors` that a board tells of, and the frames behind which
its first touch is open (0: never)."""


def _streamed(stream: Stream, recordings: Recordings) -> Expected:
    """Decisions of the stream, with the touches taught before a recording's turn."""
    for index in range(len(recordings)):
        stream.arm()
        decisions = [*stream.push(recordings.recording(index)), *stream.finish()]
        rows = np.array([decision.row() for decision in decisions]).reshape(-1, len(DECISION_FIELDS))
        of_first = [decision for decision in decisions if decision.touch == 0]
        look = max(of_first[0].onset_frame, 1) if of_first else 0
        arrays = {
            "decision": rows,
            "decision_frame": np.array([decision.frame for decision in decisions]),
            "touches": np.array([stream.touches]),
            "status": np.array([stream.status]),
            "flags": stream.flagged[None],
        }
        yield arrays, look if of_first and look < of_first[-1].frame else 0


def _of_images(model: IntegerModel, recordings: Recordings) -> Expected:
    """Decisions of the integer model; an image is one touch, decided with its last row."""
    rows = run_images(model, images_of(recordings)).streams["decision"][0].reshape(len(recordings), -1)
    for row in rows:
        each = row.reshape(-1, len(DECISION_FIELDS))
        frames = np.full(len(each), model.config.image.height)
        arrays = {
            "decision": each,
            "decision_frame": frames,
            "touches": np.array([1]),
            "status": np.array([0]),
        }
        yield arrays, int(model.config.image.height > 1)


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
        with contextlib.closing(SerialPort(request.port, baud)) as transport:
            yield board_source(model, transport, request.port, baud, plays)
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
