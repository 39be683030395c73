"""Models: the trained float network and the integer one, each a configuration and named arrays, kept together
in a model folder.

A model folder holds ``config.json``, ``float.npz`` (float network), ``training.json`` (how it came about)
and, once quantised, ``weights.npz`` (integer network, docs/specification.md section 8).
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from eskin.golden.core import (
    AcceleratorConfig,
    ArchiveError,
    Arrays,
    InputError,
    QFormat,
    Record,
    content_key,
    read_arrays,
    replacing_folder,
)
from eskin.golden.core.images import BIAS_BITS
from eskin.golden.model.cells import Fixed, Float, run_cell
from eskin.golden.model.preprocess import companded

CONFIG_FILE = "config.json"
FLOAT_FILE = "float.npz"
INTEGER_FILE = "weights.npz"
TRAINING_FILE = "training.json"
SCALE_ROOM = 2
"""Bits by which a shift may be smaller than the loudest taxel requires. A centred feature still fits, and the
quietest taxel may have a scale four times as small.
"""
MODEL_FILES = (CONFIG_FILE, FLOAT_FILE, INTEGER_FILE, TRAINING_FILE)

Files = Mapping[str, bytes]
"""Files of a model folder, name -> content."""


# ---------------------------------------------------------------------- names, shapes, formats
def network_shapes(config: AcceleratorConfig, *, real: bool) -> dict[str, tuple[int, ...]]:
    """Shapes of the network's arrays by name; ``real`` adds torch's second bias rows of a float reset-after
    GRU."""
    h, d, c = config.network.hidden, config.inputs, config.classes
    if config.is_image:
        of_stage = {f"W_{stage.number}": stage.weight_shape for stage in config.weighted_stages}
        return of_stage | {f"b_{stage.number}": (stage.outputs,) for stage in config.weighted_stages}
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
    """Shapes of the readout's arrays by name, none where logits decide: ``prototypes`` and ``taught`` (class,
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
    """mu or sigma for each input, (..., inputs), or as it is where it serves all."""
    return constants[..., list(config.input_constants)] if config.constants > 1 else constants


# ---------------------------------------------------------------------- the two models
@dataclass(frozen=True)
class FloatModel:
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
                    f"{self.source}, array {name}: holds values that are no finite numbers; train the model "
                    "again"
                )
            checked[name] = _frozen(np.array(array, dtype=np.float64))
        if "sigma" in checked and (checked["sigma"] <= 0).any():
            raise InputError(
                f"{self.source}, array sigma: is {checked['sigma'].min()}; it must be above 0: train the "
                "model again"
            )
        object.__setattr__(self, "arrays", checked)

    @property
    def parameter_count(self) -> int:
        """Trainable parameters; of images with those of the batch norm, which is folded in."""
        if self.config.is_image:
            return self.config.parameter_count
        return sum(self.arrays[name].size for name in network_shapes(self.config, real=True))

    @property
    def content(self) -> str:
        """Hash of everything that a result can depend on."""
        return _content(self)

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
        training: Mapping[str, Any],
        integer: IntegerModel | None = None,
        unchanged: Files | None = None,
    ) -> None:
        """Make ``folder`` (new, or a model folder, which is replaced) of config.json, float.npz, training.json
        and, of its integer model, weights.npz, in one exchange.

        unchanged: refuse where the folder's files are no longer these (`model_files`).
        """

        def write(temporary: Path) -> None:
            np.savez(temporary / FLOAT_FILE, allow_pickle=False, **self.arrays)
            _write(temporary, self.config, integer, training)

        replace_folder(folder, write, unchanged)

    @classmethod
    def load(cls, folder: str | Path, *, images: bool = False) -> FloatModel:
        """The float model in a model folder; one of images is refused unless ``images`` says that the caller
        takes those."""
        config, arrays, source = _load(folder, FLOAT_FILE, "train a model into it", images)
        return cls(config, arrays, source)


