"""Requests: what each verb is asked, a dataclass a verb. Command line, Python and jobs are made of it; a field's
annotation says what it means and, on the command line, how it is written.

What several verbs share is a base class. ``option`` and ``argument`` are typer's.
"""

import sys
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from eskin.golden.core import InputError

Prefer = Literal["energy", "cells", "latency"]
Readout = Literal["dense", "prototypes"]
"""What decides: the logits of the dense layer, or the nearest stored trajectory."""
Cell = Literal["gru", "lstm", "linear"]
Reset = Literal["before", "after"]
CellChoice = Literal["gru", "lstm", "linear", "tactnet", "tactnet-half", "four", "four-lean", "auto"]
"""Cells, networks for images, and auto: the smallest network that is enough."""
FORMATS = ("feature_bits", "gate_bits", "table_entries")
"""What ``quantise --formats`` sets."""
SEED_MAX = 2**31 - 1
STRESS = "off"
"""Whether `train` and `run` judge candidates under disturbance where nothing was said."""
DATA = (
    "An .npz archive, a folder of .csv, .parquet, .lvm or .png files or logs (one sub-folder a class), a long "
    ".csv or .parquet table, a .mat or .h5 file, or the word synthetic."
)
CONFIG = "A preset (thesis, synthetic, pvdf, fabric) or a JSON file; without it one is derived from the data."


def option(help: str, *names: str, **settings: Any) -> Any:
    """An option of a verb; ``names`` where it is not the field's, ``settings`` as `typer.Option` takes them."""
    return typer.Option(*names, help=help, **settings)


def argument(help: str, **settings: Any) -> Any:
    """An argument of a verb."""
    return typer.Argument(help=help, **settings)


Seed = Annotated[int, option("First seed, that of the model written.", min=0, max=SEED_MAX)]
Lanes = Annotated[
    str | None,
    option(
        "Multipliers that work at once, and what they are, such as 4 or 4:dsp (the iCE40's DSP blocks; else "
        "plain); default 4.",
        metavar="P[:TYPE]",
    ),
]
Liberty = Annotated[
    list[Path],
    option("The process's Liberty files, .gz too: cells and memory macros; several times.", metavar="FILE"),
]


ModelOut = Annotated[Path, option("The model folder: new, or an earlier model, which is replaced.")]
GateOfReset = Annotated[
    Reset | None, option("GRU only: the reset gate before or after the recurrent product.")
]


def names_of(text: str) -> list[str]:
    """The names in ``A,B``."""
    return [name.strip() for name in text.split(",") if name.strip()]


def count_of(text: str) -> int:
    """The number in ``N|all``; all: more than there are of anything."""
    if text == "all":
        return sys.maxsize
    if not (text.isdecimal() and len(text) < 10 and int(text)):
        raise InputError(f"--recordings {text[:20]}: is no number of recordings; give 1 or more, or all")
    return int(text)


def lanes_of(text: str | None) -> tuple[int | None, Any]:
    """(lanes, their type) of ``P[:TYPE]``; None where it is not said."""
    number, colon, kind = (text or "").partition(":")
    if text is None:
        return None, None
    if not (number.isdecimal() and len(number) < 4) or (colon and kind not in ("plain", "dsp")):
        raise InputError(
            f"--lanes {text[:20]}: are no lanes; give how many, 1 or more, and maybe their type, plain or dsp: 4:dsp"
        )
    return int(number), kind or None


# ---------------------------------------------------------------------- what verbs share
class Grouped:
    """A request that names group arrays."""

    group: str | None

    @property
    def groups(self) -> list[str] | None:
        """The names of ``group``; None where it is not given."""
        return None if self.group is None else names_of(self.group)


@dataclass(frozen=True, kw_only=True)
class OfModel:
    model: Annotated[Path, argument("A quantised model folder.")]


@dataclass(frozen=True, kw_only=True)
class OfData:
    data: Annotated[str, option(DATA)]


@dataclass(frozen=True, kw_only=True)
class ModelOnData(OfModel, OfData):
    """A model and recordings for it."""


@dataclass(frozen=True, kw_only=True)
class InJson:
    json: Annotated[Path | None, option("Also write the result as JSON.")] = None


@dataclass(frozen=True, kw_only=True)
class OnCluster:
    dask: Annotated[
        str | None,
        option(
            "A dask scheduler, tcp://HOST:PORT, whose workers do it; default: a process a core.",
            metavar="ADDRESS",
        ),
    ] = None


