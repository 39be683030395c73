"""Requests: one dataclass per verb holds its options. Command line, Python and jobs use the same class; the
annotation of a field holds its help text and its spelling on the command line.

Options that several verbs share are in a base class. ``option`` and ``argument`` are typer's.
"""

import sys
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from eskin.golden.core import InputError

Prefer = Literal["energy", "cells", "latency"]
Readout = Literal["dense", "prototypes"]
"""Rule of the decision: the logits of the dense layer, or the nearest stored trajectory."""
Cell = Literal["gru", "lstm", "linear"]
Reset = Literal["before", "after"]
CellChoice = Literal["gru", "lstm", "linear", "tactnet", "tactnet-half", "four", "four-lean", "auto"]
"""Cells, networks for images, and auto: the smallest network that is enough."""
FORMATS = ("feature_bits", "gate_bits", "table_entries")
"""Values that ``quantise --formats`` sets."""
SEED_MAX = 2**31 - 1
STRESS = "on"
"""Default of --stress for `train` and `run`."""
DATA = "Recordings: .npz, a folder by class, a table, .mat, .h5, a log, or synthetic."
CONFIG = "Preset (thesis, synthetic, pvdf, fabric) or JSON file. Default: derived."


def option(help: str, *names: str, **settings: Any) -> Any:
    """An option of a verb; ``names`` where it is not the field's, ``settings`` as `typer.Option` takes them."""
    return typer.Option(*names, help=help, **settings)


def argument(help: str, **settings: Any) -> Any:
    """An argument of a verb."""
    return typer.Argument(help=help, **settings)


Seed = Annotated[int, option("First seed; the written model uses it.", min=0, max=SEED_MAX)]
Lanes = Annotated[
    str | None,
    option("Parallel multipliers, such as 4 or 4:dsp (iCE40 DSP blocks). Default: 4.", metavar="P[:TYPE]"),
]
Liberty = Annotated[
    list[Path], option("Liberty file of the process (.lib, .lib.gz); may be repeated.", metavar="FILE")
]


ModelOut = Annotated[Path, option("Model folder: new, or an earlier model to replace.")]
GateOfReset = Annotated[Reset | None, option("GRU: reset gate before or after the recurrent product.")]


def parse_names(text: str) -> list[str]:
    """The names in ``A,B``."""
    return [name.strip() for name in text.split(",") if name.strip()]


def parse_count(text: str) -> int:
    """The number in ``N|all``; all: more than there are of anything."""
    if text == "all":
        return sys.maxsize
    if not (text.isdecimal() and len(text) < 10 and int(text)):
        raise InputError(f"--recordings {text[:20]}: is not a number of recordings; give 1 or more, or all")
    return int(text)


def parse_lanes(text: str | None) -> tuple[int | None, Any]:
    """(lanes, their type) of ``P[:TYPE]``; None where it is not said."""
    number, colon, kind = (text or "").partition(":")
    if text is None:
        return None, None
    if not (number.isdecimal() and len(number) < 4) or (colon and kind not in ("plain", "dsp")):
        raise InputError(
            f"--lanes {text[:20]}: is not of the form P[:TYPE]; give a number and maybe plain or dsp, such as 4:dsp"
        )
    return int(number), kind or None


# ---------------------------------------------------------------------- what verbs share
class GroupOptions:
    """A request that names group arrays."""

    group: str | None

    @property
    def groups(self) -> list[str] | None:
        """The names of ``group``; None where it is not given."""
        return None if self.group is None else parse_names(self.group)


@dataclass(frozen=True, kw_only=True)
class ModelOptions:
    model: Annotated[Path, argument("A quantised model folder.")]


@dataclass(frozen=True, kw_only=True)
class DataOptions:
    data: Annotated[str, option(DATA)]


@dataclass(frozen=True, kw_only=True)
class ModelDataOptions(ModelOptions, DataOptions):
    """A model and recordings for it."""


@dataclass(frozen=True, kw_only=True)
class JsonOptions:
    json: Annotated[Path | None, option("Also write the result as JSON.")] = None


