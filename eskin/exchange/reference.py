"""Reference inputs and outputs of a network trained elsewhere: does what was read compute the same?"""

from pathlib import Path

import numpy as np

from eskin.golden.core import ArchiveError, InputError, Record, read_arrays
from eskin.golden.model import FloatModel

NAMES = ("inputs", "outputs")
TOLERANCE = 1e-4
"""Between logits in single precision and those of what was read, of 1 + the largest logit."""


def differences(outputs: np.ndarray, logits: np.ndarray) -> dict[str, float]:
    """Largest difference of ``outputs`` from ``logits`` (n, K, C) of the ``last`` step and of ``every`` step, of
    1 + the largest logit; none where the number of values is another. Of a single step only ``every``."""
    found: dict[str, float] = {}
    references = [("every", logits), ("every", logits.swapaxes(0, 1))]
    if logits.shape[1] > 1:
        references.append(("last", logits[:, -1]))
    for shows, reference in references:
        if outputs.size == reference.size:
            difference = float(np.abs(outputs.ravel() - reference.ravel()).max(initial=0.0))
            relative = difference / (1 + float(np.abs(reference).max(initial=0.0)))
            found[shows] = min(found.get(shows, np.inf), relative)
    return found


def _read(path: Path, own: tuple[str, str]) -> tuple[np.ndarray, np.ndarray]:
    save = "save it with numpy.savez(FILE, inputs=.., outputs=..)"
    try:
        arrays = read_arrays(path)
    except (OSError, ArchiveError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"--check {path}: {why}; {save}") from None
    pair = next((pair for pair in (NAMES, own) if set(pair) <= set(arrays)), None)
    if pair is None:
        there = ", ".join(f"{name:.20}" for name in list(arrays)[:6]) or "none"
        raise InputError(f"--check {path}: arrays inputs and outputs are missing, there are {there}; {save}")
    for name in pair:
        array = arrays[name]
        if array.dtype.kind not in "fiu" or not array.size or not np.isfinite(array).all():
            raise InputError(f"--check {path}, array {name}: must hold only finite numbers; {save}")
    inputs, outputs = (arrays[name].astype(np.float64) for name in pair)
    return inputs, outputs


def check_reference(path: Path, model: FloatModel, own: tuple[str, str] = NAMES) -> Record:
    """Compare outputs that another tool computed with the model's logits of the same inputs.

    Parameters
    ----------
    path:
        An ``.npz`` with ``inputs`` as the network takes them, so normalised: (touches, steps, inputs), steps first,
        or of a linear cell its columns. And ``outputs``: logits of the last step (touches, classes) or of every step.
    own:
        Other names of the two arrays.

    Returns
    -------
    dict
        file, touches, difference (largest of a logit, of 1 + the largest logit), limit, passed, shows (``last``
        or ``every`` step's logits).

    Raises
    ------
    InputError
        The file cannot be read, or its arrays have no shape that the network has.
    """
    inputs, outputs = _read(path, own)
    config, wide, steps = model.config, model.config.inputs, model.config.windows.steps
    readings: list[np.ndarray] = []
    wanted = f"(touches, {steps} steps, {wide})"
    if inputs.ndim == 3 and inputs.shape[2] == wide:
        readings = [inputs, inputs.swapaxes(0, 1)]
    elif not config.recurrent and inputs.ndim == 2 and inputs.shape[1] % wide == 0:
        readings = [inputs.reshape(len(inputs), -1, wide)]
    readings = [features for features in readings if config.sets == 1 or features.shape[1] == steps]
    if not readings:
        raise InputError(f"--check {path}: its inputs have shape {inputs.shape}; they must be {wanted}")
    found = [
        (far, shows, len(features))
        for features in readings
        for shows, far in differences(outputs, model.forward(features)[1]).items()
    ]
    if not found:
        raise InputError(
            f"--check {path}: its outputs have shape {outputs.shape}; they must be logits, "
            f"({len(readings[0])}, {config.classes}) of the last step or of every step"
        )
    difference, shows, count = min(found)
    return {
        "file": str(path),
        "touches": count,
        "difference": difference,
        "limit": TOLERANCE,
        "passed": difference <= TOLERANCE,
        "shows": shows,
    }
