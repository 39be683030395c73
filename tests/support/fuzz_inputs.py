"""What the fuzzer feeds in: good inputs, ways to damage them, command lines. All that is random comes from
``rng``, which in the tests is drawn by Hypothesis (``st.randoms()``): so a failing input is made smaller and
kept."""

import contextlib
import dataclasses
import functools
import gzip
import io
import json
import math
import random
import re
import shutil
import struct
import zipfile
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import numpy as np
import torch
from rosbags.rosbag2 import StoragePlugin
from scipy.io import loadmat, savemat

from eskin.cli.common import VERBS
from eskin.cli.main import command_of
from eskin.exchange.onnx_file import write_onnx
from eskin.golden.core import AcceleratorConfig
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel
from eskin.teach.taught import save_taught
from eskin.training.made_up import random_images
from tests.support import doors, result_case
from tests.support.image_scenes import random_image_model
from tests.support.random_models import random_float_model, random_integer_model
from tests.support.watched import KEPT

DIGITS = "9" * 5000
NUMBERS = (
    *"0 1 2 3 -1 5 1000000 2147483648 9223372036854775808 1e400 nan -inf 0x10 ١٢ ² 1.5 1-99999999999".split(),
    "",
    " ",
    DIGITS,
)
WORDS = (
    *"- -- all synthetic [red]x[/red] [/] a,b , person person,person ../.. /dev/null \udcff icebreaker:4 "
    "icebreaker:0".split(),
    *"icebreaker ulx3s:x:dsp pvdf ä tcp://127.0.0.1:1 lowest 0 4x4 ٤x٤".split(),
    *("", " ", "\n", "x" * 5000, f"{DIGITS}x1"),
)
VALUES = [
    *json.loads(
        "[null, true, false, 0, 1, -1, 3, 2147483648, 9223372036854775808, 1e30, -1e30, 0.5, -0.0, 1e308, "
        "NaN, Infinity]"
    ),
    *json.loads('["SQ(3,5)", "SQ(99,1)", "SQ(-3,5)", "UQ(3,5)", [], [[]], [1, 2], ["a", "a"], {}, {"a": 1}]'),
    *("", "x", "../../x", "1e9999", "9" * 40, 10**30, -(10**30)),
]
CELLS = (
    *"nan inf -1e999 abc 1e5 -3 1_0 ١ 0x1 1,5 1,234".split(),
    *("", "9" * 400, DIGITS, f"x{DIGITS}", "1\t" * 2000, "1" * 131_073, f'"{"1" * 131_073}"'),
)
NAMES = "file labels samples offsets class_names sample_rate_hz images lsb_volt label class time person channel_names data fs y".split()
"""Names of columns and arrays: many mean something to the archive."""
LIBERTY = """library (tiny) { nom_voltage : 1.2 ; time_unit : "1ns" ; capacitive_load_unit (1, pf) ;
 wire_load (a) { fanout_length (1, 2) ; }
 cell (sg13g2_inv_1) { area : 5.4 ; pin (A) { direction : input ; capacitance : 0.003 ; }
  pin (Y) { direction : output ; function : "!A" ; timing () { related_pin : "A" ;
   cell_rise (t) { index_1 ("0.1, 0.2") ; values ("1, 2") ; } } } }
 cell (sg13g2_dff_1) { area : 48 ; ff (IQ, IQN) { next_state : "D" ; clocked_on : "C" ; }
  pin (Q) { direction : output ; function : "IQ" ; } }
 cell (ram) { memory () { type : ram ; address_width : 8 ; word_width : 16 ; } } }
"""