@dataclass(frozen=True, kw_only=True)
class OnFrontEnd(OfData):
    """Recordings, and the front end that they go through."""

    config: Annotated[str | None, option(CONFIG)] = None


@dataclass(frozen=True, kw_only=True)
class Judged(Grouped, OnFrontEnd):
    """Recordings to judge networks on, by what is left out."""

    group: Annotated[
        str | None, option("Group arrays A[,B..] of one split; default: the configuration's splits.")
    ] = None


@dataclass(frozen=True, kw_only=True)
class Chosen(Grouped, OnFrontEnd):
    """Recordings to choose, judge and train a network on; what is not asked for is chosen."""

    group: Annotated[str | None, option("Group arrays A[,B..] that stay on one side of a split.")] = None
    cell: Annotated[
        CellChoice | None,
        option(
            "tactnet, tactnet-half, four, four-lean are for images. auto: the smallest of several that is "
            "enough. Default: auto without --config and --hidden, else the configuration's."
        ),
    ] = None
    hidden: Annotated[int | None, option("Hidden units.")] = None
    seeds: Annotated[
        int | None, option("Seeds of the cross-validation; default: 3, of images 1.", min=1, max=100)
    ] = None
    prefer: Annotated[
        Prefer,
        option(
            "What is to be least in the candidate taken, of those level with the best: energy of a touch, logic "
            "cells, or latency from the last sample to the decision."
        ),
    ] = "energy"
    fits: Annotated[
        str | None,
        option(
            "The board that has to hold the design; what does not fit it is no candidate. Default: the "
            "icebreaker, where anything level with the best fits it.",
            metavar="BOARD",
        ),
    ] = None
    stress: Annotated[
        str,
        option(
            "Candidates are judged on disturbed recordings, too: on, off, or a JSON file of failure modes and their "
            "weights.",
            metavar="on|off|FILE",
        ),
    ] = STRESS


# ---------------------------------------------------------------------- recordings
@dataclass(frozen=True, kw_only=True)
class InspectRequest(InJson):
    data: Annotated[str, argument(DATA)]
    config: Annotated[str | None, option(CONFIG)] = None
    out: Annotated[Path | None, option("The picture; default build/inspect/NAME.png.")] = None
    card: Annotated[
        bool, option("Also write a data card, README.md in a folder called as the picture.", "--card")
    ] = False


@dataclass(frozen=True, kw_only=True)
class ConvertRequest:
    source: Annotated[
        Path,
        argument(
            "A folder by class of .csv, .parquet, .lvm or .png files or logs, one long .csv or .parquet table, a "
            ".mat or .h5 file, a log (.mcap, a ROS bag), an archive of images."
        ),
    ]
    out: Annotated[Path, option("The archive to write, FILE.npz.")]
    rate: Annotated[float | None, option("Frames a second; default: of the time column.", metavar="HZ")] = (
        None
    )
    columns: Annotated[
        str | None,
        option("The taxels: names or numbers from 1, such as 2-17; default: all else.", metavar="A,B.."),
    ] = None
    recording: Annotated[
        str | None, option("Long table: what recording a row belongs to.", metavar="COLUMN")
    ] = None
    class_: Annotated[
        str | None,
        option(
            "The class: a column, an attribute, of .mat and .h5 the array of classes, of a log their topic.",
            "--class",
            metavar="NAME",
        ),
    ] = None
    delimiter: Annotated[str | None, option("What separates the cells: a character, or tab, blank.")] = None
    samples: Annotated[
        str | None, option(".mat, .h5: the array of samples. Log: the topic of frames.", metavar="NAME")
    ] = None
    labels: Annotated[
        Path | None,
        option("Log: a .csv table of start, end (s) and class, a row a recording.", metavar="FILE"),
    ] = None
    clock: Annotated[
        Literal["log", "header"],
        option("Log: whose times frames and labels have, the log's or their headers'."),
    ] = "log"
    scale: Annotated[
        float | None, option("What one code is worth; default: whole numbers are codes, others get a scale.")
    ] = None
    like: Annotated[
        Path | None,
        option(
            "A model folder or an archive whose scale, columns, classes and rate these recordings are to have, where "
            "nothing else is said.",
            metavar="MODEL|FILE",
        ),
    ] = None
    size: Annotated[str | None, option("Images: bring them to so many pixels, 26x47 say.", metavar="HxW")] = (
        None
    )


