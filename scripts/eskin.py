"""The command line `eskin`: options in, one call into golden, rtl or cosim, a table out.

Modules are imported inside the verbs, so that `--help` is quick.
"""

from __future__ import annotations

import math
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from golden.errors import InputError

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)
console = Console()
if not console.is_terminal:  # a file or a pipe has no width: tables are not broken there
    console = Console(width=max(console.width, 160))
messages = Console(stderr=True)

DATA = "An .npz archive, a folder of .lvm files (one sub-folder a class), or the word synthetic."
SEED_MAX = 2**31 - 1
CONFIG = "A preset (thesis, synthetic, pvdf, fabric) or a JSON file; without it one is derived from the data."


@app.callback(epilog="Exit status: 0 done and every check held, 1 a check did not hold, 2 bad usage or bad input.")
def eskin() -> None:
    """From recorded tactile streams to a trained GRU or LSTM in bit-exact hardware."""


def main() -> None:
    """Entry point: every foreseen mistake becomes one sentence on standard error and status 2, an interrupt status 130."""
    try:
        app()
    except InputError as error:
        _stop(str(error), 2)
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        _stop(f"{where}{error.strerror or error}; check the path, its permissions and the room on the disk", 2)
    except RuntimeError as error:
        from cosim.runner import SimulationError

        if not isinstance(error, SimulationError):
            raise
        _stop(str(error), 1)
    except SystemExit as end:
        if end.code == 130:
            _stop("stopped by the user; files that were being written are as they were before", 130)
        raise


def _stop(sentence: str, status: int) -> None:
    print(f"eskin: {sentence}", file=sys.stderr)
    sys.exit(status)


@contextmanager
def _progress() -> Iterator[Callable[[str, int, int], None]]:
    """Progress bars on standard error, moved by calling ``(what, done, total)``; gone when done, none on a file."""
    from rich.progress import Progress, TaskID

    with Progress(console=messages, transient=True, disable=not messages.is_terminal) as bars:
        tasks: dict[str, TaskID] = {}

        def report(what: str, done: int, total: int) -> None:
            if what not in tasks:
                tasks[what] = bars.add_task(what, total=total)
            bars.update(tasks[what], completed=done, total=total)

        yield report


def _load(data: str, config: str | None = None):
    """Recordings, and the configuration that was asked for, if one was."""
    from golden.config import AcceleratorConfig
    from golden.recordings import load_recordings

    chosen = AcceleratorConfig.load(config) if config else None
    return load_recordings(data, config=chosen), chosen


def _table(title: str, *columns: str, rows: list[tuple]) -> None:
    table = Table(*columns, title=escape(title), title_justify="left")
    for row in rows:
        table.add_row(*(escape(str(cell)) for cell in row))
    console.print(table)


@app.command(epilog="Example: eskin inspect recordings.npz --json archive.json")
def inspect(
    data: Annotated[str, typer.Argument(help=DATA)],
    config: Annotated[str | None, typer.Option(help=CONFIG)] = None,
    out: Annotated[Path | None, typer.Option(help="The picture; default build/inspect/NAME.png.")] = None,
    json: Annotated[Path | None, typer.Option(help="Also write the figures as JSON.")] = None,
) -> None:
    """Show what an archive holds: taxels, rate, lengths, classes, groups, the onset of each recording, a plot."""
    from golden.files import check_target, write_json
    from golden.inspect_data import draw
    from golden.inspect_data import inspect as look

    picture = out or Path("build/inspect") / f"{_short_name(data)}.png"
    check_target(picture)
    check_target(json)
    recordings, chosen = _load(data, config)
    figures = look(recordings, chosen)
    draw(recordings, figures["onset_frames"], picture)
    if json:
        write_json(json, figures)
    _show_inspection(recordings, figures)
    console.print(f"picture: {escape(str(picture))}")


def _short_name(data: str) -> str:
    path = Path(data)
    return Path(os.path.abspath(path)).parent.name if path.name == "recordings.npz" else path.stem or "recordings"


def _show_inspection(recordings, figures: dict[str, Any]) -> None:
    rate, lengths = figures["sample_rate_hz"], figures["lengths"]
    volts = f", {1e6 * figures['volt_per_code']:.6g} uV a code" if figures["volt_per_code"] else ""
    groups = ", ".join(f"{name} ({count} values)" for name, count in figures["groups"].items()) or "none"
    seconds = "/".join(f"{lengths[key] / rate:.3g}" for key in ("min", "median", "max"))
    rows = [
        ("recordings", figures["recordings"]),
        ("taxels", figures["taxels"]),
        ("sample rate", f"{rate:g} Hz"),
        ("codes", f"{figures['sample_format']}, from {figures['sample_min']} to {figures['sample_max']}{volts}"),
        ("lengths (shortest/median/longest)", f"{lengths['min']}/{lengths['median']:g}/{lengths['max']} frames, {seconds} s"),
        ("groups", groups),
    ]
    _table(figures["source"], "what", "value", rows=rows)
    onsets = figures["onset_frames"]
    class_rows = []
    for label, (name, count) in enumerate(figures["classes"].items()):
        mine = [] if onsets is None else [frame for frame, of in zip(onsets, recordings.labels, strict=True) if of == label]
        found = sorted(frame for frame in mine if frame >= 0)
        span = f"{found[0]}/{found[len(found) // 2]}/{found[-1]}" if found else "-"
        class_rows.append((name, count, len(mine) - len(found) if onsets is not None else "-", span))
    _table("classes", "class", "recordings", "no onset", "onset frame (first/median/last)", rows=class_rows)
    odd = [(index, taxel["state"], taxel["min"], taxel["max"]) for index, taxel in enumerate(figures["taxel"]) if taxel["state"] != "ok"]
    if odd:
        _table("taxels to look at", "taxel", "state", "smallest", "largest", rows=odd)
    for reason in figures["configuration"]["reasons"]:
        console.print(f"configuration: {escape(reason)}", soft_wrap=True)
    if onsets is not None and any(frame != 0 for frame in onsets):
        console.print("onset frame of each recording (-1: none), ten a line:")
        for first in range(0, len(onsets), 10):
            console.print(f"{first:6d}: " + " ".join(f"{frame:6d}" for frame in onsets[first : first + 10]), highlight=False)
    elif onsets is not None:
        console.print("the gate is open from frame 1 in every recording, so none has an onset")


