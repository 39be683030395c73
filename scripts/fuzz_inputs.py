"""What the fuzz job feeds in: a corpus of good inputs, and ways to damage them. Everything random comes from the caller's generator.

Each group of inputs is a function ``(corpus, case, rng) -> list of words`` of `GROUPS`: it fills ``case/in`` and returns a command line,
to be run in ``case/out``. Bus traffic is a group of its own kind: it is run on the simulated accelerator.
"""

from __future__ import annotations

import dataclasses
import functools
import io
import json
import math
import os
import random
import shutil
import struct
import zipfile
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

NUMBERS = (
    "0",
    "1",
    "2",
    "3",
    "-1",
    "5",
    "1000000",
    "2147483648",
    "9223372036854775808",
    "1e400",
    "nan",
    "-inf",
    "0x10",
    "١٢",
    "",
    " ",
    "1.5",
)
WORDS = (
    "",
    " ",
    "-",
    "--",
    "all",
    "synthetic",
    "[red]x[/red]",
    "[/]",
    "a,b",
    ",",
    "person",
    "person,person",
    "x" * 5000,
    "../..",
    "/dev/null",
    "\udcff",
    "\n",
    "icebreaker:4",
    "icebreaker:0",
    "icebreaker",
    "ulx3s:x:dsp",
    "pvdf",
    "ä",
    "tcp://127.0.0.1:1",
    "lowest",
    "0",
)
ODD_VALUES: tuple[Any, ...] = (
    None,
    True,
    False,
    0,
    1,
    -1,
    3,
    2**31,
    2**63,
    10**30,
    -(10**30),
    0.5,
    -0.0,
    1e308,
    math.nan,
    math.inf,
    "",
    "x",
    "SQ(3,5)",
    "SQ(99,1)",
    "SQ(-3,5)",
    "UQ(3,5)",
    [],
    [[]],
    [1, 2],
    ["a", "a"],
    {},
    {"a": 1},
    "1e9999",
    "9" * 40,
)
INPUTS = ("recordings.npz", "config.json", "grid.json", "network.pt", "keras.npz", "lvm", "csv", "table.csv", "r.mat", "model", "result")


# ---------------------------------------------------------------------- the corpus
def make_corpus(folder: Path) -> Path:
    """Good inputs: recordings in every form, a configuration, a grid, two networks, a model folder, a result folder."""
    import torch

    from eskin.golden.model.model import FloatModel, random_integer_model
    from tests.support import result_case  # small and complete; not part of the installed packages, so the job runs from a checkout

    result_case.make_result(folder / "result")
    config = result_case.CONFIG.replace(class_names=("rough", "smooth"))  # in the order in which a folder of classes gives them
    loaded = dataclasses.replace(result_case.recordings(), class_names=config.network.class_names)
    FloatModel(config, result_case.float_model().arrays).save(folder / "model", result_case.training_record(loaded))
    random_integer_model(config, seed=2).save(folder / "model")
    arrays = {"samples": loaded.samples.astype(np.uint16), "offsets": loaded.offsets, "labels": loaded.labels}
    arrays |= {"class_names": np.array(loaded.class_names), "sample_rate_hz": np.array(500.0), "person": loaded.groups["person"]}
    np.savez_compressed(folder / "recordings.npz", allow_pickle=False, **arrays)
    (folder / "config.json").write_text(config.to_json())
    (folder / "grid.json").write_text(json.dumps({"hidden": [4, 6], "cell": ["gru", "lstm"]}))
    torch.manual_seed(1)
    layers = torch.nn.ModuleDict({"cell": torch.nn.GRU(4, 4), "head": torch.nn.Linear(4, 2)})
    torch.save(layers.state_dict(), folder / "network.pt")
    rng = np.random.default_rng(1)
    np.savez(folder / "keras.npz", *(rng.normal(0, 0.5, shape) for shape in ((4, 12), (4, 12), (2, 12), (4, 2), (2,))))
    for index in range(4):
        lines = ["LabVIEW Measurement", "***End_of_Header***", "X_Value\tV0\tV1\tV2\tV3"]
        for frame, row in enumerate(loaded.recording(index)[:80]):
            lines.append("\t".join([f"{frame / 500:.6f}", *(f"{code * 1e-3:.6f}" for code in row)]))
        path = folder / "lvm" / ("rough", "smooth")[index % 2] / f"p{index}_t1.lvm"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("\n".join(lines) + "\n")
    make_tables(folder, loaded)
    make_images(folder)
    return folder