@dataclass(frozen=True)
class IntegerModel:
    """The integer network, with which the hardware computes.

    config: with every format and ``feature_shift`` filled. arrays: int64 codes by the names of
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
        aligned = max(config.features.feature_shift[0], 0) if config.features.aligned_means else 0
        if aligned and (checked["mean"] % (1 << aligned)).any():
            step = f"2**{aligned}"
            raise InputError(
                f"{self.source}, array mean: is no multiple of {step}, which aligned_means requires; "
                "quantise the model again"
            )
        object.__setattr__(self, "arrays", checked)

    @property
    def content(self) -> str:
        """Hash of everything that a result can depend on."""
        return _content(self)

    def with_lanes(self, lanes: int | None = None, lane_type: str | None = None) -> IntegerModel:
        """The same network with other lanes; None keeps the current value."""
        return IntegerModel(self.config.with_lanes(lanes, lane_type), self.arrays, self.source)

    def forward(self, features: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(h' codes (n, K, H), logit codes (n, K, C)), int64, of feature codes (n, K, D)."""
        return self.run(Fixed(self.config), features)

    def run(self, arithmetic: Fixed, features: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """``forward`` in a fixed-point arithmetic of this configuration that is not the plain one."""
        hidden, logits = _run(arithmetic, self.config, self.arrays, features)
        return hidden.astype(np.int64), logits.astype(np.int64)

    def logits_of(self, variants: Arrays, features: np.ndarray) -> np.ndarray:
        """Logit codes (variants, n, K, C), int64: the network once for each variant of its arrays, name ->
        (variants, *shape); arrays without a variant stay. The codes are not checked against their formats."""
        count = len(next(iter(variants.values())))
        names = network_shapes(self.config, real=False)
        arrays = {
            name: np.broadcast_to(self.arrays[name], (count, *self.arrays[name].shape)) for name in names
        } | dict(variants)
        return _run(Fixed(self.config), self.config, arrays, features)[1].astype(np.int64)

    @classmethod
    def load(cls, folder: str | Path, *, images: bool = False) -> IntegerModel:
        """The integer model in a model folder; one of images is refused unless ``images`` says that the
        caller takes those."""
        config, arrays, source = _load(folder, INTEGER_FILE, "quantise the model in it", images)
        return cls(config, arrays, source)

    def save(
        self, folder: str | Path, *, training: Mapping[str, Any] | None = None, unchanged: Files | None = None
    ) -> None:
        """Write config.json, weights.npz and, when given, a new training record into ``folder``, new or a
        model folder, in one exchange.

        The folder's other files are kept. unchanged: refuse where its files are no longer these
        (`model_files`).
        """

        def write(temporary: Path) -> None:
            for name in (FLOAT_FILE, TRAINING_FILE):
                if (Path(folder) / name).exists():
                    shutil.copyfile(Path(folder) / name, temporary / name)
            _write(temporary, self.config, self, training)

        replace_folder(folder, write, unchanged)


def _write(
    folder: Path, config: AcceleratorConfig, integer: IntegerModel | None, training: Mapping[str, Any] | None
) -> None:
    """The configuration, and the integers and training record that exist."""
    if integer is not None:
        config = integer.config
        np.savez(folder / INTEGER_FILE, allow_pickle=False, **integer.arrays)
    (folder / CONFIG_FILE).write_text(config.to_json())
    if training is not None:
        (folder / TRAINING_FILE).write_text(json.dumps(training, indent=1) + "\n")


def _run(arithmetic: Float | Fixed, config: AcceleratorConfig, arrays: Arrays, features: np.ndarray):
    parameters = {name: np.asarray(arrays[name], dtype=np.float64) for name in arrays}
    return run_cell(arithmetic, config, parameters, np.asarray(features, dtype=np.float64))


def _content(model: FloatModel | IntegerModel) -> str:
    return content_key(
        model.config.to_dict(),
        *(part for name in sorted(model.arrays) for part in (name, model.arrays[name])),
    )


def _frozen(array: np.ndarray) -> np.ndarray:
    array.flags.writeable = False
    return array


def _take(arrays: Arrays, shapes: dict[str, tuple[int, ...]], source: str, config: AcceleratorConfig):
    """``arrays`` with exactly the names and shapes of ``shapes``, in that order."""
    cell = (
        f"{config.network.cell} {config.network.hidden}"
        if config.recurrent
        else f"linear, weights of {config.sets} windows"
    )
    if config.is_image:
        cell = ", ".join(config.image.layers)
    needed_by = f"configuration '{config.name}' ({cell}, {config.inputs} inputs, {config.classes} classes)"
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
            f"model '{folder}': has no {CONFIG_FILE}, so it is no model folder; name the folder that 'eskin "
            "train' wrote"
        )
    return AcceleratorConfig.load(path)