def _fitting(recordings, asked):
    """A configuration that fits: the one asked for, or a derived one; the reasons are printed."""
    from golden.derive import configure

    config, reasons = configure(recordings, asked)
    for reason in reasons:
        messages.print(f"configuration: {escape(reason)}", soft_wrap=True)
    return config


def _for_model(data: str, config):
    """Recordings that fit a model's configuration."""
    from golden.recordings import check_fit, load_recordings

    recordings = load_recordings(data, config=config)
    check_fit(recordings, config)
    return recordings


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.2f} %"


class Cell(StrEnum):
    """Recurrent cells."""

    gru = "gru"
    lstm = "lstm"


class Reset(StrEnum):
    """Where a GRU applies its reset gate: before or after the recurrent product."""

    before = "before"
    after = "after"


class Protocol(StrEnum):
    """Training recipes."""

    default = "default"
    robust = "robust"
    thesis = "thesis"


class Simulator(StrEnum):
    """Simulators."""

    verilator = "verilator"
    icarus = "icarus"


class LaneType(StrEnum):
    """Lanes of one design."""

    plain = "plain"
    dsp = "dsp"
    serial = "serial"


LaneTypeOption = Annotated[
    LaneType | None, typer.Option(help="plain; dsp: the iCE40's DSP blocks; serial: no multiplier, a cycle a weight bit.")
]


class Level(StrEnum):
    """What is simulated."""

    rtl = "rtl"
    netlist = "netlist"
    bitstream = "bitstream"


class Pace(StrEnum):
    """How frames are fed: as fast as they are taken, or at the declared rate."""

    full = "full"
    declared = "declared"


@app.command(epilog="Example: eskin train --data recordings.npz --out model --group person,trial")
def train(
    data: Annotated[str, typer.Option(help=DATA)],
    out: Annotated[Path, typer.Option(help="The model folder: new, or an earlier model, which is replaced.")],
    config: Annotated[str | None, typer.Option(help=CONFIG)] = None,
    cell: Annotated[Cell | None, typer.Option(help="Recurrent cell.")] = None,
    reset: Annotated[Reset | None, typer.Option(help="GRU only: the reset gate before or after the recurrent product.")] = None,
    hidden: Annotated[int | None, typer.Option(help="Hidden units.")] = None,
    steps: Annotated[int | None, typer.Option(help="Recurrent steps of a touch.")] = None,
    folds: Annotated[int, typer.Option(help="Folds of the cross-validation; 0: none.")] = 5,
    group: Annotated[str | None, typer.Option(help="Group arrays A[,B..] that stay on one side of a split.")] = None,
    seed: Annotated[int, typer.Option(min=0, max=SEED_MAX, help="First seed, that of the model written.")] = 0,
    protocol: Annotated[Protocol, typer.Option(help="The default recipe; robust: taxels may fail; or the thesis's.")] = Protocol.default,
    quantisation_aware: Annotated[
        bool, typer.Option("--quantisation-aware", help="Train on in integer arithmetic; the folder then holds the integers too.")
    ] = False,
    weight_bits: Annotated[int | None, typer.Option(help="With --quantisation-aware: bits of a weight.")] = None,
    state_bits: Annotated[int | None, typer.Option(help="With --quantisation-aware: bits of the hidden state.")] = None,
    feature_bits: Annotated[int | None, typer.Option(help="With --quantisation-aware: bits of a feature.")] = None,
    gate_bits: Annotated[int | None, typer.Option(help="With --quantisation-aware: fraction bits of a gate.")] = None,
    table_entries: Annotated[int | None, typer.Option(help="With --quantisation-aware: entries of an activation table.")] = None,
) -> None:
    """Cross-validate, then train a model on all recordings of DATA and write its folder."""
    from golden.model import check_model_target
    from golden.train import split_folds
    from golden.train import train as fit

    widths = _widths(weight_bits, state_bits, feature_bits, gate_bits, table_entries)
    if widths and not quantisation_aware:
        raise InputError(f"eskin train, option --{next(iter(widths)).replace('_', '-')}: needs --quantisation-aware; "
                         "without it, give it to 'eskin quantise'")
    check_model_target(out)
    recordings, asked = _load(data, config)
    groups = None if group is None else _names(group)
    if groups is not None and folds:
        split_folds(recordings, groups, folds, None)  # an unknown group is refused before anything is said
    chosen = _fitting(recordings, asked)
    with _progress() as report:
        record = fit(
            recordings, chosen, out=out, cell=cell, reset=reset, hidden=hidden, steps=steps, folds=folds, group=groups, seed=seed,
            protocol=protocol, quantisation_aware=quantisation_aware, widths=widths, progress=report,
        )  # fmt: skip
    _show_cross_validation(record)
    console.print(f"model: {escape(str(out))}, {record['parameters']} parameters, {record['wall_s']:.0f} s")


def _widths(*bits: int | None) -> dict[str, int]:
    """The widths that were asked for, by the names of ``golden.quantise.choose_formats``."""
    names = ("weight_bits", "state_bits", "feature_bits", "gate_bits", "table_entries")
    return {name: count for name, count in zip(names, bits, strict=True) if count is not None}


def _show_cross_validation(record: dict[str, Any]) -> None:
    rows = [
        (" and ".join(split["groups"]) or "none", split["folds"], _percent(split["float_accuracy"]), _percent(split["integer_accuracy"]),
         f"{100 * split['integer_spread']:.1f} points", _percent(split["agreement"]))
        for split in record["cross_validation"]
    ]  # fmt: skip
    if rows:
        _table("accuracy on unseen groups", "groups left out", "folds", "float", "integer", "spread", "agreement", rows=rows)


