"""The live view."""

from rich.markup import escape

from eskin.cli.common import app, messages, recordings_for, show
from eskin.golden.core import InputError, Record
from eskin.requests import WatchRequest


@app.command(
    epilog="Example: eskin watch model --data recordings.npz, or eskin watch model --simulate, or "
    "eskin watch model --data recordings.npz --port /dev/ttyUSB1"
)
def watch(request: WatchRequest) -> Record:
    """Watch a model live in the browser: taxels, windows, features, hidden state, logits and decisions."""
    from eskin.golden.model import IntegerModel
    from eskin.verbs import build_job, watch_job

    if request.port and request.simulate:
        raise InputError("--simulate: cannot be combined with --port; leave one out")
    if not (request.data or request.port or request.simulate):
        raise InputError(
            "--data: is missing; name recordings, or a board with --port, or add --simulate for a synthetic "
            "scene"
        )
    baud, lanes, lane_type = build_job.board_of(request.model) if request.port else (None, None, None)
    integer = IntegerModel.load(request.model).with_lanes(lanes, lane_type)
    recordings = (
        None
        if request.port and not request.data
        else recordings_for(request.data or "synthetic", integer.config)
    )
    if request.simulate:
        messages.print("watch: building the simulator, once a design", soft_wrap=True)
    result = watch_job.watch(
        integer,
        recordings,
        port=request.port,
        baud=baud,
        simulate=request.simulate,
        host_port=request.host_port,
        ready=lambda address, _: messages.print(
            f"watch: {escape(address)} (stop with Ctrl-C)", soft_wrap=True, highlight=False
        ),
    )
    show("watch", **result, hardware=bool(request.simulate or request.port))
    return result
