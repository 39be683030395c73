"""golden/core/files.py and its users: files are written whole or not at all, readable as any new file is, and no
archive larger than it looks."""

import os
import time
import zipfile
from concurrent.futures import ThreadPoolExecutor

import pytest
import torch

from eskin.exchange.import_network import read_layers
from eskin.golden.core import files, replacing, replacing_folder, write_json
from eskin.golden.model import pipeline, write_vectors
from eskin.rtl.fpga.generate import generate
from tests.support.folder import contents
from tests.support.random_models import random_integer_model
from tests.support.table import each_row, refused
from tests.support.touch_scenes import SMALL, scene


@pytest.fixture
def umask():
    before = os.umask(0o027)
    yield 0o027
    os.umask(before)


def test_files_and_folders_are_readable_as_the_umask_says(tmp_path, umask, monkeypatch):
    monkeypatch.setattr("eskin.rtl.fpga.generate.verilog", lambda *design: "module")
    write_json(tmp_path / "deep" / "a.json", {})
    with replacing_folder(tmp_path / "folder") as draft:
        (draft / "file").write_text("")
    data = scene(3, seed=1)
    model = random_integer_model(SMALL, 1)
    write_vectors(tmp_path / "v.npz", pipeline.run(model, data), data)
    generate(model.config, model.arrays, tmp_path / "design")
    for path in tmp_path.rglob("*"):
        assert path.stat().st_mode & 0o777 == (0o777 if path.is_dir() else 0o666) & ~umask, path


@each_row("fails_at", [1, 2])
def test_a_folder_whose_exchange_fails_is_as_it_was(tmp_path, monkeypatch, fails_at):
    """The disk is full, or somebody stops the program, at the first or the second rename."""

    def write(content: str) -> None:
        with replacing_folder(tmp_path / "design") as draft:
            (draft / "file").write_text(content)

    write("old")
    before, real, calls = contents(tmp_path), os.rename, []

    def failing(source, target):
        calls.append(target)
        if len(calls) == fails_at:
            raise OSError(28, "No space left on device")
        real(source, target)

    monkeypatch.setattr(os, "rename", failing)
    monkeypatch.setattr(os, "replace", failing)
    with pytest.raises(OSError, match="No space left"):
        write("new")
    monkeypatch.undo()
    assert contents(tmp_path) == before


def test_two_writers_of_one_folder_both_end_and_one_of_them_is_whole(tmp_path, monkeypatch):
    real = os.replace
    # so that others come between
    monkeypatch.setattr(os, "replace", lambda *names: (time.sleep(0.001), real(*names)))

    def write(name: str) -> None:
        for _ in range(20):
            with replacing_folder(tmp_path / "folder") as draft:
                for file in ("a", "b"):
                    (draft / file).write_text(name)

    with ThreadPoolExecutor(4) as pool:
        for writer in [pool.submit(write, name) for name in "1234"]:
            writer.result()
    assert len(set(contents(tmp_path / "folder").values())) == 1 and os.listdir(tmp_path) == ["folder"]


def test_a_file_that_cannot_be_finished_leaves_the_old_one(tmp_path):
    write_json(tmp_path / "a.json", 1)
    before = contents(tmp_path)
    with pytest.raises(ValueError, match="half"), replacing(tmp_path / "a.json") as temporary:
        temporary.write_text("half")
        raise ValueError("half")
    assert contents(tmp_path) == before


STATE = torch.nn.ModuleDict({"rnn": torch.nn.GRU(4, 5), "head": torch.nn.Linear(5, 3)}).state_dict()


def test_what_a_link_leads_to_is_replaced_and_the_link_stays(tmp_path):
    for name, link in (("folder", "link"), ("a.json", "b.json")):
        (tmp_path / link).symlink_to(tmp_path / "there" / name)
    for number in range(2):  # the link leads to nothing at first
        with replacing_folder(tmp_path / "link") as draft:
            (draft / "file").write_text(str(number))
        write_json(tmp_path / "b.json", {"number": number})
    assert (tmp_path / "there/folder/file").read_text() == "1" and (tmp_path / "link").is_symlink()
    assert (tmp_path / "there/a.json").exists() and (tmp_path / "b.json").is_symlink()


def test_a_torch_file_that_unpacks_to_too_much_is_refused_unread(tmp_path, monkeypatch):
    torch.save(STATE, tmp_path / "net.pt")
    assert read_layers(tmp_path / "net.pt").arrays
    bomb = tmp_path / "bomb.pt"
    with (
        zipfile.ZipFile(tmp_path / "net.pt") as source,
        zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as target,
    ):
        for entry in source.infolist():
            target.writestr(
                entry.filename, source.read(entry) if "data/" not in entry.filename else bytes(1 << 20)
            )
    assert bomb.stat().st_size < 1 << 17
    monkeypatch.setattr(files, "MOST_UNPACKED_BYTES", 1 << 20)
    with monkeypatch.context() as patch:
        patch.setattr(torch, "load", lambda *_, **__: pytest.fail("was read"))
        with refused(
            r"bomb\.pt': unpacks to .* GB, more than the .* GB that are read; save only the weights"
        ):
            read_layers(bomb)
