"""Widths against logit error on the recorded data sets: prints docs/widths.md.

    python -m scripts.widths FOLDER > docs/widths.md

FOLDER holds pvdf_indent, fabric_slide and biotac_slide, each with recordings.npz.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

from eskin.choose.choose_front_end import configure
from eskin.data import load_recordings
from eskin.golden.core import AcceleratorConfig
from eskin.training.widths import LeftOut, Tried, feature_headroom, fold_cases, integers_of, ladder, measure
from eskin.verbs.cost import market

SETS = (
    ("pvdf_indent", "pvdf", ("seq",)),
    ("fabric_slide", "fabric", ("label", "force_setting", "velocity_mmps")),
    ("biotac_slide", None, ("block",)),
)
"""(folder, preset or None: the front end is chosen by evidence, groups left out)."""
ROWS = tuple(
    (weight, table)
    for weight in (4, 6, 8, 10, 12, 14, 16)
    for table in (512, 1024)
    if table == 512 or weight >= 8
)
LIMITS = (2.0, 1.0, 0.5, 0.25)

HEAD = """# Widths against logit error

How far the logits of the integer network are from those in float, on recordings that the network was not trained on. `python -m
scripts.widths FOLDER` printed this page; FOLDER holds the data sets.

Networks (GRU 12, seed 0) were trained without one group each, quantised with ranges of what they saw and the headroom for features given
below, and judged on every completed step of the group left out. Mean: over all steps and classes. Largest: of all. "Most of all by": the
stage that alone, with all others in float, brings about the largest error (`golden/model/stage_error.py`). `accumulators` are the rounded
weights and biases, `gates` the two tables. Accumulators are as wide as the worst row needs.

How to read it. The mean falls by a factor of three for every two bits of a weight, down to what tables and features leave. The largest
error is another matter: it comes from a few steps in which a touch is about to tip the hidden state one way or the other, and there any
rounding is amplified. It need not fall with every bit. It is an extreme, so that a group nobody saw may exceed it: the second table of
each data set says how often. Ask for half of what must be kept.

Features must not saturate. With a format that holds 99.9 % of those seen in training, features up to twice as large as any seen are cut
off (`features at an end` counts those), and a fold of fabric_slide is off by whole logits at any width of the weights. So bits on top for
the rarest are the default, and `--logit-error` adds the headroom that the folds call for. They take no wider operand: states and gates
give up fraction bits, which the tables do not resolve.
"""


def main() -> None:
    parser = argparse.ArgumentParser(
        description="Widths against logit error on the recorded data sets, as a page."
    )
    parser.add_argument("folder", type=Path, help="the folder of the data sets")
    folder = parser.parse_args().folder
    print(HEAD)
    for name, preset, groups in SETS:
        recordings = load_recordings(folder / name / "recordings.npz")
        asked = None if preset is None else AcceleratorConfig.load(preset)
        config = configure(recordings, asked, market()).config
        cases = fold_cases(recordings, config, [groups])
        headroom = feature_headroom(cases)
        print(f"## {name}, {' and '.join(groups)} left out ({len(cases)} folds)\n")
        print(f"Features left out are up to {headroom:.2f} times as large as any seen in training.\n")
        print(
            "| weight bits | table entries | accumulator bits | mean | largest | most of all by | features "
            "at an end |"
        )
        print("|--:|--:|--:|--:|--:|---|--:|")
        for weight, table in ROWS:
            print(_row(cases, headroom, measure(cases, headroom, weight, table)), flush=True)
        print(
            "\nWidths that `eskin quantise --logit-error` chooses on all groups but one, judged on that "
            "one:\n"
        )
        print(
            "| asked for | chosen, weights x table | largest error where it was chosen | on the group left "
            "out | kept |"
        )
        print("|--:|---|---|---|--:|")
        for line in _nested(cases):
            print(line, flush=True)
        print()


def _row(cases: list[LeftOut], headroom: float, tried: Tried) -> str:
    if tried.refused:
        return f"| {tried.weight_bits} | {tried.table_entries} | - | - | - | {tried.refused} | - |"
    bits = {integers_of(case, headroom, **tried.widths).config.accumulator_bits for case in cases}
    at_an_end = next(stage.saturated for stage in tried.stages if stage.stage == "features")
    cells = f"{tried.weight_bits} | {tried.table_entries} | {max(bits)} | {tried.mean:.4f} | {tried.max:.2f} | {tried.stage}"
    return f"| {cells} | {100 * at_an_end:.2f} % |"


def _nested(cases: list[LeftOut]) -> Iterator[str]:
    outer = []
    for number in range(len(cases)):
        inner = cases[:number] + cases[number + 1 :]
        headroom = feature_headroom(inner)
        outer.append((headroom, list(ladder(inner, headroom))))
    for limit in LIMITS:
        chosen, there, here = [], [], []
        for case, (headroom, tried) in zip(cases, outer, strict=True):
            choice = next((widths for widths in tried if widths.max <= limit), None)
            chosen.append(f"{choice.weight_bits} x {choice.table_entries}" if choice else "none")
            if choice:
                there.append(choice.max)
                here.append(measure([case], headroom, choice.weight_bits, choice.table_entries).max)
        errors = [", ".join(f"{error:.2f}" for error in errors) for errors in (there, here)]
        within = f"{sum(error <= limit for error in here)} of {len(here)}"
        yield f"| {limit:g} | {', '.join(chosen)} | {errors[0]} | {errors[1]} | {within} |"


if __name__ == "__main__":
    main()