# ---------------------------------------------------------------------- good inputs
def make_corpus(folder: Path) -> Path:
    """Recordings in every form, configurations, grids, networks, model folders, a result folder, cells of a
    chip."""
    result_case.make_result(folder / "result")
    # in the order in which a folder of classes gives them
    config = result_case.CONFIG.replace(class_names=("rough", "smooth"))
    loaded = dataclasses.replace(result_case.recordings(), class_names=config.network.class_names)
    _models(folder / "model", random_integer_model(config, 2), loaded)
    board = config.with_readout(
        readout="prototypes", prototypes=2, taught=3, state_code_bits=4, state_code_shift=8
    )
    taught = random_integer_model(board, 2)
    _models(folder / "prototypes", taught, loaded)
    save_taught(taught, folder / "taught.npz")
    _archive(folder / "recordings.npz", config, samples=loaded.samples.astype(np.uint16), offsets=loaded.offsets, labels=loaded.labels,
             person=loaded.groups["person"], sample_rate_hz=500.0)  # fmt: skip
    (folder / "config.json").write_text(config.to_json())
    layers: torch.nn.Module = torch.nn.ModuleDict({"cell": torch.nn.GRU(4, 4), "head": torch.nn.Linear(4, 2)})
    torch.save(layers.state_dict(), folder / "network.pt")
    write_onnx(random_float_model(config, 5), folder / "network.onnx")
    few = dataclasses.replace(loaded.subset(range(4)).until(np.full(4, 60)), sample_rate_hz=500.0)
    _tables(folder, few)
    doors.write_hdf5(few, folder / "r.h5")
    doors.write_hdf5_by_dataset(few, folder / "sets.h5")
    signals, labels = (
        [few.recording(index) for index in range(4)],
        [few.class_names[each] for each in few.labels],
    )
    doors.write_trials(signals, labels, folder / "nested.h5", "{label}/trial{n}", on__person=lambda n: n // 2)
    doors.write_touches(signals, labels, folder / "clocks.mcap", off=-1.5, zero=3)
    doors.long_table(few).to_parquet(folder / "table.parquet")
    doors.write_lerobot(signals, labels, folder / "lerobot", files=2)
    for plugin in StoragePlugin:
        doors.write_bag(few, folder / "bag", "tactile_msgs/msg/TactileState", plugin)
        next((folder / "bag").glob("bag.*")).rename(
            folder / f"log.{plugin.name.lower()[:4].replace('sqli', 'db3')}"
        )
        shutil.rmtree(folder / "bag")
    doors.write_bag(few, folder / "bag", plugin=StoragePlugin.SQLITE3)
    doors.write_bag(few, folder / "log.bag", plugin=None)
    (folder / "times.csv").write_text(doors.times_table(few))
    image = AcceleratorConfig.of_image(12, 14, ("conv 3 4", "pool", "dense 2"), ("cup", "ball"), name="small")
    _models(folder / "image_model", random_image_model(image, 1), None)
    _archive(
        folder / "images.npz",
        image,
        images=random_images(image, 12, 2),
        labels=np.arange(12) % 2,
        person=np.arange(12) // 3,
    )
    (folder / "image.json").write_text(image.to_json())
    layers = torch.nn.Sequential(
        torch.nn.Conv2d(1, 4, 3, padding=1), torch.nn.BatchNorm2d(4), torch.nn.Linear(6 * 7 * 4, 2)
    )
    torch.save(layers.state_dict(), folder / "image.pt")
    (folder / "cells.lib").write_text(LIBERTY)
    (folder / "cells.lib.gz").write_bytes(gzip.compress(LIBERTY.encode()))
    return folder


def _models(folder: Path, integer: IntegerModel, loaded: Recordings | None) -> None:
    real = random_float_model(integer.config, 5)
    real.save(folder, result_case.training_record(loaded) if loaded else {"ranges": {"0": 4.0}})
    integer.save(folder)


def _archive(file: Path, config: AcceleratorConfig, **arrays: Any) -> None:
    np.savez_compressed(file, allow_pickle=False, class_names=np.array(config.network.class_names), **arrays)


def _tables(folder: Path, few: Recordings) -> None:
    """The first recordings as ``.lvm`` and CSV files, half of them real numbers, as one long table and as a
    ``.mat`` file."""
    cells, long = np.empty((1, 4), dtype=object), ["recording,person,class,time,a,b,c,d"]
    for index in range(4):
        samples, name = few.recording(index), few.class_names[few.labels[index]]
        rows = [
            f"{frame / 500:.4f}," + ",".join(str(code / 7 if index > 1 else code) for code in row)
            for frame, row in enumerate(samples)
        ]
        texts = {
            "lvm": doors.lvm(np.split(samples / 1000, 2), runs_on=True, hz=500).replace("\r", ""),
            "csv": "\n".join(["time,a,b,c,d", *rows]) + "\n",
        }
        for kind, text in texts.items():
            path = folder / kind / name / f"p{index}_t1.{kind}"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        long += [f"{index},{index // 2},{name},{row}" for row in rows]
        cells[0, index] = samples.astype(float)
    (folder / "table.csv").write_text("\n".join(long) + "\n")
    names = np.array(few.class_names, dtype=object)
    savemat(folder / "r.mat", {"samples": cells, "labels": few.labels + 1, "class_names": names, "fs": 500.0})


# ---------------------------------------------------------------------- damage
def damage_bytes(data: bytes, rng: random.Random) -> bytes:
    """Bits flipped, cut off, cut out, repeated, or made up."""
    begin, length, made = rng.randrange(len(data) + 1), rng.randint(1, 64), rng.randbytes(rng.randrange(9))
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8, 64)) if data else 0):
        # the ends of a zip archive and the heads of its members decide most
        at = rng.choice((begin - 1, rng.randrange(128), -1 - rng.randrange(400))) % len(data)
        changed[at] = rng.choice((0, 0xFF, 0x7F, changed[at] ^ 1 << rng.randrange(8)))
    start, part, rest = data[:begin], data[begin : begin + length], data[begin + length :]
    return rng.choice(
        (made * 600, start, start + rest, start + part * 3 + rest, data + made, *[bytes(changed)] * 3)
    )


