"""Whether a file that left the project holds a model: its numbers are read from it and compared, one by one.

No line that only claims something counts: a file whose ``model_hash`` does not belong to its contents differs, too.
"""

import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from eskin.exchange import plain_c
from eskin.golden.core import APART, AcceleratorConfig, Arrays, InputError, Result
from eskin.golden.core.config import GROUP_OF
from eskin.golden.model import IntegerModel
from eskin.golden.model.model import CONFIG_FILE, INTEGER_FILE

BUILD_FILE, MEMORIES, LOAD = "build.json", "memories", "load.hex"

Contents = Callable[[AcceleratorConfig, Arrays], dict[str, str]]
"""Files by which a design's model is known."""


class Certificate(Result):
    """evaluate.json with ``--against``. differences: what differs, in words. values: numbers, fields and lines compared."""

    file: str
    model: str
    model_hash: str
    values: int
    differences: list[str]
    passed: bool


class _Comparison:
    """Counts values, and keeps a sentence for each thing that differs."""

    def __init__(self) -> None:
        self.values = 0
        self.sentences: list[str] = []

    def array(self, name: str, there: np.ndarray, here: np.ndarray) -> None:
        """An array of the file and of the model."""
        there, here = np.asarray(there), np.asarray(here)
        if there.shape != here.shape:
            self.sentences.append(f"{name}: has shape {there.shape} there and {here.shape} in the model")
            return
        self.values += here.size
        different = np.argwhere(there != here)
        if len(different):
            place = tuple(different[0].tolist())
            where = f"[{', '.join(map(str, place))}]" if place else ""
            more = f" ({len(different)} values differ)" if len(different) > 1 else ""
            self.sentences.append(
                f"{name}{where}: is {there[place]} there and {here[place]} in the model{more}"
            )

    def arrays(self, there: Arrays, here: Arrays) -> None:
        """Arrays by name."""
        for name in sorted(there.keys() | here.keys()):
            if name in there and name in here:
                self.array(name, there[name], here[name])
            else:
                self.sentences.append(f"{name}: is only {'there' if name in there else 'in the model'}")

    def configuration(self, there: AcceleratorConfig, here: AcceleratorConfig) -> None:
        """The fields on which decisions depend."""
        fields = [field for field, group in GROUP_OF.items() if group not in APART]
        self.values += len(fields)
        self.sentences += [
            f"field {field}: is {there.value(field)} there and {here.value(field)} in the model"
            for field in ("name", *fields)
            if there.value(field) != here.value(field)
        ]

    def text(self, name: str, there: str, here: str) -> None:
        """Text of the file, and what the model's would be, line by line."""
        lines = there.splitlines(), here.splitlines()
        self.values += len(lines[1])
        for number, (in_file, in_model) in enumerate(zip(*lines, strict=False), start=1):
            if in_file != in_model:
                self.sentences.append(
                    f"{name}, line {number}: is '{in_file}' there and '{in_model}' of the model"
                )
                return
        if len(lines[0]) != len(lines[1]):
            self.sentences.append(f"{name}: has {len(lines[0])} lines there and {len(lines[1])} of the model")

    def claim(self, there: str | None, here: str) -> None:
        """The hash that the file gives for itself."""
        if there != here:
            self.sentences.append(f"model_hash: is {there} there and {here} of the model")


class Claim(Result):
    """Of a file that names its model."""

    model_hash: str | None = None


def certify(model: IntegerModel, path: Path, contents: Contents) -> Certificate:
    """Compare the model with what ``path`` holds: an exact ONNX file, the header or source of a C export,
    build.json or the config.json of `generate` (with load.hex and memories beside them), or config.json of a model
    folder. Lanes, converter and what else no decision depends on may differ. contents: of `eskin.rtl.fpga.generate`.

    Raises
    ------
    InputError
        It is none of these, damaged, or holds the float network.
    """
    if not path.is_file():
        raise InputError(f"`against` {path}: is not a file; name a file of export, generate or build")
    found = _Comparison()
    if path.suffix == ".onnx":
        _compare_onnx(found, model, path)
    elif re.fullmatch(r".+_model\.[ch]", path.name):
        _compare_c(found, model, path)
    elif path.name == BUILD_FILE or path.name == CONFIG_FILE:
        _compare_design(found, model, path, contents)
    else:
        raise InputError(
            f"`against` {path}: is no file that a model is known by; give an .onnx file, eskin_model.h, "
            "build.json or config.json"
        )
    return Certificate(
        file=str(path),
        model=model.source,
        model_hash=model.model_hash,
        values=found.values,
        differences=found.sentences,
        passed=not found.sentences,
    )