@dataclass(frozen=True, kw_only=True)
class ClusterOptions:
    dask: Annotated[
        str | None,
        option("A dask scheduler, tcp://HOST:PORT. Default: one process per core.", metavar="ADDRESS"),
    ] = None


@dataclass(frozen=True, kw_only=True)
class FrontEndOptions(DataOptions):
    """Recordings, and the front end that they go through."""

    config: Annotated[str | None, option(CONFIG)] = None


@dataclass(frozen=True, kw_only=True)
class EvaluationOptions(GroupOptions, DataOptions):
    """Recordings to judge networks on, by what is left out."""

    group: Annotated[
        str | None, option("Groups A[,B..] to leave out together. Default: the configuration's splits.")
    ] = None


@dataclass(frozen=True, kw_only=True)
class ChoiceOptions(GroupOptions, FrontEndOptions):
    """Recordings to choose, judge and train a network on; what is not asked for is chosen."""

    group: Annotated[str | None, option("Group arrays A[,B..] kept on one side of every split.")] = None
    cell: Annotated[
        CellChoice | None, option("Cell, or network for images. auto: the cheapest that is good enough.")
    ] = None
    hidden: Annotated[int | None, option("Hidden units.")] = None
    seeds: Annotated[
        int | None, option("Seeds of the cross-validation. Default: 3; images 1.", min=1, max=100)
    ] = None
    prefer: Annotated[Prefer, option("Cost to minimise among candidates as good as the best.")] = "energy"
    fits: Annotated[
        str | None,
        option("Board that must hold the design. Default: icebreaker, if possible.", metavar="BOARD"),
    ] = None
    stress: Annotated[
        str,
        option(
            "Judge candidates on disturbed recordings, too: on, off, or a JSON file of weights.",
            metavar="on|off|FILE",
        ),
    ] = STRESS


# ---------------------------------------------------------------------- recordings
@dataclass(frozen=True, kw_only=True)
class InspectRequest(JsonOptions):
    data: Annotated[str, argument(DATA)]
    out: Annotated[Path | None, option("Picture to write. Default: build/inspect/NAME.png.")] = None
    card: Annotated[
        bool, option("Also write a data card, README.md, in a folder named like the picture.", "--card")
    ] = False


@dataclass(frozen=True, kw_only=True)
class ConvertRequest:
    source: Annotated[
        Path,
        argument(
            "A folder by class of .csv, .parquet or .lvm files or logs, one long .csv or .parquet table, a "
            ".mat or .h5 file, a log (.mcap, a ROS bag), an archive of images."
        ),
    ]
    out: Annotated[Path, option("Archive to write, FILE.npz.")]
    rate: Annotated[
        float | None, option("Frames per second. Default: from the time column.", metavar="HZ")
    ] = None
    columns: Annotated[
        str | None, option("Taxel columns: names, or numbers from 1 such as 2-17.", metavar="A,B..")
    ] = None
    recording: Annotated[
        str | None, option("Long table: column that names a row's recording.", metavar="COLUMN")
    ] = None
    class_: Annotated[
        str | None,
        option("Column, attribute, array or topic that names the class.", "--class", metavar="NAME"),
    ] = None
    delimiter: Annotated[str | None, option("Separator of cells: a character, tab or blank.")] = None
    samples: Annotated[
        str | None, option("Array (.mat, .h5) or topic (log) of the samples.", metavar="NAME")
    ] = None
    labels: Annotated[
        Path | None,
        option("Log: .csv table of start, end (s) and class, one row per recording.", metavar="FILE"),
    ] = None
    clock: Annotated[Literal["log", "header"], option("Log: clock of frames and labels.")] = "log"
    scale: Annotated[
        float | None, option("Value of one code. Default: 1 for integers, else from the data.")
    ] = None
    like: Annotated[
        Path | None,
        option("Take scale, columns, classes and rate from this model or archive.", metavar="MODEL|FILE"),
    ] = None


