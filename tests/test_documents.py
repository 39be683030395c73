"""README and docs/: links lead somewhere, commands exist and run, every field is named, a name leads to file,
model, test and proof.

A block of ``sh`` or ``python`` is run in one folder for all pages, in the order of the site (docs/changing.md
says what a comment before a block means). ``make`` is only asked what it would do: its targets are this
project's own jobs, these tests among them.
"""

import contextlib
import dataclasses
import doctest
import os
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import click
import numpy as np
import onnxruntime
import pytest
from matplotlib.figure import Figure

from eskin.cli.common import VERBS
from eskin.cli.main import command_of
from eskin.data.archive import load_archive, save_archive
from eskin.golden.core import AcceleratorConfig
from eskin.golden.core.groups import GROUP_OF
from eskin.training.made_up import random_images
from scripts import ROOT, docs_site
from tests.support.forests import forest_file
from tests.support.image_scenes import random_image_model
from tests.support.table import each_row
from tests.support.tiny_cells import library, memory_library
from tests.support.touch_scenes import scene

NAVIGATION = re.findall(r"\w+\.md", (ROOT / "mkdocs.yml").read_text())
PAGES = [ROOT / "README.md", *(ROOT / "docs" / name for name in NAVIGATION)]


@dataclass(frozen=True)
class Block:
    """A fenced block of a page: its language, its text, and what the comment before it says."""

    page: str
    line: int
    mark: str
    language: str
    text: str

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"


@cache
def blocks() -> list[Block]:
    found = []
    for path in PAGES:
        text = path.read_text()
        for match in re.finditer(
            r"(?:^<!-- test: (\w+) -->\n)?^```(\w*)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL
        ):
            line = text[: match.start()].count("\n") + 1
            found.append(Block(path.name, line, match[1] or "", match[2], match[3]))
    return found


def prose(path: Path) -> str:
    return re.sub(r"^```.*?^```$", "", path.read_text(), flags=re.MULTILINE | re.DOTALL)


# ------------------------------------------------------------------ length, links, paths
def test_the_pages_are_short():
    """A command writes the page of figures, and the specification is as long as the design needs."""
    words = {path.stem: len(path.read_text().split()) for path in PAGES if path.stem != "figures"}
    assert sum(words.values()) <= 34_400  # sections of issues 56 to 59 added 2400
    assert all(count <= 2500 or page.startswith("specification") for page, count in words.items())
    assert len((ROOT / "README.md").read_text().splitlines()) <= 130


def anchors(path: Path) -> set[str]:
    """What GitHub and mkdocs make of a page's headings."""
    titles = re.findall(r"^#+ (.*)$", prose(path), re.MULTILINE)
    return {re.sub(r"[\s-]+", "-", re.sub(r"[^\w\s-]", "", title.lower())).strip("-") for title in titles}


def dead_links(path: Path, text: str) -> list[str]:
    """Relative links of ``text``, a page at ``path``, that lead nowhere."""
    dead = []
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        name, _, anchor = link.partition("#")
        target = path.parent / name if name else path
        if not re.match(r"https?:", link) and (
            not target.is_file() or (anchor and anchor not in anchors(target))
        ):
            dead.append(f"{path.name}: {link}")
    return dead


@each_row("path", PAGES)
def test_links_lead_somewhere(path):
    assert dead_links(path, prose(path)) == []


@each_row("path", PAGES)
def test_files_that_are_named_are_there(path):
    """With what a page says is in them."""
    text = path.read_text()
    named = re.findall(r"`((?:golden|rtl|cosim|scripts|tests|formal|docs)/[\w/.]+)`", text)
    assert [name for name in named if not re.search("NAME|FOLDER", name) and not (ROOT / name).exists()] == []
    inside = re.findall(r"`(\w+)` (?:in|of) `([\w/]+\.py)`", text)
    assert [name for name, file in inside if not re.search(rf"\b{name}\b", (ROOT / file).read_text())] == []


def test_pages_quote_one_result():
    """Of each run accuracy, energy, power and latency are the same on the page of results, and of figures."""

    def rows(page: str) -> list[list[str]]:
        table = r"^\| recordings \| left out.*\n\| ---.*\n((?:\|.*\n)+)"
        found = re.search(table, (ROOT / page).read_text(), re.MULTILINE)
        return [re.split(r" +\| +", line.strip("| ")) for line in found[1].splitlines()]

    for page in (rows("docs/results.md"), rows("docs/figures.md")):
        for *_, accuracy, energy, power, _, latency, verdict in rows("README.md"):
            quoted = {accuracy, energy, power, latency}
            assert any(quoted <= set(row) for row in page), verdict


# ------------------------------------------------------------------ commands
@cache
def verbs() -> dict[str, click.Command]:
    return {verb: command_of(verb) for verb in VERBS}


