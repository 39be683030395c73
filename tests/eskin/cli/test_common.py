"""eskin/cli/common.py: no output of any verb destroys an input, whatever its name; numbers that are none."""

import inspect
from pathlib import Path
from typing import get_type_hints

import pytest

from eskin.cli.common import VERBS, module_of, parse_count, parse_lanes, remaining, spelled
from eskin.cli.main import INPUT_WORDS, OUTPUTS, check_outputs, command_of
from eskin.verbs.energy import parse_configuration
from eskin.verbs.enrol import EnrolRequest
from scripts import ROOT
from tests.support.table import each_row, refused

COMMANDS = {verb: command_of(verb).callback for verb in VERBS}


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("mine.npz", "in/model/config.json", "in/model/new.json", "in/c.csv"):
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_text("PK")
    Path("link.npz").symlink_to("mine.npz")
    Path("hard.npz").hardlink_to("mine.npz")
    Path("synthetic").touch()


def test_every_file_of_a_verb_is_in_the_help():
    files = (ROOT / "eskin/verbs").glob("*.py")
    assert {path.stem for path in files if "\ndef command(" in path.read_text()} == {*map(module_of, VERBS)}


def inputs_and_outputs(verb: str) -> tuple[list[str], list[str]]:
    hints = get_type_hints(COMMANDS[verb])
    inputs = [
        name
        for name, kind in hints.items()
        if name not in OUTPUTS and (name in INPUT_WORDS or "Path" in str(kind))
    ]
    return inputs, [name for name in OUTPUTS if name in hints]


@each_row("verb", COMMANDS)
def test_every_output_of_every_verb_is_held_against_every_input(verb):
    inputs, outputs = inputs_and_outputs(verb)
    parameters = inspect.signature(COMMANDS[verb]).parameters
    for output in outputs:
        for name in inputs:
            several = "list[" in str(get_type_hints(COMMANDS[verb])[name])
            for place, path in (
                ("mine.npz", "mine.npz"),
                ("link.npz", "mine.npz"),
                ("./in/../hard.npz", "mine.npz"),
                ("in/c.csv", "in"),
            ):
                given = dict.fromkeys(parameters) | {
                    name: [Path(path)] if several else path if name in INPUT_WORDS else Path(path)
                }
                with refused(rf"^--{output} .*{Path(place).name}: would overwrite .*; give another name"):
                    COMMANDS[verb](**given | {output: Path(place)})


@each_row(
    "verb, given, said",
    [
        (
            "generate",
            {"model": "in/model", "out": "in"},
            "would be replaced together with the input in/model",
        ),
        ("compare", {"model": "in/model", "out": "in"}, None),
        ("train", {"data": "in", "out": "in/new"}, None),
        ("train", {"data": "synthetic", "out": "synthetic"}, None),
        (
            "evaluate",
            {"model": "in/model", "json": "in/model/config.json"},
            "would overwrite a file of the input in/model",
        ),
        ("evaluate", {"model": "in/model", "json": "in/model/new.json"}, None),
        ("evaluate", {"model": "in/model", "json": "mine.npz"}, "would overwrite a file that is not JSON"),
        ("inspect", {"data": "mine.npz", "out": "a", "json": "./a"}, "--json a: --out names the same path"),
        ("convert", {"source": "absent.csv", "out": "absent.csv"}, None),
    ],
)
def test_folders_and_words(verb, given, said):
    given = {name: value if name in INPUT_WORDS else Path(value) for name, value in given.items()}
    given["model"] = Path(given["model"]) if "model" in given else None
    if said is None:
        check_outputs(verb, given)
        return
    with refused(said):
        check_outputs(verb, given)


@each_row("text", ["9" * 5000, "-1", "x", "1_0"])
def test_numbers_that_are_none_are_one_short_sentence(text):
    for reader in (parse_count, lambda k: EnrolRequest(k=k).ks, parse_configuration, parse_lanes):
        before = {parse_configuration: "icebreaker:"}.get(reader, "")
        with refused("^.{20,250}$"):
            reader(f"{before}{text}")


def test_a_field_becomes_the_option_that_sets_it():
    fields = "`clock_hz` 9: `class_`, `with_`, `k`, `threads`, `weight_bits`, `no_link`, `nothing`"
    assert spelled(fields) == "--clock 9: --class, --with, -k, --jobs, --weight-bits, --no-link, `nothing`"


def test_a_long_choice_is_foretold():
    assert not remaining(9) and not remaining(100, folds=False)
    assert "take 5 to 27 minutes more" in remaining(100)
