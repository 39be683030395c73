"""Models: the trained float network and the integer one, each a configuration and named arrays, kept together
in a model folder.

A model folder holds ``config.json``, ``float.npz`` (float network), ``training.json`` (how it came about)
and, once quantised, ``weights.npz`` (integer network, docs/specification.md section 8).
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eskin.golden.core import (
    AcceleratorConfig,
    ArchiveError,
    Arrays,
    Check,
    InputError,
    QFormat,
    Record,
    Result,
    content_key,
    model_hash,
    read_arrays,
    replacing_folder,
)
from eskin.golden.core.config import VOTE_BITS
from eskin.golden.core.images import BIAS_BITS
from eskin.golden.model.cells import Fixed, Float, run_cell
from eskin.golden.model.forest import check_forest

CONFIG_FILE = "config.json"
FLOAT_FILE = "float.npz"
INTEGER_FILE = "weights.npz"
TRAINING_FILE = "training.json"
MODEL_FILES = (CONFIG_FILE, FLOAT_FILE, INTEGER_FILE, TRAINING_FILE)


# ---------------------------------------------------------------------- names, shapes, formats
def network_shapes(config: AcceleratorConfig, *, real: bool) -> dict[str, tuple[int, ...]]:
    """Shapes of the network's arrays by name; ``real`` adds torch's second bias rows of a float reset-after
    GRU."""
    h, d, c = config.network.hidden, config.inputs, config.classes
    if config.is_image:
        of_stage = {f"W_{stage.number}": stage.weight_shape for stage in config.weighted_stages}
        return of_stage | {f"b_{stage.number}": (stage.outputs,) for stage in config.weighted_stages}
    if config.is_forest:
        nodes = config.forest.nodes
        of_node = dict.fromkeys(("tree_input", "subtrahend", "threshold"), (nodes,))
        return of_node | dict.fromkeys(("child", "vote"), (nodes, 2))
    if not config.recurrent:
        return {"V": (config.sets, c, d), "b_y": (c,)}
    shapes: dict[str, tuple[int, ...]] = {}
    for gate in config.gates:
        shapes |= {f"W_{gate}": (h, d), f"U_{gate}": (h, h), f"b_{gate}": (h,)}
    if config.network.cell == "gru" and config.network.reset == "after":
        shapes |= {f"bh_{gate}": (h,) for gate in (config.gates if real else ("n",))}
    return shapes | {"V": (c, h), "b_y": (c,)}


def network_formats(config: AcceleratorConfig) -> dict[str, QFormat]:
    """Formats of the integer network's arrays by name."""
    if config.is_image:
        weights = {
            f"W_{stage.number}": fmt
            for stage, fmt in zip(config.weighted_stages, config.image.weight_formats, strict=True)
        }
        return weights | {f"b_{stage.number}": QFormat(BIAS_BITS, 0) for stage in config.weighted_stages}
    formats = config.formats
    if config.is_forest:
        inputs = dict.fromkeys(("tree_input", "subtrahend"), QFormat(17, 0, False))
        whole = {"child": QFormat(16, 0), "vote": QFormat(VOTE_BITS, 0)}
        return inputs | whole | {"threshold": config.threshold_format}
    kinds = {
        "W": formats.weight_format,
        "U": formats.recurrent_format,
        "b": formats.bias_format,
        "bh": formats.bias_format,
    }
    dense = {"V": formats.dense_format, "b_y": formats.dense_bias_format}
    names = [name for name in network_shapes(config, real=False) if name not in dense]
    return {name: kinds[name.partition("_")[0]] for name in names} | dense


def readout_shapes(config: AcceleratorConfig) -> dict[str, tuple[int, ...]]:
    """Shapes of the readout's arrays by name, empty if logits decide: ``prototypes`` and ``taught`` (class,
    place, step, value), ``taught_count`` (class)."""
    rule = config.readout_rule
    if not config.has_prototypes:
        return {}
    touch = config.windows.steps, config.trajectory_width
    shapes: dict[str, tuple[int, ...]] = {"prototypes": (config.classes, rule.prototypes, *touch)}
    if rule.taught:
        shapes |= {"taught": (config.classes, rule.taught, *touch), "taught_count": (config.classes,)}
    return shapes


