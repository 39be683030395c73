"""Compare the float model with the integer model: accuracy, agreement, per class, per step.

Example: eskin evaluate model --data recordings.npz --json evaluate.json, or eskin evaluate model --against build.json

With --against: whether a file of export, generate or build holds this very model.
"""

from pathlib import Path

from eskin.cli.common import DATA, JsonOptions, ModelOptions, integer_model, option, recordings_for, show
from eskin.golden.core import InputError, Result
from eskin.golden.model import load_config
from eskin.training.evaluate import evaluate
from eskin.training.record import is_training_data


class EvaluateRequest(ModelOptions, JsonOptions):
    data: str | None = option(DATA)
    against: Path | None = option(
        "A file of export, generate or build that should hold this model.", metavar="FILE"
    )


def command(request: EvaluateRequest) -> Result:
    if (request.data is None) == (request.against is None):
        raise InputError("`data`: gives recordings and `against` a file to compare with; give one of the two")
    result: Result
    if request.against is not None:
        from eskin.exchange.certificate import certify
        from eskin.rtl.fpga.generate import contents

        result = certify(integer_model(request.model), request.against, contents)
        show("certificate", **dict(result))
    else:
        result = evaluate(request.model, recordings_for(request.data, load_config(request.model)))
        known = is_training_data(request.model, result.source, result.recordings)
        show("evaluate", **dict(result), known=known)
    return result
