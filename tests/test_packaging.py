"""What makes a checkout installable: the lock, the dependencies and the check for system tools."""

import os
import re
import shutil
import stat
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from scripts import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
LOCK = (ROOT / "requirements.lock").read_text().splitlines()


def plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def test_the_lock_has_exact_versions_and_names_no_index():
    assert all(re.fullmatch(r"[A-Za-z0-9._-]+==[0-9][A-Za-z0-9.]*", line) for line in LOCK)
    assert len({plain(line.split("==")[0]) for line in LOCK}) == len(LOCK)


def test_every_dependency_is_locked_within_its_range():
    from packaging.requirements import Requirement

    locked = {plain(line.split("==")[0]): line.split("==")[1] for line in LOCK}
    extras = PROJECT["optional-dependencies"]
    wanted = [
        Requirement(text)
        for text in [
            *PROJECT["dependencies"],
            *(
                text
                for name in ("train", "hdf5", "parquet", "ros", "gowin", "sim", "test", "docs")
                for text in extras[name]
            ),
        ]
    ]
    assert all(requirement.specifier.contains(locked[plain(requirement.name)]) for requirement in wanted)
    # make builds without fetching a build environment
    assert "torch==2.13.0" in extras["train"] and locked["setuptools"]


def check_tools(path: Path, python: str, *more: str) -> tuple[int, str]:
    """Exit status and standard error of the check with ``path`` as the only folder of programs."""
    command = ["/bin/sh", str(ROOT / "scripts" / "check_tools.sh"), python, *more]
    environment = {"PATH": str(path), "ESKIN_NO_APT": os.environ.get("ESKIN_NO_APT", "")}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=600)
    assert done.stdout == ""
    return done.returncode, done.stderr


def program(folder: Path, name: str, script: str = "exit 0") -> Path:
    path = folder / name
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(path.stat().st_mode | stat.S_IEXEC)
    return path


@pytest.fixture
def tools(tmp_path) -> Path:
    """A folder with every tool there is."""
    for name in ("g++", "perl", "iverilog", "python3"):
        program(tmp_path, name)
    return tmp_path


def test_every_folder_of_code_is_a_package_of_the_wheel():
    options = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    tops = {
        name: ROOT / name.removeprefix("eskin.")
        for name in ("eskin", "eskin.golden", "eskin.rtl", "eskin.cosim")
    }
    mapped = {name: ROOT / folder for name, folder in options["package-dir"].items()}
    assert {"eskin": ROOT / "eskin"} | mapped == tops
    folders = {
        ".".join((top, *path.parent.relative_to(folder).parts))
        for top, folder in tops.items()
        for path in folder.rglob("*.py")  # rglob follows no links
        if path.parent.name != "templates"  # a text that eskin generate writes
    }
    assert sorted(options["packages"]) == sorted(folders)


@pytest.mark.parametrize("beside", ["link", "text", "nothing", "installed"])
def test_the_parts_are_found_beside_the_package_with_links_and_without(beside, tmp_path):
    golden = "golden" if beside != "installed" else "eskin/golden"
    for folder in ("eskin", golden):
        (tmp_path / folder).mkdir()
    shutil.copy(ROOT / "eskin" / "__init__.py", tmp_path / "eskin")
    shutil.copy(ROOT / "golden" / "__init__.py", tmp_path / golden)
    for part in ("golden", "rtl", "cosim"):
        place = tmp_path / "eskin" / part
        if beside == "link":
            place.symlink_to(f"../{part}")
        elif beside == "text":
            place.write_text(f"../{part}")
        elif beside == "installed":
            place.mkdir(exist_ok=True)
            (tmp_path / part).mkdir()  # of somebody else
            (tmp_path / part / "__init__.py").touch()
    code = "import eskin.golden; print(eskin.golden.__file__)"
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=600,
        env={"PYTHONPATH": str(tmp_path)},
    )
    assert done.stdout.strip() == str(tmp_path / golden / "__init__.py"), done.stderr


@pytest.mark.parametrize(
    "name, package",
    [
        ("g++", "g++"),
        ("perl", "perl"),
        ("iverilog", "iverilog"),
        ("python3", "python3 python3-venv python3-dev"),
    ],
)
def test_a_missing_tool_is_named_with_the_command_that_installs_it(tools, name, package):
    assert check_tools(tools, "python3", "test") == (0, "")
    (tools / name).unlink()
    status, output = check_tools(tools, "python3", "test")
    assert (
        status == 1 and output.count("\n") == 1 and name in output and f"apt-get install {package}" in output
    )


@pytest.mark.parametrize("root", [True, False])
def test_root_installs_what_is_missing_unless_it_is_forbidden(tools, root, monkeypatch):
    """An apt-get that installs what it is asked for."""
    for name in ("iverilog", "perl"):
        (tools / name).unlink()
    program(tools, "id", f"echo {0 if root else 1000}")
    install = f'for word in "$@"; do case $word in perl|iverilog) echo "#!/bin/sh" > {tools}/$word; /bin/chmod +x {tools}/$word;; esac; done'
    program(tools, "apt-get", f'echo "$*" >> {tools}/asked; {install}')
    for forbidden in (True, False):
        monkeypatch.setenv("ESKIN_NO_APT", "1" if forbidden else "")
        status, output = check_tools(tools, "python3", "test")
        if forbidden or not root:
            assert status == 1 and output.count("\n") == 2 and not (tools / "asked").exists()
        else:
            assert (
                status == 0
                and output.count("\n") == 1
                and "ESKIN_NO_APT=1" in output
                and "perl iverilog" in output
            )