def damage_text(text: str, rng: random.Random) -> str:
    """Words or whole lines of other values, gone, repeated, or new."""
    for _ in range(rng.choice((1, 1, 2, 5))):
        found = [*re.finditer(rng.choice((r"[^\s,:\[\]{}]+", r"[^\s,:\[\]{}]+", r".*\n?")), text)]
        begin, end = rng.choice(found).span() if found else (0, 0)  # blanks alone have no word
        made = (*map(json.dumps, VALUES), *CELLS, *NAMES, "", 3 * text[begin:end], "[" * 100_000)
        text = text[:begin] + rng.choice(made) + text[end:]
    return text


TYPES = "f8 f2 c16 i1 u8 i8 ? U8 S4 M8[s] m8[ns] V8 i4,f8".split()
SHAPES = ((), (0,), (0, 4), (3, 0), (5,), (2, 2, 2))
ENDS = (math.nan, math.inf, -1e300, 1e-320, -1, 2**31, 2**63 - 1, -(2**63))


@np.errstate(over="ignore", invalid="ignore")  # a type too narrow is one of the damages
def damage_array(array: np.ndarray, rng: random.Random) -> np.ndarray:
    """Another type, another shape, other values."""
    number, kind = array.dtype.kind in "iuf", rng.choice(TYPES)
    changed = array.astype("f8" if number else "O").ravel()
    changed[: rng.randint(1, 3)] = rng.choice(ENDS)
    rng.shuffle(changed)
    return rng.choice(
        (
            array.astype(kind) if number and kind[0] not in "mMV" else np.zeros(array.shape, kind),
            array.reshape(1, -1),
            array.ravel()[: rng.randrange(array.size + 1)],
            np.zeros(rng.choice(SHAPES), array.dtype),
            np.array(["a\x00b", "[red]", "", "ä" * 300][: max(1, array.size)]),
            *[changed.reshape(array.shape).astype(rng.choice((array.dtype, changed.dtype)))] * 3,
        )
    )


def damage_arrays(arrays: dict[str, Any], rng: random.Random) -> dict[str, Any]:
    """One or two arrays damaged, gone, or under another name too."""
    for name in rng.sample(sorted(arrays), rng.choice((1, 1, 2))):
        array = arrays.pop(name)
        if rng.randrange(7):
            arrays[name] = damage_array(np.asarray(array), rng) if rng.randrange(4) else array
            arrays[rng.choice((name, name, *NAMES))] = arrays[name]
    return arrays