@app.command("import", epilog="Example: eskin import weights.pt --out model --config c.json --cell gru --reset after --mean 0 --std 40")
def import_(
    file: Annotated[Path, typer.Argument(help="A torch state_dict (.pt, .pth), or an .npz of Keras weights in get_weights() order.")],
    out: Annotated[Path, typer.Option(help="The model folder: new, or an earlier model, which is replaced.")],
    config: Annotated[str, typer.Option(help="A preset or a JSON file: the array, windows and classes of the network's training.")],
    cell: Annotated[Cell | None, typer.Option(help="Recurrent cell; default: the configuration's.")] = None,
    reset: Annotated[Reset | None, typer.Option(help="GRU only: the reset gate before or after the recurrent product.")] = None,
    mean: Annotated[float | None, typer.Option(help="Codes taken off every window mean in its training.")] = None,
    std: Annotated[float | None, typer.Option(help="Codes that became 1 in its training.")] = None,
    data: Annotated[str | None, typer.Option(help="Without --mean and --std: measure them on these recordings.")] = None,
) -> None:
    """Make a model folder of a network trained elsewhere; then quantise it with --data."""
    from golden.config import AcceleratorConfig
    from golden.import_network import import_network
    from golden.model import check_model_target

    check_model_target(out)
    chosen = AcceleratorConfig.load(config)
    recordings = None if data is None or mean is not None or std is not None else _for_model(data, chosen)
    record = import_network(file, chosen, out=out, cell=cell, reset=reset, mean=mean, std=std, recordings=recordings)
    scale = record["normalisation"]
    console.print(f"normalisation: mean {scale['mean']:.6g}, deviation {scale['std']:.6g} codes ({escape(scale['source'])})")
    console.print(f"model: {escape(str(out))}, {record['parameters']} parameters")


@app.command(epilog="Example: eskin quantise model --weight-bits 6")
def quantise(
    model: Annotated[Path, typer.Argument(help="A model folder.")],
    data: Annotated[str | None, typer.Option(help="Profile ranges on these recordings; default: the ranges noted at training.")] = None,
    weight_bits: Annotated[int | None, typer.Option(help="Bits of a weight.")] = None,
    state_bits: Annotated[int | None, typer.Option(help="Bits of the hidden state.")] = None,
    feature_bits: Annotated[int | None, typer.Option(help="Bits of a feature.")] = None,
    gate_bits: Annotated[int | None, typer.Option(help="Fraction bits of a gate.")] = None,
    table_entries: Annotated[int | None, typer.Option(help="Entries of an activation table.")] = None,
    lean: Annotated[bool, typer.Option("--lean", help="Formats of features and logits that need the fewest logic cells.")] = False,
) -> None:
    """Write the integer model into a model folder, a format for each signal."""
    from golden.model import describe_formats, load_config
    from golden.quantise import quantise as to_integers

    recordings = None if data is None else _for_model(data, load_config(model))
    if lean and feature_bits is not None:
        raise InputError("--lean chooses the bits of a feature; give it or --feature-bits")
    integer = to_integers(model, recordings, lean=lean, **_widths(weight_bits, state_bits, feature_bits, gate_bits, table_entries))
    _table("formats", "signal", "format", rows=list(describe_formats(integer.config).items()))


@app.command(epilog="Example: eskin evaluate model --data recordings.npz --json evaluate.json")
def evaluate(
    model: Annotated[Path, typer.Argument(help="A quantised model folder.")],
    data: Annotated[str, typer.Option(help=DATA)],
    json: Annotated[Path | None, typer.Option(help="Also write the result as JSON.")] = None,
) -> None:
    """Set float against integer: accuracy, agreement, per class, per step; on training data this is no accuracy on unseen recordings."""
    from golden.evaluate import evaluate as compare
    from golden.files import check_target, write_json
    from golden.model import load_config

    check_target(json)
    result = compare(model, _for_model(data, load_config(model)))
    if json:
        write_json(json, result)
    _show_evaluation(result)
    if not result["passed"]:
        messages.print("check not held: the integer model may lose 1 point at most and must agree in 98 % at least")
        raise typer.Exit(1)


def _show_evaluation(result: dict[str, Any]) -> None:
    rows = [
        ("recordings", f"{result['recordings']}, of which {result['not_touched']} show no onset"),
        ("accuracy, float", _percent(result["float_accuracy"])),
        ("accuracy, integer", _percent(result["integer_accuracy"])),
        ("agreement", _percent(result["agreement"])),
        ("decided after", "never" if result["decision_time_s"] is None else f"{1e3 * result['decision_time_s']:.4g} ms, mean, integer"),
    ]
    _table("float against integer", "what", "value", rows=rows)
    steps = [
        (row["step"], f"{1e3 * row['time_s']:.4g} ms", _percent(row["float_accuracy"]), _percent(row["integer_accuracy"]))
        for row in result["per_step"]
    ]
    _table("local decision, step by step", "step", "since the onset", "float", "integer", rows=steps)


@app.command(epilog="Example: eskin generate model --out design --lanes 4")
def generate(
    model: Annotated[Path, typer.Argument(help="A quantised model folder.")],
    out: Annotated[Path, typer.Option(help="The folder to write: new, or an earlier generated one, which is replaced.")],
    lanes: Annotated[int | None, typer.Option(help="Multipliers that work at once; default 4.")] = None,
    lane_type: LaneTypeOption = None,
    data: Annotated[str | None, typer.Option(help="The testbench plays the first of these recordings; default: a made-up one.")] = None,
) -> None:
    """Write the accelerator: Verilog, memory images, config.json, register map, C header, self-checking testbench."""
    from golden.model import IntegerModel
    from scripts.flow import generate_design

    integer = IntegerModel.load(model)
    recordings = None if data is None else _for_model(data, integer.config)
    folder = generate_design(integer, out, lanes=lanes, lane_type=lane_type, recordings=recordings)
    console.print(f"{escape(str(folder))}: {escape(', '.join(sorted(path.name for path in folder.iterdir())))}", soft_wrap=True)


