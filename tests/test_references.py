"""What documents, comments and docstrings refer to is there: files and sections of the
specification."""

import re
from functools import cache
from pathlib import Path

from scripts import ROOT

FOLDERS = ("golden", "rtl", "cosim", "scripts", "tests", "formal", "docs", "eskin")
WRITTEN = {"builds.md", "fit.md", "mutants.md", "proofs.md", "ratios.md", "registers.md"}
"""Pages that commands write into build folders."""
CITED = r"(specification\w*\.md)\)?,?\s+sections?\s+(\d+)"
"""A page of the specification and a section, in text that may be broken over lines."""


@cache
def texts() -> dict[str, str]:
    """Every text file of the project, by path; this one is left out."""
    kinds = {".py", ".md", ".sv", ".v", ".cpp", ".toml", ".j2"}
    paths = [*ROOT.glob("*.md"), *(path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*")))]
    own = Path(__file__).resolve()
    return {
        path.relative_to(ROOT).as_posix(): path.read_text()
        for path in paths
        if path.suffix in kinds and path.resolve() != own
    }


def dead(texts_: dict[str, str]) -> list[str]:
    """(file, Markdown file it names) that is neither in the repository nor written by a command."""
    there = {Path(name).name for name in texts_} | WRITTEN
    return [
        f"{name}: {other}"
        for name, text in texts_.items()
        for other in re.findall(r"[\w-]+\.md\b", text)
        if other not in there
    ]


def test_every_document_that_is_named_is_there():
    assert len(texts()) > 200 and dead(texts()) == []
    assert dead({"a.py": "see lost.md, section 2"}) == ["a.py: lost.md"]


def test_every_section_that_is_named_is_there():
    """On the page that is named with it, and each number on one page alone."""
    named = {
        (name, page, int(number))
        for name, text in texts().items()
        for page, number in re.findall(CITED, text)
    }
    sections = {
        page: [int(number) for number in re.findall(r"(?m)^## (\d+)\. ", texts()[f"docs/{page}"])]
        for page in ("specification.md", "specification_interfaces.md")
    }
    chain, around = sections.values()
    assert sorted(chain + around) == list(range(1, 20))
    assert len(named) > 60 and [place for place in named if place[2] not in sections[place[1]]] == []