def _compare_onnx(found: _Comparison, model: IntegerModel, path: Path) -> None:
    import onnx
    from onnx import numpy_helper

    from eskin.exchange import exact_onnx
    from eskin.exchange.onnx_file import METADATA

    try:
        proto = onnx.load(path)
        metadata = json.loads({each.key: each.value for each in proto.metadata_props}[METADATA])
    except Exception:  # protobuf's errors have no common class of their own
        raise InputError(f"`against` {path}: is not an ONNX file of eskin; export the model again") from None
    if "scale" not in metadata:
        raise InputError(
            f"`against` {path}: holds the float network, which is another one; export the model with `exact`"
        )
    found.claim(metadata.get("model_hash"), model.model_hash)
    found.configuration(AcceleratorConfig.from_dict(metadata["config"], str(path)), model.config)
    graph = (
        exact_onnx.step_graph
        if "step" in {each.name for each in proto.graph.input}
        else exact_onnx.touch_graph
    )
    own = graph(model).graph
    constants = [
        {each.name: numpy_helper.to_array(each) for each in part.initializer} for part in (proto.graph, own)
    ]
    scales = [{name: np.asarray(metadata[name]) for name in ("mean", "scale")}]
    scales += [{name: model.arrays[name] for name in ("mean", "scale")}]
    found.arrays(constants[0] | scales[0], constants[1] | scales[1])
    nodes = [[each.SerializeToString() for each in part.node] for part in (proto.graph, own)]
    if nodes[0] != nodes[1]:
        found.sentences.append("nodes of the graph: are others there than in the model's")


def _compare_c(found: _Comparison, model: IntegerModel, path: Path) -> None:
    prefix = path.stem.removesuffix("_model")
    own = plain_c.sources(model, prefix)
    for name in (plain_c.HEADER, plain_c.SOURCE):
        file = path.with_name(name.replace("eskin_", f"{prefix}_"))
        try:
            there, here = file.read_text(), own[file.name]
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"`against` {file}: cannot be read ({error}); export the model again") from None
        claims = [re.search(r'MODEL_HASH "(\w+)"', text) for text in (there, here)]
        if claims[1]:
            found.claim(claims[0] and claims[0][1], claims[1][1])
        tables = [dict(_tables(text)) for text in (there, here)]
        found.arrays(*tables)
        if tables[0].keys() == tables[1].keys() and not found.sentences:
            found.text(file.name, there, here)


def _tables(text: str) -> Iterator[tuple[str, np.ndarray]]:
    """Tables of numbers in C source: name and values, in a row."""
    for name, values in re.findall(
        r"(\w+)(?:\[\d+\])+ = (\{[^;]*\});", re.sub(r"/\*.*?\*/|\"[^\"]*\"", "", text)
    ):
        yield name, np.array(re.findall(r"-?\d+", values), dtype=np.int64)


def _compare_design(found: _Comparison, model: IntegerModel, path: Path, contents: Contents) -> None:
    folder = path.parent
    config = AcceleratorConfig.load(folder / CONFIG_FILE)
    found.configuration(config, model.config)
    found.claim(Claim.read(path, "make it again").model_hash, model.model_hash)
    if (folder / INTEGER_FILE).exists():
        found.arrays(IntegerModel.load(folder, images=True).arrays, model.arrays)
        return
    if any(each.startswith("field") for each in found.sentences):
        return  # memories of another network have other places
    own = contents(config, model.arrays)
    for name in sorted(own.keys() - {CONFIG_FILE}):
        file = folder / name
        if not file.is_file():
            raise InputError(f"`against` {path}: has no {name} beside it; keep the folder whole")
        words = [[int(line, 16) for line in text.split()] for text in (file.read_text(), own[name])]
        found.array(f"{name}, word", *map(np.asarray, words))