@app.command(epilog="Example: eskin cosim model --data recordings.npz --recordings 40 --lanes 4 --json cosim.json")
def cosim(
    model: Annotated[Path, typer.Argument(help="A quantised model folder.")],
    data: Annotated[str, typer.Option(help=DATA)],
    recordings: Annotated[str, typer.Option(metavar="N|all", help="How many, the same every time, spread over the classes.")] = "all",
    lanes: Annotated[int | None, typer.Option(help="Multipliers that work at once; default 4.")] = None,
    lane_type: LaneTypeOption = None,
    simulator: Annotated[Simulator, typer.Option(help="Icarus is four-state and slow.")] = Simulator.verilator,
    level: Annotated[Level, typer.Option(help="Generated Verilog, its netlist, or what its bitstream reads back as.")] = Level.rtl,
    target: Annotated[str | None, typer.Option(help="Not with --level rtl: the board, such as icebreaker, icestick, ulx3s.")] = None,
    pace: Annotated[Pace, typer.Option(help="full: as fast as frames are taken; declared: at the recordings' rate.")] = Pace.full,
    clock: Annotated[
        str | None, typer.Option(metavar="HZ|lowest", help="Clock of the declared pace; default: the configuration's. lowest: look for it.")
    ] = None,
    stalls: Annotated[bool, typer.Option("--stalls", help="Random stalls on both sides.")] = False,
    seed: Annotated[int, typer.Option(min=0, max=SEED_MAX, help="Of the stalls.")] = 1,
    json: Annotated[Path | None, typer.Option(help="Also write the result as JSON.")] = None,
) -> None:
    """Simulate the hardware on recordings and compare every stage with the golden model, bit for bit."""
    from golden.files import check_target, write_json
    from golden.model import IntegerModel
    from scripts.flow import cosimulate

    check_target(json)
    count = _count(recordings)
    hertz = _clock(clock)
    lowest = clock == "lowest"
    if lowest and pace is not Pace.declared:
        raise InputError("--clock lowest: budgets are met or missed at the sensor's pace; add --pace declared")
    integer = IntegerModel.load(model)
    loaded = _for_model(data, integer.config)
    numbers = loaded.evenly(len(loaded) if count is None else count)
    with _work_folder(Path("build/cosim")) as work, _progress() as report:
        result = cosimulate(
            integer, loaded.subset(numbers), numbers=numbers, lanes=lanes, lane_type=lane_type, work=work,
            simulator=simulator.value, stalls=stalls, seed=seed, level=level.value, target=target,
            **({"lowest": True} if lowest else {"pace": pace.value, "clock_hz": hertz}),
            progress=lambda done, total: report("simulated frames", done, total),
        )  # fmt: skip
        if result["waves"]:
            result["waves"] = _keep(Path(result["waves"]), work)
    if json:
        write_json(json, result)
    _show_cosimulation(result)
    if not result["passed"]:
        raise typer.Exit(1)


@contextmanager
def _work_folder(parent: Path) -> Iterator[Path]:
    """A folder for this call alone, gone afterwards; two calls at a time do not meet."""
    parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=parent) as work:
        yield Path(work)


def _keep(waves: Path, work: Path) -> str:
    """The waves of a mismatch, moved out of the work folder that ends with the call."""
    kept = work.with_name(f"waves_{work.name}")
    waves.rename(kept)
    return str(kept)


def _clock(text: str | None) -> float | None:
    """Hertz of ``--clock``; None where it names none."""
    if text in (None, "lowest"):
        return None
    try:
        hertz = float(text)
    except ValueError:
        hertz = math.nan
    if not (math.isfinite(hertz) and hertz >= 1):
        raise InputError(f"--clock {text}: is no clock; give hertz, 1 or more, or the word lowest")
    return hertz


def _count(text: str) -> int | None:
    """The number in ``--recordings N|all``; None is all."""
    if text == "all":
        return None
    if not text.isdecimal() or int(text) < 1:
        raise InputError(f"--recordings {text}: is no number of recordings; give 1 or more, or all")
    return int(text)


def _show_cosimulation(result: dict[str, Any]) -> None:
    cycles = result["cycles"]
    verdict = "bit-exact" if result["bit_exact"] else f"{result['mismatches']} MISMATCHES"
    on = f"the {result['level']} for {result['target']} on {result['simulator']}" if result["target"] else result["simulator"]
    speed = f"{result['cycles_per_s'] / 1e6:.3g} M cycles/s"
    rows = [
        ("verdict", f"{verdict}: {result['compared_values']} values of {result['recordings']} recordings compared"),
        ("simulated", f"{result['frames']} frames, {result['steps']} steps, {result['decisions']} decisions, {on}"),
        ("time", f"{result['simulated_cycles']} cycles in {result['wall_s']:.1f} s, {speed}"),
        ("cycles a step", f"{cycles['step_min']} to {cycles['step_max']}, ideal {cycles['step_ideal']} with {result['lanes']} lanes"),
        ("pace", f"{result['pace']}, clock {result['clock_hz'] / 1e6:g} MHz" + (", random stalls" if result["stalls"] else "")),
    ]
    if "without_probes" in result:
        bare = result["without_probes"]
        exact = "bit-exact" if bare["bit_exact"] else f"{bare['mismatches']} MISMATCHES"
        rows.insert(1, ("without probes", f"{exact}: {bare['compared_values']} values of decisions and registers of the netlist as placed"))
    _table("co-simulation", "what", "value", rows=rows)
    budget_rows = [
        (row["name"], f"{1e3 * row['limit_s']:.4g} ms", f"{1e3 * row['measured_s']:.4g} ms", "met" if row["met"] else "missed")
        for row in result["budgets"]
    ]
    if budget_rows:
        _table("latency budgets", "budget", "limit", "measured", "verdict", rows=budget_rows)
    for sentence in result["mismatch_list"] + result.get("without_probes", {}).get("mismatch_list", []):
        console.print(f"mismatch: {escape(sentence)}")
    if result["waves"]:
        console.print(f"waves around the first mismatch: {escape(result['waves'])}")


