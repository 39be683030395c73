"""What the tools of others say of the generated folder: Verilator's lint, slang, FuseSoC."""

import re
import subprocess
import sys

import pyslang
import pytest
from systemrdl import RDLCompiler

from eskin.cosim.runner import verilator_command
from eskin.golden.core import PRESETS
from eskin.rtl.fpga import generate as generating
from eskin.rtl.fpga.export import WAIVER
from eskin.verbs.generate import generate_design
from tests.support.generated_bench import make
from tests.support.image_scenes import random_image_model
from tests.support.random_models import random_integer_model
from tests.support.silent import forget
from tests.support.table import refused
from tests.test_matrix import IMAGES, KINDS, TOUCHES

DESIGNS = {
    "linear": ("linear", {}),
    "lstm behind Wishbone": ("lstm", {"bus": "wishbone"}),
    "image behind Wishbone": ("image", {"bus": "wishbone"}),
    "prototypes": ("prototypes", {}),
    "early behind AXI4-Lite": ("early", {"bus": "axi4lite"}),
    "rom with AXI streams": ("rom", {"axis": True}),
    "behind a converter": ("converter", {}),
    "thesis": ("thesis", {}),
}


def model_of(kind):
    if kind == "image":
        return random_image_model(IMAGES, 1)
    return random_integer_model(PRESETS["thesis"] if kind == "thesis" else TOUCHES.replace(**KINDS[kind]), 1)


def linted(folder, *waiver):
    """Rules of Verilator's warnings and errors."""
    verilator, environment = verilator_command()
    call = [verilator, "--lint-only", "-Wall", *waiver, "-f", "filelist.f"]
    done = subprocess.run(
        call, cwd=folder, env=environment, capture_output=True, text=True, timeout=600, check=False
    )
    rules = set(re.findall(r"^%(?:Warning|Error)-?(\w*): \S+\.sv", done.stderr, re.MULTILINE))
    assert rules or done.returncode == 0, done.stderr
    return rules


@pytest.mark.parametrize(
    "design", [pytest.param(n, marks=[pytest.mark.slow] * (n != "behind a converter")) for n in DESIGNS]
)
def test_lint_is_clean_slang_reads_it_and_signals_have_names(design, tmp_path):
    kind, system = DESIGNS[design]
    folder = generate_design(model_of(kind), tmp_path / "design", **system)
    assert linted(folder, "waiver.vlt") == set()
    waived = set(re.findall(r"-rule (\w+)", WAIVER.read_text()))
    if kind != "image":
        assert linted(folder) == waived  # nothing is waived that is not there
    compilation = pyslang.ast.Compilation()
    for name in (folder / "filelist.f").read_text().split():
        # Amaranth names a signal after the variable that alone stands on the left of its line
        assert "$signal" not in (folder / name).read_text()
        compilation.addSyntaxTree(pyslang.syntax.SyntaxTree.fromFile(str(folder / name)))
    assert len(compilation.getRoot().topInstances) == 1
    assert [str(message.code) for message in compilation.getAllDiagnostics() if message.isError()] == []


def test_fusesoc_lints_it(tmp_path):
    generate_design(model_of("linear"), tmp_path / "cores" / "eskin")
    (tmp_path / "fusesoc.conf").write_text("[main]\n")
    verilator, environment = verilator_command()
    environment |= {"PATH": f"{verilator.parent}:{environment['PATH']}", "HOME": str(tmp_path)}
    call = [sys.executable, "-m", "fusesoc.main", "--config", "fusesoc.conf", "--cores-root", "cores"]
    call += ["run", "--target", "lint", "eskin:ip:accelerator"]
    done = subprocess.run(
        call, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0 and "%Warning" not in done.stdout + done.stderr, done.stdout + done.stderr


BOTH = """#include "left/left.h"
#include "right/right.h"
#include "left/load.h"
#include "right/load.h"
int main(void)
{
    left_hw one = { 0 };
    right_hw two = { 0 };
    (void)left_load, (void)right_load;
    return (int)(one.next + two.next) + (LEFT_FRAME_TAXELS == RIGHT_FRAME_TAXELS);
}
"""


@pytest.mark.slow
def test_two_designs_go_into_one_system(tmp_path):
    """Every module, function and macro of a design is there once; each bench plays its design."""
    designs = {
        "left": ("lstm", {"bus": "wishbone"}),
        "right": ("thesis", {"bus": "wishbone"}),
        "third": ("linear", {}),
    }
    files = []
    for name, (kind, system) in designs.items():
        folder = generate_design(model_of(kind), tmp_path / name, top=name, **system)
        files += sorted(folder.glob("*.sv"))
        assert (folder / "filelist.f").read_text() == f"{name}.sv\n"
        assert (folder / "eskin.rdl").read_text().count(f"addrmap \\{name} ") == 1
    names = "left.sv left_accelerator.sv right.sv right_accelerator.sv third.sv"
    assert [file.name for file in files] == names.split()
    modules = [
        word
        for file in files
        for word in re.findall(r"^module (\S+?)\(?(?: |$)", file.read_text(), re.MULTILINE)
    ]
    assert len(modules) > 30 and len(set(modules)) == len(modules)
    (tmp_path / "main.c").write_text(BOTH)
    command = "gcc -std=c99 -Wall -Wextra -Werror main.c left/left.c right/right.c -o both"
    subprocess.run(command.split(), cwd=tmp_path, check=True)
    assert subprocess.run([tmp_path / "both"], check=False).returncode == 0
    done = make(tmp_path / "third")
    assert done.returncode == 0, done.stdout
    with refused("`top` '2': is not a prefix"):
        generate_design(model_of("linear"), tmp_path / "no", top="2")
    with refused("`top` stdint: names the driver stdint.h"):
        generate_design(model_of("linear"), tmp_path / "no", top="stdint", bus="wishbone")


def test_a_name_may_be_a_word_of_another_language(tmp_path, monkeypatch):
    """Of SystemRDL, where it is escaped, and of YAML, where it is quoted; Yosys escapes Verilog's."""
    monkeypatch.setattr(generating, "verilog", lambda design, name: forget(design) or "")
    for name in ("reg", "true"):
        folder = generate_design(model_of("linear"), tmp_path / name, top=name)
        compiler = RDLCompiler()
        compiler.compile_file(str(folder / "eskin.rdl"))
        assert compiler.elaborate().top.inst_name == name
        assert f'toplevel: "{name}"' in (folder / "eskin.core").read_text()