@dataclass(frozen=True, kw_only=True)
class WatchRequest(ModelOptions):
    data: Annotated[str | None, option(f"Recordings to play. {DATA}")] = None
    port: Annotated[str | None, option("Serial port of a board. Without --data: show its own sensor.")] = None
    simulate: Annotated[bool, option("Also simulate the RTL and compare it in lock step.", "--simulate")] = (
        False
    )
    host_port: Annotated[int, option("TCP port of the page; 0: any free one.", min=0, max=65535)] = 8765


# ---------------------------------------------------------------------- networks
@dataclass(frozen=True, kw_only=True)
class RunRequest(ChoiceOptions):
    data: Annotated[str, option(DATA)] = "synthetic"
    recordings: Annotated[
        str | None, option("Recordings to co-simulate. Default: 8 per class.", metavar="N|all")
    ] = None
    out: Annotated[Path, option("Result folder: new, or an earlier result to replace.")] = Path("build/run")
    test: Annotated[
        str | None, option("Recordings held back, used once for a separate accuracy.", metavar="HELD")
    ] = None
    name: Annotated[str | None, option("Title of the report. Default: name of the data.")] = None

    @property
    def count(self) -> int | None:
        """The number of ``recordings``; None where it is not given."""
        return None if self.recordings is None else parse_count(self.recordings)


@dataclass(frozen=True, kw_only=True)
class ReportRequest:
    folder: Annotated[Path, argument("A folder that eskin run wrote.", metavar="DIR")]


@dataclass(frozen=True, kw_only=True)
class TrainRequest(ChoiceOptions):
    out: ModelOut
    reset: GateOfReset = None
    folds: Annotated[int, option("Folds of the cross-validation; 0: none.")] = 5
    seed: Seed = 0
    protocol: Annotated[
        Literal["default", "robust", "thesis"], option("Training recipe; robust trains with failing taxels.")
    ] = "default"


ENROL_MODES = {
    "evaluate": (("evaluate", "data", "group"), ("readout", "k", "config", "seeds")),
    "teach": (("model", "teach", "out"), ()),
    "train": (("model", "data", "out"), ("with_",)),
}
"""Options of `eskin enrol`: what each mode needs, and what else it takes."""


@dataclass(frozen=True, kw_only=True)
class EnrolRequest(GroupOptions, JsonOptions):
    model: Annotated[Path | None, argument("A quantised model folder; it is not changed.")] = None
    data: Annotated[
        str | None, option(f"Touches to train on, 1 to 5 per class; with --evaluate all. {DATA}")
    ] = None
    out: Annotated[
        Path | None, option("Folder of the enrolled model: new, or an earlier model to replace.")
    ] = None
    with_: Annotated[
        str | None,
        option("Recordings of the first training, so that they are not forgotten.", "--with", metavar="D"),
    ] = None
    teach: Annotated[
        str | None, option("Touches to store as prototypes; nothing is trained.", "--teach", metavar="FEW")
    ] = None
    evaluate: Annotated[
        bool, option("Report the gain for each value of --group left out of the training.", "--evaluate")
    ] = False
    readout: Annotated[
        Readout, option("With --evaluate: dense trains further, prototypes stores touches.")
    ] = "dense"
    group: Annotated[
        str | None, option("With --evaluate: group arrays A[,B..], such as mounting or person.")
    ] = None
    k: Annotated[str, option("With --evaluate: touches to enrol per class.", "-k", metavar="K[,K..]")] = (
        "1,2,5"
    )
    config: Annotated[str | None, option(f"With --evaluate. {CONFIG}")] = None
    seeds: Annotated[int, option("With --evaluate: number of seeds.", min=1, max=1000)] = 3

    def check(self, mode: str) -> None:
        """Refuse what a mode (evaluate, teach, train) lacks, and what another mode takes."""
        needs, takes = ENROL_MODES[mode]
        for field in fields(self):
            given, name = getattr(self, field.name) != field.default, field.name.strip("_")
            where = f"eskin enrol{'' if mode == 'train' else f' --{mode}'}, {'MODEL' if name == 'model' else f'--{name}'}"
            if field.name in needs and not given:
                raise InputError(
                    f"{where}: is missing; give {', '.join(needs)}, or another mode (--evaluate, --teach FEW)"
                )
            if given and field.name not in (*needs, *takes, "json"):
                raise InputError(f"{where}: belongs to another mode; leave it out")

    @property
    def ks(self) -> list[int]:
        """The numbers of ``k``."""
        counts = [word.strip() for word in self.k.split(",")]
        if not all(word.isdecimal() and len(word) < 4 and 1 <= int(word) <= 100 for word in counts):
            raise InputError(
                f"-k {self.k[:40]}: is not a list of touches per class; give numbers from 1 to 100, such as 1,2,5"
            )
        return [int(word) for word in counts]


