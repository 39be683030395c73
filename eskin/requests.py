"""Requests: one dataclass per verb holds its options. Command line, Python and jobs use the same class; a
field holds its help text, its default and its spelling on the command line.

Options that several verbs share are in a base class.
"""

import re
import sys
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar, dataclass_transform

import typer

from eskin.choose.cost import Prefer
from eskin.cosim.simulation import Simulation
from eskin.golden.core import InputError, Record
from eskin.golden.core.groups import Readout, Reset
from eskin.training.settings import TrainingSettings, parse_names

Cell = Literal["gru", "lstm", "linear"]
CellChoice = Literal["gru", "lstm", "linear", "tactnet", "tactnet-half", "four", "four-lean", "auto"]
"""Cells, networks for images, and auto: the smallest network that is enough."""
FORMATS = ("feature_bits", "gate_bits", "table_entries")
"""Values that ``quantise --formats`` sets."""
SEED_MAX = 2**31 - 1
STRESS = "on"
"""Default of --stress for `train` and `run`."""
DATA = "Recordings: .npz, a folder by class, a table, .mat, .h5, a log, or synthetic."
CONFIG = "Preset (thesis, synthetic, pvdf, fabric) or JSON file. Default: derived."


Kind = TypeVar("Kind")


@dataclass_transform(kw_only_default=True, frozen_default=True)
def request(kind: type[Kind]) -> type[Kind]:
    """A dataclass of keywords that nobody changes."""
    return dataclass(frozen=True, kw_only=True)(kind)


def option(help: str, default: Any = None, *names: str, **settings: Any) -> Any:
    """An option of a verb; ``names`` where it is not the field's, ``settings`` as `typer.Option` takes them."""
    return field(default=default, metadata={"of": typer.Option(*names, help=help, **settings)})


def required(help: str, **settings: Any) -> Any:
    """An option that must be given."""
    return option(help, MISSING, **settings)


def argument(help: str, default: Any = MISSING, **settings: Any) -> Any:
    """An argument of a verb."""
    return field(default=default, metadata={"of": typer.Argument(help=help, **settings)})


def parse_count(text: str) -> int:
    """The number in ``N|all``; all: more than there are of anything."""
    if text == "all":
        return sys.maxsize
    if not (text.isdecimal() and len(text) < 10 and int(text)):
        raise InputError(f"--recordings {text[:20]}: is not a number of recordings; give 1 or more, or all")
    return int(text)