@app.command(epilog="Example: eskin build model --target icebreaker --seeds 5")
def build(
    model: Annotated[Path, typer.Argument(help="A quantised model folder.")],
    target: Annotated[str | None, typer.Option(metavar="NAME", help="icebreaker, upduino, ulx3s, icestick or icesugar-nano.")] = None,
    lanes: Annotated[int | None, typer.Option(help="Multipliers that work at once; default 1.")] = None,
    lane_type: Annotated[LaneType | None, typer.Option(help="Default: what suits the part.")] = None,
    link: Annotated[bool, typer.Option(help="With the serial link; without it: onset to decision alone, for its figures.")] = True,
    baud: Annotated[float | None, typer.Option(min=300, help="Of the serial link; default: up to 2000000, as the clock allows.")] = None,
    clock: Annotated[float | None, typer.Option(min=1e3, metavar="HZ", help="The clock to reach; default: the board's oscillator.")] = None,
    seed: Annotated[int, typer.Option(min=1, max=SEED_MAX, help="First seed of the placement.")] = 1,
    seeds: Annotated[int, typer.Option(min=1, max=1000, help="How many seeds to try; the fastest placement is kept.")] = 1,
    out: Annotated[Path | None, typer.Option(help="New folder or an earlier build; default build/board/NAME.")] = None,
    table: Annotated[bool, typer.Option("--table", help="Build for every part, and with several lanes, and print one table.")] = False,
) -> None:
    """Make a board's bitstream; tell its area block by block, its highest clock and slowest path, and the clock each budget needs."""
    from golden.model import IntegerModel
    from rtl.targets import target as board
    from scripts import build_job as job

    if table == (target is not None):
        raise InputError("--table: goes through the boards by itself; leave out --target" if table else "--target: is missing; name one")
    if table and not (link and lanes is lane_type is clock is baud is None):
        raise InputError("--table: goes through designs by itself; leave out --lanes, --lane-type, --no-link, --clock and --baud")
    folder = out or Path("build/board") / (target or "table")
    chosen = None if target is None else board(target)
    if table:
        from golden.files import check_target

        check_target(folder / job.TABLE)
    else:
        job.check_out(folder)
    integer = IntegerModel.load(model)
    options = {"seed": seed, "seeds": seeds}
    if table:
        with _progress() as report:
            rows = job.table(integer.config, integer.arrays, folder, **options, progress=report)
        _table(f"best of {seeds} seeds" if seeds > 1 else f"seed {seed}", *job.TABLE_COLUMNS, rows=rows)
        console.print(f"files: {escape(str(folder))}")
        return
    config = integer.config.with_lanes(lanes or 1, lane_type or job.suited_lane_type(integer.config, chosen))
    try:
        with _progress() as report:
            result, *files = job.build(
                config, integer.arrays, chosen, link=link, clock_hz=clock, baud=baud, **options, progress=report
            )
    except job.BuildError as error:
        _stop(str(error), 1)
    job.write(result, *files, folder)
    _table("build", "what", "value", rows=job.figures(result))
    _table("cells by block", *job.BLOCK_COLUMNS, rows=job.block_rows(result))
    console.print(f"files: {escape(str(folder))}")
    if not result["clock_met"]:
        _stop(job.clock_sentence(result), 1)


@app.command(epilog="Example: eskin replay model --port /dev/ttyUSB1 --data recordings.npz --recordings 40")
def replay(
    model: Annotated[Path, typer.Argument(help="The quantised model folder that the bitstream was built from.")],
    port: Annotated[str, typer.Option(help="The board's serial port.")],
    data: Annotated[str, typer.Option(help=DATA)],
    recordings: Annotated[str, typer.Option(metavar="N|all", help="How many, the same every time, spread over the classes.")] = "all",
    baud: Annotated[int, typer.Option(min=1, help="Bits a second that the bitstream was built for.")] = 2_000_000,
    lanes: Annotated[int, typer.Option(help="Lanes that the bitstream was built with.")] = 1,
    lane_type: Annotated[LaneType | None, typer.Option(help="Lanes that the bitstream was built with; default plain.")] = None,
    json: Annotated[Path | None, typer.Option(help="Also write the result as JSON.")] = None,
) -> None:
    """Play recordings to a board over its serial line and compare its decisions with the golden model's."""
    from golden.files import check_target, write_json
    from golden.model import IntegerModel
    from scripts.replay_job import replay as play

    check_target(json)
    count = _count(recordings)
    integer = IntegerModel.load(model).with_lanes(lanes, lane_type)
    loaded = _for_model(data, integer.config)
    numbers = loaded.evenly(len(loaded) if count is None else count)
    with _progress() as report:
        result = play(
            integer, loaded.subset(numbers), numbers=numbers, port=port, baud=baud,
            progress=lambda done, total: report("frames played", done, total),
        )  # fmt: skip
    if json:
        write_json(json, result)
    verdict = "equal" if result["passed"] else f"{result['mismatches']} MISMATCHES"
    lost = f"{result['repeated']} packets sent again, {result['damaged']} came back damaged, {result['replayed']} recordings played again"
    rows = [
        ("verdict", f"{verdict}: {result['decisions']} decisions of {result['recordings']} recordings, {result['compared_values']} values"),
        ("pace", f"{result['frames']} frames in {result['wall_s']:.1f} s, {result['frames_per_s']} a second"),
        ("line", f"{port}, {baud} baud; {lost}"),
    ]
    _table("replay", "what", "value", rows=rows)
    for sentence in result["mismatch_list"]:
        console.print(f"mismatch: {escape(sentence)}")
    if not result["passed"]:
        console.print("where most decisions differ, the bitstream is of another model, or of other --lanes or --lane-type", soft_wrap=True)
        raise typer.Exit(1)


@app.command(epilog="Example: eskin schedule model --lanes 4 --out picture")
def schedule(
    model: Annotated[str, typer.Argument(help="A model folder, or a preset: thesis, synthetic, pvdf, fabric.")],
    lanes: Annotated[int | None, typer.Option(help="Multipliers that work at once; default 4.")] = None,
    lane_type: LaneTypeOption = None,
    out: Annotated[Path | None, typer.Option(help="Folder of the files; default build/schedule, with --table none.")] = None,
    table: Annotated[bool, typer.Option("--table", help="Cycles against the ideal for every cell, three sizes and 1 to 12 lanes.")] = False,
    complexity: Annotated[bool, typer.Option("--complexity", help="Cycles and memory against taxels and against classes.")] = False,
) -> None:
    """Draw which unit does what in which cycle, from the very program that goes into the hardware."""
    from golden.config import PRESETS
    from golden.files import check_target
    from rtl import schedule_view

    if table and (complexity or lanes is not None or lane_type is not None):
        extra = "--complexity" if complexity else "--lanes" if lanes is not None else "--lane-type"
        raise InputError(f"--table: goes through lanes and sizes by itself; leave out {extra}")
    if model in PRESETS:
        config = PRESETS[model]
    else:
        from golden.model import load_config

        config = load_config(model)
    config = config.with_lanes(lanes, lane_type)
    folder = out or Path("build/schedule")
    check_target(folder / "schedule")
    if table:
        rows = schedule_view.ratio_table(config)
        files = schedule_view.table_files(rows) if out else {}
        shown = ("cycles of a step against the ideal", schedule_view.RATIO_COLUMNS, [schedule_view.ratio_cells(row) for row in rows])
    elif complexity:
        from rtl import complexity as costs

        with _progress() as report:
            sweeps = costs.complexity(config, report)
        files = costs.files(config, sweeps)
        shown = ("complexity", costs.COLUMNS, [costs.cells(point) for sweep in sweeps.values() for point in sweep])
    else:
        from rtl.schedule import schedule as plan_step

        plan = plan_step(config)
        files = schedule_view.drawing_files(plan)
        shown = (schedule_view.title(plan).partition("\n")[0], ("what", "value"), schedule_view.figures(plan))
    _write_files(folder, files)
    _table(shown[0], *shown[1], rows=shown[2])
    if table:
        console.print(schedule_view.RATIO_NOTE, soft_wrap=True)
    if files:
        console.print(f"files: {escape(', '.join(str(folder / name) for name in files))}", soft_wrap=True)