@dataclass(frozen=True, kw_only=True)
class WatchRequest(OfModel):
    data: Annotated[str | None, option(f"Recordings to play. {DATA}")] = None
    port: Annotated[
        str | None,
        option("A board's serial port: with --data it is given the recordings, without it is listened to."),
    ] = None
    simulate: Annotated[
        bool,
        option(
            "The RTL in Verilator in lock step, beside the model; without --data a synthetic scene.",
            "--simulate",
        ),
    ] = False
    host_port: Annotated[int, option("Port of the page; 0: any that is free.", min=0, max=65535)] = 8765


# ---------------------------------------------------------------------- networks
@dataclass(frozen=True, kw_only=True)
class RunRequest(Chosen):
    data: Annotated[str, option(DATA)] = "synthetic"
    recordings: Annotated[
        str | None, option("Co-simulated ones; default: 8 a class, or all of few.", metavar="N|all")
    ] = None
    out: Annotated[Path, option("The result folder: new, or an earlier result, which is replaced.")] = Path(
        "build/run"
    )
    test: Annotated[str | None, option("Recordings held back: judged once, shown apart.", metavar="HELD")] = (
        None
    )
    name: Annotated[str | None, option("Title of the report; default: the data's name.")] = None

    @property
    def count(self) -> int | None:
        """The number of ``recordings``; None where it is not given."""
        return None if self.recordings is None else count_of(self.recordings)


@dataclass(frozen=True, kw_only=True)
class ReportRequest:
    folder: Annotated[Path, argument("A folder that eskin run wrote.", metavar="DIR")]


@dataclass(frozen=True, kw_only=True)
class TrainRequest(Chosen):
    out: ModelOut
    reset: GateOfReset = None
    folds: Annotated[int, option("Folds of the cross-validation; 0: none.")] = 5
    seed: Seed = 0
    protocol: Annotated[
        Literal["default", "robust", "thesis"],
        option("The default recipe; robust: taxels may fail; or the thesis's."),
    ] = "default"


ENROL_MODES = {
    "evaluate": (("evaluate", "data", "group"), ("readout", "k", "config", "seeds")),
    "teach": (("model", "teach", "out"), ()),
    "train": (("model", "data", "out"), ("with_",)),
}
"""Options of `eskin enrol`: what each mode needs, and what else it takes."""


@dataclass(frozen=True, kw_only=True)
class EnrolRequest(Grouped, InJson):
    model: Annotated[Path | None, argument("A quantised model folder; it stays as it is.")] = None
    data: Annotated[
        str | None,
        option(f"The touches to train on, 1 to 5 of each class; with --evaluate all recordings. {DATA}"),
    ] = None
    out: Annotated[
        Path | None, option("The folder of the enrolled model: new, or an earlier model, which is replaced.")
    ] = None
    with_: Annotated[
        str | None,
        option(
            "The recordings that the model was trained on, which it then remembers best.",
            "--with",
            metavar="D",
        ),
    ] = None
    teach: Annotated[
        str | None,
        option(
            "In place of --data: touches to store as prototypes beside those of a model quantised with "
            "--readout prototypes; nothing is trained.",
            "--teach",
            metavar="FEW",
        ),
    ] = None
    evaluate: Annotated[
        bool,
        option(
            "Report what enrolment brings on each value of --group, left out of the training.", "--evaluate"
        ),
    ] = False
    readout: Annotated[
        Readout, option("With --evaluate: what is judged, a network trained on, or prototypes taught.")
    ] = "dense"
    group: Annotated[
        str | None, option("With --evaluate: group arrays A[,B..], a mounting, person or place a value.")
    ] = None
    k: Annotated[
        str, option("With --evaluate: touches of each class that are enrolled.", "-k", metavar="K[,K..]")
    ] = "1,2,5"
    config: Annotated[str | None, option(f"With --evaluate. {CONFIG}")] = None
    seeds: Annotated[int, option("With --evaluate: how many seeds.", min=1, max=1000)] = 3

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
                f"-k {self.k[:40]}: is no list of touches a class; give numbers from 1 to 100, such as 1,2,5"
            )
        return [int(word) for word in counts]