def constants_shape(config: AcceleratorConfig) -> tuple[int, ...]:
    """Shape of mu and sigma, and of mean and scale for one window length: () where one pair serves all
    inputs, else (constants,)."""
    return (config.constants,) if config.constants > 1 else ()


def real_by_input(config: AcceleratorConfig, constants: np.ndarray) -> np.ndarray:
    """mu or sigma for each input, (..., inputs), or unchanged if one value serves all inputs."""
    return constants[..., list(config.input_constants)] if config.constants > 1 else constants


# ---------------------------------------------------------------------- the two models
class _Model:
    config: AcceleratorConfig
    arrays: Arrays

    @property
    def content(self) -> str:
        """Hash of everything that a result can depend on."""
        named = (part for name in sorted(self.arrays) for part in (name, self.arrays[name]))
        return content_key(self.config.to_dict(), *named)


@dataclass(frozen=True)
class FloatModel(_Model):
    """A trained float network with its normalisation: feature = (d / unit - mu) / sigma
    (``AcceleratorConfig.feature_unit``), the same for all steps.

    config: the configuration it was trained under. arrays: float64, by name (``network_shapes(config,
    real=True)``) and ``mu``, ``sigma`` (codes; sigma above 0): scalars, or (constants) with several kinds of
    feature or a scale a taxel. A network for images has neither.

    Raises
    ------
    InputError
        When an array is missing, superfluous, of another shape, or not finite.
    """

    config: AcceleratorConfig
    arrays: Arrays
    source: str = "float model"

    def __post_init__(self) -> None:
        shapes = network_shapes(self.config, real=True)
        if not self.config.is_image:
            shapes |= dict.fromkeys(("mu", "sigma"), constants_shape(self.config))
        checked = {}
        for name, array in _take(self.arrays, shapes, self.source, self.config).items():
            if array.dtype.kind not in "fiu" or not np.isfinite(array).all():
                raise InputError(
                    f"{self.source}, array {name}: holds values that are not finite numbers; train the model "
                    "again"
                )
            checked[name] = _frozen(np.array(array, dtype=np.float64))
        check_forest(self.config, checked, self.source)
        if "sigma" in checked and (checked["sigma"] <= 0).any():
            raise InputError(
                f"{self.source}, array sigma: is {checked['sigma'].min()}; it must be above 0: train the "
                "model again"
            )
        object.__setattr__(self, "arrays", checked)

    def features(self, means: np.ndarray) -> np.ndarray:
        """Features (..., steps, inputs) from the result of `eskin.golden.model.preprocess.real_features`; 0
        for masked taxels."""
        mu, sigma = (real_by_input(self.config, self.arrays[name]) for name in ("mu", "sigma"))
        features = (means - mu) / sigma
        features[..., list(self.config.input_mask)] = 0.0
        return features

    def forward(self, features: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(hidden (n, K, H), logits (n, K, C)), float64, of real features (n, K, D)."""
        return _run(Float(self.config), self.config, self.arrays, features)

    def save(
        self,
        folder: str | Path,
        training: Record | Result,
        integer: IntegerModel | None = None,
        check: Check = lambda: None,
    ) -> None:
        """Write config.json, float.npz, training.json and, if there is an integer model, weights.npz into
        ``folder`` (new, or a model folder, which is replaced) in one exchange. check: as for
        `replacing_folder`."""

        def write(temporary: Path) -> None:
            np.savez(temporary / FLOAT_FILE, allow_pickle=False, **self.arrays)
            (temporary / TRAINING_FILE).write_text(
                json.dumps(training, indent=1, default=Result.plain) + "\n"
            )
            _write(temporary, self.config, integer)

        replace_folder(folder, write, check)

    @classmethod
    def load(cls, folder: str | Path, *, images: bool = False) -> FloatModel:
        """The float model in a model folder. A model for images is refused unless ``images`` is True."""
        config, arrays, source = _load(folder, FLOAT_FILE, "train a model into it", images)
        return cls(config, arrays, source)


@dataclass(frozen=True)
class IntegerModel(_Model):
    """The integer network, with which the hardware computes.

    config: must have every format and ``feature_shift`` set. arrays: int64 codes by the names of
    docs/specification.md section 8.

    Raises
    ------
    InputError
        When an array is missing, superfluous, not integer, of another shape, or outside its format; when
        feature_shift is empty.
    """

    config: AcceleratorConfig
    arrays: Arrays
    source: str = "integer model"

    def __post_init__(self) -> None:
        config, lengths = self.config, len(self.config.window_lengths)
        field = "weight_formats" if config.is_image else "feature_shift"
        if not config.value(field):
            raise InputError(
                f"{self.source}: field {field} of its configuration is empty; quantise the model"
            )
        shapes, formats = network_shapes(config, real=False), network_formats(config)
        if not config.is_image:
            shapes |= dict.fromkeys(("mean", "scale"), (lengths, *constants_shape(config)))
            formats |= {"mean": config.mean_format, "scale": config.scale_format}
            shapes |= readout_shapes(config)
            formats |= dict.fromkeys(("prototypes", "taught"), config.state_code_format)
            formats |= {"taught_count": QFormat(6, 0, False)}
        checked = {}
        for name, array in _take(self.arrays, shapes, self.source, config).items():
            if array.dtype.kind not in "iu":
                raise InputError(
                    f"{self.source}, array {name}: holds {array.dtype}, not integers; quantise the model "
                    "again"
                )
            lowest = 1 if name == "scale" else formats[name].min_code  # a scale of 0 would lose the input
            highest = formats[name].max_code
            if name == "taught_count":
                highest = 2 * config.readout_rule.taught - 1
            if array.min() < lowest or array.max() > highest:
                raise InputError(
                    f"{self.source}, array {name}: holds {array.min()}..{array.max()}, outside "
                    f"{lowest}..{highest} of {formats[name]}; quantise the model again"
                )
            checked[name] = _frozen(np.array(array, dtype=np.int64))
        check_forest(config, checked, self.source)
        features = config.features
        if features.aligned_means and (checked["mean"] % 2.0 ** features.feature_shift[0]).any():
            step = f"2**{features.feature_shift[0]}"
            raise InputError(
                f"{self.source}, array mean: is not a multiple of {step}, which aligned_means requires; "
                "quantise the model again"
            )
        object.__setattr__(self, "arrays", checked)

    @property
    def model_hash(self) -> str:
        """Hash of what its decisions depend on."""
        return model_hash(self.config, self.arrays)

    def with_lanes(self, lanes: int | None = None, lane_type: str | None = None) -> IntegerModel:
        """The same network with other lanes; None keeps the current value."""
        return IntegerModel(self.config.with_lanes(lanes, lane_type), self.arrays, self.source)

    def forward(self, features: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(h' codes (n, K, H), logit codes (n, K, C)), int64, of feature codes (n, K, D)."""
        return self.run(Fixed(self.config), features)

    def run(self, arithmetic: Fixed, features: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """``forward`` in another fixed-point arithmetic of this configuration than `Fixed` itself."""
        hidden, logits = _run(arithmetic, self.config, self.arrays, features)
        return hidden.astype(np.int64), logits.astype(np.int64)

    @classmethod
    def load(cls, folder: str | Path, *, images: bool = False) -> IntegerModel:
        """The integer model in a model folder. A model for images is refused unless ``images`` is True."""
        config, arrays, source = _load(folder, INTEGER_FILE, "quantise the model in it", images)
        return cls(config, arrays, source)

    def save(self, folder: str | Path) -> None:
        """Write config.json and weights.npz into ``folder``, new or a model folder, in one exchange. The folder's
        other files are kept."""

        def write(temporary: Path) -> None:
            for name in (FLOAT_FILE, TRAINING_FILE):
                if (Path(folder) / name).exists():
                    shutil.copyfile(Path(folder) / name, temporary / name)
            _write(temporary, self.config, self)

        replace_folder(folder, write)


def _write(folder: Path, config: AcceleratorConfig, integer: IntegerModel | None) -> None:
    """Write the configuration and, if there is an integer model, its arrays."""
    if integer:
        config = integer.config
        np.savez(folder / INTEGER_FILE, allow_pickle=False, **integer.arrays)
    (folder / CONFIG_FILE).write_text(config.to_json(integer.model_hash if integer else ""))


def _run(arithmetic: Float | Fixed, config: AcceleratorConfig, arrays: Arrays, features: np.ndarray):
    parameters = {name: np.asarray(arrays[name], dtype=np.float64) for name in arrays}
    return run_cell(arithmetic, config, parameters, np.asarray(features, dtype=np.float64))


def _frozen(array: np.ndarray) -> np.ndarray:
    array.flags.writeable = False
    return array


def _take(arrays: Arrays, shapes: dict[str, tuple[int, ...]], source: str, config: AcceleratorConfig):
    """``arrays`` with exactly the names and shapes of ``shapes``, in that order."""
    needed_by = f"configuration '{config.name}' ({config.inputs} inputs, {config.classes} classes)"
    fix = "use weights and config.json of one model"
    for name in [*shapes, *arrays]:
        if name not in arrays:
            raise InputError(f"{source}, array {name}: is missing and {needed_by} needs it; {fix}")
        if name not in shapes:
            raise InputError(f"{source}, array {name}: is unknown to {needed_by}; {fix}")
    for name, shape in shapes.items():
        if arrays[name].shape != shape:
            raise InputError(
                f"{source}, array {name}: has shape {arrays[name].shape} and {needed_by} needs {shape}; {fix}"
            )
    return {name: arrays[name] for name in shapes}


# ---------------------------------------------------------------------- folders
def load_config(folder: str | Path) -> AcceleratorConfig:
    """The configuration of a model folder.

    Raises
    ------
    InputError
        When the folder or its config.json is missing or damaged.
    """
    path = Path(folder) / CONFIG_FILE
    if not path.is_file():
        raise InputError(
            f"model '{folder}': has no {CONFIG_FILE}, so it is not a model folder; name the folder that 'eskin "
            "train' wrote"
        )
    return AcceleratorConfig.load(path)


def _load(
    folder: str | Path, file: str, fix: str, images: bool
) -> tuple[AcceleratorConfig, dict[str, np.ndarray], str]:
    config = load_config(folder)
    if config.is_image and not images:
        raise InputError(
            f"model '{folder}': is a network for images, which this verb does not take; docs/images.md "
            "lists such verbs"
        )
    path = Path(folder) / file
    if not path.is_file():
        raise InputError(f"model '{folder}': has no {file}; {fix}")
    try:
        arrays = read_arrays(path)
    except (OSError, ArchiveError) as error:
        where = f", array {error.member}" if isinstance(error, ArchiveError) and error.member else ""
        raise InputError(f"{path}: is damaged ({error}{where}); {fix} again") from None
    return config, arrays, str(path)


def check_model_target(folder: str | Path) -> None:
    """Refuse a folder that a model must not replace.

    Raises
    ------
    InputError
        When ``folder`` is a file, or a folder that is not empty and not a model folder (config.json and
        nothing but model files).
    """
    folder = Path(folder)
    if not folder.exists():
        return
    if not folder.is_dir():
        raise InputError(f"model '{folder}': is a file; name a new folder")
    names = {entry.name for entry in folder.iterdir()}
    foreign = names - set(MODEL_FILES) or (names if CONFIG_FILE not in names else None)
    if foreign:
        raise InputError(
            f"model '{folder}': holds '{min(foreign)}' and is not a model folder; name a new folder or move that away"
        )


def replace_folder(folder: str | Path, write: Callable[[Path], None], check: Check = lambda: None) -> None:
    """Make a model folder in one exchange: ``write`` fills a temporary folder beside it, which then takes the
    name. check: as for `replacing_folder`.

    Raises
    ------
    InputError
        When ``folder`` may not be replaced (``check_model_target``) or cannot be written.
    """
    folder = Path(folder)
    check_model_target(folder)
    try:
        with replacing_folder(folder, check) as draft:
            write(draft)
    except OSError as error:
        raise InputError(
            f"model '{folder}': cannot be written ({error.strerror}); name a folder you may write to"
        ) from None
