"""`make wheel-test`: the wheel, installed without extras into an empty environment, does what the small installation promises.

Builds the wheel, looks at what is in it, installs it with its dependencies at the versions of the lock, and runs the verbs that need
neither
training nor a simulator; the others must name their extra in a sentence. Needs a package index.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
WORK = ROOT / "build" / "wheel"
PREDICT = """
import sys
from eskin.golden.model.model import IntegerModel
from eskin.golden.model.pipeline import run
from eskin.golden.model.vectors import random_recordings
model = IntegerModel.load("model")
assert len(run(model, random_recordings(model.config, [3000], 1)).decision) > 0
assert "torch" not in sys.modules
"""


def must(command: list[str | Path], status: int = 0, said: str = "") -> None:
    """Run ``command`` in the work folder; it must end with ``status`` and say ``said``."""
    done = subprocess.run([str(word) for word in command], cwd=WORK, capture_output=True, text=True, timeout=600, check=False)
    text = done.stdout + done.stderr
    if done.returncode != status or said not in text:
        what = f"{' '.join(map(str, command))} ended with {done.returncode}, not {status}, or did not say '{said}'"
        sys.exit(f"wheel test: {what}:\n{text[-3000:]}")
    print(f"ok: {' '.join(str(word) for word in command[1:])[:100]}", flush=True)


def main() -> None:
    """Build, install, try."""
    from eskin.golden.core.config import PRESETS
    from eskin.golden.model.model import random_integer_model

    shutil.rmtree(WORK, ignore_errors=True)
    WORK.mkdir(parents=True)
    must([sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation", "-w", WORK, ROOT])
    (wheel,) = WORK.glob("*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    strays = [name for name in names if not name.startswith(("eskin/", "eskin-"))]
    kinds = {Path(name).suffix for name in names}
    if strays or not {".py", ".sv", ".v", ".cpp", ".j2", ".css"} <= kinds or any("/dev/" in name for name in names):
        sys.exit(
            f"wheel test: the wheel holds {strays[:3]} outside of eskin/, or files of kinds {sorted(kinds)} only, or tools of the checkout"
        )
    random_integer_model(PRESETS["pvdf"], seed=3).save(WORK / "model")
    venv.create(WORK / "venv", with_pip=True)
    python, eskin = WORK / "venv" / "bin" / "python", WORK / "venv" / "bin" / "eskin"
    must([python, "-m", "pip", "install", "-q", "-c", ROOT / "requirements.lock", wheel])
    must([python, "-c", "import torch"], 1, "No module named 'torch'")
    must([eskin, "--version"], 0, wheel.name.split("-")[1])
    must([eskin, "--help"], 0, "generate")
    must([eskin, "inspect", "synthetic", "--out", "scene.png"], 0, "recordings")
    must([eskin, "schedule", "thesis", "--lanes", "4", "--out", "schedule"], 0)
    must([eskin, "generate", "model", "--out", "design"], 0)
    must([eskin, "build", "--help"], 0, "--target")
    must([eskin, "replay", "--help"], 0, "--port")
    must([python, "-c", PREDICT])
    must([eskin, "train", "--data", "synthetic", "--out", "mine"], 2, "which comes with the extra 'train'")
    must([eskin, "cosim", "model", "--data", "synthetic"], 2, "extra 'sim'")
    print("1 passed, 0 failed")


if __name__ == "__main__":
    main()