@dataclass(frozen=True, kw_only=True)
class QuantiseRequest(Grouped):
    model: Annotated[Path, argument("A model folder.")]
    data: Annotated[
        str | None, option("Profile ranges on these recordings; default: the ranges noted at training.")
    ] = None
    weight_bits: Annotated[int | None, option("Bits of a weight.")] = None
    state_bits: Annotated[int | None, option("Bits of the hidden state.")] = None
    formats: Annotated[
        str | None,
        option(
            "feature_bits=B, gate_bits=B (of its fraction), table_entries=N, one or more with commas; or the word "
            "lean: features and logits that need the fewest logic cells.",
            metavar="NAME=N,..|lean",
        ),
    ] = None
    quantisation_aware: Annotated[
        bool, option("Train on in integer arithmetic of these widths; needs --data.", "--quantisation-aware")
    ] = False
    readout: Annotated[
        Readout | None,
        option(
            "What decides: the dense layer, or the nearest stored trajectory; that needs --data. Default: as the "
            "model's config.json says."
        ),
    ] = None
    group: Annotated[
        str | None,
        option(
            "With --readout: group arrays A,B.. that are left out for --unknown and for how much nearer a taught touch "
            "counts; default: those of the training."
        ),
    ] = None
    prototypes: Annotated[
        int | None, option("With --readout: prototypes a class at most; default: 8.", min=1, max=16)
    ] = None
    taught: Annotated[
        int | None,
        option("With --readout: places a class for touches taught in use; default: 3.", min=0, max=16),
    ] = None
    unknown: Annotated[
        float | None,
        option(
            "With --readout: share of known touches, of groups left out, that may be called unsure; what is "
            "further from every prototype is unsure, too.",
            min=0.0,
            max=0.5,
        ),
    ] = None
    spare_classes: Annotated[
        int | None,
        option(
            "With --readout: so many of the classes, the last ones, of which there is no recording, are known once they "
            "are taught.",
            min=0,
            max=30,
        ),
    ] = None

    @property
    def widths(self) -> dict[str, Any]:
        """Those that were asked for, by the names of ``eskin.training.quantise.choose_formats``."""
        bits = {"weight_bits": self.weight_bits, "state_bits": self.state_bits}
        widths: dict[str, Any] = {name: value for name, value in bits.items() if value is not None}
        if self.formats == "lean":
            return widths | {"lean": True}
        for word in names_of(self.formats or ""):
            name, _, number = word.partition("=")
            if name not in FORMATS or not (number.isdecimal() and len(number) < 5):
                raise InputError(
                    f"--formats {word[:40]}: is no format; give {', '.join(FORMATS)} with a number, such as "
                    "gate_bits=9, or the word lean"
                )
            widths[name] = int(number)
        return widths

    @property
    def of_readout(self) -> dict[str, Any]:
        """What was asked for of prototypes."""
        names = ("groups", "prototypes", "taught", "unknown", "spare_classes")
        return {name: getattr(self, name) for name in names if getattr(self, name) is not None}


@dataclass(frozen=True, kw_only=True)
class EvaluateRequest(ModelOnData, InJson):
    pass


@dataclass(frozen=True, kw_only=True)
class CompareRequest(OfModel, InJson):
    data: Annotated[
        str | None,
        option(f"{DATA} Default: made-up touches that reach every rule of the front end, or images."),
    ] = None
    out: Annotated[Path, option("Folder of compare.html.")] = Path("build/compare")


@dataclass(frozen=True, kw_only=True)
class ImportRequest:
    file: Annotated[
        Path,
        argument(
            "A torch state_dict (.pt, .pth), an .npz of Keras weights in get_weights() order, an .onnx file; "
            "linear cell: an .npz with coef_ and intercept_, columns window by window."
        ),
    ]
    out: ModelOut
    config: Annotated[
        str | None,
        option(
            "A preset or a JSON file: the array, windows and classes of the network's training. Of an .onnx file "
            "by default its own, where eskin exported it, or derived from --data."
        ),
    ] = None
    cell: Annotated[
        Cell | None, option("Its cell; default: the configuration's, of an .onnx file the file's.")
    ] = None
    reset: GateOfReset = None
    mean: Annotated[float | None, option("Codes taken off every window mean in its training.")] = None
    std: Annotated[float | None, option("Codes that became 1 in its training.")] = None
    data: Annotated[str | None, option("Without --mean and --std: measure them on these recordings.")] = None
    check: Annotated[
        Path | None,
        option(
            "An .npz of reference inputs (touches, steps, inputs), normalised, and outputs (logits, of the last step or of "
            "every step) that the model must give; else nothing is written, status 1."
        ),
    ] = None