def _write_files(folder: Path, files: dict[str, Callable[[Path], None]]) -> None:
    """Write each file whole into ``folder``; every name is checked before the first is written."""
    from golden.files import check_target, replacing

    for name in files:
        check_target(folder / name)
    for name, write in files.items():
        with replacing(folder / name) as temporary:
            write(temporary)


@app.command(epilog="Example: eskin run --data recordings.npz --recordings 40 --out result")
def run(
    data: Annotated[str, typer.Option(help=DATA)] = "synthetic",
    config: Annotated[str | None, typer.Option(help=CONFIG)] = None,
    recordings: Annotated[str | None, typer.Option(metavar="N|all", help="Co-simulated ones; default: 8 a class, or all of few.")] = None,
    out: Annotated[Path, typer.Option(help="The result folder: new, or an earlier result, which is replaced.")] = Path("build/run"),
    seed: Annotated[int, typer.Option(min=0, max=SEED_MAX, help="First seed of the training.")] = 0,
) -> None:
    """Do the main job: train, quantise, evaluate, generate, co-simulate, and report, all in one folder."""
    count = None if recordings is None else _count(recordings) or sys.maxsize
    from golden.report import PAGE, summary
    from scripts.main_job import run as main_job

    record = main_job(data, config, count, out, seed=seed, console=messages if messages.is_terminal else Console(quiet=True))
    console.print(summary(out))
    console.print(f"report: {escape(str(out / PAGE))}")
    if not record["passed"]:
        raise typer.Exit(1)


@app.command(epilog="Example: eskin sweep --data recordings.npz --accuracy-floor 0.95 --latency-budget 100e-6")
def sweep(
    data: Annotated[str, typer.Option(help=DATA)],
    out: Annotated[Path, typer.Option(help="Folder of sweep.json, sweep.csv and the charts.")] = Path("build/sweep"),
    config: Annotated[str | None, typer.Option(help=CONFIG)] = None,
    grid: Annotated[
        str, typer.Option(help="A JSON file: {field: list of values} or a list of such; or default (84 points) or bits (8, 6, 4 bits).")
    ] = "default",
    accuracy_floor: Annotated[float | None, typer.Option(help="Share of unseen recordings to be decided rightly, 0 to 1.")] = None,
    latency_budget: Annotated[float | None, typer.Option(help="Seconds from a window's features to its decision.")] = None,
    energy_budget: Annotated[
        float | None, typer.Option(help="Joule of a touch, waiting for its frames included (estimate: iCE40UP5K, clock stops when idle).")
    ] = None,
    group: Annotated[str | None, typer.Option(help="Group arrays A[,B..] of one split; default: the configuration's splits.")] = None,
    folds: Annotated[int, typer.Option(min=2, help="Folds of each split.")] = 5,
    seed: Annotated[int, typer.Option(min=0, max=SEED_MAX, help="First seed.")] = 0,
    seeds: Annotated[int, typer.Option(min=1, max=100, help="Seeds that every point is trained with.")] = 3,
    dask: Annotated[str | None, typer.Option(metavar="ADDRESS", help="A dask scheduler whose workers train; default: all cores.")] = None,
    baselines: Annotated[bool, typer.Option(help="Logistic regression, SVM and CNN on the same splits.")] = True,
    skipping: Annotated[bool, typer.Option(help="The configuration's network with delta updates and with pruned weights.")] = True,
    all_points: Annotated[bool, typer.Option("--all-points", help="List every point, and its accuracy for each group left out.")] = False,
) -> None:
    """Train and quantise a grid of networks, chart accuracy against cost, and name the smallest that is enough."""
    bounds = (("--accuracy-floor", accuracy_floor), ("--latency-budget", latency_budget), ("--energy-budget", energy_budget))
    for (name, value), most in zip(bounds, (1.0, math.inf, math.inf), strict=True):
        if value is not None and not (0 < value <= most and math.isfinite(value)):
            raise InputError(f"{name} {value}: is out of range; give a number above 0" + (f" and at most {most:g}" if most == 1.0 else ""))
    from scripts.sweep_job import CONFIG as CHOSEN
    from scripts.sweep_job import run as sweep_job

    recordings, asked = _load(data, config)
    chosen = _fitting(recordings, asked)
    groups = None if group is None else _names(group)
    with _progress() as report:
        result = sweep_job(
            recordings, chosen, out=out, grid=grid, group=groups, folds=folds, seed=seed, seeds=seeds, accuracy_floor=accuracy_floor,
            latency_budget=latency_budget, energy_budget=energy_budget, dask=dask, baselines=baselines, skipping=skipping, progress=report,
        )  # fmt: skip
    _show_sweep(result, all_points)
    widths = result["points"][result["recommended"]]["widths"].items()
    options = "".join(f" --{name.replace('_', '-')} {bits}" for name, bits in widths)
    console.print(f"recommended: {escape(result['recommendation']['sentence'])}", soft_wrap=True)
    first = f"eskin train --data {data} --config {out / CHOSEN} --out MODEL"
    aware = result["points"][result["recommended"]]["config"]["quantisation_aware"]
    commands = f"{first} --quantisation-aware{options}" if aware else f"{first}, then eskin quantise MODEL{options}"
    console.print(f"to have it: {escape(commands)}", soft_wrap=True)
    console.print(f"files: {escape(str(out))}")


def _mean_and_spread(accuracy: float, by_seed: list[float]) -> str:
    import numpy as np

    return f"{100 * accuracy:.1f}" + (f" ± {100 * np.std(by_seed, ddof=1):.1f}" if len(by_seed) > 1 else "")


