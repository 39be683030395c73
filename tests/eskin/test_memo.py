"""eskin/memo.py: keys follow content and sources; a result is made once, whole, by whoever comes
first."""

import threading
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from eskin import memo
from eskin.golden.core import PRESETS, content_key
from eskin.memo import Memo, code_version
from eskin.training import train_images
from eskin.verbs import cosim, enrol, stability_job
from tests.support import result_case
from tests.support.random_models import random_integer_model
from tests.support.table import each_row
from tests.test_imports import beyond


def test_a_key_tells_parts_apart(tmp_path):
    file = tmp_path / "file"
    file.write_bytes(b"ab")
    parts = [
        b"ab",
        "ab",
        ["ab"],
        ["a", "b"],
        [["ab"]],
        1,
        "1",
        None,
        [],
        np.array([1, 2]),
        np.array([1, 2], np.int32),
        np.array([[1, 2]]),
        SimpleNamespace(content="x"),
    ]
    keys = [content_key(part) for part in parts] + [content_key("a", "b"), content_key("ab", "")]
    assert len(set(keys)) == len(keys) and content_key(file) == content_key(b"ab")
    file.write_bytes(b"ac")
    assert content_key(file) == content_key(b"ac")
    (tmp_path / "sub").mkdir()
    whole = [content_key(tmp_path)]
    for change in (lambda: file.write_bytes(b"ad"), lambda: file.rename(tmp_path / "sub/file")):
        change()
        whole.append(content_key(tmp_path))
    assert len({*whole}) == 3 and content_key(tmp_path / "sub") == whole[1]


def test_recordings_and_models_have_their_content():
    same, other = result_case.recordings(), result_case.recordings()
    renamed = replace(other, class_names=("x", *other.class_names[1:]))
    assert content_key(same) == content_key(other) != content_key(renamed)
    first, again, third = (content_key(random_integer_model(PRESETS["pvdf"], seed)) for seed in (1, 1, 2))
    assert first == again != third


WORKERS = {"training.train_images": train_images, "verbs.cosim": cosim}
WORKERS |= {"verbs.stability_job": stability_job, "teach.enrol": enrol, "verbs.cost": enrol}


@each_row("worker", WORKERS)
def test_the_code_of_a_key_is_all_that_makes_the_result(worker):
    code = WORKERS[worker].CODE.args
    assert not beyond(f"eskin.{worker}", code) and beyond(f"eskin.{worker}", code[1:])


@pytest.mark.parametrize("links", [True, False])
@each_row("changed", ["rtl/a.py", "rtl/cells.v", "rtl/new/part.py"])
def test_every_source_is_in_the_code_version(changed, links, monkeypatch, tmp_path):
    package = tmp_path / "eskin"
    package.mkdir()
    for part in ("rtl", "golden"):
        if links:
            (package / part).symlink_to(f"../{part}")
        else:
            (package / part).write_text(f"../{part}")
    for name in ("rtl/a.py", "rtl/cells.v", "golden/a.py", "rtl/__pycache__/a.pyc"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("1")
    monkeypatch.setattr(memo, "PACKAGE", package)
    golden, both, one_file = code_version("golden"), code_version("golden", "rtl"), code_version("rtl/a.py")
    (tmp_path / "rtl/__pycache__/a.pyc").write_text("2")
    assert code_version("golden", "rtl") == both
    (tmp_path / changed).parent.mkdir(exist_ok=True)
    (tmp_path / changed).write_text("2")
    assert code_version("golden") == golden and code_version("golden", "rtl") != both
    assert (code_version("rtl/a.py") != one_file) == (changed == "rtl/a.py")


def test_a_folder_is_made_once_and_whole(tmp_path):
    made, kept = [], Memo(tmp_path / "kept")

    def make(folder):
        made.append(folder)
        (folder / "result").write_text("done")

    def fails(folder):
        (folder / "half").touch()
        raise OSError("disk full")

    with pytest.raises(OSError):
        kept.folder("key", fails)
    threads = [threading.Thread(target=kept.folder, args=("key", make)) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(made) == 1 and not (made[0] / "half").exists() and kept.folder("key", make) == made[0]