@dataclass(frozen=True, kw_only=True)
class QuantiseRequest(GroupOptions):
    model: Annotated[Path, argument("A model folder.")]
    data: Annotated[
        str | None, option("Measure value ranges on these recordings. Default: ranges from training.")
    ] = None
    weight_bits: Annotated[int | None, option("Bits of a weight.")] = None
    state_bits: Annotated[int | None, option("Bits of the hidden state.")] = None
    formats: Annotated[
        str | None,
        option(
            "lean (fewest cells), or feature_bits=B,gate_bits=B,table_entries=N.", metavar="NAME=N,..|lean"
        ),
    ] = None
    quantisation_aware: Annotated[
        bool, option("Train further in integers of these widths; needs --data.", "--quantisation-aware")
    ] = False
    readout: Annotated[
        Readout | None, option("Decide by the dense layer or by prototypes (needs --data).")
    ] = None
    group: Annotated[
        str | None, option("Prototypes: group arrays A,B.. to leave out. Default: the training's.")
    ] = None
    prototypes: Annotated[int | None, option("Prototypes: maximum per class. Default: 8.", min=1, max=16)] = (
        None
    )
    taught: Annotated[
        int | None, option("Prototypes: slots per class for taught touches. Default: 3.", min=0, max=16)
    ] = None
    unknown: Annotated[
        float | None,
        option("Prototypes: share of known touches that may be flagged unsure.", min=0.0, max=0.5),
    ] = None
    spare_classes: Annotated[
        int | None,
        option("Prototypes: number of last classes without recordings, to be taught later.", min=0, max=30),
    ] = None

    @property
    def widths(self) -> dict[str, Any]:
        """The widths that were given, by the names of ``eskin.training.quantise.choose_formats``."""
        bits = {"weight_bits": self.weight_bits, "state_bits": self.state_bits}
        widths: dict[str, Any] = {name: value for name, value in bits.items() if value is not None}
        if self.formats == "lean":
            return widths | {"lean": True}
        for word in parse_names(self.formats or ""):
            name, _, number = word.partition("=")
            if name not in FORMATS or not (number.isdecimal() and len(number) < 5):
                raise InputError(
                    f"--formats {word[:40]}: is not a format; give {', '.join(FORMATS)} with a number, such as "
                    "gate_bits=9, or the word lean"
                )
            widths[name] = int(number)
        return widths

    @property
    def readout_options(self) -> dict[str, Any]:
        """The user's options about prototypes."""
        names = ("groups", "prototypes", "taught", "unknown", "spare_classes")
        return {name: getattr(self, name) for name in names if getattr(self, name) is not None}


@dataclass(frozen=True, kw_only=True)
class EvaluateRequest(ModelDataOptions, JsonOptions):
    pass


@dataclass(frozen=True, kw_only=True)
class CompareRequest(ModelOptions, JsonOptions):
    data: Annotated[str | None, option(f"{DATA} Default: random touches.")] = None


@dataclass(frozen=True, kw_only=True)
class ImportRequest:
    file: Annotated[Path, argument("A torch state_dict (.pt, .pth), or an .onnx file.")]
    out: ModelOut
    config: Annotated[str | None, option("Configuration of the training: a preset or a JSON file.")] = None
    cell: Annotated[
        Cell | None, option("Cell. Default: the .onnx file's, otherwise the configuration's.")
    ] = None
    reset: GateOfReset = None
    mean: Annotated[float | None, option("Codes subtracted from every window mean in its training.")] = None
    std: Annotated[float | None, option("Codes by which its training divided.")] = None
    data: Annotated[str | None, option("Measure mean and std on these recordings.")] = None
    check: Annotated[
        Path | None, option("Reference inputs and outputs (.npz) that the model must reproduce.")
    ] = None


