"""`make wheel-test`: eskin installs whole, and where there are no symbolic links too.

It writes the files of git's index into a folder as git does without links (``core.symlinks=false``), and packs
them into a zip with Python's zipfile. pip installs the zip with the locked versions of
its dependencies into an empty environment, without extras: the verbs that need neither training nor a simulator
run, the others name the extra that they need. Then the packages of this environment stand in for the extras, and
the package generates and co-simulates; so does an editable installation of the folder. Both must hold every source
of this checkout. It needs a package index.
"""

import os
import shlex
import shutil
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

from scripts import ROOT

WORK = ROOT / "build" / "wheel"
PACKAGES = Path(sysconfig.get_path("purelib", vars={"base": WORK}))
PREDICT = """
import sys
from eskin.golden.model.model import IntegerModel
from eskin.golden.model.pipeline import run
from eskin.training.made_up import random_recordings
model = IntegerModel.load("model")
assert len(run(model, random_recordings(model.config, [3000], 1)).decision) > 0
assert "torch" not in sys.modules
"""
PLACES = """
import sys
from eskin import cosim, golden, memo, rtl
places = {part.__path__[0].rpartition("/")[0] for part in (cosim, golden, rtl)}
print(*places, memo.code_version(*sys.argv[1:]))
"""
"""The folder out of which the parts are imported, and the version of all sources."""
WITHOUT_EXTRAS = (
    ("bin/pip install -q -c ../../requirements.lock checkout.zip setuptools", 0, ""),
    ("bin/python -c 'import torch'", 1, "No module named 'torch'"),
    ("bin/python predict.py", 0, ""),
    ("bin/eskin inspect synthetic --out scene.png", 0, "recordings"),
    ("bin/eskin schedule thesis --lanes 4 --out schedule", 0, ""),
    ("bin/eskin generate model --out design", 0, ""),
    ("bin/eskin replay --help", 0, "--port"),
    ("bin/eskin train --data synthetic --out mine", 2, "which comes with the extra 'train'"),
    ("bin/eskin cosim model --data synthetic", 2, "extra 'sim'"),
)
"""Command line, its status, and words that it prints."""


def must(line: str, status: int = 0, words: str = "") -> None:
    """Run a command in the work folder; it must end with ``status`` and print ``words``."""
    own = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}  # else it may find ROOT
    done = subprocess.run(shlex.split(line), cwd=WORK, env=own, capture_output=True, text=True, timeout=600)
    text = done.stdout + done.stderr
    if done.returncode != status or words not in text:
        sys.exit(
            f"wheel test: {line} ended with {done.returncode} or did not print '{words}':\n{text[-3000:]}"
        )
    print(f"ok: {line[:120]}", flush=True)


def whole(place: Path) -> None:
    """The package is installed in ``place`` with all its sources; it generates and co-simulates."""
    from eskin.memo import code_version

    sources = sorted(path.name for path in (ROOT / "eskin").glob("[!_]*"))
    must("bin/python places.py " + " ".join(sources), words=f"{place} {code_version(*sources)}")
    must("bin/eskin generate model --out design")
    must("bin/eskin cosim model --data touches.npz --json played.json")


def main() -> None:
    """Build, install, try."""
    from eskin.data.archive import save_archive
    from eskin.golden.core import PRESETS
    from eskin.training.made_up import random_recordings
    from tests.support.random_models import random_integer_model

    shutil.rmtree(WORK, ignore_errors=True)
    git = f"git -c core.symlinks=false checkout-index --all --prefix={WORK}/checkout/"
    subprocess.run(git.split(), cwd=ROOT, check=True)
    shutil.make_archive(f"{WORK}/checkout", "zip", WORK, "checkout")
    model = random_integer_model(PRESETS["pvdf"], seed=3)
    model.save(WORK / "model")
    save_archive(random_recordings(model.config, [3000, 2000], 1), WORK / "touches.npz")
    (WORK / "predict.py").write_text(PREDICT)
    (WORK / "places.py").write_text(PLACES)
    venv.create(WORK, with_pip=True)
    for line, status, words in WITHOUT_EXTRAS:
        must(line, status, words)
    (PACKAGES / "extras.pth").write_text(sysconfig.get_path("purelib"))
    whole(PACKAGES / "eskin")
    must("bin/pip install -q --no-deps --no-build-isolation -e checkout")
    whole(WORK / "checkout")
    print("1 passed, 0 failed")


if __name__ == "__main__":
    main()