def wrong(command: str) -> list[str]:
    """What the command line does not know of ``command``, a line of shell or what a sentence quotes."""
    words = shlex.split(command.replace("[", " ").replace("]", " "), comments=True)
    if not words:
        return []
    if words[0] == "make":
        folder = ROOT
        if words[1:2] == ["-C"]:
            folder, words = ROOT / words[2], words[2:]
        targets = set(
            re.search(r"^\.PHONY: (.*)$", (folder / "Makefile").read_text(), re.MULTILINE)[1].split()
        )
        return [word for word in words[1:] if "=" not in word and word not in targets]
    if Path(words[0]).name != "eskin" or len(words) == 1 or words[1] in ("VERB", "--version", "--help"):
        return []
    if words[1] not in verbs():
        return [words[1]]
    known = {
        option
        for parameter in verbs()[words[1]].params
        for option in (*parameter.opts, *parameter.secondary_opts)
    } | {"--help"}
    return [word for word in words[2:] if word.startswith("-") and word.split("=")[0] not in known]


def commands(path: Path) -> list[str]:
    """Every command that a page shows: lines of its blocks, and code within its sentences."""
    lines = [
        line
        for block in blocks()
        if block.page == path.name and block.language == "sh"
        for line in block.text.splitlines()
    ]
    return lines + [" ".join(code.split()) for code in re.findall(r"`((?:eskin|make) [^`]+)`", prose(path))]


@each_row("path", PAGES)
def test_verbs_options_and_targets_exist(path):
    assert {command: wrong(command) for command in commands(path) if wrong(command)} == {}


def test_every_verb_is_in_the_readme():
    rows = re.findall(r"^\| (`.*?) \|", (ROOT / "README.md").read_text(), re.MULTILINE)
    named = {name for row in rows for name in re.findall(r"`([\w-]+)`", row)}
    assert set(verbs()) - named == set()


def run(block: Block, folder: Path) -> str:
    """Runs a block in ``folder``; what went wrong, or nothing."""
    if block.language == "python":
        done = subprocess.run(
            [sys.executable, "-c", block.text], cwd=folder, capture_output=True, text=True, timeout=7200
        )
    else:
        words = {
            r"^make": f"make -n -C {shlex.quote(str(ROOT))}",
            r"^(.*eskin watch .*?)(#|$)": r"timeout -s INT 20 \1 || test $? = 124",  # it ends with nobody
        }
        lines = block.text.splitlines()
        for pattern, command in words.items():
            lines = [re.sub(pattern, command, line) for line in lines]
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", "\n".join(lines)],
            cwd=folder,
            capture_output=True,
            text=True,
            timeout=7200,
            env=os.environ | {"COLUMNS": "140", "PATH": f"{sys.prefix}/bin:{os.environ['PATH']}"},
        )
    return (
        ""
        if done.returncode == 0
        else f"{block}: status {done.returncode}\n{done.stdout[-2000:]}{done.stderr[-2000:]}"
    )


@pytest.fixture
def folder(tmp_path) -> Path:
    """A folder in which the project is installed as `make` does it, with files as people have them."""
    folder = tmp_path / "one"
    folder.mkdir()
    (folder / ".venv").symlink_to(sys.prefix)
    few = scene(30)
    for number, label in enumerate(few.labels):
        table = folder / "recordings" / few.class_names[label] / f"{number}.csv"
        table.parent.mkdir(parents=True, exist_ok=True)
        frames = few.recording(number)
        rows = np.column_stack([np.arange(len(frames)) / few.sample_rate_hz, frames])
        np.savetxt(table, rows, "%g", ",", header="time,a,b,c,d", comments="")
    config = AcceleratorConfig.of_image(
        16, 20, ("conv 3 4", "pool", "dense 2"), ("left", "right"), name="few"
    )
    random_image_model(config, 0).save(folder / "image-model")
    images, labels = random_images(config, 40, 1) // 2, np.arange(40) % 2
    images[labels == 1, :, 10:] += 100
    np.savez(folder / "images.npz", images=images, labels=labels, class_names=["left", "right"])
    for name, text in (
        ("cells_typ", library("typ")),
        ("cells_slow", library("slow")),
        ("sram", memory_library()),
    ):
        (folder / f"{name}.lib").write_text(text)
    return folder


def page_folder(folder: Path, page: str) -> Path:
    """A copy of ``folder`` for the blocks of a page that take other files: recordings.npz and few.npz are of mine.npz,
    net.onnx and its reference of an exported model, forest.onnx and its reference of the page's own lines."""
    copy = folder.parent / page
    if copy.exists():
        return copy
    shutil.copytree(folder, copy, symlinks=True)
    if (copy / "mine.npz").exists():
        mine = load_archive(copy / "mine.npz")
        mine = dataclasses.replace(mine, groups={"seq": mine.groups["person"]})
        save_archive(mine, copy / "recordings.npz")
        save_archive(mine.subset(range(4)), copy / "few.npz")
    if (copy / "net").exists():
        shutil.copy(copy / "net/model.onnx", copy / "net.onnx")
        session = onnxruntime.InferenceSession(copy / "net.onnx")
        inputs = (
            np.random.default_rng(0).normal(size=(3, *session.get_inputs()[0].shape[1:])).astype(np.float32)
        )
        outputs = session.run(None, {session.get_inputs()[0].name: inputs})[0]
        np.savez(copy / "reference.npz", inputs=inputs, outputs=outputs)
        (lines,) = (block.text for block in blocks() if "forest = RandomForest" in block.text)
        with contextlib.chdir(copy):
            exec(lines, made := {})
        features, forest = made["features"], made["forest"]
        forest_file(forest, copy / "forest.onnx")
        np.savez(copy / "forest.npz", inputs=features, outputs=forest.predict_proba(features))
    return copy


