"""``make docs``: what the site has beyond the pages in docs/. mkdocs calls the functions whose names begin with ``on_``.

The order of the pages, the tables of fields and of modules in place of their markers, and an API page for each folder of code.
A page in docs/ that `ORDER` does not know comes last; one that it names and that is not there is left out.
"""

from __future__ import annotations

import ast
import dataclasses
import functools
import inspect
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from annotated_types import Ge, Gt, Interval

from eskin.golden.core.formats import QFormat
from eskin.golden.core.groups import GROUPS

ROOT = Path(__file__).resolve().parents[1]
CODE = ("golden", "rtl", "cosim", "eskin", "scripts")
ORDER = {
    "": ["index"],
    "Use": [
        "quick_start",
        "report",
        "recordings",
        "images",
        "python",
        "configuration",
        "front_end",
        "features",
        "linear",
        "widths",
        "enrolment",
        "boards",
        "live_view",
        "interface",
    ],
    "Judge": ["results", "baselines", "robustness", "energy", "verification", "long_jobs", "skipped_work"],
    "Change": ["where", "specification", "changing", "area", "glossary"],
}
"""Sections of the navigation and the pages in them, in the order in which a newcomer reads."""


# ------------------------------------------------------------------ pages
def pages() -> dict[str, list[Path]]:
    """The pages in docs/ by section, in the order of the site; those that `ORDER` does not know under More."""
    there = {path.stem: path for path in sorted((ROOT / "docs").glob("*.md"))}
    known = {name for names in ORDER.values() for name in names}
    sections = {section: [there[name] for name in names if name in there] for section, names in ORDER.items()}
    return sections | {"More": [path for name, path in there.items() if name not in known]}


def packages() -> dict[str, list[Path]]:
    """The modules of each folder of code, by the folder's dotted name as it is imported."""
    found: dict[str, list[Path]] = {}
    for folder in CODE:
        for path in sorted((ROOT / folder).rglob("*.py")):
            if path.stem != "__init__":
                parts = path.relative_to(ROOT).parent.parts
                found.setdefault(".".join(parts if folder in ("eskin", "scripts") else ("eskin", *parts)), []).append(path)
    return found


# ------------------------------------------------------------------ fields of the configuration
def _said(hint: Any) -> str:
    """What may be given for a field, from its annotation."""
    if get_origin(hint) is Literal:
        return ", ".join(f"`{word}`" for word in get_args(hint))
    if get_origin(hint) in (Union, UnionType):
        return f"{_said(get_args(hint)[0])}, or null"
    if get_origin(hint) is tuple:
        return f"list of: {_said(get_args(hint)[0])}"
    if isinstance(hint, type):
        return {int: "whole number", float: "number", bool: "`true`, `false`", str: "text"}.get(hint, hint.__name__)
    kind, *rules = _flat(hint)
    if QFormat in (kind, *get_args(kind)):
        return "signed format"
    for rule in rules:
        if isinstance(rule, Interval):
            return f"{_said(kind)}, {rule.ge}..{rule.le}"
        if isinstance(rule, Ge):
            return f"{_said(kind)}, at least {rule.ge}"
        if isinstance(rule, Gt):
            return f"{_said(kind)}, above {rule.gt}"
    return _said(kind)


def _flat(hint: Any) -> tuple[Any, ...]:
    """(type, metadata...) of an annotation, however often it was annotated."""
    kind = getattr(hint, "__origin__", hint)
    return kind, *getattr(hint, "__metadata__", ())


def _default(value: Any) -> str:
    if value is None:
        return "null"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    return ", ".join(map(str, value)) or "none" if isinstance(value, tuple) else f"`{value}`" if isinstance(value, str) else f"{value}"


def fields_table(group: str) -> str:
    """What ``group``'s docstring says, and a table of its fields: name, what may be given, default. Markdown."""
    kind = GROUPS[group]
    hints = get_type_hints(kind, include_extras=True)
    fields: list[dataclasses.Field] = list(dataclasses.fields(kind))  # type: ignore[arg-type]
    names = "|".join(sorted((field.name for field in fields), key=len, reverse=True))
    said = re.sub(rf"(?<![`\w])({names})(?![`\w])", r"`\1`", inspect.cleandoc(kind.__doc__ or "").replace("``", "`").replace("|", "\\|"))
    rows = [f"| `{field.name}` | {_said(hints[field.name])} | {_default(field.default)} |" for field in fields]
    return "\n".join([said, "", f"| field of `{group}` | give | default |", "| --- | --- | --- |", *rows])


