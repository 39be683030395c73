"""Samples as codes: integers are kept, real samples are scaled, and the scale is reported and stored."""

import math
from collections.abc import Sequence

import numpy as np

from eskin.golden.core import InputError, QFormat

HEADROOM = 2.0
"""Factor by which later recordings may exceed the largest value of those that choose the scale."""
MOST_CLIPPED = 0.01
"""Largest share of a taxel's samples that a requested scale may clip."""
UNEVEN = 8.0
"""Largest ratio of the ranges of kinds of columns that one scale serves; beyond it each kind needs a
separate scale."""
APART, NOISE, MOST_DEAD = 32.0, 16.0, 1 / 3
"""Of columns without names that tell their kind: largest ratio of the ranges within a kind, up to which one scale leaves
the smallest 500 codes; highest range of noise in medians of its steps; highest share of dead taxels."""
Worth = float | tuple[float, ...]
"""Value of one code: one for all taxels, or one for each."""
FEW_CODES = 16
"""A taxel that moves by fewer codes, from its 1 % to its 99 % quantile, has lost its signal to the scale."""


def place_of(bad: np.ndarray) -> tuple[int, int]:
    """(row, column) of the first True of a table."""
    row, column = np.argwhere(bad)[0]
    return int(row), int(column)


def round_step(largest: float, top: int) -> float:
    """The smallest of 1, 2 and 5 times a power of ten that scales ``largest`` to at most ``top`` codes."""
    # 1e-12: a step that is exact but for the last bits is not passed over; .6g drops those bits again
    exact = largest / top
    power = 10.0 ** math.floor(math.log10(exact))
    return float(
        f"{next(factor for factor in (1, 2, 5, 10) if factor * power >= exact * (1 - 1e-12)) * power:.6g}"
    )


def called(taxels: Sequence[int] | np.ndarray, names: Sequence[str] = ()) -> str:
    """Text that lists taxels by their names or, without names, by their numbers from 0."""
    words = [names[taxel] if len(names) else str(taxel) for taxel in taxels]
    listed = ", ".join(words[:8]) + (f" and {len(words) - 8} more" if len(words) > 8 else "")
    return f"taxel{'s' if len(words) > 1 else ''} {listed}"


def clipped_to(codes: np.ndarray, fmt: QFormat, names: Sequence[str] = ()) -> tuple[np.ndarray, list[str]]:
    """(share of each taxel's codes outside of a format, a sentence about these codes if there are any)."""
    outside = ((codes < fmt.min_code) | (codes > fmt.max_code)).mean(axis=0)
    if not outside.any():
        return outside, []
    which, share = called(np.flatnonzero(outside), names), float(outside.mean())
    span = f"{fmt.min_code}..{fmt.max_code}"
    return outside, [f"{share:.2g} of the samples lie beyond {span} and were held at its ends: {which}"]


def in_words(worth: Worth) -> str:
    """Value of one code in words; for taxels of several kinds the smallest and the largest."""
    return " to ".join(f"{value:.6g}" for value in sorted({float(np.min(worth)), float(np.max(worth))}))


def scale_a_kind(values: np.ndarray, kinds: Sequence[str | int], top: int) -> tuple[float, ...] | None:
    """A scale for each column, equal for columns of one kind. None if all columns are of one kind, or if the
    largest values of the kinds differ by a factor of UNEVEN at most. Without kinds they are told by their ranges."""
    largest = np.abs(values).max(axis=0)
    kinds = kinds or _kinds_by_range(values, largest)
    of_kind = {kind: max(largest[[kind == other for other in kinds]]) for kind in kinds}
    moving = [value for value in of_kind.values() if value > 1e-300]
    if len(moving) < 2 or max(moving) <= UNEVEN * min(moving):
        return None
    return tuple(round_step(HEADROOM * (of_kind[kind] or max(moving)), top) for kind in kinds)


def _kinds_by_range(values: np.ndarray, largest: np.ndarray) -> list[int]:
    """Kinds of columns that nothing names, by their largest values: below the APART-th of a kind's largest begins another.
    Columns of noise alone, MOST_DEAD of all at most, are dead taxels, of the kind above them."""
    kinds, below = np.zeros(len(largest), dtype=int), largest < largest.max() / APART
    while below.any():
        kinds[~below] += 1
        below = largest < largest[below].max() / APART
    steps = np.abs(np.diff(values[:100_000], axis=0, prepend=values[:1]))
    noise = np.ptp(values, axis=0) <= NOISE * np.median(steps, axis=0)
    for kind in range(kinds.max()):
        if noise[kinds == kind].all() and (kinds == kind).mean() <= MOST_DEAD:
            kinds[kinds == kind] = kind + 1
    return kinds.tolist()