def _show_sweep(result: dict[str, Any], all_points: bool) -> None:
    from golden.sweep import split_name

    def accuracies(record: dict[str, Any]) -> tuple[str, ...]:
        return tuple(_mean_and_spread(split["accuracy"], split["by_seed"]) for split in record["splits"])

    splits = result["points"][0]["splits"]
    names = [f"unseen {split_name(split['groups'])} (%)" for split in splits]
    shown = result["points"] if all_points else sorted((p for p in result["points"] if p["on_front"]), key=lambda p: p["latency_s"])
    rows = [
        (point["name"], *accuracies(point), _percent(point["agreement"]), point["cycles_step"], f"{1e6 * point['latency_s']:.4g}",
         point["multiplies_decision"], point["weight_memory_bits"], f"{1e6 * point['compute_j']:.3g}", f"{1e6 * point['energy_j']:.4g}")
        for point in shown
    ]  # fmt: skip
    costs = ("agreement", "cycles a step", "latency (us)", "multiplies a decision", "weight bits", "compute (uJ)", "with waiting (uJ)")
    _table(f"{'all' if all_points else 'front of'} {len(result['points'])} points", "point", *names, *costs, rows=rows)
    if all_points:
        for number, name in enumerate(names):
            _show_one_split(result["points"], number, name)
    rows = [(b["label"], *accuracies(b), b["parameters"], b["multiplies_decision"]) for b in result["baselines"]]
    if rows:
        _table("without a recurrent cell", "baseline", *names, "parameters", "multiplies a decision", rows=rows)
    if result["skipping"]:
        _show_skipping(result["skipping"])
    for refused in result["refused"]:
        messages.print(f"left out: {escape(refused['name'])}: {escape(refused['reason'])}", soft_wrap=True)


def _show_one_split(points: list[dict[str, Any]], number: int, name: str) -> None:
    """Float, integer and agreement of every point, and the groups left out one by one where they are few."""
    left_out = [fold["held_out"] for fold in points[0]["splits"][number]["per_fold"]]
    rows = []
    for point in points:
        split = point["splits"][number]
        folds = (_mean_and_spread(fold["accuracy"], fold["by_seed"]) for fold in split["per_fold"])
        rows.append(
            (point["name"], _mean_and_spread(split["float_accuracy"], split["float_by_seed"]),
             _mean_and_spread(split["accuracy"], split["by_seed"]), _percent(split["agreement"]), *folds)
        )  # fmt: skip
    _table(name, "point", "float", "integer", "agreement", *left_out, rows=rows)


def _show_skipping(skipping: list[dict[str, Any]]) -> None:
    """Rows of the split that is judged; the others stand in skipping.csv."""
    from golden.sweep import split_name, thresholds_in_words

    judged = [row for row in skipping if row["groups"] == skipping[0]["groups"]]
    joules = {
        "declared clock": lambda row: row["declared_clock_j"],
        "lowest clock": lambda row: row["lowest_clock_j"],
        "stopped clock": lambda row: row["stopped_clock_j"],
        "the same above rest": lambda row: row["stopped_clock_j"] - row["static_j"],
    }
    rows = []
    for row in judged:
        energies = (f"{1e6 * of(row):.4g} ({100 * (of(row) / of(judged[0]) - 1):+.2f} %)" for of in joules.values())
        rows.append(
            (f"{100 * row['pruned']:g} %", thresholds_in_words(row), f"{100 * row['skipped']:.1f} %",
             _mean_and_spread(row["accuracy"], row["by_seed"]), _percent(row["agreement"]), *energies)
        )  # fmt: skip
    name = f"unseen {split_name(judged[0]['groups'])} (%)"
    columns = ("pruned", "thresholds", "skipped", name, "agreement", *(f"{each} (uJ)" for each in joules))
    _table("skipped work; energy of a touch is an estimate within a factor of two", *columns, rows=rows)


@app.command(epilog="Example: eskin stability model --data recordings.npz --out build/stability")
def stability(
    model: Annotated[Path, typer.Argument(help="A quantised model folder.")],
    data: Annotated[str, typer.Option(help=DATA)],
    out: Annotated[Path, typer.Option(help="Folder of stability.html, stability.json, recommended.json.")] = Path("build/stability"),
    mode: Annotated[list[str] | None, typer.Option(help="Only this mode; may be given again.")] = None,
    cosim: Annotated[bool, typer.Option(help="Confirm the weakest cases in co-simulation.")] = True,
    defences: Annotated[bool, typer.Option(help="Train with and without defences, cross-validated.")] = True,
    few: Annotated[int, typer.Option(min=1, help="Recordings of each point of a curve; the figures take all.")] = 100,
    seeds: Annotated[int, typer.Option(min=1, max=100, help="Seeds of the comparison of defences.")] = 3,
) -> None:
    """Show where the method fails: every failure mode with a figure, a bound and a curve, and what defences save and cost."""
    from golden.model import load_config
    from scripts.stability_job import run as stability_job

    recordings = _for_model(data, load_config(model))
    with _progress() as report:
        result = stability_job(
            model, recordings, out=out, names=mode or None, cosim=cosim, compare=defences and not mode, few=few, seeds=seeds,
            progress=report,
        )  # fmt: skip
    _show_stability(result)
    console.print(f"page: {escape(str(out / 'stability.html'))}")
    if not result["passed"]:
        raise typer.Exit(1)


def _show_stability(result: dict[str, Any]) -> None:
    from golden.stability_page import COSTS, costs_in_words
    from golden.stability_page import figure_in_words as words

    rows = [
        (record["name"], record["group"], words(record["value"], record["unit"]), record["sense"], words(record["bound"], record["unit"]),
         "held" if record["passed"] else "FAILED", record["unit"],
         "" if not record["rtl"] else "bit-exact" if record["rtl"]["bit_exact"] else "DIFFERS")
        for record in result["modes"]
    ]  # fmt: skip
    columns = ("mode", "group", "figure", "", "bound", "verdict", "unit", "RTL")
    title = f"{len(rows)} failure modes, {result['recordings']} recordings, undisturbed {_percent(result['clean_accuracy'])}"
    _table(title, *columns, rows=rows)
    for entry in result["not_run"]:
        console.print(f"not run: {escape(entry['name'])}: {escape(entry['why'])}", soft_wrap=True)
    if result["defences"]:
        names = [" and ".join(split["groups"]) or "recordings" for split in result["defences"][0]["clean"]]
        rows = [
            (record["name"], *(_percent(split["accuracy"]) for split in record["clean"]),
             *(f"{_percent(record[kind]['mean'])} / {_percent(record[kind]['worst'])}" for kind in ("dead", "stuck", "stuck, masked")),
             *costs_in_words(record["hardware"]))
            for record in result["defences"]
        ]  # fmt: skip
        faults = ("one dead: mean / worst", "one sticks", "the same, masked")
        columns = (*(f"clean, unseen {name}" for name in names), *faults, *COSTS.values())
        _table("defences on unseen recordings, and in hardware", "defences", *columns, rows=rows)
        for split in result["defences"][-1]["margin"]:
            group = " and ".join(split["groups"]) or "recordings"
            console.print(f"margin of at least {split['threshold']}: {_percent(split['coverage'])} of unseen {group} confident, "
                          f"{_percent(split['accuracy'])} of them right (all: {_percent(split['without'])})")
    console.print(f"weakest: {', '.join(result['weakest'])}", soft_wrap=True)


