"""`make wheel-test`: eskin installs whole, and where there are no symbolic links too.

It writes the files of git's index into a folder as git does without links (``core.symlinks=false``), and packs
them into a zip with Python's zipfile. The wheel is built from the zip and installed with the locked versions of
its dependencies into an empty environment, without extras: the verbs that need neither training nor a simulator run,
the others name the extra that they need. Then the packages of this environment stand in for the
extras, and the wheel generates and co-simulates; so does an editable installation of the folder. It needs a
package index.
"""

import os
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

from scripts import ROOT

WORK = ROOT / "build" / "wheel"
CHECKOUT, ENVIRONMENT = WORK / "checkout", WORK / "venv"
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
import eskin.golden, eskin.rtl, eskin.cosim
from eskin.memo import code_version
for part in (eskin.golden, eskin.rtl, eskin.cosim):
    print(part.__file__)
print(code_version("golden", "rtl", "cosim"))
"""
"""The files that are imported, and the version of their sources."""
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
    own = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}  # else it may find ROOT
    done = subprocess.run(
        command, cwd=WORK, env=own, capture_output=True, text=True, timeout=600, check=False
    )
    line, text = " ".join(" ".join(map(str, command)).split()), done.stdout + done.stderr
    if done.returncode != status or words not in text:
        sys.exit(
            f"wheel test: {line} ended with {done.returncode}, not {status}, or did not print "
            f"'{words}':\n{text[-3000:]}"
        )
    print(f"ok: {line[:120]}", flush=True)


def zipped() -> Path:
    """`CHECKOUT`, and a zip of it. Links are files with their text."""
    git = ["git", "-c", "core.symlinks=false", "checkout-index", "--all", f"--prefix={CHECKOUT}/"]
    subprocess.run(git, cwd=ROOT, check=True)
    return Path(shutil.make_archive(str(WORK / "repository"), "zip", WORK, CHECKOUT.name))


def unlike(wheel: Path) -> list[str]:
    """Files of the package that are in the wheel alone or in the checkout alone."""
    files = {
        f"eskin/{path.relative_to(CHECKOUT)}".replace("eskin/eskin/", "eskin/")
        for folder in ("eskin", "golden", "rtl", "cosim")
        for path in (CHECKOUT / folder).rglob("*")
        if path.is_file() and path.suffix  # a link's text has none
    }
    names = zipfile.ZipFile(wheel).namelist()
    return sorted(files ^ {name for name in names if not name.startswith("eskin-")})


def whole(place: Path) -> None:
    """The package is installed in ``place`` with all parts: it generates and co-simulates."""
    from eskin.memo import code_version

    python, eskin = ENVIRONMENT / "bin" / "python", ENVIRONMENT / "bin" / "eskin"
    parts = ("golden", "rtl", "cosim")
    files = "".join(f"{place / part / '__init__.py'}\n" for part in parts)
    must(python, "-c", PLACES, words=files + code_version(*parts))
    must(eskin, "generate", "model", "--out", "design")
    must(eskin, *"cosim model --data touches.npz --json played.json".split(), words="bit-exact")


def main() -> None:
    """Build, install, try."""
    from eskin.data.archive import save_archive
    from eskin.golden.core import PRESETS
    from eskin.training.made_up import random_recordings
    from tests.support.random_models import random_integer_model

    shutil.rmtree(WORK, ignore_errors=True)
    WORK.mkdir(parents=True)
    build = "-q", "--no-deps", "--no-build-isolation"
    must(sys.executable, "-m", "pip", "wheel", *build, "-w", WORK, zipped())
    (wheel,) = WORK.glob("*.whl")
    if differing := unlike(wheel):
        sys.exit(f"wheel test: wheel and checkout differ in {len(differing)} files: {differing[:5]}")
    model = random_integer_model(PRESETS["pvdf"], seed=3)
    model.save(WORK / "model")
    save_archive(random_recordings(model.config, [3000, 2000], 1), WORK / "touches.npz")
    venv.create(ENVIRONMENT, with_pip=True)
    python, eskin = ENVIRONMENT / "bin" / "python", ENVIRONMENT / "bin" / "eskin"
    locked = "install", "-q", "-c", ROOT / "requirements.lock"
    must(python, "-m", "pip", *locked, wheel, "setuptools")
    must(python, "-c", "import torch", status=1, words="No module named 'torch'")
    must(python, "-c", PREDICT)
    for line, status, words in VERBS:
        must(eskin, *line.split(), status=status, words=words)
    must(eskin, "--version", words=wheel.name.split("-")[1])
    packages = Path(sysconfig.get_path("purelib", vars={"base": ENVIRONMENT}))
    (packages / "extras.pth").write_text(sysconfig.get_path("purelib"))
    whole(packages / "eskin")
    must(python, "-m", "pip", "install", *build, "-e", CHECKOUT)
    whole(CHECKOUT)
    print("1 passed, 0 failed")


if __name__ == "__main__":
    main()