def damage_archive(data: bytes, rng: random.Random) -> bytes:
    """An ``.npz`` whose bytes or arrays are wrong."""
    if rng.randrange(2):
        return damage_bytes(data, rng)
    file = io.BytesIO()
    with np.load(io.BytesIO(data)) as archive:
        arrays = dict(archive)
    with zipfile.ZipFile(file, "w") as archive:  # numpy.savez takes no array named file
        for name, array in damage_arrays(arrays, rng).items():
            member = io.BytesIO()
            np.save(member, array)
            archive.writestr(f"{name}.npy", member.getvalue())
    return file.getvalue()


def header(shape: tuple[int, ...]) -> bytes:
    """Of an ``.npy`` file of that shape, true or not."""
    text = f"{{'descr': '<i4', 'fortran_order': False, 'shape': {shape!r}, }}".encode().ljust(117) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text


def damage(path: Path, rng: random.Random) -> None:
    """A file by its kind, a folder in one or two of its files."""
    if path.is_dir():
        files = sorted(file for file in path.rglob("*") if file.is_file())
        for file in rng.sample(files, rng.choice((1, 1, 2))):
            damage(file, rng)
        return
    data = path.read_bytes()
    if path.suffix == ".mat" and rng.randrange(2):
        arrays = {name: value for name, value in loadmat(path).items() if not name.startswith("__")}
        # what MATLAB's format cannot hold ends the file where it stands
        with contextlib.suppress(TypeError, ValueError):
            savemat(path, damage_arrays(arrays, rng))
        return
    if path.suffix == ".npz":
        data = damage_archive(data, rng)
    elif path.suffix in (".json", ".csv", ".lvm") and rng.randrange(4):
        data = damage_text(data.decode(), rng).encode("utf-8", "replace")
    else:
        data = damage_bytes(data, rng)
    path.write_bytes(data)