@dataclass(frozen=True, kw_only=True)
class ExportRequest(OfModel):
    to: Annotated[
        Literal["c", "onnx"],
        option("c: the integer model as plain C99 for a microcontroller; onnx: the float network."),
    ]
    out: Annotated[Path, option("The folder to write: new, or an earlier exported one, which is replaced.")]
    prefix: Annotated[
        str | None,
        option(
            "With --to c: begins the names of files, types, functions and macros, so that several models go into one "
            "program; default eskin."
        ),
    ] = None


# ---------------------------------------------------------------------- studies
@dataclass(frozen=True, kw_only=True)
class SweepRequest(Judged, OnCluster):
    out: Annotated[Path, option("Folder of sweep.json, sweep.csv and the charts.")] = Path("build/sweep")
    grid: Annotated[
        str,
        option(
            "A JSON file: {field: list of values} or a list of such; or default (84 points) or bits (8, 6, "
            "4 bits)."
        ),
    ] = "default"
    accuracy_floor: Annotated[
        float | None, option("Share of unseen recordings to be decided rightly, 0 to 1.")
    ] = None
    latency_budget: Annotated[float | None, option("Seconds from a window's features to its decision.")] = (
        None
    )
    seeds: Annotated[
        int | None, option("Seeds that every point is trained with; default: 3, of images 1.", min=1, max=100)
    ] = None


@dataclass(frozen=True, kw_only=True)
class BaselinesRequest(Judged, OnCluster):
    out: Annotated[Path, option("Folder of baselines.json.")] = Path("build/baselines")


@dataclass(frozen=True, kw_only=True)
class StabilityRequest(ModelOnData, OnCluster):
    out: Annotated[Path, option("Folder of stability.html, stability.json, recommended.json.")] = Path(
        "build/stability"
    )
    mode: Annotated[list[str] | None, option("Only this mode; may be given again.")] = None
    cosim: Annotated[bool, option("Confirm the weakest cases in co-simulation.")] = True
    defences: Annotated[
        bool | None,
        option("Train with and without defences, cross-validated; default: where no --mode is named."),
    ] = None
    few: Annotated[int, option("Recordings of each point of a curve; the figures take all.", min=1)] = 100


# ---------------------------------------------------------------------- hardware
@dataclass(frozen=True, kw_only=True)
class OnLanes(OfModel):
    lanes: Lanes = None


@dataclass(frozen=True, kw_only=True)
class ReplayRequest(ModelOnData, InJson):
    model: Annotated[Path, argument("The quantised model folder that the bitstream was built from.")]
    port: Annotated[str, option("The board's serial port.")]
    teach: Annotated[
        str | None,
        option("The last touch of each recording is taught as this class when it is over.", metavar="CLASS"),
    ] = None
    save_taught: Annotated[
        Path | None,
        option(
            "File (.npz) of touches taught: what it holds is loaded, what the board holds in the end is written to "
            "it.",
            metavar="FILE",
        ),
    ] = None


@dataclass(frozen=True, kw_only=True)
class EnergyRequest(ModelOnData):
    configuration: Annotated[
        list[str] | None,
        option(
            "A board, its lanes and their type; may be given several times.", metavar="TARGET:LANES[:TYPE]"
        ),
    ] = None
    recordings: Annotated[int, option("Recordings whose activity is counted.", min=1)] = 2
    out: Annotated[Path, option("Folder of energy.json and energy.html.")] = Path("build/energy")


@dataclass(frozen=True, kw_only=True)
class ScheduleRequest:
    model: Annotated[str, argument("A model folder, or a preset: thesis, synthetic, pvdf, fabric.")]
    lanes: Lanes = None
    out: Annotated[Path, option("Folder of the files.")] = Path("build/schedule")


@dataclass(frozen=True, kw_only=True)
class GenerateRequest(OnLanes):
    out: Annotated[Path, option("The folder to write: new, or an earlier generated one, which is replaced.")]
    data: Annotated[
        str | None, option("The bench plays the first of these recordings; default: a made-up one.")
    ] = None
    bus: Annotated[
        Literal["wishbone", "axi4lite"] | None,
        option("For a CPU: registers, samples, decisions and an interrupt behind this bus, a driver in C."),
    ] = None
    streams: Annotated[
        Literal["axis"] | None, option("Frames under AXI-Stream names; without --bus decisions too.")
    ] = None
    top: Annotated[
        str | None,
        option(
            "Name of the topmost module; all other modules and the driver begin with it, so that several designs go into "
            "one system.",
            metavar="NAME",
        ),
    ] = None


