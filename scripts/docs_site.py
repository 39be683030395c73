"""``make docs``: what the site has beyond the pages in docs/. mkdocs calls the functions named ``on_...``.

They add the tables of fields in place of their markers, and an API page for each folder of code.
"""

import ast
import dataclasses
import inspect
import json
import re
import shutil
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from eskin.golden.core.groups import GROUPS
from eskin.rtl.program import register_files
from scripts import ROOT

CODE = ("golden", "rtl", "cosim", "eskin", "scripts")
KINDS = {"integer": "whole number", "number": "number", "string": "text", "boolean": "`true`, `false`"}
LIMITS = {"minimum": "at least", "exclusiveMinimum": "above"}


# ------------------------------------------------------------------ modules
def packages() -> dict[str, list[Path]]:
    """The modules of each folder of code, by the folder's dotted name as it is imported."""
    modules: dict[str, list[Path]] = {}
    for path in (path for folder in CODE for path in sorted((ROOT / folder).rglob("*.py"))):
        if path.stem != "__init__" and path.parent.name != "templates":
            parts = path.relative_to(ROOT).parent.parts
            parts = parts if parts[0] in ("eskin", "scripts") else ("eskin", *parts)
            modules.setdefault(".".join(parts), []).append(path)
    return modules


# ------------------------------------------------------------------ fields of the configuration
def _choices(schema: dict[str, Any]) -> str:
    """Possible values of a field, from its JSON schema."""
    if "$ref" in schema:
        return "a name, or an object" if schema["$ref"].endswith("Converter") else "signed format"
    if "enum" in schema:
        return ", ".join(f"`{word}`" for word in schema["enum"])
    if "anyOf" in schema:
        return f"{_choices(schema['anyOf'][0])}, or null"
    if schema["type"] == "array":
        return f"list of: {_choices(schema['items'])}"
    if "maximum" in schema:
        return f"{KINDS[schema['type']]}, {schema['minimum']}..{schema['maximum']}"
    limits = [f"{words} {schema[key]}" for key, words in LIMITS.items() if key in schema]
    return ", ".join([KINDS[schema["type"]], *limits])


def fields_table(group: str) -> str:
    """The docstring of ``group``, and a table of its fields: name, what may be given, default as in JSON.
    Markdown."""
    kind = GROUPS[group]
    schemas = TypeAdapter(kind).json_schema()["properties"]
    defaults = {field.name: json.dumps(field.default, default=str) for field in dataclasses.fields(kind)}  # type: ignore[arg-type]
    names = "|".join(sorted(schemas, key=len, reverse=True))
    text = inspect.cleandoc(kind.__doc__ or "").replace("``", "`").replace("|", "\\|")
    rows = [f"| `{name}` | {_choices(schema)} | `{defaults[name]}` |" for name, schema in schemas.items()]
    head = [f"| field of `{group}` | give | default |", "| --- | --- | --- |"]
    return "\n".join([re.sub(rf"(?<![`\w])({names})(?![`\w])", r"`\1`", text), "", *head, *rows])


def docstring_of(path: Path) -> str:
    """A module's docstring; the file is not imported."""
    return ast.get_docstring(ast.parse(path.read_text())) or ""


def summary_of(path: Path) -> str:
    """The first paragraph of a module's docstring, on one line."""
    return " ".join(docstring_of(path).partition("\n\n")[0].split())


def sections_of(path: Path) -> set[int]:
    """Sections of the specification that a module's docstring names."""
    sections: set[int] = set()
    pattern = r"specification\w*\.md,?\s+sections?\s+(\d+)(?:\s+(to|and)\s+(\d+))?"
    for first, link, last in re.findall(pattern, docstring_of(path)):
        sections |= {int(first), int(last or first)} | set(
            range(int(first), int(last) + 1) if link == "to" else ()
        )
    return sections


def companions(path: Path) -> dict[str, list[Path]]:
    """A module's test, its proof, and (hardware) the golden models of the same sections, found by name and
    section."""
    place = path.relative_to(ROOT)
    paths = {"test": [ROOT / "tests" / place.with_name(f"test_{place.name}")], "proof": [], "model": []}
    if place.parts[0] == "rtl":
        candidates = (
            model
            for name in ("golden/core", "golden/model", "eskin/live")
            for model in sorted((ROOT / name).glob("*.py"))
        )
        paths["proof"] = [ROOT / "formal" / place.relative_to("rtl")]
        paths["model"] = [model for model in candidates if sections_of(model) & sections_of(path)]
    return {kind: [path for path in files if path.exists()] for kind, files in paths.items()}


def filled(text: str) -> str:
    """A page with its tables in place of the markers, and an empty line before each list, which Python's
    Markdown needs."""
    text = re.sub(r"<!-- fields: (\w+) -->", lambda marker: fields_table(marker[1]), text)
    text = re.sub(r"<!-- registers -->", lambda _: register_files.markdown(), text)
    parts = re.split(r"(^```.*?^```$)", text, flags=re.MULTILINE | re.DOTALL)
    lists = r"(?m)^((?!- |\d+\. |  |#|$).*)\n(?=- |1\. )"
    return "".join(part if part.startswith("```") else re.sub(lists, r"\1\n\n", part) for part in parts)


# ------------------------------------------------------------------ mkdocs
def on_startup(**_: Any) -> None:
    """Copy the code as it lies once installed, for the API reference, which resolves links. It looks for its
    folder only when the configuration is read, so the copy is made before that."""
    roof = ROOT / "build" / "docs_source"
    shutil.rmtree(roof, ignore_errors=True)
    for folder in ("eskin", "scripts"):
        shutil.copytree(ROOT / folder, roof / folder)


def on_config(config: Any) -> Any:
    """The API pages in the navigation."""
    config.nav.append({"API": [f"api/{name}.md" for name in packages()]})
    return config


def on_files(files: Any, config: Any) -> Any:
    """An API page for each folder of code."""
    from mkdocs.structure.files import File

    for name, paths in packages().items():
        parts = [
            f"## {path.stem}\n\n::: {name}.{path.stem}\n    options:\n      show_root_heading: false\n"
            for path in paths
        ]
        files.append(File.generated(config, f"api/{name}.md", content=f"# {name}\n\n" + "\n".join(parts)))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """The tables of a page."""
    return filled(markdown)