@dataclass(frozen=True, kw_only=True)
class ExportRequest(ModelOptions):
    to: Annotated[Literal["c", "onnx"], option("c: integer model as C99; onnx: float network.")]
    out: Annotated[Path, option("Folder to write: new, or an earlier export to replace.")]
    prefix: Annotated[str | None, option("C: prefix of all names. Default: eskin.")] = None


# ---------------------------------------------------------------------- studies
@dataclass(frozen=True, kw_only=True)
class SweepRequest(EvaluationOptions, FrontEndOptions, ClusterOptions):
    out: Annotated[Path, option("Folder of sweep.json, sweep.csv and the chart.")] = Path("build/sweep")
    grid: Annotated[str, option("default (84 points), or JSON: {field: [values]}.")] = "default"
    accuracy_floor: Annotated[float | None, option("Required accuracy on new recordings, 0 to 1.")] = None
    latency_budget: Annotated[float | None, option("Maximum time from features to decision, in seconds.")] = (
        None
    )


@dataclass(frozen=True, kw_only=True)
class BaselinesRequest(EvaluationOptions, ClusterOptions):
    out: Annotated[Path, option("Folder for baselines.json.")] = Path("build/baselines")


@dataclass(frozen=True, kw_only=True)
class StabilityRequest(ModelDataOptions, ClusterOptions):
    out: Annotated[Path, option("Folder for stability.html, stability.json and recommended.json.")] = Path(
        "build/stability"
    )
    mode: Annotated[list[str] | None, option("Only this mode; may be repeated.")] = None
    cosim: Annotated[bool, option("Confirm the weakest cases in co-simulation.")] = True
    defences: Annotated[
        bool | None, option("Compare training with and without defences. Default: without --mode.")
    ] = None
    few: Annotated[int, option("Recordings per point of a curve.", min=1)] = 100


# ---------------------------------------------------------------------- hardware
@dataclass(frozen=True, kw_only=True)
class LaneOptions(ModelOptions):
    lanes: Lanes = None


@dataclass(frozen=True, kw_only=True)
class ReplayRequest(ModelDataOptions, JsonOptions):
    model: Annotated[Path, argument("The quantised model folder that the bitstream was built from.")]
    port: Annotated[str, option("Serial port of the board.")]
    teach: Annotated[
        str | None, option("Teach the last touch of each recording as this class.", metavar="CLASS")
    ] = None
    save_taught: Annotated[
        Path | None,
        option("File (.npz) of taught touches: loaded first, written at the end.", metavar="FILE"),
    ] = None


@dataclass(frozen=True, kw_only=True)
class EnergyRequest(ModelDataOptions):
    configuration: Annotated[
        list[str] | None,
        option("Board, lanes and lane type; may be repeated.", metavar="TARGET:LANES[:TYPE]"),
    ] = None
    recordings: Annotated[int, option("Number of recordings to simulate.", min=1)] = 2
    out: Annotated[Path, option("Folder for energy.json.")] = Path("build/energy")


@dataclass(frozen=True, kw_only=True)
class ScheduleRequest:
    model: Annotated[str, argument("A model folder, or a preset: thesis, synthetic, pvdf, fabric.")]
    lanes: Lanes = None
    out: Annotated[Path, option("Folder for the files.")] = Path("build/schedule")


@dataclass(frozen=True, kw_only=True)
class GenerateRequest(LaneOptions):
    out: Annotated[Path, option("Folder to write: new, or an earlier design to replace.")]
    data: Annotated[
        str | None, option("The bench plays the first of these recordings. Default: a synthetic one.")
    ] = None
    bus: Annotated[
        Literal["wishbone", "axi4lite"] | None, option("Add a bus shell for a CPU, with a C driver.")
    ] = None
    streams: Annotated[
        Literal["axis"] | None, option("Take frames from an AXI-Stream; without --bus send decisions on one.")
    ] = None
    top: Annotated[
        str | None, option("Name of the top module, and prefix of all other names.", metavar="NAME")
    ] = None


