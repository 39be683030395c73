"""The live view."""

from typing import Annotated

from rich.markup import escape

from eskin.cli.common import DATA, ModelArgument, app, integer_model, messages, option, recordings_for, show
from eskin.golden.core import InputError, Record


@app.command(
    epilog="Example: eskin watch model --data recordings.npz, or eskin watch model --simulate, or "
    "eskin watch model --data recordings.npz --port /dev/ttyUSB1"
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
    host_port: Annotated[int, option("Port of the page; 0: any that is free.", min=0, max=65535)] = 8765,
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
    baud, lanes, lane_type = build_job.board_of(model) if port else (None, None, None)
    integer = integer_model(model).with_lanes(lanes, lane_type)
    if integer.config.is_image and not data:
        raise InputError(
            "--data: is missing; a model of images has no synthetic scene and no converter: name images"
        )
    recordings = None if port and not data else recordings_for(data or "synthetic", integer.config)
    if simulate:
        messages.print("watch: building the simulator, once a design", soft_wrap=True)
    result = watch_job.watch(
        integer,
        recordings,
        port=port,
        baud=baud,
        simulate=simulate,
        host_port=host_port,
        ready=lambda address, _: messages.print(
            f"watch: {escape(address)} (stop with Ctrl-C)", soft_wrap=True, highlight=False
        ),
    )
    show("watch", **result, hardware=bool(simulate or port))
    return result
