"""Play recordings to a board over its serial line and compare its decisions with the golden model's.

Example: eskin replay model --port /dev/ttyUSB1 --data recordings.npz
"""

import contextlib
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from eskin.cli.common import (
    JsonOptions,
    ModelDataOptions,
    argument,
    integer_model,
    option,
    progress_bars,
    recordings_for,
    required,
    show,
)
from eskin.cosim.scoreboard import Mismatch, Recording, Scoreboard
from eskin.golden.core import AcceleratorConfig, Arrays, InputError, Progress, Record
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel, Stream, images_of, run_images
from eskin.golden.model.pipeline import DECISION_FIELDS
from eskin.golden.model.prototypes import check_teachable, taught_in_use
from eskin.live.link import BURST, Link
from eskin.live.serial_port import SerialPort
from eskin.live.sources import on_port
from eskin.rtl.fpga.generate import boot_writes, register_map
from eskin.rtl.program.memory_map import TeachRegister, taught_arrays
from eskin.teach.taught import load_taught, save_taught
from eskin.verbs.build import board_of


class ReplayRequest(ModelDataOptions, JsonOptions):
    model: Path = argument("The quantised model folder that the bitstream was built from.")
    port: str = required("Serial port of the board.")
    teach: str | None = option("Teach the last touch of each recording as this class.", metavar="CLASS")
    save_taught: Path | None = option(
        "File (.npz) of taught touches: loaded first, written at the end.", metavar="FILE"
    )


def command(request: ReplayRequest) -> Record:
    baud, lanes, lane_type = board_of(request.model)
    integer = integer_model(request.model).with_lanes(lanes, lane_type)
    recordings = recordings_for(request.data, integer.config)
    with progress_bars() as report:
        result = replay(request, integer, recordings, baud, report)
    show("replay", **result)
    return result


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
    path, classes = request.save_taught, model.config.network.class_names
    if request.teach not in (None, *classes):
        raise InputError(
            f"--teach {request.teach}: is not a class of the model; there are {', '.join(classes)}"
        )
    if request.teach or path:
        check_teachable(model.config)
    if path and path.exists():
        model = load_taught(model, path)
    config = model.config
    recordings = recordings.scanned(config.sensor.scan_every)
    stream = None if config.is_image else Stream(model, scanned=True)
    decided = _of_images(model, recordings) if stream is None else _streamed(stream, recordings)
    differences: list[Mismatch] = []
    compared = decisions = 0
    places: Record = {"in_use": None, "taught_equal": True}
    with contextlib.closing(SerialPort(request.port, baud)) as transport, on_port(request.port):
        link = Link(transport, register_map(config), timeout_s=answer_s(config, baud))
        begin = time.monotonic()
        progress("loading the model over the line", 0, 0)
        link.connect()
        link.load(boot_writes(config, model.arrays))
        for number, (arrays, look) in enumerate(decided):  # which heeds the touches taught below
            before = int(recordings.offsets[number])

            def report(taken: int, before: int = before) -> None:
                progress("frames played", before + taken, recordings.frames)

            got = link.play(recordings.recording(number), report, look)
            ends = {"numbers": np.array([number]), "decision_offsets": np.array([0, len(arrays["decision"])])}
            scoreboard = Scoreboard(config, link.map, probes=False)
            scoreboard.begin(Recording({**arrays, **ends}, 0))
            try:
                scoreboard.check("decision", np.array(got.decisions, np.uint32))
                for at_frame, status in got.looks.items():
                    scoreboard.look(at_frame, status)
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
        if stream is not None and (request.teach or path):
            assert isinstance(stream.model, IntegerModel)
            places = _held(link, stream.model, path)
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
        "passed": exact and decisions > 0 and places["taught_equal"],
        **places,
        "mismatch_list": [str(mismatch) for mismatch in differences],
        "wall_s": round(wall_s, 3),
        "frames_per_s": round(recordings.frames / wall_s),
    }


def _held(link: Link, model: IntegerModel, path: Path | None) -> Record:
    """Taught touches of the board, read out, against ``model``; written to ``path``."""
    arrays = taught_arrays(model.config, link.places)
    on_board = IntegerModel(model.config, {**model.arrays, **arrays}, "the board")
    in_use, names = taught_in_use(on_board), model.config.network.class_names
    equal = (arrays["taught_count"] == model.arrays["taught_count"]).all() and all(
        (places[:count] == aim[:count]).all()
        for places, aim, count in zip(arrays["taught"], model.arrays["taught"], in_use, strict=True)
    )
    if path:
        save_taught(on_board, path)
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
            "taught": taught_in_use(stream.model).sum(keepdims=True),
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
