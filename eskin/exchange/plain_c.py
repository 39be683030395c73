"""The integer model as plain C: C99, integers alone, one call a frame, constants in tables.

docs/specification.md, sections 1 to 8 and 15, and docs/specification_interfaces.md, section 10 (faults), a third
time beside golden model and hardware: it takes their tables and formats, and adds up hops, as the hardware does.
`templates` hold the code; this module computes their values.
"""

import math
import textwrap
from collections.abc import Iterable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from eskin.golden.core import (
    EXTREMES,
    PREFIX,
    AcceleratorConfig,
    InputError,
    Pool,
    Record,
    sigmoid_table,
    signed_bits,
    tanh_table,
    template,
)
from eskin.golden.data import Recordings
from eskin.golden.model import ImageTrace, IntegerModel, Trace, completing_frames

HEADER, SOURCE, CHECK, VECTORS = "eskin_model.h", "eskin_model.c", "eskin_check.c", "test_vectors.h"


class Table(NamedTuple):
    """A constant of the program: type, name, size, comment and values in C."""

    kind: str
    name: str
    size: tuple[int, ...]
    comment: str
    values: str


def _word(bits: int) -> str:
    """The narrowest signed type of at least 16 bits."""
    return "int16_t" if bits <= 16 else "int32_t" if bits <= 32 else "int64_t"


def _initialiser(values: np.ndarray) -> str:
    if values.ndim == 1:
        return "\n".join(textwrap.wrap(", ".join(map(str, values.tolist())), 100, initial_indent="    "))
    return ",\n".join(f"{{\n{_initialiser(row)} }}" for row in values)


def _table(name: str, values: Any, comment: str, kind: str = "") -> Table:
    values = np.asarray(values, dtype=np.int64)
    bits = signed_bits(int(np.abs(values).max(initial=0)))
    kind = kind or ("int8_t" if bits <= 8 else _word(bits))
    return Table(kind, name, values.shape, comment, _initialiser(values))


def c_string(text: str) -> str:
    """``text`` as a literal of C, UTF-8, whatever letters it has."""
    plain = lambda byte: 32 <= byte < 127 and chr(byte) not in '"\\?'
    return '"' + "".join(chr(b) if plain(b) else f"\\{b:03o}" for b in text.encode()) + '"'


def _comment(text: str) -> str:
    """``text`` as it may stand in a comment."""
    return text.replace("*/", "* /").replace("/*", "/ *")


