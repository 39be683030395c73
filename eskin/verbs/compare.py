"""Compare float with integer stage by stage: errors, saturations, share of the range in use. With --data the
check of evaluate decides the exit status.

Example: eskin compare model --data recordings.npz --json compare.json
"""

from eskin.cli.common import DATA, JsonOptions, ModelOptions, option, recordings_for, show, warn
from eskin.golden.core import Record
from eskin.golden.model import load_config
from eskin.training.evaluate import OF_LABELS, evaluate
from eskin.training.made_up import image_recordings, random_images, random_recordings


class CompareRequest(ModelOptions, JsonOptions):
    data: str | None = option(f"{DATA} Default: random touches.")


def command(request: CompareRequest) -> Record:
    config = load_config(request.model)
    if request.data is None:
        things = "images" if config.is_image else "touches"
        warn(f"no --data: uses random {things}, whose ranges may differ from those of real ones")
    if request.data is None and config.is_image:
        recordings = image_recordings(config, random_images(config, 64, 1))
    elif request.data is None:
        length = config.rest_level.rest_frames + 2 * config.last_frame + config.onset_rule.rearm_frames
        recordings = random_recordings(config, [length] * 12, 1)
    else:
        recordings = recordings_for(request.data, config)
    result = evaluate(request.model, recordings).model_dump(
        exclude=OF_LABELS if request.data is None else None
    )
    show("compare", **result)
    return result
