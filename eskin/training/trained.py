"""A trained model folder before it is quantised. Its config.json applies; values in it that quantisation
cannot keep are refused. No torch."""

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from eskin.golden.core import AcceleratorConfig, ArchiveError, InputError, Record, read_arrays
from eskin.golden.core.groups import GROUP_OF, Formats
from eskin.golden.model import (
    FloatModel,
    IntegerModel,
    constants_shape,
    load_config,
    load_training,
    network_shapes,
)
from eskin.golden.model.model import INTEGER_FILE, TRAINING_FILE

CHOSEN = (
    *(field.name for field in dataclasses.fields(Formats)),
    *("feature_shift", "aligned_means", "weight_formats", "map_formats", "state_code_shift", "taught_shift"),
)
"""Fields that quantisation chooses, starting from their values in the training's configuration, unless
somebody changed them since."""

CHOSEN_BY = {
    "weight_bits": ("weight_format", "recurrent_format", "dense_format", "weight_formats"),
    "state_bits": ("state_format",),
    "feature_bits": ("feature_format",),
    "gate_bits": ("gate_frac",),
    "table_entries": ("table_entries",),
    "unknown": ("unknown_above",),
}
"""Options whose fields have other names."""

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

    current: config.json. edited: fields of CHOSEN that somebody changed in it. record: training.json. files: content
    of each file in the folder.
    """

    folder: str
    model: FloatModel
    current: AcceleratorConfig
    edited: tuple[str, ...]
    record: Record
    files: dict[str, bytes]

    def check_unchanged(self) -> None:
        """Refuse to overwrite files that another program wrote after they were read."""
        if _contents(self.folder) != self.files:
            raise InputError(
                f"model '{self.folder}': was changed by another program in the meantime and was not overwritten; "
                "run the command again"
            )

    def check_kept(self, config: AcceleratorConfig, options: Record) -> None:
        """Refuse a quantisation that would lose a value of config.json.

        Parameters
        ----------
        config:
            Configuration of the integers that are to be written. If another readout decides, its fields are
            new.
        options:
            Options that the user gave, by name; their fields may change.

        Raises
        ------
        InputError
            Naming the field.
        """
        same_readout = config.has_prototypes == self.current.has_prototypes
        asked = [option for option, value in options.items() if value is not None]
        given = {name for option in asked for name in (option, *CHOSEN_BY.get(option, ()))}
        for field, group in GROUP_OF.items():
            before, after = self.current.value(field), config.value(field)
            free = field in CHOSEN and field not in self.edited
            if before == after or free or field in given or not (same_readout or group != "readout_rule"):
                continue
            raise InputError(
                f"model '{self.folder}', field {field}: is {before} in config.json, and the integers need {after}; "
                "put that there, or give the option that chooses it"
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
    files, current, record = _contents(model_dir), load_config(model_dir), load_training(model_dir)

    def noted(values: Record, name: str, otherwise: AcceleratorConfig) -> AcceleratorConfig:
        where = f"{model_dir}/{TRAINING_FILE}, field {name}"
        return AcceleratorConfig.from_dict(values[name], where) if name in values else otherwise

    trained, quantised = noted(record, "config", current), record.get("quantised")
    quantised = quantised if isinstance(quantised, dict) else {}
    before = noted(quantised, "start", trained)
    # a folder of an earlier version has no record of its quantisation
    written = noted(quantised, "config", current if INTEGER_FILE in files else trained)
    _check_network(model_dir, current, trained, before if ranges else None)
    _check_untaught(model_dir)
    edited = tuple(
        field
        for field in CHOSEN
        if current.value(field) != written.value(field)
        # kept by an earlier quantisation
        or current.value(field) == before.value(field) != trained.value(field)
    )
    start = {field: before.value(field) for field in CHOSEN if field not in edited and "shift" not in field}
    model = FloatModel.load(model_dir, images=images)
    config = current.replace(**start, feature_shift=())
    model = FloatModel(config, model.arrays, model.source)
    return Trained(str(model_dir), model, current, edited, record, files)


def _contents(folder: str | Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in Path(folder).glob("*") if path.is_file()}


def written_by(start: AcceleratorConfig, integer: IntegerModel) -> Record:
    """Record of a quantisation in training.json: the configurations from which it started and which it
    made."""
    return {"quantised": {"start": start.to_dict(), "config": integer.config.to_dict()}}


def _check_network(
    model_dir: str | Path,
    current: AcceleratorConfig,
    trained: AcceleratorConfig,
    noted: AcceleratorConfig | None,
) -> None:
    """Raise InputError for a config.json of another network, or of features other than those of the ``noted``
    ranges."""

    def refuse(before: AcceleratorConfig, fields: Iterable[str], why: str) -> None:
        for field in fields:
            value, other = current.value(field), before.value(field)
            if value != other:
                raise InputError(
                    f"model '{model_dir}', field {field}: is {value} in config.json and was {other} in training, {why}"
                )

    shapes = [network_shapes(c, real=True) | {"mu": constants_shape(c)} for c in (current, trained)]
    if shapes[0] != shapes[1]:
        refuse(trained, OF_SHAPES, "which is another network; put it back, or train again")
    if noted is not None:
        fields = (field for field, group in GROUP_OF.items() if group in OF_RANGES and field not in CHOSEN)
        refuse(noted, fields, "and so are the noted ranges; give recordings (--data)")


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