def to_codes(
    values: np.ndarray,
    source: str,
    scale: Worth | None = None,
    *,
    names: Sequence[str] = (),
    kinds: Sequence[str] = (),
    requested: bool = False,
) -> tuple[np.ndarray, Worth, list[str]]:
    """Finite real samples as codes ``rint(value / scale)``.

    Parameters
    ----------
    values:
        (frames, taxels), finite.
    source:
        Name of the samples in messages.
    scale:
        Value of one code, one for all taxels or one for each; None: whole numbers of at most 16 bits are
        codes already, others get a scale with room for twice their range.
    names:
        Names of the taxels, for messages; none: their numbers.
    kinds:
        Kinds of the taxels; each kind gets a separate scale if the kinds need it (`scale_a_kind`).
    requested:
        The user requested this scale: it is refused if it clips more than MOST_CLIPPED of a taxel's samples.

    Returns
    -------
    (codes int32, value of one code (0: the values were codes), sentences about it)

    Raises
    ------
    InputError
        The scale is not a positive number, or all values are 0.
    """
    if scale is not None and not (np.isfinite(scale).all() and np.greater(scale, 0).all()):
        raise InputError(f"{source}: a scale of {scale} makes no codes; give the value of one code, above 0")
    low, high = float(values.min()), float(values.max())
    if scale is not None and not math.isfinite(max(-low, high) / float(np.min(scale))):
        raise InputError(
            f"{source}: a scale of {scale} makes infinite codes of samples up to {max(-low, high):.6g}; "
            "give a larger one"
        )
    if max(-low, high) > 1e300:
        raise InputError(
            f"{source}: samples run from {low:.6g} to {high:.6g}, too far for any scale; give them in "
            "another unit"
        )
    whole = values.dtype.kind in "iu" or np.array_equal(values, np.rint(values))
    if scale is None and whole and low >= -32768 and high <= (32767 if low < 0 else 65535):
        return values.astype(np.int32), 0.0, ["samples are whole numbers and were taken as codes"]
    bounds = QFormat(16, 0, signed=low < 0)
    largest = max(abs(low), abs(high))
    origin = "as asked for"
    if scale is None:
        if largest < 1e-300:
            raise InputError(f"{source}: every sample is 0; nothing can be scaled")
        scale = scale_a_kind(values, kinds, bounds.max_code)
        origin = "twice the largest value of each kind of column fits 16 bits"
        if scale is None:
            scale = round_step(HEADROOM * largest, bounds.max_code)
            origin = f"twice the largest value of {largest:.6g} fits 16 bits"
    codes = np.rint(values / np.asarray(scale))
    clipped, held_codes = clipped_to(codes, bounds, names)
    if requested and clipped.max() > MOST_CLIPPED:
        worst = int(np.argmax(clipped))
        raise InputError(
            f"{source}, {called([worst], names)}: a scale of {in_words(scale)} puts {clipped[worst]:.1%} of its samples beyond "
            f"16 bits; give {round_step(largest, bounds.max_code):.6g}, which holds all, or leave `scale` out"
        )
    notes = [
        f"samples are real numbers from {low:.6g} to {high:.6g}; one code is {in_words(scale)} ({origin})"
    ]
    notes += held_codes
    reach = np.abs(values).max(axis=0)
    weak = np.flatnonzero((reach > 0) & (reach * APART < largest))
    if len(weak) and isinstance(scale, float):
        fix = "if another sensor gives these, name the columns by their kinds"
        notes.append(f"{called(weak, names)}: far below the others, with one scale for all; {fix}")
    # a quantile of about 100 000 frames is as good as one of all frames
    span = np.subtract(*np.quantile(values[:: max(1, len(values) // 100_000)], [0.99, 0.01], axis=0))
    moves = span / np.asarray(scale)
    coarse = np.flatnonzero((moves < FEW_CODES) & (moves > 0))
    if len(coarse):
        finest = round_step(largest, bounds.max_code)
        finer = f", or give a scale of {finest:.6g}" if span[coarse].min() >= FEW_CODES * finest else ""
        notes.append(
            f"{called(coarse, names)}: fewer than {FEW_CODES} codes between rest and touch, "
            f"{moves[coarse].min():.2g} the least: subtract the level at rest{finer}"
        )
    return np.clip(codes, bounds.min_code, bounds.max_code).astype(np.int32), scale, notes