@dataclass(frozen=True, kw_only=True)
class CosimRequest(ModelOnData, OnLanes, InJson, OnCluster):
    recordings: Annotated[
        str, option("How many, the same every time, spread over the classes.", metavar="N|all")
    ] = "all"
    simulator: Annotated[
        Literal["verilator", "icarus", "compiled"] | None,
        option(
            "Icarus is four-state and slow; compiled: a chip's netlist as C. Default: compiled for chips, "
            "else verilator."
        ),
    ] = None
    level: Annotated[Literal["rtl", "netlist"], option("Generated Verilog, or its netlist.")] = "rtl"
    target: Annotated[
        str | None, option("Not with --level rtl: the board, such as icebreaker, ulx3s; or asic.")
    ] = None
    pdk: Annotated[str | None, option("With --target asic: ihp-sg13g2 or sky130hd.", metavar="NAME")] = None
    liberty: Annotated[
        list[Path] | None,
        option("With --target asic: the process's Liberty files; several times.", metavar="FILE"),
    ] = None
    rom: Annotated[bool, option("With --target asic: weights and constants are fixed.", "--rom")] = False
    converter: Annotated[
        str | None,
        option(
            "Begin at the pins of this converter, such as ads7953 or spi (docs/interface.md has all); or none.",
            metavar="NAME",
        ),
    ] = None
    pace: Annotated[
        Literal["full", "declared"],
        option("full: as fast as frames are taken; declared: at the recordings' rate."),
    ] = "full"
    clock: Annotated[
        str | None,
        option(
            "Clock of --pace declared, the sensor's; default: the configuration's. lowest: look for it.",
            metavar="HZ|lowest",
        ),
    ] = None
    stalls: Annotated[bool, option("Random stalls on both sides.", "--stalls")] = False
    bench: Annotated[
        Literal["sample", "cocotb"],
        option("Under cocotb: one recording of each class, the others in bulk in this process; or all."),
    ] = "sample"
    jobs: Annotated[int | None, option("Processes that play side by side; default: one a core.", min=1)] = (
        None
    )


@dataclass(frozen=True, kw_only=True)
class BoardRequest(OfModel):
    target: Annotated[str, option("icebreaker, upduino, ulx3s or tangnano9k.", metavar="NAME")]
    lanes: Annotated[
        str | None,
        option(
            "Multipliers that work at once; default: the model's, fewer where they do not fit, of the type that "
            "suits the part.",
            metavar="P[:TYPE]",
        ),
    ] = None
    link: Annotated[
        bool, option("With the serial link; without it: onset to decision alone, for its figures.")
    ] = True
    converter: Annotated[
        str | None,
        option(
            "Frames from its pins: any that cosim takes; with --standalone default: the model's.",
            metavar="NAME",
        ),
    ] = None
    stimulator: Annotated[
        bool, option("With a converter: drive the stimulator by decisions.", "--stimulator")
    ] = False
    standalone: Annotated[
        bool,
        option(
            "No host: the model in the bitstream, frames from a converter on the board's pins.",
            "--standalone",
        ),
    ] = False
    flash: Annotated[
        bool,
        option(
            "With --standalone: the model not in the bitstream but in the board's flash, read at start.",
            "--flash",
        ),
    ] = False
    clock: Annotated[
        float | None, option("The clock to reach; default: the board's oscillator.", min=1e3, metavar="HZ")
    ] = None
    seeds: Annotated[
        int, option("How many seeds to try; the fastest placement is kept.", min=1, max=1000)
    ] = 1
    out: Annotated[Path | None, option("New folder or an earlier build; default build/board/NAME.")] = None


@dataclass(frozen=True, kw_only=True)
class AsicRequest(OfModel):
    pdk: Annotated[str, option("The process: ihp-sg13g2 or sky130hd.", metavar="NAME")]
    liberty: Liberty
    lanes: Annotated[int | None, option("Multipliers that work at once; default: the model's.")] = None
    rom: Annotated[
        bool, option("Weights and constants are fixed; otherwise the host loads them.", "--rom")
    ] = False
    data: Annotated[
        str | None,
        option(
            "One of these recordings is played into the netlist and its energy counted; many minutes.",
            metavar="D",
        ),
    ] = None
    out: Annotated[Path, option("Folder of asic.json, asic.md, netlist.v and accelerator.sdc.")] = Path(
        "build/asic"
    )