# ---------------------------------------------------------------------- networks that read frames
def _frame_tables(model: IntegerModel) -> list[Table]:
    config, arrays = model.config, model.arrays
    formats, lengths = config.formats, len(config.window_lengths)
    weight = "int8_t" if config.weight_bits <= 8 else "int16_t"
    wide = _wide(config)
    mean, scale = (arrays[name].reshape(lengths, config.constants) for name in ("mean", "scale"))
    shift = np.reshape(config.features.feature_shift, (lengths, config.kinds)) + config.mean_frac
    tables = [
        _table("MEAN", mean, "of the normaliser", wide if wide == "int64_t" else "int32_t"),
        _table("SHIFT", shift, "of the normaliser", "uint8_t"),
        _table("SCALE", scale, "of the normaliser", "int16_t"),
    ]
    if lengths > 1 and not config.follows_touch:
        tables.append(_table("LENGTH", config.length_index, "of each window, index into these", "uint8_t"))
    if config.sensor.masked_taxels:
        mask = [taxel in config.sensor.masked_taxels for taxel in range(config.sensor.taxels)]
        tables.append(_table("MASK", mask, "1: the taxel is out of use", "uint8_t"))
    if config.is_forest:
        threshold = "int16_t" if config.threshold_format.width <= 16 else "int32_t"
        return [
            *tables,
            _table("INPUT", arrays["tree_input"], "of a comparison: window * inputs + input", "int32_t"),
            _table("SUBTRAHEND", arrays["subtrahend"], "of a comparison: as INPUT; the same: 0", "int32_t"),
            _table(
                "THRESHOLD", arrays["threshold"], f"{config.threshold_format}, above it side 1", threshold
            ),
            _table("CHILD", arrays["child"], "next node; -1 - class: a vote", "int16_t"),
            _table("VOTE", arrays["vote"], "on the scale of logits", "int8_t"),
        ]
    if config.recurrent:
        stacked = lambda kind: np.concatenate([arrays[f"{kind}_{gate}"] for gate in config.gates])
        order = f"rows of gates {', '.join(config.gates)}"
        tables += [
            _table("W", stacked("W"), f"{formats.weight_format}, {order}", weight),
            _table("U", stacked("U"), f"{formats.recurrent_format}, {order}", weight),
            _table("B", stacked("b"), f"{formats.bias_format}", "int16_t"),
        ]
        if "bh_n" in arrays:
            tables.append(_table("BH", arrays["bh_n"], "inside the reset product", "int16_t"))
        tables += [
            _table(name, np.append(table[len(table) // 2 :], end - table[0]), "index 0 up", "int16_t")
            for name, table, end in (
                ("SIGMOID", sigmoid_table(config), config.gate_one),
                ("TANH", tanh_table(config), 0),
            )
        ]
    return [
        *tables,
        _table("V", arrays["V"], f"{formats.dense_format}", weight),
        _table("BY", arrays["b_y"], f"{formats.dense_bias_format}", "int16_t"),
    ]


def _wide(config: AcceleratorConfig) -> str:
    """The type of what a window gives."""
    frames, block = config.windows.window, config.features.activity_block
    if config.follows_touch:  # the most sums of a window, before their shift
        frames = config.windows.store_per_window * config.windows.hop << config.doublings
    bounds = [frames * config.deviation_bound, frames // block * config.block_bound]
    if "integral" in config.features.feature_kinds:
        bounds.append(config.integral_bound)
    # one bit to spare: a mean is taken off
    return "int64_t" if max(config.sum_bits, *map(signed_bits, bounds)) + config.mean_frac > 31 else "int32_t"


def _frame_values(config: AcceleratorConfig) -> Record:
    """Values of the templates beside the configuration (``c``) and its fields.

    hop_sums: sums that are added up hop by hop, ``depth`` hops of it. total, extremes: of a touch so far. hop_extremes: the
    latter hop by hop, too. of_touch: names of a touch's values, and of a hop's values that they begin with. ring: frames of
    deviations that are held. moves: activity is of changes. checks: blocks of the mean that the onset rule judges. The rest are
    types and terms.
    """
    rule, windows, kinds = config.onset_rule, config.windows, config.features.feature_kinds
    faults, touch_mode = config.faults.fault_frames, windows.window_mode == "touch"
    integral, activity, follows = "integral" in kinds, "activity" in kinds, config.follows_touch
    ring = windows.pretrigger_frames + 1 if touch_mode and not config.opens_at_once else 1
    ends = [last for _, last in config.window_spans]
    depth = max((end - 1) // windows.hop - k + 1 for k, end in enumerate(ends)) if touch_mode else 2
    depth = config.stored_sums if follows else depth
    early = not touch_mode and not config.opens_at_once  # frames before the gate opens count
    extremes = [kind for kind in EXTREMES if kind in kinds]
    mean_needed = "mean" in kinds or (integral and (early or follows))
    masked, limit = bool(config.sensor.masked_taxels), rule.onset_threshold * rule.onset_mean_frames
    flagged = f"s->flag_age[i]{' > (uint16_t)back' if ring > 1 else ''}"
    counts = [*["!MASK[i]"] * masked, *["!s->flag_age[i]"] * bool(faults)]
    return {
        "worth": np.broadcast_to(config.sensor.volt_per_code, config.sensor.taxels).tolist(),
        "hop_sums": [*["mean"] * mean_needed, *["activity"] * activity],
        "integral": integral,
        "total": integral and not follows,
        "extremes": extremes,
        "hop_extremes": early or follows,
        "of_touch": [*[("total", "mean")] * integral, *((kind, f"{kind}_of") for kind in extremes)],
        "follows": follows,
        "activity": activity,
        "moves": activity and config.features.activity_rule == "change",
        "block_sums": activity and config.features.activity_block > 1,
        "depth": depth,
        "ring": ring,
        "replay_faults": bool(faults) and ring > 1,
        "out_of_use": " || ".join([*["MASK[i]"] * masked, *[flagged] * bool(faults)]),
        "counts": "".join(f" && {term}" for term in counts),
        "checks": rule.onset_mean_frames // max(rule.onset_check_frames, 1),
        "onset_limit": f"{limit}{'LL' if limit >> 31 else ''}",
        "acc": _word(max(config.accumulator_bits, 32)),
        "weight": "int8_t" if config.weight_bits <= 8 else "int16_t",
        "wide": _wide(config),
        "deviation": _word(config.deviation_bits),
        "level": _word(max(32, signed_bits(rule.onset_mean_frames * config.deviation_bound))),
    }


# ---------------------------------------------------------------------- networks for images
def _image_tables(model: IntegerModel) -> list[Table]:
    tables = []
    for stage in model.config.weighted_stages:
        weights, bias = (model.arrays[f"{name}_{stage.number}"] for name in "Wb")
        tables += [
            _table(f"W_{stage.number}", weights.ravel(), f"{stage.layer}, output by output", "int8_t"),
            _table(f"B_{stage.number}", bias, "its biases", "int32_t"),
        ]
    return tables


def _image_values(config: AcceleratorConfig) -> Record:
    """Values of the templates of images: a row (stage, shift, 2 where a pool follows, else 1) a layer with weights, and
    the sizes of the two maps that layers give in turn."""
    sizes, rows = [0, 0], []
    for index, (stage, shift) in enumerate(zip(config.weighted_stages, config.layer_shifts, strict=True)):
        following = stage if stage.last else config.stages[stage.number + 1]
        pool = isinstance(following.layer, Pool)
        if not stage.last:
            result = following.result if pool else stage.result
            sizes[index % 2] = max(sizes[index % 2], int(np.prod(result)))
        rows.append((stage, shift, 1 + pool))
    return {"layers": ", ".join(config.image.layers), "rows": rows, "maps": sizes, "acc": "int32_t"}


def constant_bytes(model: IntegerModel) -> int:
    """Bytes of all tables."""
    tables = _image_tables(model) if model.config.is_image else _frame_tables(model)
    bits = {"int8_t": 8, "uint8_t": 8, "int16_t": 16, "int32_t": 32, "int64_t": 64}
    return sum(bits[table.kind] // 8 * math.prod(table.size) for table in tables)


# ---------------------------------------------------------------------- files
def sources(model: IntegerModel, prefix: str = PREFIX) -> dict[str, str]:
    """``eskin_model.h`` and ``eskin_model.c``, library.properties of Arduino and module.yml of Zephyr with
    what it names: text by path. Their names and everything that they declare begin with ``prefix``.

    Raises
    ------
    InputError
        The model's readout is not the dense one.
    """
    config = model.config
    if config.has_prototypes:
        raise InputError(
            f"configuration '{config.name}', field readout: is 'prototypes', which C does not have; export a "
            "model with readout 'dense'"
        )
    image = config.is_image
    tables = _image_tables(model) if image else _frame_tables(model)
    values: Record = _image_values(config) if image else _frame_values(config)
    values = (
        config.fields()
        | values
        | {
            "name": _comment(config.name),
            "c": config,
            "model_hash": model.model_hash,
            "image": image,
            "classes": config.classes,
            "names": ", ".join(map(c_string, config.network.class_names)),
            "vote": config.network.decision == "vote",
            "tables": tables,
            "version": version("eskin"),
        }
    )
    paths = (HEADER, SOURCE, "library.properties", "zephyr/module.yml", "zephyr/CMakeLists.txt")
    return _rendered(paths, values, prefix)


def _brackets(size: Iterable[int]) -> str:
    return "".join(f"[{length or 1}]" for length in size)  # C has no array of no elements


def _rendered(paths: Iterable[str], values: Record, prefix: str) -> dict[str, str]:
    """The files, each from the template of its name."""
    fill = lambda path: template(__file__, Path(path).name, prefix, brackets=_brackets).render(values)
    return {path.replace(f"{PREFIX}_", f"{prefix}_"): fill(path) for path in paths}


def expected(trace: Trace, recordings: Recordings) -> list[list[tuple[int, ...]]]:
    """Expected results of each recording, for every call with a result: (frame, 1-based, 0 for
    eskin_finish; return value; cls; margin; step; local_cls)."""
    rows, offsets = trace.streams["decision"]
    frames, calls = completing_frames(trace), []
    for first, last, length in zip(offsets, offsets[1:], recordings.lengths, strict=False):
        of_recording: dict[int, tuple[int, ...]] = {}
        latest = -1
        for (is_global, step, label, margin, *_), frame in zip(
            rows[first:last], frames[first:last], strict=True
        ):
            frame = trace.config.sensor.source_frame(int(frame))
            flags, *before = of_recording.get(frame, (0, 0, 0, 0, 0))
            latest = latest if is_global else int(label)
            row = before[:3] if flags & 2 else (int(label), int(margin), int(step))
            of_recording[frame] = (flags | 1 + int(is_global), *row, latest)
        calls.append(
            [
                (frame, *call)
                for frame, call in sorted(of_recording.items(), key=lambda item: item[0] or length + 1)
            ]
        )
    return calls


def expected_of_images(trace: ImageTrace) -> list[list[tuple[int, ...]]]:
    """As `expected`, of images."""
    return [
        [(0, 3, int(label), int(margin), 0, int(label))]
        for label, margin in zip(trace.decision, trace.margin, strict=True)
    ]


def check_sources(
    config: AcceleratorConfig,
    samples: np.ndarray,
    lengths: Sequence[int],
    calls: Sequence[Sequence[tuple[int, ...]]],
    prefix: str = PREFIX,
) -> dict[str, str]:
    """``eskin_check.c``, whose ``main`` plays recordings and compares what comes, and its ``test_vectors.h``.

    Parameters
    ----------
    samples:
        (frames, taxels) of all recordings, or pixels (rows, width).
    lengths:
        Frames of each recording.
    calls:
        Of `expected`.
    prefix:
        Of `sources`.
    """
    kind = "uint8_t" if config.is_image else "int32_t"
    rows = [(number, *call) for number, of_recording in enumerate(calls) for call in of_recording]
    values = {
        "image": config.is_image,
        "recordings": len(lengths),
        "codes": _table("CODES", samples, "frames, one recording after the other", kind),
        "lengths": _table("LENGTHS", lengths, "frames of each recording", "int32_t"),
        "calls": _table(
            "CALLS",
            np.reshape(rows, (-1, 7)),
            "recording, frame (0: the end), returned, cls, margin, step, local_cls",
            "int32_t",
        ),
    }
    return _rendered((CHECK, VECTORS), values, prefix)