def make_images(folder: Path) -> None:
    """An archive of small images, a model of them, its configuration, a grid, and a state_dict of its layers."""
    import torch

    from eskin.golden.core.config import AcceleratorConfig
    from eskin.golden.model.image_network import random_image_model, random_images
    from eskin.golden.model.model import FloatModel

    config = AcceleratorConfig.of_image(12, 14, ("conv 3 4", "pool", "dense 2"), ("cup", "ball"), name="small")
    integer = random_image_model(config, 1)
    FloatModel(config, {name: array / 64.0 for name, array in integer.arrays.items()}).save(folder / "image_model", {"ranges": {"0": 4.0}})
    integer.save(folder / "image_model")
    arrays = {"images": random_images(config, 12, 2), "labels": np.arange(12) % 2, "class_names": np.array(["cup", "ball"])}
    np.savez_compressed(folder / "images.npz", allow_pickle=False, **arrays, person=np.arange(12) // 3)
    (folder / "image.json").write_text(config.to_json())
    (folder / "image_grid.json").write_text(json.dumps({"size": ["12x14", "6x7"], "layers": ["four", ["conv 3 4", "pool"]]}))
    layers = torch.nn.Sequential(torch.nn.Conv2d(1, 4, 3, padding=1), torch.nn.BatchNorm2d(4), torch.nn.Linear(6 * 7 * 4, 2))
    torch.save(layers.state_dict(), folder / "image.pt")


def make_tables(folder: Path, loaded: Any) -> None:
    """The first recordings as CSV files, half of them real numbers, as one long table and as a ``.mat`` file."""
    from scipy.io import savemat

    cells, long = np.empty((1, 4), dtype=object), ["recording,person,class,time,a,b,c,d"]
    for index in range(4):
        samples = loaded.recording(index)[:60]
        name = loaded.class_names[loaded.labels[index]]
        rows = [
            [f"{frame / 500:.4f}", *(str(code / 7 if index > 1 else code) for code in row)] for frame, row in enumerate(samples.tolist())
        ]
        path = folder / "csv" / ("rough", "smooth")[index % 2] / f"p{index}_t1.csv"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("\n".join(["time,a,b,c,d", *(",".join(row) for row in rows)]) + "\n")
        long += [",".join([str(index), str(index // 2), name, *row]) for row in rows]
        cells[0, index] = samples.astype(float)
    (folder / "table.csv").write_text("\n".join(long) + "\n")
    labels, names = loaded.labels[:4] + 1, np.array(loaded.class_names, dtype=object)
    savemat(folder / "r.mat", {"samples": cells, "labels": labels, "class_names": names, "fs": 500.0})


def _take(corpus: Path, case: Path, *names: str) -> None:
    for name in names:
        source, target = corpus / name, case / "in" / name
        (shutil.copytree if source.is_dir() else shutil.copyfile)(source, target)


# ---------------------------------------------------------------------- damage
def damage_bytes(data: bytes, rng: random.Random) -> bytes:
    """Bits flipped, cut off, cut out, repeated, or made up."""
    kind = rng.randrange(7)
    if not data or kind == 0:
        return rng.randbytes(rng.choice((0, 1, 4, 100, 5000)))
    if kind == 1:
        return data[: rng.randrange(len(data))]
    if kind == 2:
        begin = rng.randrange(len(data))
        return data[:begin] + data[begin + rng.randint(1, 64) :]
    if kind == 3:
        begin = rng.randrange(len(data))
        return data[:begin] + data[begin : begin + rng.randint(1, 256)] * rng.randint(2, 4) + data[begin:]
    if kind == 4:
        return data + rng.randbytes(rng.randint(1, 100))
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8, 64))):
        # the ends of a zip archive and the heads of its members decide most
        at = rng.choice((rng.randrange(len(data)), rng.randrange(min(len(data), 128)), len(data) - 1 - rng.randrange(min(len(data), 400))))
        changed[at] = changed[at] ^ 1 << rng.randrange(8) if kind == 5 else rng.choice((0, 0xFF, 0x7F, rng.randrange(256)))
    return bytes(changed)


def damage_json(text: str, rng: random.Random) -> str:
    """One to three fields of other values or types, gone, or new; now and then damage of the text itself."""
    if rng.random() < 0.15:
        return damage_bytes(text.encode(), rng).decode("latin-1")
    if rng.random() < 0.02:
        return rng.choice(("[" * 100_000, '{"a":' * 50_000, "null", "[]", "3", '"x"', "9" * 5000))
    value = json.loads(text)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        where = value
        while isinstance(where, (dict, list)) and where:
            key = rng.choice(list(where)) if isinstance(where, dict) else rng.randrange(len(where))
            if not isinstance(where[key], (dict, list)) or not where[key] or rng.random() < 0.3:
                kind = rng.random()
                if kind < 0.15:
                    del where[key]
                elif kind < 0.2 and isinstance(where, dict):
                    where[rng.choice(("unknown", "", "name"))] = rng.choice(ODD_VALUES)
                elif kind < 0.4 and isinstance(where[key], (int, float)) and math.isfinite(where[key]):
                    where[key] = rng.choice((-1, 2, 0.5, 1000)) * where[key] + rng.choice((0, 1))
                else:
                    where[key] = rng.choice(ODD_VALUES)
                break
            where = where[key]
    return json.dumps(value)


def damage_array(array: np.ndarray, rng: random.Random) -> np.ndarray:
    """Another type, another shape, other values."""
    kind = rng.randrange(10)
    if kind == 0:
        return array.astype(rng.choice(("f8", "f2", "c16", "i1", "u8", "i8", "?", "U8", "S4"))) if array.dtype.kind in "iuf" else array[:0]
    if kind == 1:
        return np.zeros(array.shape, dtype=rng.choice(("M8[s]", "m8[ns]", "V8", [("a", "i4"), ("b", "f8")])))
    if kind == 2:
        return np.array([{"a": 1}, None], dtype=object)
    if kind == 3:
        return array.reshape(rng.choice(((-1,), (1, -1), (-1, 1), (1, 1, *array.shape))))
    if kind == 4:
        return array[: rng.randrange(len(array) + 1)] if array.ndim else np.zeros(0, dtype=array.dtype)
    if kind == 5:
        return np.zeros(rng.choice(((), (0,), (0, 4), (3, 0), (5,), (2, 2, 2))), dtype=array.dtype)
    if array.size and array.dtype.kind in "iuf":
        changed = array.copy()
        if kind == 6 and array.dtype.kind == "f":
            changed.flat[rng.randrange(array.size)] = rng.choice((math.nan, math.inf, -math.inf, 1e300, -1e300, 1e-320))
        elif kind < 9:
            info = np.iinfo(array.dtype) if array.dtype.kind in "iu" else np.finfo(array.dtype)
            for _ in range(rng.randint(1, 3)):
                changed.flat[rng.randrange(array.size)] = rng.choice((info.min, info.max, 0, 1))
        else:
            changed = changed[::-1].copy() if changed.ndim else changed + 1
        return changed
    return np.array(["a\x00b", "[red]", "", "ä" * 300][: max(1, array.size)])


def damage_archive(data: bytes, rng: random.Random) -> bytes:
    """An ``.npz`` whose bytes, members or arrays are wrong, or that is something else altogether."""
    kind = rng.random()
    if kind < 0.35:
        return damage_bytes(data, rng)
    with np.load(io.BytesIO(data)) as archive:
        arrays = {name: archive[name] for name in archive.files}
    if kind < 0.75:
        for _ in range(rng.choice((1, 1, 2))):
            name = rng.choice(list(arrays))
            what = rng.random()
            if what < 0.15:
                del arrays[name]
            elif what < 0.3:
                other = rng.choice(("lsb_volt", "extra", "images", "labels", "sample_rate_is_inferred", "channel_names"))
                arrays[other] = damage_array(arrays[name], rng)
            else:
                arrays[name] = damage_array(arrays[name], rng)
            if not arrays:
                break
        file = io.BytesIO()
        np.savez(file, **arrays)
        return file.getvalue()
    if kind < 0.80:
        file = io.BytesIO()
        np.save(file, next(iter(arrays.values())))
        return file.getvalue()
    return _odd_zip(arrays, rng)


def _odd_zip(arrays: dict[str, np.ndarray], rng: random.Random) -> bytes:
    """Members that numpy would not write: lying headers, bombs, paths out of the folder, double names, pickles, odd methods."""
    file, victim, kind = io.BytesIO(), rng.choice(list(arrays)), rng.randrange(8)
    with zipfile.ZipFile(file, "w", rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA))) as archive:
        for name, array in arrays.items():
            member = io.BytesIO()
            np.save(member, array)
            content = member.getvalue()
            if name == victim and kind == 0:
                content = _header(rng.choice(((10**9, 4), (2**62,), (2**63, 2**63), (-1, 4), (0, 10**18), (10**12,)))) + content[128:]
            elif name == victim and kind == 1:  # 400 MB of zeros in 400 kB
                content = _header((400_000_000 // 16, 4)) + bytes(400_000_000)
            elif name == victim and kind == 2:
                content = rng.choice((b"\x80\x04N.", b"cos\nsystem\n(S'touch pickled'\ntR.", b"", b"\x93NUMPY\x09\x09", content[:40]))
            names = {3: rng.choice(("../../outside.npy", "/tmp/outside.npy", "..\\x.npy", "a/b.npy", "x" * 3000 + ".npy"))}
            archive.writestr(names.get(kind, f"{name}.npy") if name == victim else f"{name}.npy", content)
        if kind == 4:
            archive.writestr(f"{victim}.npy", b"second")
        if kind == 5:
            archive.writestr("folder/", b"")
            archive.writestr("readme", rng.randbytes(100))
    data = bytearray(file.getvalue())
    if kind in (6, 7):  # encrypted, or an unknown method, in every directory entry and member
        for mark, offset in ((b"PK\x01\x02", 8), (b"PK\x03\x04", 6)):
            at = data.find(mark)
            while at >= 0:
                data[at + offset + (0 if kind == 6 else 2)] = 1 if kind == 6 else rng.choice((1, 6, 9, 97))
                at = data.find(mark, at + 4)
    return bytes(data)


def _header(shape: tuple[int, ...]) -> bytes:
    text = f"{{'descr': '<i4', 'fortran_order': False, 'shape': {shape!r}, }}".encode()
    text += b" " * (117 - len(text)) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text


def damage_lvm(data: bytes, rng: random.Random, mark: str = "\t") -> bytes:
    """Cells, rows, separators, encodings, headers."""
    kind = rng.random()
    if kind < 0.25:
        return damage_bytes(data, rng)
    if kind < 0.35:
        text = data.decode()
        return rng.choice(
            (
                text.encode("utf-16"),
                text.replace("\t", ";").encode(),
                text.replace("\t", ",").encode(),
                text.replace(".", ",").encode(),
                text.replace("\t", " ").encode(),
                text.replace("\n", "\r").encode(),
                text.replace("\n", "\r\n").encode(),
                b"\xef\xbb\xbf" + data,
                data.replace(b"\n", b"\n\x00"),
                data + b"1" * 200_000,
                data * 40,
                text.replace("\t", ", ").encode(),
            )
        )
    lines = data.decode().split("\n")
    for _ in range(rng.choice((1, 1, 2, 5))):
        at, what = rng.randrange(len(lines)), rng.randrange(6)
        cells = lines[at].split(mark)
        cell = rng.randrange(len(cells))
        if what == 0:
            lines.insert(at, rng.choice(lines))
        elif what == 1:
            del lines[at:][: rng.randint(1, 10)]
            lines = lines or [""]
        elif what == 2:
            lines[at] = rng.choice(("***End_of_Header***", "Channels\t4", "\t\t\t", "0\t1", "x\ty", "1;2;3;4;5", "1,5\t2,5", "\x0c"))
        else:
            cells[cell] = rng.choice(("nan", "inf", "-1e999", "", "abc", "1e5", "-3", "1_0", "١", "0x1", "1,5", "9" * 400, "1\t" * 2000))
            if what == 3:
                cells = cells[: cell + 1]
            lines[at] = mark.join(cells)
    return "\n".join(lines).encode("utf-8", "replace")


# ---------------------------------------------------------------------- the groups
def archives(corpus: Path, case: Path, rng: random.Random) -> list[str]:
    """A damaged archive of recordings, or a damaged network, under any verb that reads it."""
    if rng.random() < 0.25:
        name = rng.choice(("network.pt", "keras.npz"))
        _take(corpus, case, name, "config.json")
        damage = damage_archive if name == "keras.npz" else damage_bytes
        _rewrite(case / "in" / name, lambda data: damage(data, rng))
        scale = rng.choice((["--mean", "0", "--std", "40"], ["--mean", rng.choice(NUMBERS), "--std", rng.choice(NUMBERS)]))
        return ["import", f"../in/{name}", "--out", "made", "--config", "../in/config.json", *scale]
    _take(corpus, case, "recordings.npz", "config.json", "model")
    file = case / "in" / "recordings.npz"
    if rng.random() < 0.02:
        file.unlink()
        rng.choice((os.mkfifo, os.mkdir, lambda name: os.symlink(name, name)))(file)
    else:
        _rewrite(file, lambda data: damage_archive(data, rng))
    return _reading("../in/recordings.npz", rng)


def _reading(data: str, rng: random.Random) -> list[str]:
    """A command that reads recordings."""
    config = rng.choice(([], ["--config", "../in/config.json"], ["--config", rng.choice(("thesis", "pvdf", "fabric", "synthetic"))]))
    model = ["../in/model", "--data", data]
    return rng.choice(
        (
            ["inspect", data, "--json", "look.json", *config],
            ["inspect", data, *config],
            ["train", "--data", data, "--out", "made", *config],
            ["evaluate", *model, "--json", "e.json"],
            ["cosim", *model],
            ["sweep", "--data", data, *config, "--folds", "2", "--seeds", "1"],
            ["leak-check", "--data", data, *config],
            ["generate", *model, "--out", "design"],
            ["stability", *model],
            ["run", "--data", data, *config],
            ["energy", *model],
            ["import", "../in/model/float.npz", "--out", "made", "--config", "../in/config.json", "--data", data],
        )
    )


def lvm_files(corpus: Path, case: Path, rng: random.Random) -> list[str]:
    """A folder of ``.lvm`` files, one or two of them damaged, or the folder itself odd."""
    _take(corpus, case, "lvm", "config.json", "model")
    folder = case / "in" / "lvm"
    files = sorted(folder.rglob("*.lvm"))
    for file in rng.sample(files, rng.choice((1, 1, 2))):
        _rewrite(file, lambda data: damage_lvm(data, rng))
    if rng.random() < 0.08:
        odd, target = rng.randrange(6), rng.choice(files)
        if odd == 0:
            (folder / rng.choice(("empty", "[red]", "ä\udcff", " "))).mkdir()
        elif odd in (1, 2, 3):
            target.unlink()
            (os.mkdir, os.mkfifo, lambda name: os.symlink(name, name))[odd - 1](target)
        elif odd == 4:
            names = ("x.LVM", "\udcff.lvm", "p9_t9_t8.lvm", "p99999999999999999999_t1.lvm", ".lvm", "[b].lvm")
            target.rename(target.with_name(rng.choice(names)))
        else:
            shutil.rmtree(target.parent)
    return _reading("../in/lvm", rng)


def tables(corpus: Path, case: Path, rng: random.Random) -> list[str]:
    """A folder of CSV files, a long table or a ``.mat`` file, damaged; read by any verb, or converted with odd options."""
    what = rng.choice(("csv", "csv", "table.csv", "r.mat"))
    _take(corpus, case, what, "config.json", "model")
    place = case / "in" / what
    files = sorted(place.rglob("*.csv")) if place.is_dir() else [place]
    for file in rng.sample(files, min(len(files), rng.choice((0, 1, 1, 2)))):
        _rewrite(file, lambda data: damage_bytes(data, rng) if what == "r.mat" else damage_lvm(data, rng, ","))
    if rng.random() < 0.5:
        return _reading(f"../in/{what}", rng)
    options: list[str] = []
    for option in rng.sample(
        ("--rate", "--time", "--columns", "--recording", "--class", "--group", "--delimiter", "--samples", "--scale"), 2
    ):
        good = {"--columns": ("2-5", "a,b,c,d"), "--group": ("person",), "--delimiter": (",", "tab"), "--class": ("class", "labels")}
        options += [option, rng.choice((*good.get(option, ("time", "100", "1")), *NUMBERS, *WORDS))] if rng.random() < 0.7 else []
    return ["convert", f"../in/{what}", "--out", rng.choice(("made.npz", "made.npz", "keep", "deep/made.npz")), *options]


def models(corpus: Path, case: Path, rng: random.Random) -> list[str]:
    """A damaged model folder, configuration, grid or result folder, under a verb that reads it."""
    what = rng.random()
    if what < 0.25:
        _take(corpus, case, "result")
        file = rng.choice(sorted(path for path in (case / "in" / "result").rglob("*") if path.is_file()))
        _damage_file(file, rng)
        shutil.move(case / "in" / "result", case / "out" / "result")  # the page is written into it
        return ["report", "result"]
    if what < 0.5:
        _take(corpus, case, "recordings.npz", "config.json", "grid.json", "keras.npz")
        data, config = "../in/recordings.npz", ["--config", "../in/config.json"]
        if what < 0.32:
            _damage_file(case / "in" / "grid.json", rng)
            return ["sweep", "--data", data, "--grid", "../in/grid.json", *rng.choice(([], config))]
        _damage_file(case / "in" / "config.json", rng)
        return rng.choice(
            (
                ["inspect", data, *config],
                ["train", "--data", data, "--out", "made", *config],
                ["sweep", "--data", data, *config],
                ["import", "../in/keras.npz", "--out", "made", *config, "--mean", "0", "--std", "9"],
                ["run", "--data", data, *config],
                ["leak-check", "--data", data, *config],
                ["inspect", "synthetic", *config],
            )
        )
    _take(corpus, case, "recordings.npz", "model")
    folder = case / "in" / "model"
    for file in rng.sample(sorted(folder.iterdir()), rng.choice((1, 1, 1, 2))):
        _damage_file(file, rng)
    if rng.random() < 0.05:
        (folder / "foreign").write_text("keep")
    model, data = "../in/model", "../in/recordings.npz"
    if rng.random() < 0.3:  # written in place
        shutil.move(folder, case / "out" / "model")
        return ["quantise", "model", *rng.choice(([], ["--data", data], ["--weight-bits", rng.choice(NUMBERS)]))]
    return rng.choice(
        (
            ["evaluate", model, "--data", data],
            ["cosim", model, "--data", data],
            ["generate", model, "--out", "design"],
            ["generate", model, "--out", "design", "--lanes", rng.choice(NUMBERS)],
            ["schedule", model],
            ["energy", model, "--data", data],
            ["stability", model, "--data", data],
            ["build", model, "--target", "icebreaker"],
            ["replay", model, "--port", "/dev/null", "--baud", "2000000", "--data", data],
        )
    )


def images(corpus: Path, case: Path, rng: random.Random) -> list[str]:
    """A damaged archive of images, model of them, list of layers, grid or state_dict, under any verb that reads it."""
    _take(corpus, case, "images.npz", "image_model", "image.json", "image_grid.json", "image.pt")
    folder, what = case / "in", rng.random()
    data, model, config = "../in/images.npz", "../in/image_model", ["--config", "../in/image.json"]
    if what < 0.15:
        _rewrite(folder / "image.pt", lambda content: damage_bytes(content, rng))
        scale = rng.choice((["--mean", "0", "--std", "255"], ["--mean", rng.choice(NUMBERS), "--std", rng.choice(NUMBERS)]))
        return ["import", "../in/image.pt", "--out", "made", *config, *scale]
    if what < 0.3:
        _damage_file(folder / "image_grid.json", rng)
        return ["sweep", "--data", data, "--grid", "../in/image_grid.json", "--folds", "2", "--out", "swept"]
    if what < 0.45:
        _damage_file(folder / "image.json", rng)
        imported = ["import", "../in/image.pt", "--out", "made", *config, "--mean", "0", "--std", "255"]
        return rng.choice((["train", "--data", data, "--out", "made", *config], ["run", "--data", data, *config], imported))
    if what < 0.6:
        for file in rng.sample(sorted((folder / "image_model").iterdir()), rng.choice((1, 1, 2))):
            _damage_file(file, rng)
    else:
        _rewrite(folder / "images.npz", lambda content: damage_archive(content, rng))
    read = ["--data", data]
    return rng.choice(
        (
            ["inspect", data, "--json", "look.json"],
            ["convert", data, "--size", rng.choice(("6x7", "12x14", rng.choice(NUMBERS))), "--out", "small.npz"],
            ["train", *read, "--out", "made", *rng.choice(([], ["--cell", "tactnet"], config))],
            ["sweep", *read, "--folds", "2", "--out", "swept"],
            ["evaluate", model, *read, "--json", "e.json"],
            ["compare", model, *rng.choice(([], read)), "--out", "page"],
            ["stability", model, *read, "--out", "stable"],
            ["cosim", model, *read],
            ["generate", model, "--out", "design"],
            ["schedule", model, "--out", "drawn"],
            ["run", *read],
            ["watch", model, *read, "--terminal", "--speed", "max"],
            ["replay", model, "--port", "/dev/null", "--baud", "2000000", *read],
        )
    )


CHIPS = ("ads7953", "mcp3208x2", "ad7476", "spi", "ddc232", "mpr121", "matrix", "none")


def interfaces(corpus: Path, case: Path, rng: random.Random) -> list[str]:
    """A model whose configuration has an interface of good, borderline and odd values, under a verb that makes hardware of it."""
    from eskin.golden.core.groups import Interface

    _take(corpus, case, "recordings.npz", "model")
    file = case / "in" / "model" / "config.json"
    values = json.loads(file.read_text())
    fields = {"converter": rng.choice(CHIPS), "stimulator": rng.choice(("none", "decisions")), "rows": 2, "columns": 2, "mpr_chips": 2}
    names = [field.name for field in dataclasses.fields(Interface)]
    for name in rng.sample(names, rng.choice((0, 0, 1, 1, 3))):
        numbers = (
            0,
            1,
            2,
            3,
            4,
            7,
            8,
            12,
            16,
            17,
            24,
            31,
            32,
            33,
            255,
            256,
            4095,
            65535,
            65536,
            -1,
            1 << 24,
            1e-6,
            1e6,
            20e6,
            rng.random(),
        )
        fields[name] = rng.choice(ODD_VALUES) if rng.random() < 0.2 else rng.choice(numbers)
    values["interface"] = fields
    values["sensor"]["sample_rate_hz"] = rng.choice((500.0, 500.0, 500.0, 50.0, 6000.0))
    values["hardware"]["clock_hz"] = rng.choice((12e6, 12e6, 25e6, 25e6, 2e6, 3e5))
    file.write_text(json.dumps(values))
    if rng.random() < 0.1:
        _damage_file(file, rng)
    model, chip = "../in/model", rng.choice((*CHIPS, "x"))
    target = ["--target", rng.choice(("icebreaker", "upduino", "ulx3s", "icestick"))]
    odd = [option for option in ("--standalone", "--stimulator", "--flash", "--no-link") if rng.random() < 0.4]
    return rng.choice(
        (
            ["generate", model, "--out", "design"],
            ["generate", model, "--out", "design"],
            ["schedule", model],
            ["cosim", model, "--data", "../in/recordings.npz", *rng.choice(([], ["--converter", chip]))],
            ["build", model, *target, *odd, *rng.choice(([], ["--converter", chip]))],
            ["energy", model, "--data", "../in/recordings.npz"],
            ["inspect", "../in/recordings.npz", "--config", "../in/model/config.json"],
        )
    )


def _damage_file(file: Path, rng: random.Random) -> None:
    what = rng.random()
    if what < 0.04:
        file.unlink()
        if what < 0.02:
            # a user's own --grid or --config may be a pipe, and waits for its writer as any program would
            rng.choice((os.mkdir, os.mkdir if file.parent.name == "in" else os.mkfifo))(file)
    elif file.suffix == ".json":
        file.write_text(damage_json(file.read_text(), rng))
    else:
        _rewrite(file, lambda data: damage_archive(data, rng))


def _rewrite(file: Path, change: Callable[[bytes], bytes]) -> None:
    file.write_bytes(change(file.read_bytes()))


def commands(corpus: Path, case: Path, rng: random.Random) -> list[str]:
    """A command line of good inputs: any verb, any of its options, with good and bad values in any order."""
    _take(corpus, case, *INPUTS)
    for name in ("keep", "foreign/keep"):
        (case / "out" / name).parent.mkdir(exist_ok=True)
        (case / "out" / name).write_text("keep")
    shutil.copytree(corpus / "model", case / "out" / "model")
    verbs = _verbs()
    verb = rng.choice(sorted(verbs))
    if rng.random() < 0.02:
        return [rng.choice((*WORDS, "--version", "--help", verb[:-1], verb.upper())), rng.choice(WORDS)]
    arguments, options = [], []
    for parameter in verbs[verb].params:
        often = 0.9 if parameter.name == "data" else 0.25  # without data it is the synthetic scene, which is large
        given = parameter.required or rng.random() < often
        if given and rng.random() > 0.04:
            value = _value(verb, parameter, rng)
            if parameter.param_type_name == "argument":
                arguments.append(value)
            elif parameter.is_flag:
                options.append([rng.choice([*parameter.opts, *parameter.secondary_opts])])
            else:
                options += [[parameter.opts[0], value]] * rng.choice((1, 1, 1, 1, 2))
    if rng.random() < 0.06:
        options.append([rng.choice(("--unknown", "--help", "-x", "--", "--out", "--json", "-", "--=", rng.choice(WORDS)))])
    rng.shuffle(options)
    words = [verb, *arguments, *(word for option in options for word in option)]
    return words if rng.random() > 0.05 else words[: rng.randrange(1, len(words) + 1)]


@functools.cache
def _verbs() -> dict[str, Any]:
    import typer

    from eskin.cli.main import app

    return (app if hasattr(app, "commands") else typer.main.get_command(app)).commands


def _value(verb: str, parameter: Any, rng: random.Random) -> str:
    """A value for one option or argument, mostly of the right kind."""
    name, kind = parameter.name, parameter.type_descriptor.annotation
    if name in ("out", "json"):
        return rng.choice(("new", "new", "new/deep", "model", "foreign", "keep", "keep/under", ".", "", "/dev/null", "x" * 300))
    if rng.random() < 0.08:
        return rng.choice((*WORDS, *NUMBERS, *(f"../in/{one}" for one in INPUTS)))
    good = {
        "model": ("model" if verb == "quantise" else "../in/model", "thesis")[: 2 if verb == "schedule" else 1],
        "data": ("../in/recordings.npz", "../in/recordings.npz", "../in/lvm", "../in/csv", "synthetic"),
        "source": ("../in/csv", "../in/table.csv", "../in/r.mat", "../in/lvm"),
        "config": ("../in/config.json", "pvdf", "thesis"),
        "file": ("../in/network.pt", "../in/keras.npz"),
        "folder": ("../in/model",),
        "grid": ("../in/grid.json", "bits", "default"),
        "group": ("person", "source_file", "person,source_file", ""),
        "recordings": ("1", "2", "all", "-1", "0"),
        "target": ("icebreaker", "icestick", "ulx3s", "upduino", "icesugar-nano", "x"),
        "port": ("/dev/null", "../in/config.json", "none"),
        "mode": ("dead taxel", "drift", "x"),
        "configuration": ("icebreaker:4", "ulx3s:1:dsp", "icestick:0", ":::"),
        "clock": ("12e6", "lowest", "1", "-1", "nan"),
        "dask": ("tcp://127.0.0.1:1", "x"),
    }.get(name)
    if good:
        return rng.choice(good)
    if isinstance(kind, type) and issubclass(kind, StrEnum):
        return rng.choice([*(str(choice) for choice in kind), "x"])
    return rng.choice(("1", "2", "3", "4", "6", "8", "12", "0.5", rng.choice(NUMBERS)))


def traffic(seed: str, folder: Path, builds: Path) -> list[str]:
    """Every second input rubbish, the others meddling (tests/support/traffic_case.py); what of the recording is not golden."""
    from tests.support.traffic_case import judge, meddling, recovery, small_case

    case = small_case()
    script = recovery(case, seed) if int(seed.rpartition("/")[2]) % 2 else meddling(case, seed, case.open_frames(folder))
    return judge(script, case, folder, builds)[1]


GROUPS: dict[str, tuple[int, Callable[..., Any]]] = {
    "commands": (3300, commands),
    "archives": (2300, archives),
    "lvm files": (1400, lvm_files),
    "tables": (1400, tables),
    "model folders": (2400, models),
    "images": (1200, images),
    "interfaces": (600, interfaces),
    "processes": (200, commands),
    "bus traffic": (400, traffic),
}
"""Group: its share of the inputs, and what makes one."""