@dataclass(frozen=True, kw_only=True)
class CosimRequest(ModelDataOptions, LaneOptions, JsonOptions, ClusterOptions):
    recordings: Annotated[str, option("Number of recordings, spread over the classes.", metavar="N|all")] = (
        "all"
    )
    simulator: Annotated[
        Literal["verilator", "icarus", "compiled"] | None,
        option("Simulator; compiled is for chips. Default: compiled for chips, else verilator."),
    ] = None
    jobs: Annotated[int | None, option("Recordings played side by side. Default: one per core.", min=1)] = (
        None
    )
    level: Annotated[Literal["rtl", "netlist"], option("Generated Verilog, or its netlist.")] = "rtl"
    target: Annotated[str | None, option("Part of the netlist: a board such as icebreaker, or asic.")] = None
    pdk: Annotated[str | None, option("Chip: ihp-sg13g2 or sky130hd.", metavar="NAME")] = None
    liberty: Annotated[
        list[Path] | None, option("Chip: a Liberty file of the process; may be repeated.", metavar="FILE")
    ] = None
    rom: Annotated[bool, option("Chip: weights and constants are in ROM.", "--rom")] = False
    converter: Annotated[
        str | None, option("Play frames to the pins of this converter; none: to the core.", metavar="NAME")
    ] = None
    pace: Annotated[
        Literal["full", "declared"], option("full: as fast as possible; declared: at the recordings' rate.")
    ] = "full"
    clock: Annotated[float | None, option("Clock for --pace declared.", metavar="HZ")] = None
    stalls: Annotated[bool, option("Insert random stalls at input and output.", "--stalls")] = False
    bench: Annotated[
        Literal["sample", "cocotb"],
        option("Recordings under cocotb: one per class (others in bulk), or all."),
    ] = "sample"


@dataclass(frozen=True, kw_only=True)
class BoardRequest(ModelOptions):
    target: Annotated[str, option("icebreaker, upduino, ulx3s or tangnano9k.", metavar="NAME")]
    lanes: Annotated[
        str | None,
        option("Parallel multipliers. Default: the model's, or as many as fit.", metavar="P[:TYPE]"),
    ] = None
    link: Annotated[bool, option("Include the serial link, or build onset to decision only.")] = True
    converter: Annotated[
        str | None,
        option("Read frames from this converter. Default with --standalone: the model's.", metavar="NAME"),
    ] = None
    stimulator: Annotated[
        bool, option("With a converter: decisions drive the stimulator.", "--stimulator")
    ] = False
    standalone: Annotated[
        bool, option("Build without a host: model in the bitstream, frames from a converter.", "--standalone")
    ] = False
    flash: Annotated[bool, option("With --standalone: load the model from the board's flash.", "--flash")] = (
        False
    )
    clock: Annotated[
        float | None, option("Target clock. Default: the board's oscillator.", min=1e3, metavar="HZ")
    ] = None
    seeds: Annotated[int, option("Number of placements to try; the fastest is kept.", min=1, max=1000)] = 1
    out: Annotated[
        Path | None, option("Folder to write: new, or an earlier build. Default: build/board/NAME.")
    ] = None


@dataclass(frozen=True, kw_only=True)
class AsicRequest(ModelOptions):
    pdk: Annotated[str, option("Process: ihp-sg13g2 or sky130hd.", metavar="NAME")]
    liberty: Liberty
    lanes: Annotated[int | None, option("Parallel multipliers. Default: the model's.")] = None
    rom: Annotated[
        bool, option("Put weights and constants in ROM; otherwise the host loads them.", "--rom")
    ] = False
    data: Annotated[
        str | None,
        option("Simulate one of these recordings for its energy; takes many minutes.", metavar="D"),
    ] = None
    out: Annotated[Path, option("Folder for asic.json, asic.md, netlist.v and accelerator.sdc.")] = Path(
        "build/asic"
    )
