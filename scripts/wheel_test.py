"""`make wheel-test`: the wheel, installed without extras into an empty environment, does what the README
promises.

It builds the wheel, looks at its files, installs it with the locked versions of its dependencies, and runs
the verbs that need neither training nor a simulator. The other verbs must name the extra that they need. It
needs a package index.
"""

import shutil
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

from scripts import ROOT

WORK = ROOT / "build" / "wheel"
PREDICT = """
import sys
from eskin.golden.model.model import IntegerModel
from eskin.golden.model.pipeline import run
from eskin.training.made_up import random_recordings
model = IntegerModel.load("model")
assert len(run(model, random_recordings(model.config, [3000], 1)).decision) > 0
assert "torch" not in sys.modules
"""
VERBS = (
    ("--help", 0, "generate"),
    ("inspect synthetic --out scene.png", 0, "recordings"),
    ("schedule thesis --lanes 4 --out schedule", 0, ""),
    ("generate model --out design", 0, ""),
    ("build --help", 0, "--target"),
    ("replay --help", 0, "--port"),
    ("train --data synthetic --out mine", 2, "which comes with the extra 'train'"),
    ("cosim model --data synthetic", 2, "extra 'sim'"),
)
"""Command line, its status, and words that it prints."""


def must(*command: str | Path, status: int = 0, words: str = "") -> None:
    """Run ``command`` in the work folder; it must end with ``status`` and print ``words``."""
    done = subprocess.run(command, cwd=WORK, capture_output=True, text=True, timeout=600, check=False)
    line, text = " ".join(map(str, command)), done.stdout + done.stderr
    if done.returncode != status or words not in text:
        sys.exit(
            f"wheel test: {line} ended with {done.returncode}, not {status}, or did not print "
            f"'{words}':\n{text[-3000:]}"
        )
    print(f"ok: {line[:120]}", flush=True)


def main() -> None:
    """Build, install, try."""
    from eskin.golden.core import PRESETS
    from tests.support.random_models import random_integer_model

    shutil.rmtree(WORK, ignore_errors=True)
    WORK.mkdir(parents=True)
    must(sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation", "-w", WORK, ROOT)
    (wheel,) = WORK.glob("*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    strays = [name for name in names if not name.startswith(("eskin/", "eskin-")) or "/dev/" in name]
    missing = {".py", ".sv", ".v", ".vlt", ".cpp", ".j2", ".css"} - {Path(name).suffix for name in names}
    if strays or missing:
        sys.exit(
            f"wheel test: the wheel holds {strays[:3]}, which is not the product's, or lacks files of kinds "
            f"{sorted(missing)}"
        )
    random_integer_model(PRESETS["pvdf"], seed=3).save(WORK / "model")
    venv.create(WORK / "venv", with_pip=True)
    python, eskin = WORK / "venv" / "bin" / "python", WORK / "venv" / "bin" / "eskin"
    must(python, "-m", "pip", "install", "-q", "-c", ROOT / "requirements.lock", wheel)
    must(python, "-c", "import torch", status=1, words="No module named 'torch'")
    must(python, "-c", PREDICT)
    for line, status, words in VERBS:
        must(eskin, *line.split(), status=status, words=words)
    must(eskin, "--version", words=wheel.name.split("-")[1])
    print("1 passed, 0 failed")


if __name__ == "__main__":
    main()