# ---------------------------------------------------------------------- readers
RECORDED = """inspect @ --json look.json
inspect @
train --data @ --out made
train --data @ --out made --config ../in/config.json
train --data @ --out made --config thesis
train --data @ --out made --prefer cells --fits icebreaker
evaluate ../in/model --data @ --json e.json
compare ../in/model --data @
cosim ../in/model --data @
generate ../in/model --data @ --out design
stability ../in/model --data @
enrol ../in/model --data @ --out taught
enrol ../in/prototypes --teach @ --out taught
evaluate ../in/prototypes --data @
quantise model --data @ --readout prototypes
quantise model --data @ --readout prototypes --group person --spare-classes #
enrol --evaluate --readout prototypes --data @ --config ../in/config.json --group person -k # --seeds 1
run --data @ --config ../in/config.json
energy ../in/model --data @
watch ../in/model --data @ --host-port #
import ../in/model/float.npz --out made --config ../in/config.json --data @
"""
CONVERTED = f"""{RECORDED}convert @ --out made.npz --rate 100
convert @ --out made.npz --columns #
convert @ --out deep/made.npz --columns a,b,c,d --class $
convert @ --out keep --recording $ --delimiter $
convert @ --out made.npz --samples $ --scale # --class labels
"""
LOG = """convert @ --out made.npz --class /touched
convert @ --out made.npz --class /touched --samples /skin --rate 500
convert @ --out made.npz --labels ../in/times.csv --columns $
convert @ --out made.npz --class $ --samples $
convert @ --out made.npz --class /touched --samples /skin --clock header
inspect @
"""
MODEL = """evaluate @ --data ../in/recordings.npz
cosim @ --data ../in/recordings.npz
generate @ --out design
generate @ --out design --lanes #
schedule @
export @ --to c --out design
export @ --to onnx --out design
export @ --to c --out keep
energy @ --data ../in/recordings.npz
stability @ --data ../in/recordings.npz
build @ --target icebreaker
build @ --target # --converter $ --standalone
build @ --target icebreaker --converter ads7953 --standalone
asic @ --pdk ihp-sg13g2 --liberty ../in/cells.lib
replay @ --port /dev/null --data ../in/recordings.npz
watch @ --data ../in/recordings.npz
quantise model
quantise model --data ../in/recordings.npz
quantise model --weight-bits #
"""
CONFIGURED = """train --data ../in/recordings.npz --out made --config @
import ../in/network.pt --out made --config @ --mean 0 --std 9
run --data ../in/recordings.npz --config @
train --data synthetic --out made --config @
"""
IMAGES = """inspect @ --json look.json
convert @ --out small.npz
train --data @ --out made
train --data @ --out made --cell tactnet
evaluate ../in/image_model --data @ --json e.json
compare ../in/image_model --data @
stability ../in/image_model --data @ --out stable
cosim ../in/image_model --data @
run --data @
watch ../in/image_model --data @
replay ../in/image_model --port /dev/null --data @
"""
READERS = {
    "recordings.npz": RECORDED,
    "lvm": CONVERTED,
    "csv": CONVERTED,
    "table.csv": CONVERTED,
    "r.mat": CONVERTED,
    "r.h5": CONVERTED,
    "sets.h5": CONVERTED,
    "nested.h5": CONVERTED,
    "clocks.mcap": LOG,
    "table.parquet": CONVERTED,
    "lerobot": f"{CONVERTED}convert @ --out made.npz --samples observation.touch\n"
    "convert @ --out made.npz --samples $ --class $ --rate #\ninspect @",
    "log.mcap": LOG,
    "log.db3": LOG,
    "log.bag": LOG,
    "bag": LOG,
    "times.csv": "convert ../in/log.mcap --out made.npz --labels @\nconvert ../in/log.mcap --out made.npz --labels @ --columns $",
    "model": MODEL,
    "prototypes": f"{MODEL}enrol @ --teach ../in/recordings.npz --out taught",
    "taught.npz": "replay ../in/prototypes --port /dev/null --data ../in/recordings.npz --save-taught @\n"
    "replay ../in/prototypes --port /dev/null --data ../in/recordings.npz --save-taught @ --teach $",
    "config.json": CONFIGURED,
    "network.pt": "import @ --out made --config ../in/config.json --mean # --std #",
    "network.onnx": "import @ --out made\nimport @ --out made --config ../in/config.json --mean # --std #\n"
    "import @ --out made --data ../in/recordings.npz",
    "result": "report result",
    "images.npz": IMAGES,
    "image_model": MODEL.replace("recordings.npz", "images.npz"),
    "image.json": "import ../in/image.pt --out made --config @ --mean 0 --std 255\nrun --data "
    "../in/images.npz --config @",
    "image.pt": "import @ --out made --config ../in/image.json --mean # --std #",
    "cells.lib": "asic ../in/model --pdk ihp-sg13g2 --liberty @\nasic ../in/model --pdk sky130hd --liberty @",
    "cells.lib.gz": "asic ../in/model --pdk ihp-sg13g2 --liberty @",
}
"""Input -> the command lines that read it: ``@`` its place, ``#`` a number, ``$`` a word."""
INPUTS = tuple(READERS)


def make_case(corpus: Path, case: Path) -> None:
    """Folders ``in`` with all good inputs, ``out`` to work in with something that must stay, ``tmp``."""
    shutil.copytree(corpus, case / "in")
    (case / "tmp").mkdir()
    shutil.copytree(corpus / "model", case / "out" / "model")
    for name in KEPT:
        (case / "out" / name).parent.mkdir(exist_ok=True)
        (case / "out" / name).write_text("keep")


def damaged(case: Path, rng: random.Random) -> list[str]:
    """One input damaged, and a command that reads it."""
    name = rng.choice(INPUTS)
    damage(case / "in" / name, rng)
    return _reader(case, name, rng)