# ------------------------------------------------------------------ modules
@functools.cache  # a file is asked for once for every module of the table
def docstring_of(path: Path) -> str:
    """A module's docstring; the file is not imported."""
    return ast.get_docstring(ast.parse(path.read_text())) or ""


def sections_of(path: Path) -> set[int]:
    """Sections of the specification that a module's docstring names."""
    said = docstring_of(path)
    found: set[int] = set()
    for first, link, last in re.findall(r"specification\.md,?\s+sections?\s+(\d+)(?:\s+(to|and)\s+(\d+))?", said):
        found |= set(range(int(first), int(last) + 1)) if link == "to" else {int(first)} | ({int(last)} if last else set())
    return found


def companions(path: Path) -> dict[str, list[Path]]:
    """Of a module: its test, its proof, and (hardware) the golden model of the same sections. Found by name and section alone."""
    way = path.relative_to(ROOT)
    test = ROOT / "tests" / way.parent / f"test_{way.name}"
    proof = ROOT / "formal" / way.relative_to("rtl") if way.parts[0] == "rtl" else None
    wanted = sections_of(path) if way.parts[0] == "rtl" else set()
    models = [
        other
        for name in ("golden/core", "golden/model", "cosim")
        for other in sorted((ROOT / name).glob("*.py"))
        if sections_of(other) & wanted
    ]
    return {"test": [test] if test.exists() else [], "proof": [proof] if proof and proof.exists() else [], "model": models}


def modules_table() -> str:
    """Every module: its file, what it is, its test, proof and model. Markdown."""

    def rows() -> Iterator[str]:
        for path in (path for paths in packages().values() for path in paths):
            said = docstring_of(path).split("\n")[0].replace("|", "\\|")
            others = companions(path)
            cells = [", ".join(f"`{other.relative_to(ROOT)}`" for other in others[kind]) for kind in ("test", "proof", "model")]
            yield f"| `{path.relative_to(ROOT)}` | {said} | {' | '.join(cells)} |"

    return "\n".join(["| module | what | test | proof | model |", "| --- | --- | --- | --- | --- |", *rows()])


def filled(text: str) -> str:
    """A page with its tables in place of the markers, and an empty line before each list, which Python's Markdown wants."""
    text = re.sub(r"<!-- fields: (\w+) -->", lambda found: fields_table(found[1]), text)
    if "<!-- modules -->" in text:
        text = text.replace("<!-- modules -->", modules_table())
    parts = re.split(r"(^```.*?^```$)", text, flags=re.MULTILINE | re.DOTALL)
    return "".join(
        part if part.startswith("```") else re.sub(r"(?m)^((?!- |\d+\. |  |#|$).*)\n(?=- |1\. )", r"\1\n\n", part) for part in parts
    )


# ------------------------------------------------------------------ mkdocs
def on_startup(**_: Any) -> None:
    """A copy of the code as it lies once installed, for the API reference (it resolves links). The reference's reader looks for
    its folder when the configuration is read and never again, so the copy is made before that."""
    roof = ROOT / "build" / "docs_source"
    shutil.rmtree(roof, ignore_errors=True)
    for path in (path for folder in CODE for path in (ROOT / folder).rglob("*.py")):
        way = path.relative_to(ROOT)
        copy = roof / (way if way.parts[0] in ("eskin", "scripts") else "eskin" / way)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, copy)


def on_config(config: Any) -> Any:
    """The navigation."""
    config.nav = [{section: [path.name for path in paths]} if section else paths[0].name for section, paths in pages().items() if paths]
    config.nav.append({"API": [f"api/{name}.md" for name in packages()]})
    return config


def on_files(files: Any, config: Any) -> Any:
    """An API page for each folder of code."""
    from mkdocs.structure.files import File

    for name, paths in packages().items():
        parts = [f"## {path.stem}\n\n::: {name}.{path.stem}\n    options:\n      show_root_heading: false\n" for path in paths]
        files.append(File.generated(config, f"api/{name}.md", content=f"# {name}\n\n" + "\n".join(parts)))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """The tables of a page."""
    return filled(markdown)
