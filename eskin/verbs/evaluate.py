"""Compare the float model with the integer model: accuracy, agreement, per class, per step.

Example: eskin evaluate model --data recordings.npz --json evaluate.json
"""

from eskin.cli.common import JsonOptions, ModelDataOptions, recordings_for, show
from eskin.golden.core import Result
from eskin.golden.model import load_config
from eskin.training.evaluate import evaluate


class EvaluateRequest(ModelDataOptions, JsonOptions):
    pass


def command(request: EvaluateRequest) -> Result:
    result = evaluate(request.model, recordings_for(request.data, load_config(request.model)))
    show("evaluate", **dict(result))
    return result
