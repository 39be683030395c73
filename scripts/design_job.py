"""``make designs``: random configurations, each generated, simulated with Icarus and compared with the golden model at every stage.

A design is drawn as a row of choices, each among few options with the simplest first. So a failing design is made smaller by making its
choices smaller, and a row of numbers is all that must be kept of it (tests/scripts/failing_designs.json). The same rule is drawn from
by
hypothesis in tests/scripts/test_random_designs.py.

Icarus, because it builds fastest: of a design of 4 taxels and 4 hidden units, 3 recordings, all steps from configuration to verdict take
1.1 s with Icarus, 0.8 s in Amaranth's own simulator (which does not see the exported Verilog and is slower from there on), and 8.5 s with
Verilator.
"""

from __future__ import annotations

import argparse
import collections
import math
import random
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.converters import code_format, code_shift
from eskin.golden.core.errors import InputError
from eskin.golden.core.files import write_json
from eskin.golden.core.formats import QFormat
from eskin.golden.core.groups import FEATURE_KINDS
from eskin.golden.core.jobs import Jobs
from eskin.golden.core.memo import Memo, content_key
from eskin.golden.data.recordings import Recordings
from eskin.golden.model.conversion import codes_of, samples_of
from eskin.golden.model.image_network import image_recordings, random_image_model, random_images
from eskin.golden.model.model import IntegerModel, random_integer_model
from eskin.golden.model.vectors import random_recordings
from eskin.rtl.program.schedule import lowest_clock_hz
from eskin.verbs.flow import cosimulate
from scripts.fuzz_job import code_version

GATED_CYCLES = 40
"""Cycles of a frame beyond what a design with a clock gate needs: more than its clock runs on."""
T = TypeVar("T")
Pick = Callable[[Sequence[T]], T]


@dataclass(frozen=True)
class Design:
    """A configuration, the seed of weights and recordings, and whether both sides stall at random."""

    config: AcceleratorConfig
    seed: int
    stalls: bool