def load_training(folder: str | Path) -> Record:
    """The training record of a model folder; empty when it has none.

    Raises
    ------
    InputError
        When the file is damaged.
    """
    path = Path(folder) / TRAINING_FILE
    if not path.exists():
        return {}
    if not path.is_file():
        raise InputError(f"{path}: is no regular file; train the model again")
    try:
        record = json.loads(path.read_text())
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: is damaged ({error}); train the model again") from None
    if not isinstance(record, dict):
        raise InputError(f"{path}: holds no JSON object; train the model again")
    return record


def _load(
    folder: str | Path, file: str, fix: str, images: bool
) -> tuple[AcceleratorConfig, dict[str, np.ndarray], str]:
    config = load_config(folder)
    if config.is_image and not images:
        raise InputError(
            f"model '{folder}': is a network for images, which this verb does not take; docs/images.md "
            "lists those that do"
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
    foreign = sorted(names - set(MODEL_FILES))
    if foreign:
        raise InputError(
            f"model '{folder}': holds '{foreign[0]}', which is no part of a model; name a new folder or "
            "move that away"
        )
    if names and CONFIG_FILE not in names:
        raise InputError(
            f"model '{folder}': is not empty and has no {CONFIG_FILE}, so it is no model folder; name a new "
            "folder"
        )


def model_files(folder: str | Path) -> Files:
    """Content of a model folder, name -> content."""
    paths = (Path(folder) / name for name in MODEL_FILES)
    return {path.name: path.read_bytes() for path in paths if path.is_file()}


def replace_folder(folder: str | Path, write: Callable[[Path], None], unchanged: Files | None = None) -> None:
    """Make a model folder in one exchange: ``write`` fills a temporary folder beside it, which then takes the
    name. ``unchanged``: only where the folder's files are still these (`model_files`).

    Raises
    ------
    InputError
        When ``folder`` may not be replaced (``check_model_target``) or cannot be written, or was changed.
    """
    folder = Path(folder)
    check_model_target(folder)

    def check() -> None:
        if unchanged is not None and model_files(folder) != unchanged:
            raise InputError(
                f"model '{folder}': was changed by another program in the meantime and was not overwritten; run the command again"
            )

    try:
        with replacing_folder(folder, check) as fresh:
            write(fresh)
    except OSError as error:
        raise InputError(
            f"model '{folder}': cannot be written ({error.strerror}); name a folder you may write to"
        ) from None


# ---------------------------------------------------------------------- constants and random models
def normaliser_constants(
    config: AcceleratorConfig, mu: float | np.ndarray, sigma: float | np.ndarray, *, aligned: bool = False
) -> tuple[AcceleratorConfig, np.ndarray, np.ndarray]:
    """Integer constants of feature = (d / unit - mu) / sigma, for every distinct window length.

    unit: ``config.feature_unit``; d: the sum, or what else a window gives, companded where it is. mu, sigma:
    scalars or (constants). The feature code is ``(d - unit mu) * ratio`` with ``ratio = 2**feature_frac /
    (unit sigma)``. The shift, one for each length and kind, drops as many bits as leave ``scale = ratio
    2**(shift + gate_frac)`` in 2**(gate_frac-2)..2**(gate_frac-1): centred then resolves one to two bits more
    than the feature, and a full-scale feature takes at most 2 bits more than the feature's width. With a
    scale a taxel that holds for the taxel that moves most, and the shift is up to SCALE_ROOM smaller where
    the quietest one's scale would not fit 16 bits. Half of 2**shift is taken off the mean, which turns the
    floor of the declared narrowing into a rounding. At shift 0 scale may be larger; only where it would not
    fit 16 bits even so, a shift goes below 0 (``mean_frac``): sums of few levels, which features must
    resolve. ``aligned``: the largest window's for all, which hardware need not choose, and means that end in
    as many zeros (``aligned_means``); only where one pair serves all inputs.

    Returns
    -------
    (config with feature_shift, mean, scale), the arrays int64, (lengths) or (lengths, constants).

    Raises
    ------
    InputError
        When sigma is so small that scale exceeds 16 bits at the lowest shift.
    """
    shifts, means, scales = [], [], []
    lengths, many = len(config.window_lengths), config.constants
    mu, sigma = (np.broadcast_to(np.asarray(value, dtype=np.float64), (many,)) for value in (mu, sigma))
    kind_of = np.arange(many) % config.kinds  # a constant a kind, or a constant an input
    units = np.array(config.feature_units).reshape(lengths, config.kinds)
    unit_code = 2.0**config.formats.feature_format.frac_bits
    # 2: a full-scale centred feature has up to two bits more than the feature
    spare = max(config.formats.feature_format.width + 2 - config.centred_format.width, 0)
    for row in units:
        ratio = unit_code / (row[kind_of] * sigma)
        for kind in range(config.kinds):
            of_kind = unit_code / (units * sigma[0]).ravel() if aligned else ratio[kind_of == kind]
            # the least shift at which ratio 2**shift of the loudest input is 1/4 or more
            shift = min(max(0, int(np.ceil(np.log2(0.25 / of_kind.min()))) + spare), config.sum_bits)
            room = SCALE_ROOM if config.features.feature_scale == "taxel" else 0
            lowest = max(shift - room, -config.most_mean_frac) if shift else -config.most_mean_frac
            while (
                shift > lowest
                and np.rint(of_kind.max() * 2.0 ** (shift + config.formats.gate_frac))
                > config.scale_format.max_code
            ):
                shift -= 1
            shifts.append(shift)
    filled = config.replace(feature_shift=tuple(shifts), aligned_means=aligned)
    frac = filled.mean_frac
    for q, length in enumerate(config.window_lengths):
        unit = units[q, kind_of]
        ratio = unit_code / (unit * sigma)
        by = np.array(shifts[q * config.kinds :][: config.kinds])[kind_of]
        scale = np.rint(ratio * 2.0 ** (by + config.formats.gate_frac))
        largest = config.scale_format.max_code
        if scale.max() > largest or scale.min() < 1:
            worst = int(np.argmax(scale)) if scale.max() > largest else int(np.argmin(scale))
            raise InputError(
                f"configuration '{config.name}', field feature_format: {config.formats.feature_format} "
                f"needs a scale of {scale[worst]:.0f} for windows of {length} frames with a spread of "
                f"{sigma[worst]:.3g} codes, outside 1..{largest}; use fewer feature bits"
            )
        step, half = (1 << by + frac) if aligned else np.ones_like(by), (1 << by + frac) >> 1
        middle = mu * unit * 2.0**frac
        means.append(np.rint((middle - half) / step) * step if aligned else np.rint(middle) - half)
        scales.append(scale)
    shape = (lengths, *constants_shape(config))
    mean = QFormat(filled.mean_format.width, 0).quantise(np.array(means)).reshape(shape)
    return filled, mean, np.array(scales).astype(np.int64).reshape(shape)


def random_integer_model(config: AcceleratorConfig, seed: int) -> IntegerModel:
    """A model with random weights, for tests: as a trained one, or (one array in four) spread over the whole
    format; biases are not 0.

    Mean and scale suit the signals that the configuration's front end lets through; feature_shift is filled
    when empty.
    """
    rng, rule, features = np.random.default_rng(seed), config.onset_rule, config.features
    banded = rule.onset == "band"
    spread = (rule.band_high - rule.band_low) / 2 if banded else float(rule.onset_threshold)
    level = (rule.band_low + rule.band_high) / 2 if config.rest_level.rest == "none" else 0.0
    mu: Any = level + spread * rng.uniform(-0.2, 0.2)
    few_levels = config.sensor.sample_bits <= 2
    sigma: Any = max(spread, 0.5 if few_levels else 8.0) * float(np.exp(rng.uniform(-0.7, 0.7)))
    if features.compand == "log":  # of a whole window
        knee, frac = features.compand_knee, features.compand_frac
        mu, sigma = (_logarithm(value * config.windows.window, knee, frac) for value in (mu, sigma))
    if config.constants > 1 or features.feature_kinds != ("mean",) or few_levels:
        mu, sigma = _random_scaling(config, rng, mu, sigma)
    filled, mean, scale = normaliser_constants(config, mu, sigma)
    if config.features.feature_shift:
        filled = config
    arrays: dict[str, np.ndarray] = {"mean": mean, "scale": scale}
    for name, shape in network_shapes(config, real=False).items():
        fmt = network_formats(config)[name]
        if rng.random() < 0.25:
            arrays[name] = rng.integers(fmt.min_code, fmt.max_code, shape, endpoint=True)
        else:
            deviation = 0.5 if name.startswith("b") else 1.5 * shape[-1] ** -0.5
            arrays[name] = fmt.quantise(rng.normal(0.0, deviation, shape))
        if name.startswith("b"):
            # a bias of 0 would hide a bias that the hardware forgets
            arrays[name] = np.where(arrays[name] == 0, 1, arrays[name])
    for name, shape in readout_shapes(config).items():
        ends = (
            (0, 2 * config.readout_rule.taught - 1)
            if name == "taught_count"
            else (config.state_code_format.min_code, config.state_code_format.max_code)
        )
        arrays[name] = rng.integers(*ends, shape, endpoint=True)
    return IntegerModel(filled, arrays, f"random model {seed}")


def _logarithm(value: float, knee: int, frac: int) -> float:
    return companded(np.array([round(value)]), knee, frac)[0] / 2.0**frac


def _random_scaling(
    config: AcceleratorConfig, rng: np.random.Generator, mu: float, sigma: float
) -> tuple[np.ndarray, np.ndarray]:
    """Constants a kind or an input about those of the mean, each a little different."""
    features, count, frac = config.features, config.constants, config.formats.feature_format.frac_bits
    moved = sigma * features.activity_block**0.5
    of_kind = {
        "mean": (mu, sigma),
        "activity": (mu, sigma) if features.compand == "log" else (moved, moved),
        "integral": tuple(
            _logarithm(abs(value) * config.last_frame / 2, features.integral_knee, features.integral_frac)
            for value in (mu, sigma)
        ),
    }
    kinds = np.resize(features.feature_kinds, count)
    middle, spread = np.array([of_kind[kind] for kind in kinds]).T
    means = middle + spread * rng.uniform(-0.2, 0.2, count)
    sigmas = np.maximum(spread, np.where(kinds == "integral", 0.25, 1.0)) * rng.uniform(0.5, 1.0, count)
    # no finer features than a 16-bit scale can make of the window's value
    units = np.array(config.feature_units).reshape(-1, config.kinds).min(axis=0)
    fractions = config.most_mean_frac if config.sensor.sample_bits <= 2 else 0
    finest = 2.0 ** (frac + config.formats.gate_frac - fractions) / config.scale_format.max_code
    sigmas = np.maximum(sigmas, 1.01 * finest / np.resize(units, count))
    return (means, sigmas) if count > 1 else (means[0], sigmas[0])


def with_network(
    config: AcceleratorConfig,
    *,
    cell: str | None = None,
    reset: str | None = None,
    hidden: int | None = None,
    steps: int | None = None,
) -> AcceleratorConfig:
    """``config`` with another cell, reset, hidden size or number of steps; formats and feature_shift return
    to the initial ones of the cell.

    A thesis-mode configuration keeps its touch length: hop = floor(touch_frames / steps), window = 2 hop + 1.
    A linear cell decides by its last step, which has seen every window, where the configuration counted
    votes.

    Raises
    ------
    InputError
        For a linear cell with hidden units or a reset gate.
    """
    if (cell or config.network.cell) == "linear":
        for field, value in (("hidden", hidden), ("reset", reset)):
            if value is not None:
                raise InputError(
                    f"configuration '{config.name}', field {field}: is {value} and a linear cell has none; "
                    "leave it out"
                )
    fields = {"cell": cell, "reset": reset, "hidden": hidden}
    changes: Record = {field: value for field, value in fields.items() if value is not None}
    if steps is not None and steps != config.windows.steps:
        changes |= {"steps": steps, "feature_shift": ()}
        if config.windows.window_mode == "touch" and steps > 0:
            hop = config.windows.touch_frames // steps
            changes |= {"hop": hop, "window": 2 * hop + 1}
    if cell == "linear" and config.network.decision == "vote":
        changes["decision"] = "last"
    changed = config.replace(**changes)
    if not changed.recurrent:
        return changed
    # an LSTM's cell state and a reset-after row are not held within +-1 as h is
    wide = changed.network.cell == "lstm" or changed.network.reset == "after"
    integer_bits = 4 if wide else 2
    if (cell or reset) and changed.formats.state_format.int_bits != integer_bits:
        changed = changed.replace(state_format=QFormat(integer_bits, changed.formats.state_format.frac_bits))
    return changed


def describe_formats(config: AcceleratorConfig) -> dict[str, str]:
    """Every number format that the configured cell has, by signal, printed, for reports."""
    if config.is_image:
        outputs = (*config.image.map_formats, config.formats.logit_format)
        stages = zip(
            config.weighted_stages, config.image.weight_formats, outputs, config.layer_shifts, strict=True
        )
        return {
            f"{stage.number} {stage.layer}": f"weights {weight}, gives {behind}, shift {shift}"
            for stage, weight, behind, shift in stages
        }
    linear = ("feature_format", "dense_format", "dense_bias_format", "logit_format")
    names = [name for name in config.fields() if name.endswith("_format")]
    names = names if config.recurrent else [name for name in names if name in linear]
    return {name.removesuffix("_format"): str(config.value(name)) for name in names}