def parse_lanes(text: str | None, option: str = "--lanes") -> tuple[Any, Any]:
    """(lanes, their type) of ``P[:TYPE]``; None where it is not said."""
    number, colon, kind = (text or "").partition(":")
    if text is None:
        return None, None
    if not (number.isdecimal() and len(number) < 4) or (colon and kind not in ("plain", "dsp")):
        raise InputError(
            f"{option} {text[:20]}: is not of the form P[:TYPE]; give a number and maybe plain or dsp, such as 4:dsp"
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


@request
class ModelOptions:
    model: Path = argument("A quantised model folder.")


@request
class DataOptions:
    data: str = required(DATA)


@request
class ModelDataOptions(ModelOptions, DataOptions):
    """A model and recordings for it."""


@request
class JsonOptions:
    json: Path | None = option("Also write the result as JSON.")


@request
class ClusterOptions:
    dask: str | None = option(
        "A dask scheduler, tcp://HOST:PORT. Default: one process per core.", metavar="ADDRESS"
    )


@request
class FrontEndOptions(DataOptions):
    """Recordings, and the front end that they go through."""

    config: str | None = option(CONFIG)


@request
class ChoiceOptions(TrainingSettings, FrontEndOptions):
    """Recordings to choose, judge and train a network on; what is not asked for is chosen."""

    group: str | None = option("Group arrays A[,B..] kept on one side of every split.")
    cell: CellChoice | None = option("Cell, or network for images. auto: the cheapest that is good enough.")
    hidden: int | None = option("Hidden units.")
    seeds: int | None = option("Seeds of the cross-validation. Default: 3; images 1.", min=1, max=100)
    prefer: Prefer = option("Cost to minimise among candidates as good as the best.", "energy")
    fits: str | None = option(
        "Board that must hold the design. Default: icebreaker, if possible.", metavar="BOARD"
    )
    stress: str = option(
        "Judge candidates on disturbed recordings, too: on, off, or a JSON file of weights.",
        STRESS,
        metavar="on|off|FILE",
    )


# ---------------------------------------------------------------------- recordings
@request
class InspectRequest(JsonOptions):
    data: str = argument(DATA)
    out: Path | None = option("Picture to write. Default: build/inspect/NAME.png.")
    card: bool = option(
        "Also write a data card, README.md, in a folder named like the picture.", False, "--card"
    )


@request
class ConvertRequest:
    source: Path = argument(
        "A folder by class of .csv, .parquet or .lvm files or logs, one long .csv or .parquet table, a "
        ".mat or .h5 file, a log (.mcap, a ROS bag), an archive of images."
    )
    out: Path = required("Archive to write, FILE.npz.")
    rate: float | None = option("Frames per second. Default: from the time column.", metavar="HZ")
    columns: str | None = option("Taxel columns: names, or numbers from 1 such as 2-17.", metavar="A,B..")
    recording: str | None = option("Long table: column that names a row's recording.", metavar="COLUMN")
    class_: str | None = option(
        "Column, attribute, array or topic that names the class.", None, "--class", metavar="NAME"
    )
    delimiter: str | None = option("Separator of cells: a character, tab or blank.")
    samples: str | None = option("Array (.mat, .h5) or topic (log) of the samples.", metavar="NAME")
    labels: Path | None = option(
        "Log: .csv table of start, end (s) and class, one row per recording.", metavar="FILE"
    )
    clock: Literal["log", "header"] = option("Log: clock of frames and labels.", "log")
    scale: float | None = option("Value of one code. Default: 1 for integers, else from the data.")
    like: Path | None = option(
        "Take scale, columns, classes and rate from this model or archive.", metavar="MODEL|FILE"
    )


@request
class WatchRequest(ModelOptions):
    data: str | None = option(f"Recordings to play. {DATA}")
    port: str | None = option("Serial port of a board. Without --data: show its own sensor.")
    simulate: bool = option("Also simulate the RTL and compare it in lock step.", False, "--simulate")
    host_port: int = option("TCP port of the page; 0: any free one.", 8765, min=0, max=65535)


# ---------------------------------------------------------------------- networks
@request
class RunRequest(ChoiceOptions):
    data: str = option(DATA, "synthetic")
    recordings: str | None = option("Recordings to co-simulate. Default: 8 per class.", metavar="N|all")
    out: Path = option("Result folder: new, or an earlier result to replace.", Path("build/run"))
    test: str | None = option("Recordings held back, used once for a separate accuracy.", metavar="HELD")
    name: str | None = option("Title of the report. Default: name of the data.")

    @property
    def count(self) -> int | None:
        """The number of ``recordings``; None where it is not given."""
        return None if self.recordings is None else parse_count(self.recordings)


@request
class ReportRequest:
    folder: Path = argument("A folder that eskin run wrote.", metavar="DIR")


@request
class TrainRequest(ChoiceOptions):
    out: Path = required("Model folder: new, or an earlier model to replace.")
    reset: Reset | None = option("GRU: reset gate before or after the recurrent product.")
    folds: int = option("Folds of the cross-validation; 0: none.", 5)
    seed: int = option("First seed; the written model uses it.", 0, min=0, max=SEED_MAX)
    protocol: Literal["default", "robust"] = option(
        "Training recipe; robust trains with failing taxels and offsets.", "default"
    )


ENROL_MODES = {
    "evaluate": (("evaluate", "data", "group"), ("readout", "k", "config", "seeds")),
    "teach": (("model", "teach", "out"), ()),
    "train": (("model", "data", "out"), ("with_",)),
}
"""Options of `eskin enrol`: what each mode needs, and what else it takes."""


@request
class EnrolRequest(GroupOptions, JsonOptions):
    model: Path | None = argument("A quantised model folder; it is not changed.", None)
    data: str | None = option(f"Touches to train on, 1 to 5 per class; with --evaluate all. {DATA}")
    out: Path | None = option("Folder of the enrolled model: new, or an earlier model to replace.")
    with_: str | None = option(
        "Recordings of the first training, so that they are not forgotten.", None, "--with", metavar="D"
    )
    teach: str | None = option(
        "Touches to store as prototypes; nothing is trained.", None, "--teach", metavar="FEW"
    )
    evaluate: bool = option(
        "Report the gain for each value of --group left out of the training.", False, "--evaluate"
    )
    readout: Readout = option("With --evaluate: dense trains further, prototypes stores touches.", "dense")
    group: str | None = option("With --evaluate: group arrays A[,B..], such as mounting or person.")
    k: str = option("With --evaluate: touches to enrol per class.", "1,2,5", "-k", metavar="K[,K..]")
    config: str | None = option(f"With --evaluate. {CONFIG}")
    seeds: int = option("With --evaluate: number of seeds.", 3, min=1, max=1000)

    def check(self, mode: str) -> None:
        """Refuse what a mode (evaluate, teach, train) lacks, and what another mode takes."""
        needs, takes = ENROL_MODES[mode]
        for each in fields(self):
            given, name = getattr(self, each.name) != each.default, each.name.strip("_")
            where = f"eskin enrol{'' if mode == 'train' else f' --{mode}'}, {'MODEL' if name == 'model' else f'--{name}'}"
            if each.name in needs and not given:
                raise InputError(
                    f"{where}: is missing; give {', '.join(needs)}, or another mode (--evaluate, --teach FEW)"
                )
            if given and each.name not in (*needs, *takes, "json"):
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


@request
class QuantiseRequest(GroupOptions):
    model: Path = argument("A model folder.")
    data: str | None = option("Measure value ranges on these recordings. Default: ranges from training.")
    weight_bits: int | None = option("Bits of a weight.")
    state_bits: int | None = option("Bits of the hidden state.")
    formats: str | None = option(
        "lean (fewest cells), or feature_bits=B,gate_bits=B,table_entries=N.", metavar="NAME=N,..|lean"
    )
    quantisation_aware: bool = option(
        "Train further in integers of these widths; needs --data.", False, "--quantisation-aware"
    )
    readout: Readout | None = option("Decide by the dense layer or by prototypes (needs --data).")
    group: str | None = option("Prototypes: group arrays A,B.. to leave out. Default: the training's.")
    prototypes: int | None = option("Prototypes: maximum per class. Default: 8.", min=1, max=16)
    taught: int | None = option("Prototypes: slots per class for taught touches. Default: 3.", min=0, max=16)
    spare_classes: int | None = option(
        "Prototypes: number of last classes without recordings, to be taught later.", min=0, max=30
    )

    @property
    def widths(self) -> Record:
        """The widths that were given, by the names of ``eskin.training.quantise.choose_formats``."""
        bits = {"weight_bits": self.weight_bits, "state_bits": self.state_bits}
        widths: Record = {name: value for name, value in bits.items() if value is not None}
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
    def readout_options(self) -> Record:
        """The user's options about prototypes."""
        names = ("groups", "prototypes", "taught", "spare_classes")
        return {name: getattr(self, name) for name in names if getattr(self, name) is not None}


@request
class EvaluateRequest(ModelDataOptions, JsonOptions):
    pass


@request
class CompareRequest(ModelOptions, JsonOptions):
    data: str | None = option(f"{DATA} Default: random touches.")


@request
class ImportRequest:
    file: Path = argument("A torch state_dict (.pt, .pth), or an .onnx file.")
    out: Path = required("Model folder: new, or an earlier model to replace.")
    config: str | None = option("Configuration of the training: a preset or a JSON file.")
    cell: Cell | None = option("Cell. Default: the .onnx file's, otherwise the configuration's.")
    reset: Reset | None = option("GRU: reset gate before or after the recurrent product.")
    mean: float | None = option("Codes subtracted from every window mean in its training.")
    std: float | None = option("Codes by which its training divided.")
    data: str | None = option("Measure mean and std on these recordings.")
    check: Path | None = option("Reference inputs and outputs (.npz) that the model must reproduce.")


@request
class ExportRequest(ModelOptions):
    to: Literal["c", "onnx"] = required("c: integer model as C99; onnx: float network.")
    out: Path = required("Folder to write: new, or an earlier export to replace.")
    prefix: str | None = option("C: prefix of all names. Default: eskin.")


# ---------------------------------------------------------------------- studies
@request
class StabilityRequest(ModelDataOptions, ClusterOptions):
    out: Path = option("Folder for stability.html and stability.json.", Path("build/stability"))
    mode: list[str] | None = option("Only this mode; may be repeated.")
    cosim: bool = option("Confirm the weakest cases in co-simulation.", True)
    no_defences: bool = option("Without effect: defences are not compared any more.", False, "--no-defences")
    few: int = option("Recordings per point of a curve.", 100, min=1)


# ---------------------------------------------------------------------- hardware
@request
class LaneOptions(ModelOptions):
    lanes: str | None = option(
        "Parallel multipliers, such as 4 or 4:dsp (iCE40 DSP blocks). Default: 4.", metavar="P[:TYPE]"
    )


@request
class ReplayRequest(ModelDataOptions, JsonOptions):
    model: Path = argument("The quantised model folder that the bitstream was built from.")
    port: str = required("Serial port of the board.")
    teach: str | None = option("Teach the last touch of each recording as this class.", metavar="CLASS")
    save_taught: Path | None = option(
        "File (.npz) of taught touches: loaded first, written at the end.", metavar="FILE"
    )


@request
class EnergyRequest(ModelDataOptions):
    configuration: list[str] | None = option(
        "Board, lanes and lane type; may be repeated.", metavar="TARGET:LANES[:TYPE]"
    )
    recordings: int = option("Number of recordings to simulate.", 2, min=1)
    touches: float = option("Touches a minute, for the average power.", 60.0, min=0)
    measured: Path | None = option(
        "An instrument's CSV file: time, current, voltage; printed beside the estimate.", metavar="FILE"
    )
    out: Path = option("Folder for energy.json.", Path("build/energy"))


@request
class ScheduleRequest(LaneOptions):
    model: Path = argument("A model folder, or a preset: thesis, synthetic, pvdf, fabric.")
    out: Path = option("Folder for the files.", Path("build/schedule"))


@request
class GenerateRequest(LaneOptions):
    out: Path = required("Folder to write: new, or an earlier design to replace.")
    data: str | None = option("The bench plays the first of these recordings. Default: a synthetic one.")
    bus: Literal["wishbone", "axi4lite"] | None = option("Add a bus shell for a CPU, with a C driver.")
    streams: Literal["axis"] | None = option(
        "Take frames from an AXI-Stream; without --bus send decisions on one."
    )
    top: str | None = option("Name of the top module, and prefix of all other names.", metavar="NAME")


@request
class CosimRequest(Simulation, ModelDataOptions, LaneOptions, JsonOptions, ClusterOptions):
    recordings: str = option("Number of recordings, spread over the classes.", "all", metavar="N|all")
    simulator: Literal["verilator", "icarus"] = option("Simulator.", "verilator")
    threads: int | None = option(
        "Recordings played side by side. Default: one per core.", None, "--jobs", min=1
    )
    level: Literal["rtl", "netlist"] = option("Generated Verilog, or its netlist.", "rtl")
    target: str | None = option("Part of the netlist: a board such as icebreaker, or asic.")
    pdk: str | None = option("Chip: ihp-sg13g2 or sky130hd.", metavar="NAME")
    liberty: list[Path] | None = option(
        "Chip: a Liberty file of the process; may be repeated.", metavar="FILE"
    )
    rom: bool = option("Chip: weights and constants are in ROM.", False, "--rom")
    converter: str | None = option(
        "Play frames to the pins of this converter; none: to the core.", metavar="NAME"
    )
    pace: Literal["full", "declared"] = option(
        "full: as fast as possible; declared: at the recordings' rate.", "full"
    )
    clock_hz: float | None = option("Clock for --pace declared.", None, "--clock", metavar="HZ")
    stalls: bool = option("Insert random stalls at input and output.", False, "--stalls")
    bench: Literal["sample", "cocotb"] = option(
        "Recordings under cocotb: one per class (others in bulk), or all.", "sample"
    )


@request
class BoardRequest(ModelOptions):
    target: str = required("icebreaker, upduino, ulx3s or tangnano9k.", metavar="NAME")
    lanes: str | None = option(
        "Parallel multipliers. Default: the model's, or as many as fit.", metavar="P[:TYPE]"
    )
    link: bool = option("Include the serial link, or build onset to decision only.", True)
    converter: str | None = option(
        "Read frames from this converter. Default with --standalone: the model's.", metavar="NAME"
    )
    stimulator: bool = option("With a converter: decisions drive the stimulator.", False, "--stimulator")
    standalone: bool = option(
        "Build without a host: model in the bitstream, frames from a converter.", False, "--standalone"
    )
    clock: float | None = option("Target clock. Default: the board's oscillator.", min=1e3, metavar="HZ")
    seeds: int = option("Number of placements to try; the fastest is kept.", 1, min=1, max=1000)
    out: Path | None = option("Folder to write: new, or an earlier build. Default: build/board/NAME.")


@request
class AsicRequest(ModelOptions):
    pdk: str = required("Process: ihp-sg13g2 or sky130hd.", metavar="NAME")
    liberty: list[Path] = required(
        "Liberty file of the process (.lib, .lib.gz); may be repeated.", metavar="FILE"
    )
    lanes: int | None = option("Parallel multipliers. Default: the model's.")
    rom: bool = option("Put weights and constants in ROM; otherwise the host loads them.", False, "--rom")
    data: str | None = option(
        "Simulate one of these recordings for its energy; takes many minutes.", metavar="D"
    )
    out: Path = option("Folder for asic.json, asic.md, netlist.v and accelerator.sdc.", Path("build/asic"))


# ---------------------------------------------------------------------- sentences
OPTIONS = {
    each.name: name
    if isinstance(name := each.metadata["of"].default, str)
    else f"--{each.name.replace('_', '-')}"
    for kind in [*vars().values()]
    if is_dataclass(kind)
    for each in fields(kind)
    if "of" in each.metadata
}
"""Option that sets a field."""
OPTIONS |= {f"no_{name}": f"--no-{option[2:]}" for name, option in OPTIONS.items()}


def spelled(sentence: str) -> str:
    """A sentence with options in place of fields in back quotes."""
    return re.sub(r"`(\w+)`", lambda found: OPTIONS.get(found[1], found[0]), sentence)