def draw(pick: Pick) -> Design:
    """A design by choices of ``pick``.

    Raises
    ------
    InputError
        The choices make none: the configuration refuses them.
    """
    cell, reset = pick((("gru", "before"), ("gru", "after"), ("lstm", "before"), ("linear", "before")))
    taxels, hidden, classes = pick((4, 5, 6, 7, 8, 9, 12, 16, 17, 21)), pick((4, 5, 6, 7, 8, 9, 11)), pick((2, 3, 4, 5, 7))
    sample_bits, signed = pick((12, 8, 10, 16, 6)), pick((False, True))
    low, high = QFormat(sample_bits, 0, signed).min_code, QFormat(sample_bits, 0, signed).max_code
    onset = pick(("band", "baseline", "immediate"))
    mode = pick(("touch", "free"))
    hop, steps = pick((2, 3, 4, 5, 7, 8)), pick((1, 2, 3, 4, 5, 6))
    window = 2 * hop + (pick((0, 1)) if mode == "touch" else 0)
    pretrigger = pick((0, 1, 3, 6)) if mode == "touch" and onset != "immediate" else 0
    whole = hop * (steps - 1) + window
    touch_frames = whole - pick((0, 1, hop, window - 2)) if mode == "touch" else whole
    rest = (
        pick(("none", "initial", "tracked"))
        if onset == "band"
        else pick(("tracked", "initial"))
        if onset == "baseline"
        else pick(("none", "initial"))
    )
    check = pick((1, 2, 4))
    compand = pick(("none", "log"))
    decision = pick(("last", "vote", "early"))
    hits, span = pick(((1, 1), (2, 3), (3, 3)))
    fields = dict(
        name="random",
        taxels=taxels,
        sample_rate_hz=1000.0,
        sample_bits=sample_bits,
        sample_signed=signed,
        clock_hz=12e6,
        masked_taxels=pick(((), (0,), (taxels - 1, 1))),
        rest=rest,
        rest_frames=0 if rest == "none" else pick((1, 2, 5, 8)),
        clip=pick((0, 7, (high - low) // 4)),
        onset=onset,
        band_low=low + (high - low) * 3 // 8,
        band_high=low + (high - low) * 5 // 8,
        onset_mean_frames=check * pick((1, 2, 4, 8)),
        onset_check_frames=check,
        onset_threshold=max(1, (high - low) // pick((40, 16))),
        rearm_frames=pretrigger + 9 + pick((0, 1, 7)),
        onset_hits=hits,
        onset_span=span,
        fault_frames=pick((0, 0, 4)) * check,
        fault_activity=pick((0, 3)),
        window_mode=mode,
        pretrigger_frames=pretrigger,
        touch_frames=touch_frames,
        hop=hop,
        window=window,
        steps=steps,
        compand=compand,
        compand_knee=pick((2, 0, 5)),
        compand_frac=pick((4, 1, 8)),
        cell=cell,
        reset=reset,
        gate_activation=pick(("sigmoid", "hard_sigmoid")),
        hidden=hidden,
        class_names=tuple(f"c{k}" for k in range(classes)),
        decision=decision,
        early_margin=pick((0, 9)),
        early_steps=min(steps, pick((1, 2))),
        margin_threshold=pick((0, 5)),
        weight_format=QFormat(pick((3, 1, 2)), pick((5, 3, 7, 9))),
        recurrent_format=QFormat(pick((3, 2, 1)), pick((5, 4, 7))),
        dense_format=QFormat(pick((3, 1)), pick((5, 2, 7))),
        bias_format=QFormat(pick((5, 2)), pick((9, 4))),
        dense_bias_format=QFormat(pick((5, 2)), pick((9, 4))),
        feature_format=QFormat(pick((4, 2)), pick((8, 5, 3))),
        state_format=QFormat(pick((2, 4)), pick((12, 10, 7))),
        gate_frac=pick((13, 14, 9, 4)),
        logit_format=QFormat(pick((6, 3)), pick((10, 5))),
        table_entries=pick((128, 64, 512, 1024)),
        lanes=pick((1, 2, 3, 4, 6, 9, 12, 16)),
        lane_type=pick(("plain", "serial", "dsp")),
        loadable=pick((True, False)),
    )
    if fields["lane_type"] == "serial":
        fields["lanes"] = 1
    config = AcceleratorConfig.of(**fields)
    design = Design(config, pick(range(1, 100)), pick((False, True)))
    hardware = dict(checksum=pick((False, True)), watchdog=pick((False, True)))
    kinds = pick((("mean",), *(subset for size in (1, 2, 3) for subset in combinations(FEATURE_KINDS, size) if subset != ("mean",))))
    block = max(1, math.gcd(hop, *config.window_lengths) // pick((1, 2, 3, 64)))
    changes: dict[str, Any] = dict(
        feature_kinds=kinds,
        activity_rule=pick(("sum", "change")),
        activity_block=block,
        integral_knee=pick((4, 0, 7)),
        integral_frac=pick((8, 5, 1)),
        feature_scale=pick(("array", "taxel")),
        weight_sets=pick(("window", "one")),
    )
    if kinds == ("integral",):
        changes["compand"] = "none"
    design = replace(design, config=config.replace(**hardware, **changes))
    if pick((False, False, False, True)):
        return _for_images(pick, design)
    chip = pick(("none", "none", "none", "ads7953", "mcp3208x2", "ad7476", "spi", "matrix"))
    if chip != "none":
        return _behind(pick, design, chip)
    # as a process's chips have it; not with an FPGA's lanes
    kept = {"one_port": pick((False, True))} | ({"clock_gate": pick((False, True))} if fields["lane_type"] != "dsp" else {})
    return replace(design, config=design.config.replace(**kept))


def _behind(pick: Pick, design: Design, chip: str) -> Design:
    """The design behind a converter, without stalls: frames come at its pace, at a clock that is low enough for Icarus.

    Not the ddc232 and mpr121: their frames take thousands of cycles. The shift is the default, either way as the widths are: by another
    most samples would lie beyond the converter's ends.
    """
    taxels = design.config.sensor.taxels
    clock, rate = pick((2e6, 1.7e6)), pick((2000.0, 3000.0, 900.0))
    fields: dict[str, Any] = dict(converter=chip, clock_hz=clock, sample_rate_hz=rate, code_offset=pick((None, 0, 60, -40)))
    if chip == "mcp3208x2":
        fields["data_lines"] = pick((0, 1))
    elif chip == "matrix":
        rows = pick([rows for rows in (1, 2, 3, 4, 5, 7) if taxels % rows == 0])
        fields |= dict(rows=rows, columns=taxels // rows, settle_s=pick((2e-6, 0.0, 9e-6)))
    elif chip == "spi":
        channels, delay, code, bits = pick((taxels, 1, 2, 4)), pick((0, 1, 2)), pick((0, 2)), pick((12, 8, 14))
        numbered = pick((0, 5))
        fields |= dict(spi_channels=channels, spi_delay=delay, spi_code_bit=code, spi_code_bits=bits, spi_tag_bit=code + bits)
        fields |= dict(spi_tag_bits=numbered, spi_frame_bits=code + bits + numbered + 6, spi_channel_bit=code + bits + numbered)
        fields |= dict(data_lines=pick((0, 1, 2)))
    config = design.config.replace(**fields)
    if lowest_clock_hz(config) > clock:
        raise InputError(f"clock_hz: is {clock:g}; the network needs {lowest_clock_hz(config):g}")
    return replace(design, config=config, stalls=False)


def _never_stuck(recordings: Recordings, config: AcceleratorConfig) -> Recordings:
    """Every second taxel kept off the ends of the converter's range: a line that is all at one end is a fault, and its frame is dropped."""
    codes, step = codes_of(recordings.samples, config), 1 << max(code_shift(config), 0)
    codes[:, ::2] = np.clip(codes[:, ::2], step, code_format(config).max_code - step)
    return replace(recordings, samples=samples_of(codes, config))


def _for_images(pick: Pick, design: Design) -> Design:
    """A network for images in its place: up to three convolutions, each with or without a pool, one or two dense layers."""
    layers: list[str] = []
    for _ in range(pick((1, 0, 2, 3))):
        layers.append(f"conv {pick((3, 1, 5))} {pick((4, 1, 3, 5, 9))}")
        layers += ["pool"] * pick((1, 0))
    layers += [f"dense {hidden}" for hidden in pick(((), (5,), (8,)))]
    classes = pick((3, 2, 4, 9))
    names = tuple(f"c{k}" for k in range(classes))
    config = AcceleratorConfig.of_image(pick((4, 5, 6, 9)), pick((4, 5, 7, 10)), (*layers, f"dense {classes}"), names, clock_hz=12e6)
    kept = {name: getattr(design.config.hardware, name) for name in ("checksum", "watchdog")}
    return replace(design, config=config.with_lanes(pick((4, 8, 1, 2, 16)), pick(("plain", "dsp"))).replace(**kept))


def model_of(design: Design) -> IntegerModel:
    """Random weights."""
    return (random_image_model if design.config.is_image else random_integer_model)(design.config, design.seed)


class Recorded:
    """Choices of a row of numbers (0 after its end), or new ones of a generator; ``row`` is what was chosen."""

    def __init__(self, row: Sequence[int] = (), rng: random.Random | None = None) -> None:
        self.given, self.rng = list(row), rng
        self.row: list[int] = []

    def __call__(self, options: Sequence[T]) -> T:
        given = self.given[len(self.row)] if len(self.row) < len(self.given) else 0
        self.row.append(self.rng.randrange(len(options)) if self.rng else min(given, len(options) - 1))
        return options[self.row[-1]]


def random_row(number: int, seed: int) -> list[int]:
    """The choices of design ``number``: the first that the configuration takes and whose recordings have a step."""
    rng = random.Random(f"{seed}/{number}")
    while True:
        picked = Recorded(rng=rng)
        try:
            design = draw(picked)
            model_of(design)
        except InputError:
            continue
        return picked.row


def play(design: Design, folder: Path) -> dict[str, Any]:
    """Generate the design, simulate a few short recordings, compare; the co-simulation's result (eskin.cosim.flow.cosim)."""
    model = model_of(design)
    config = model.config
    if config.is_image:
        images = image_recordings(config, random_images(config, 3, design.seed))
        options: dict[str, Any] = dict(simulator="icarus", stalls=design.stalls, seed=design.seed)
        return cosimulate(model, images, work=folder, builds=folder / "simulators", **options)
    whole = config.rest_level.rest_frames + config.windows.pretrigger_frames + config.last_frame + 2 * config.windows.hop
    recordings = random_recordings(
        config, (2 * whole + config.onset_rule.rearm_frames + 20, whole + 10, config.rest_level.rest_frames + 3), design.seed
    )
    if config.interface.converter != "none":
        recordings = _never_stuck(recordings, config)
    options = dict(simulator="icarus", stalls=design.stalls, seed=design.seed)
    if config.hardware.clock_gate:  # which stops the clock between frames only
        clock = lowest_clock_hz(config) + GATED_CYCLES * config.sensor.sample_rate_hz
        options |= {"pace": "declared", "clock_hz": clock}
    return cosimulate(model, recordings, work=folder, builds=folder / "simulators", **options)


def healthy(result: Mapping[str, Any]) -> bool:
    """Exact, and where there is a converter no frame broken and no limit of its data sheet."""
    way = result.get("conversion", {})
    return result["bit_exact"] and not way.get("faults") and not way.get("violations")


def judged(row: Sequence[int]) -> dict[str, Any]:
    """What becomes of a row: {exact, detail, compared_values, steps, cycles}; a standstill and an exception are failures too."""
    design = draw(Recorded(row))
    with tempfile.TemporaryDirectory() as folder:
        try:
            result = play(design, Path(folder))
        except (RuntimeError, AssertionError, ValueError, IndexError, KeyError, TypeError) as error:
            return {"exact": False, "detail": f"{type(error).__name__}: {error}", "compared_values": 0, "steps": 0, "cycles": 0}
    return {
        "exact": healthy(result),
        "detail": "; ".join([*result["mismatch_list"][:3], *(f"{result['conversion']}" for _ in range("conversion" in result))]),
        "compared_values": result["compared_values"],
        "steps": result["steps"],
        "cycles": result["simulated_cycles"],
    }


def shrink(row: list[int], fails: Callable[[list[int]], bool], most: int = 30) -> list[int]:
    """A smaller row that ``fails`` too: each choice set to the first option, else halved, as long as that helps, in ``most`` trials."""
    trials, moved = 0, True
    while moved and trials < most:
        moved = False
        for place in range(len(row)):
            for smaller in dict.fromkeys((0, row[place] // 2)):
                if smaller < row[place] and trials < most:
                    candidate = [*row[:place], smaller, *row[place + 1 :]]
                    trials += 1
                    if fails(candidate):
                        row, moved = candidate, True
                        break
    return row


def fails(row: list[int]) -> bool:
    """Whether a row is a design and is not exact."""
    try:
        return not judged(row)["exact"]
    except InputError:
        return False


FEATURES = (
    "cell",
    "reset",
    "gate_activation",
    "lane_type",
    "lanes",
    "loadable",
    "rest",
    "onset",
    "onset_span",
    "fault_frames",
    "window_mode",
    "compand",
    "feature_kinds",
    "activity_rule",
    "feature_scale",
    "decision",
    "table_entries",
    "gate_frac",
    "taxels",
    "hidden",
    "steps",
    "weight_format",
    "state_format",
    "weight_sets",
    "converter",
    "one_port",
    "clock_gate",
)


def summary(records: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Counts of the designs, by each feature too, and the failing ones."""
    designs = [(draw(Recorded(record["row"])), record) for record in records]
    counts = {name: collections.Counter(str(design.config.value(name)) for design, _ in designs) for name in FEATURES}
    counts["stalls"] = collections.Counter(str(design.stalls) for design, _ in designs)
    return {
        "designs": len(records),
        "exact": sum(record["exact"] for record in records),
        "simulator": "icarus",
        "with_steps": sum(record["steps"] > 0 for record in records),
        "steps": sum(record["steps"] for record in records),
        "compared_values": sum(record["compared_values"] for record in records),
        "cycles": sum(record["cycles"] for record in records),
        "design_seconds": round(sum(record["seconds"] for record in records), 1),
        "features": {name: dict(sorted(found.items())) for name, found in counts.items()},
        "failing": [record for record in records if not record["exact"]],
    }


def design(seed: int, number: int) -> dict[str, Any]:
    """Draw, judge and, where it fails, shrink design ``number``: what stands in the result."""
    row, started = random_row(number, seed), time.monotonic()
    record = judged(row)
    if not record["exact"]:
        record |= {"row": row, "shrunk": shrink(row, fails)}
    return {"number": number, "row": row, **record, "seconds": round(time.monotonic() - started, 2)}


def main() -> None:
    """The command line of the job."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--designs", type=int, default=300)
    parser.add_argument("--out", type=Path, default=Path("build/designs"))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, help="Processes; default: one a core.")
    options = parser.parse_args()
    begin, version = time.monotonic(), code_version()

    def progress(what: str, done: int, total: int) -> None:
        if done % 10 == 0:
            print(f"{done} of {total} designs {what}, {time.monotonic() - begin:.0f} s", file=sys.stderr, flush=True)

    pieces = {content_key(version, options.seed, number): number for number in range(options.designs)}
    jobs, keep = Jobs(workers=options.jobs, progress=progress), Memo(options.out / "done")
    records = list(jobs.results(design, pieces, options.seed, keep=keep, what="played").values())
    result = summary(records) | {"wall_s": round(time.monotonic() - begin, 1)}
    write_json(options.out / "designs.json", result)
    compared = f"{result['compared_values']} values of {result['steps']} steps compared"
    print(f"{result['exact']} of {result['designs']} designs bit-exact, {compared}")
    for record in result["failing"]:
        print(f"design {record['number']}: {record['detail'][:300]}\n  shrunk: {record['shrunk']}")
    sys.exit(0 if result["exact"] == result["designs"] else 1)


if __name__ == "__main__":
    main()
