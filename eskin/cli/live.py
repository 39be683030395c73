"""The live view."""

from pathlib import Path
from typing import Annotated

import numpy as np
from rich.markup import escape

from eskin.cli.common import (
    DATA,
    LaneType,
    ModelArgument,
    app,
    console,
    how_many,
    integer_model,
    messages,
    option,
    recordings_for,
    show,
)
from eskin.golden.core import InputError, Record


@app.command(
    epilog="Example: eskin watch model --data recordings.npz, or eskin watch model --simulate --speed 0.5, "
    "or "
    "eskin watch model --data recordings.npz --port /dev/ttyUSB1 --build build/board/icebreaker, or "
    "eskin watch model --data recordings.npz --terminal"
)
def watch(
    model: ModelArgument,
    data: Annotated[str | None, option(f"Recordings to play. {DATA}")] = None,
    port: Annotated[
        str | None,
        option("A board's serial port: with --data it is given the recordings, without it is listened to."),
    ] = None,
    simulate: Annotated[
        bool,
        option(
            "The RTL in Verilator in lock step, beside the model; without --data a synthetic scene.",
            "--simulate",
        ),
    ] = False,
    host: Annotated[str, option("Interface of the page; 0.0.0.0 lets other machines watch.")] = "127.0.0.1",
    host_port: Annotated[int, option("Port of the page; 0: any that is free.", min=0, max=65535)] = 8765,
    terminal: Annotated[
        bool, option("Show it here instead of in a browser, until all is played.", "--terminal")
    ] = False,
    record: Annotated[
        Path | None, option("Also write all that is played to this archive.", metavar="FILE")
    ] = None,
    speed: Annotated[
        str,
        option("Times the sensor's pace (images: one a second), or as fast as possible.", metavar="X|max"),
    ] = "1",
    recordings: Annotated[
        str, option("How many, spread over the classes, the classes in turn.", metavar="N|all")
    ] = "all",
    shape: Annotated[
        str | None, option("Rows and columns of the array; default: guessed.", metavar="RxC")
    ] = None,
    once: Annotated[
        bool, option("End when all is played; otherwise the page may ask for more.", "--once")
    ] = False,
    build: Annotated[
        Path | None,
        option(
            "With --port: the board's build, which tells rate and lanes; default: the only one.",
            metavar="DIR",
        ),
    ] = None,
    baud: Annotated[int | None, option("With --port, without a build at hand: bits a second.", min=1)] = None,
    lanes: Annotated[
        int | None, option("Lanes of the simulated hardware (default 4), or with --baud the board's.")
    ] = None,
    lane_type: Annotated[LaneType | None, option("plain or dsp, likewise.")] = None,
) -> Record:
    """Watch a model at work in the browser: taxels, windows, features, hidden state, logits and decisions as
    they come."""
    from eskin.verbs import build_job, watch_job

    if port and simulate:
        raise InputError(
            "--simulate: the simulated hardware or the board at --port is watched, not both; leave one out"
        )
    if not (data or port or simulate):
        raise InputError(
            "--data: is missing; name recordings, or a board with --port, or add --simulate for a synthetic "
            "scene"
        )
    if not port and (build or baud):
        raise InputError(f"--{'build' if build else 'baud'}: is for a board; add --port, or leave it out")
    if build and baud:
        raise InputError(f"--build {build}: tells the rate by itself; leave out --baud")
    if not (simulate or baud) and (lanes is not None or lane_type):
        raise InputError(
            f"--{'lanes' if lanes is not None else 'lane-type'}: is for --simulate, or for --port with "
            "--baud; leave it out"
        )
    if terminal and host != "127.0.0.1":
        raise InputError(f"--host {host}: no page is served with --terminal; leave one of them out")
    pace, count = watch_job.parsed_speed(speed), how_many(recordings)
    if port and not baud:
        baud, lanes, lane_type = build_job.link_of(build or build_job.only_build())
    lanes = 1 if lanes is None and port else lanes
    integer = integer_model(model).with_lanes(lanes, lane_type)
    if integer.config.is_image and not data:
        raise InputError(
            "--data: is missing; a model of images has no synthetic scene and no converter: name images"
        )
    loaded = None if port and not data else recordings_for(data or "synthetic", integer.config)
    numbers = (
        []
        if loaded is None
        else watch_job.in_turn(loaded, np.asarray(loaded.evenly(len(loaded) if count is None else count)))
    )

    def ready(address: str, controls: object) -> None:
        if address:
            messages.print(f"watch: {escape(address)} (stop with Ctrl-C)", soft_wrap=True, highlight=False)

    if simulate:
        messages.print("watch: building the simulator, once a design", soft_wrap=True)
    result = watch_job.watch(
        integer,
        loaded,
        numbers,
        port=port,
        baud=baud,
        simulate=simulate,
        host=host,
        host_port=host_port,
        in_terminal=terminal,
        record=record,
        speed=pace,
        shape=shape,
        once=once,
        console=console,
        ready=ready,
    )
    show("watch", **result, hardware=bool(simulate or port), record=record)
    return result