def _reader(case: Path, name: str, rng: random.Random) -> list[str]:
    words = rng.choice(READERS[name].splitlines()).split()
    # the model that a verb writes in place; the command line of a file may hold the word by chance
    if (case / "in" / name).is_dir() and (name in words or "model" in words):
        shutil.rmtree(case / "out" / words[1], ignore_errors=True)
        shutil.copytree(case / "in" / name, case / "out" / words[1])
    filled = {
        "@": f"../in/{name}",
        "#": rng.choice(("1", "100", *NUMBERS)),
        "$": rng.choice((*NAMES, *WORDS)),
    }
    return [filled.get(word, word) for word in words]


# ---------------------------------------------------------------------- command lines
def commands(case: Path, rng: random.Random) -> list[str]:
    """A command line of good inputs: any verb, any of its options, with good and bad values in any order."""
    verb = rng.choice(sorted(_verbs()))
    arguments, options = [], []
    for parameter in _verbs()[verb].params:
        # without data: the synthetic scene, which is large
        often = 39 if parameter.required else 36 if parameter.name == "data" else 6
        if rng.randrange(40) < often:
            value = _value(verb, parameter, rng)
            if parameter.param_type_name == "argument":
                arguments.append(value)
            elif parameter.is_flag:
                options.append([rng.choice([*parameter.opts, *parameter.secondary_opts])])
            else:
                options += [[parameter.opts[0], value]] * rng.choice((1, 1, 1, 1, 1, 1, 2))
    if rng.randrange(16) == 15:
        options.append(
            [rng.choice(("--unknown", "--help", "-x", "--", "--out", "--json", "-", "--=", *WORDS))]
        )
    rng.shuffle(options)
    words = [verb, *arguments, *(word for option in options for word in option)]
    odd = [rng.choice((*WORDS, "--version", "--help", verb[:-1], verb.upper())), rng.choice(WORDS)]
    return rng.choice((*[words] * 28, words[: rng.randrange(1, len(words) + 1)], odd))


@functools.cache
def _verbs() -> dict[str, Any]:
    return {verb: command_of(verb) for verb in VERBS}


GOOD = {
    "data": "../in/recordings.npz ../in/recordings.npz ../in/images.npz ../in/lvm ../in/csv synthetic",
    "source": "../in/csv ../in/table.csv ../in/r.mat ../in/lvm ../in/r.h5 ../in/table.parquet ../in/log.mcap ../in/bag",
    "labels": "../in/times.csv ../in/table.csv",
    "config": "../in/config.json pvdf thesis",
    "file": "../in/network.pt ../in/network.onnx",
    "folder": "../in/model",
    "group": "person source_file person,source_file x",
    "recordings": "1 2 all -1 0",
    "target": "icebreaker ulx3s upduino tangnano9k x",
    "port": "/dev/null ../in/config.json none",
    "mode": "drift x",
    "teach": "../in/recordings.npz rough smooth x",
    "save_taught": "../in/taught.npz new keep/under .",
    "configuration": "icebreaker:4 ulx3s:1:dsp icebreaker:0 :::",
    "clock": "12e6 inf 1 -1 nan",
    "dask": "tcp://127.0.0.1:1 x",
    "pdk": "ihp-sg13g2 sky130hd x",
    "liberty": "../in/cells.lib ../in/cells.lib.gz",
    "out": "new new new/deep model foreign keep keep/under . /dev/null",
}
GOOD["json"] = GOOD["record"] = GOOD["out"]


def _value(verb: str, parameter: Any, rng: random.Random) -> str:
    """A value for one option or argument, mostly of the right kind."""
    name, kind = parameter.name, parameter.type_descriptor.annotation
    if rng.randrange(24) == 23:
        # an older result, which --json may replace, ends in .json
        places = [place for place in INPUTS if name != "json" or not place.endswith(".json")]
        return rng.choice((*WORDS, *NUMBERS, "x" * 300, *(f"../in/{place}" for place in places)))
    if name == "model":
        return rng.choice(
            ("model",) if verb == "quantise" else ("../in/model", "../in/prototypes", "../in/image_model")
        )
    if name in GOOD:
        return rng.choice(GOOD[name].split())
    if get_origin(kind) is Literal:
        return rng.choice([*get_args(kind), "x"])
    return rng.choice((*"1 2 3 4 6 8 12 0.5".split(), rng.choice(NUMBERS)))
