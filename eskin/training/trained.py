"""A trained model folder before it is quantised. Its config.json applies; values in it that quantisation
cannot keep are refused. No torch."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from eskin.golden.core import AcceleratorConfig, ArchiveError, InputError, read_arrays
from eskin.golden.core.groups import GROUP_OF, Formats
from eskin.golden.model import FloatModel, constants_shape, load_config, network_shapes
from eskin.golden.model.model import INTEGER_FILE, TRAINING_FILE
from eskin.training.record import Training, training_of

CHOSEN = (
    *(field.name for field in dataclasses.fields(Formats)),
    *("feature_shift", "aligned_means", "weight_formats", "map_formats", "state_code_shift", "taught_shift"),
)
"""Fields that quantisation chooses, starting from their values in the training's configuration."""

OF_SHAPES = (
    *("hidden", "cell", "reset", "weight_sets", "layers", "height", "width"),
    *("taxels", "feature_kinds", "feature_scale", "steps", "class_names"),
)
"""Fields that a network's arrays depend on."""

OF_RANGES = ("rest_level", "windows", "features")
"""Groups that the noted ranges depend on."""


@dataclass(frozen=True)
class Trained:
    """A float model and the configuration that quantisation starts from, both read from its folder.

    current: config.json. record: training.json. files: content of each file in the folder.
    """

    folder: str
    model: FloatModel
    current: AcceleratorConfig
    record: Training
    files: dict[str, bytes]

    def check_unchanged(self) -> None:
        """Refuse to overwrite files that another program wrote after they were read."""
        if _contents(self.folder) != self.files:
            raise InputError(
                f"model '{self.folder}': was changed by another program in the meantime and was not overwritten; "
                "run the command again"
            )


def load_trained(model_dir: str | Path, *, ranges: bool = False, images: bool = False) -> Trained:
    """Reads the model folder for quantisation. ``ranges``: True if the ranges noted in training.json are
    used.

    Raises
    ------
    InputError
        The folder is not a model folder, its config.json does not fit its network, or the model holds taught
        touches.
    """
    files, current = _contents(model_dir), load_config(model_dir)
    record = training_of(model_dir)

    def noted(values: Mapping[str, Any], otherwise: AcceleratorConfig) -> AcceleratorConfig:
        where = f"{model_dir}/{TRAINING_FILE}, field config"
        return AcceleratorConfig.from_dict(dict(values), where) if values else otherwise

    trained, quantised = noted(record.config, current), record.quantised
    # a folder of an earlier version has no record of its quantisation
    before = current if INTEGER_FILE in files else trained
    written = noted(quantised.config, before) if quantised else before
    one, other = (network_shapes(c, real=True) | {"mu": constants_shape(c)} for c in (current, trained))
    of_ranges = [name for name, group in GROUP_OF.items() if group in OF_RANGES and name not in CHOSEN]
    for fields, before, why in (
        (
            OF_SHAPES if one != other else (),
            trained,
            "in training, which is another network; put it back, or train again",
        ),
        (
            of_ranges if ranges else (),
            written,
            "in training, and so are the noted ranges; give recordings (`data`)",
        ),
        (
            CHOSEN,
            written,
            "as quantise chose it; put that back, and give `weight_bits`, `state_bits` or `formats`",
        ),
    ):
        for field in fields:
            if (value := current.value(field)) != before.value(field):
                raise InputError(
                    f"model '{model_dir}', field {field}: is {value} in config.json and was {before.value(field)} {why}"
                )
    _check_untaught(model_dir)
    model = FloatModel.load(model_dir, images=images)
    start = {field: trained.value(field) for field in CHOSEN if "shift" not in field}
    config = current.replace(**start, feature_shift=())
    model = FloatModel(config, model.arrays, model.source)
    return Trained(str(model_dir), model, current, record, files)


def _contents(folder: str | Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in Path(folder).glob("*") if path.is_file()}


def _check_untaught(model_dir: str | Path) -> None:
    """Refuse a model that was taught touches: other integers have other trajectories."""
    try:
        count = read_arrays(Path(model_dir) / INTEGER_FILE).get("taught_count")
    except (ArchiveError, OSError):
        return  # missing, or damaged, which quantisation repairs
    if count is not None and count.any():
        raise InputError(
            f"model '{model_dir}', array taught: it holds taught touches, which new integers would lose; "
            "quantise the model before teaching, then teach it again"
        )