def runnable(block: Block) -> bool:
    return block.language in ("sh", "python") and block.mark in ("", "quick", "recordings")


def only_make(block: Block) -> bool:
    return all(line.startswith("make") for line in block.text.splitlines())


def test_quick_commands_run(folder, call, monkeypatch):
    """In this process, where they are eskin's own; pictures are drawn, not rendered."""
    monkeypatch.chdir(folder)
    monkeypatch.setattr(Figure, "savefig", lambda *given, **options: None)
    chosen = [block for block in blocks() if runnable(block) and (block.mark == "quick" or only_make(block))]
    assert len(chosen) >= 5
    for block in chosen:
        if block.language == "python":
            exec(block.text, {})
        elif only_make(block):
            assert run(block, folder) == ""
        else:
            for line in block.text.splitlines():
                program, *words = shlex.split(line, comments=True)
                status, out, err = call(*words)
                assert program == ".venv/bin/eskin" and status == 0, (block, line, out, err)
    assert (folder / "mine.npz").exists()


@pytest.mark.slow
@pytest.mark.timeout(6 * 3600)
def test_all_commands_run(folder):
    failures = []
    for block in filter(runnable, blocks()):
        own = page_folder(folder, block.page) if block.mark == "recordings" else folder
        failures.append(run(block, own))
    assert [text for text in failures if text] == []


def test_each_mark_of_a_block_is_known():
    """One that is not would be run by nothing."""
    assert {block.mark for block in blocks()} == {"", "quick", "recordings", "board", "long"}


def test_examples_of_the_specification_hold():
    text = "\n".join(block.text for block in blocks() if block.language == "pycon")
    examples = doctest.DocTestParser().get_doctest(text, {}, "specification", None, 0)
    assert len(examples.examples) > 50 and doctest.DocTestRunner().run(examples).failed == 0


# ------------------------------------------------------------------ configuration
def test_every_field_is_named():
    """On the page, in its group's table, and in a sentence of its group."""
    page = docs_site.filled((ROOT / "docs" / "configuration.md").read_text())
    rows = dict(re.findall(r"^\| `(\w+)` \| (.+?) \| .+? \|$", page, re.MULTILINE))
    assert set(GROUP_OF) - set(rows) == set() and "<!-- fields" not in page
    assert rows["taxels"] == "whole number, 1..256"
    assert rows["weight_format"] == "signed format"
    assert "`tracked`" in rows["rest"]
    sentences = "\n".join(line for line in page.splitlines() if not line.startswith("| `"))
    assert [name for name in GROUP_OF if f"`{name}`" not in sentences] == []


# ------------------------------------------------------------------ where things are
def test_tests_and_proofs_mirror_the_folders():
    tests = {path.parent.relative_to(ROOT / "tests") for path in (ROOT / "tests").rglob("test_*.py")}
    assert [str(folder) for folder in tests if not (ROOT / folder).is_dir()] == []
    proofs = [path.relative_to(ROOT / "formal") for path in (ROOT / "formal").glob("*/*.py")]
    assert len(proofs) > 10 and [str(proof) for proof in proofs if not (ROOT / "rtl" / proof).exists()] == []


def test_every_stop_of_data_is_a_function():
    stops = re.findall(r"\| \d+ \| `(.+?)` \| `(\w+)`", (ROOT / "docs/where.md").read_text())
    assert len(stops) == 12
    assert [stop for stop in stops if f"def {stop[1]}(" not in (ROOT / stop[0]).read_text()] == []


# ------------------------------------------------------------------ the site
def test_every_page_is_in_the_navigation_once():
    assert sorted(PAGES[1:]) == sorted((ROOT / "docs").glob("*.md"))


@pytest.mark.slow
def test_the_site_is_built_and_fetches_nothing(tmp_path):
    shutil.rmtree(ROOT / "build" / "docs_source", ignore_errors=True)  # as on a fresh clone
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path / "site")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stdout + done.stderr
    html = {
        path.relative_to(tmp_path / "site").as_posix(): path.read_text()
        for path in (tmp_path / "site").rglob("*.html")
    }
    assert {path.stem + ".html" for path in PAGES[1:]} <= set(html) and "OnsetDetector" in html[
        "api/eskin.rtl.frontend.html"
    ]
    assert "<table>" in html["configuration.html"] and "fault_activity" in html["configuration.html"]
    fetched = {
        found
        for text in html.values()
        for found in re.findall(r"<(?:script|link|img|iframe)[^>]*(?:src|href)=.(?:https?:)?//[^>]*", text)
    }
    styles = "".join(path.read_text() for path in (tmp_path / "site").rglob("*.css"))
    assert fetched == set() and not re.search(r"(url\(|@import\s*)['\"]?(https?:)?//", styles)