def _names(group: str) -> list[str]:
    """Group names of ``--group A,B``."""
    return [name.strip() for name in group.split(",") if name.strip()]


@app.command(epilog="Example: eskin energy model --data recordings.npz --configuration icebreaker:6 --configuration ulx3s:12")
def energy(
    model: Annotated[Path, typer.Argument(help="A quantised model folder.")],
    data: Annotated[str, typer.Option(help=DATA)],
    configuration: Annotated[
        list[str] | None,
        typer.Option(metavar="TARGET:LANES[:TYPE]", help="A board, its lanes and their type; may be given several times."),
    ] = None,
    recordings: Annotated[int, typer.Option(min=1, help="Recordings whose activity is counted.")] = 2,
    out: Annotated[Path, typer.Option(help="Folder of energy.json and energy.html.")] = Path("build/energy"),
) -> None:
    """Estimate energy of a touch and power of waiting, from activity counted in co-simulated netlists; minutes a configuration."""
    from golden.energy_page import PAGE
    from golden.files import check_target
    from golden.model import IntegerModel
    from scripts.energy_job import CONFIGURATIONS, RESULT, job

    check_target(out / RESULT)
    integer = IntegerModel.load(model)
    loaded = _for_model(data, integer.config)
    with _work_folder(Path("build/cosim")) as work, _progress() as report:
        result = job(integer, loaded, configuration or CONFIGURATIONS, count=recordings, out=out, work=work, notify=report)
    _show_energy(result)
    console.print(f"page: {escape(str(out / PAGE))}")
    if not result["passed"]:
        raise typer.Exit(1)


def _show_energy(result: dict[str, Any]) -> None:
    from golden.report import hertz, unit

    rows = [
        (row["name"], f"{row['activity']['step_cycles']:g}", unit(row["per_step_j"], "J"), unit(row["per_touch_j"], "J"),
         f"{row['band']:g}", unit(row["preprocessing_per_touch_j"], "J"), "yes" if row["bit_exact"] else "NO")
        for row in result["configurations"]
    ]  # fmt: skip
    columns = ("configuration", "cycles a step", "a step", "a touch", "band ÷ ×", "preprocessing", "bit-exact")
    _table("compute energy, estimate", *columns, rows=rows)
    rows = [
        (row["name"], choice["name"], hertz(choice["clock_hz"]), unit(choice["idle_w"], "W"), unit(choice["average_w"], "W"),
         f"{choice['average_w'] / row['static_w']:.2f}", f"{choice['hours']:.0f} h")
        for row in result["configurations"] for choice in row["choices"]
    ]  # fmt: skip
    columns = ("configuration", "clock", "frequency", "idle", "one touch a second", "over static", "1000 mAh, 5 V")
    _table("power, estimate", *columns, rows=rows)
    if result["least_average"]:
        console.print(f"least energy a touch: {escape(result['least_touch'])}")
        console.print(f"least average power: {escape(result['least_average']['name'])}, {escape(result['least_average']['choice'])}")
    for check in result["checks"]:
        value, limit = (unit(check[key], check["unit"]) if check["unit"] else f"{check[key]:.2f}" for key in ("value", "limit"))
        console.print(f"{escape(check['name'])}: {value}, aim {limit}: {'met' if check['met'] else 'missed'}", soft_wrap=True)




@app.command("leak-check", epilog="Example: eskin leak-check --data recordings.npz --group person")
def leak_check(
    data: Annotated[str, typer.Option(help=DATA)],
    config: Annotated[str | None, typer.Option(help=CONFIG)] = None,
    group: Annotated[str | None, typer.Option(help="Group arrays A[,B..] of one split; default: the configuration's splits.")] = None,
    folds: Annotated[int, typer.Option(min=2, help="Folds of each split.")] = 5,
    seed: Annotated[int, typer.Option(min=0, max=SEED_MAX, help="First seed.")] = 0,
    seeds: Annotated[int, typer.Option(min=1, max=100, help="Number of seeds.")] = 3,
    left_in: Annotated[int, typer.Option(min=0, help="Frames of the touch that stay in: above 0 it shows what a leak looks like.")] = 0,
    json: Annotated[Path | None, typer.Option(help="Also write the figures as JSON.")] = None,
) -> None:
    """Take the touch out of every unseen recording: networks that still know its class know it from elsewhere."""
    from golden.files import check_target, write_json
    from golden.leak_check import leak_check as check
    from golden.sweep import split_name
    from golden.train import default_splits

    check_target(json)
    recordings, asked = _load(data, config)
    chosen = _fitting(recordings, asked)
    splits = default_splits(recordings, chosen) if group is None else [_names(group)]
    with _progress() as report:
        result = check(recordings, chosen, splits, range(seed, seed + seeds), folds=folds, left_in=left_in, progress=report)
    if json:
        write_json(json, result)
    rows = [
        (split_name(row["groups"]), row["recordings"], _percent(row["accuracy"]), _percent(row["without_touch"]), _percent(row["chance"]),
         _percent(row["limit"]), "no leak" if row["passed"] else "LEAK")
        for row in result
    ]  # fmt: skip
    columns = ("unseen", "recordings", "as recorded", "without the touch", "chance", "limit", "verdict")
    _table("accuracy with the touch replaced by the recording's own quiet lead-in", *columns, rows=rows)
    if result[0]["no_lead_in"]:
        messages.print(f"left out: {result[0]['no_lead_in']} recordings without an onset or a quiet lead-in before it")
    if not all(row["passed"] for row in result):
        raise typer.Exit(1)


@app.command(epilog="Example: eskin report build/run")
def report(folder: Annotated[Path, typer.Argument(metavar="DIR", help="A folder that eskin run wrote.")]) -> None:
    """Make the HTML page of a result folder again and print its summary."""
    from golden.report import summary, write_report

    page = write_report(folder)
    console.print(summary(folder))
    console.print(f"report: {escape(str(page))}")


if __name__ == "__main__":
    main()
