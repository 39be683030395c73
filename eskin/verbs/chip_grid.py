"""All chips that a table asks for, one after the other: processes, lanes, ROM and loadable; what is kept is not made again."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from eskin.golden.core.memo import Memo, code_version, content_key
from eskin.golden.data.recordings import Recordings
from eskin.golden.model.model import IntegerModel

RowOf = Callable[[str, Sequence[Path], int, bool], dict[str, Any]]
"""A chip of (process, its Liberty files, lanes, constants in ROMs)."""


def chip_parser(name: str, said: str) -> argparse.ArgumentParser:
    """Arguments that say which chips: model, processes, recordings, lanes, constants, and where rows are kept."""
    parser = argparse.ArgumentParser(prog=f"python -m eskin.verbs.{name}", description=said.splitlines()[0])
    parser.add_argument("model", type=Path)
    parser.add_argument("--process", nargs="+", action="append", required=True, metavar="NAME FILE ...", help="its Liberty files behind it")
    parser.add_argument("--data", default="synthetic")
    parser.add_argument("--lanes", type=int, nargs="+", default=[1, 4])
    parser.add_argument("--constants", nargs="+", choices=["rom", "loaded"], default=["rom", "loaded"])
    parser.add_argument("--out", type=Path, default=Path(f"build/{name}"))
    return parser


def rows_of(
    asked: argparse.Namespace, model: IntegerModel, recordings: Recordings, row_of: RowOf, *, also: bool, told: Callable[[dict], str]
) -> list[dict[str, Any]]:
    """A row a chip, kept in the folder ``asked.out``, and ``told`` of it; ``also``: what else was asked."""
    memo, rows = Memo(asked.out), []
    for pdk, *liberty in asked.process:
        for lanes in asked.lanes:
            for constants in asked.constants:
                files = [Path(path) for path in liberty]
                key = content_key(code_version("golden", "rtl", "cosim"), model, recordings, *files, pdk, lanes, constants, also)
                rows.append(memo.remembered(key, lambda: row_of(pdk, files, lanes, constants == "rom")))  # noqa: B023 (called at once)
                print(f"{pdk}, {lanes} lanes, {constants}: {told(rows[-1])}", flush=True)
    return rows
