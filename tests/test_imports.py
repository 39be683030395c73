"""design.md section 2: which folder imports which. The files are read, not run; what the modules import in turn counts too."""

from __future__ import annotations

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
FOLDERS = ("golden", "rtl", "cosim", "scripts")
SHARED_WITH_RTL = {"golden", "golden.formats", "golden.config", "golden.activation", "golden.errors"}
TORCH_MODULES = {
    f"golden.{name}"
    for name in ("cells", "model", "train", "quantise", "pipeline", "sparsity", "import_network", "baselines", "sweep", "leak_check")
}  # fmt: skip


def modules() -> dict[str, Path]:
    """Every module of the project by its dotted name."""
    found = {}
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports_of(tree: ast.AST, known: set[str], *, typing_only: bool = False) -> set[str]:
    """Dotted names that the code imports, inside functions too. ``from golden import formats`` counts as golden.formats."""
    names: set[str] = set()
    skipped = set()
    for node in ast.walk(tree):
        if not typing_only and isinstance(node, ast.If) and ast.unparse(node.test) in ("TYPE_CHECKING", "typing.TYPE_CHECKING"):
            skipped |= {id(inner) for part in node.body for inner in ast.walk(part)}
    for node in ast.walk(tree):
        if id(node) in skipped:
            continue
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            submodules = {f"{node.module}.{alias.name}" for alias in node.names} & known
            names |= submodules or {node.module}
    return names


@cache
def imports(name: str) -> frozenset[str]:
    """What one module imports when it runs."""
    return frozenset(imports_of(ast.parse(modules()[name].read_text()), set(modules())))


@cache
def load_time_imports(name: str) -> frozenset[str]:
    """What one module imports at its top level, so whenever it is loaded."""
    tree = ast.parse(modules()[name].read_text())
    tree.body = [node for node in tree.body if not isinstance(node, (ast.FunctionDef, ast.ClassDef))]
    return frozenset(imports_of(tree, set(modules())))


def reached(name: str) -> set[str]:
    """Everything that loading ``name`` loads, as far as the project's own modules say."""
    seen: set[str] = set()
    todo = [name]
    while todo:
        for other in load_time_imports(todo.pop()):
            if other not in seen:
                seen.add(other)
                if other in modules():
                    todo.append(other)
    return seen


def top(name: str) -> str:
    return name.partition(".")[0]


def breaches(name: str) -> list[str]:
    """Rules of design.md section 2 that module ``name`` breaks."""
    folder, used = top(name), imports(name)
    packages = {top(other) for other in used}
    broken = []
    if folder == "golden":
        broken += [f"golden imports {other}" for other in packages & {"rtl", "cosim", "scripts"}]
        if "torch" in packages and name not in TORCH_MODULES:
            broken.append("imports torch")
    if folder == "rtl":
        broken += [f"rtl imports {other}" for other in used if top(other) == "golden" and other not in SHARED_WITH_RTL]
        broken += [f"rtl imports {other}" for other in packages & {"torch", "cosim", "scripts"}]
        broken += [f"rtl loads {other}" for other in reached(name) if top(other) == "torch"]
    if folder == "cosim":
        broken += [f"cosim loads {other}" for other in used | reached(name) if top(other) in ("torch", "amaranth", "rtl", "scripts")]
    return broken


@pytest.mark.parametrize("name", sorted(modules()))
def test_imports_go_one_way(name):
    assert not breaches(name)


def test_the_walk_sees_what_it_should(monkeypatch):
    assert "golden.formats" in imports("golden.config") and "torch" in reached("golden.model")
    tree = ast.parse("import torch.nn\nfrom golden import model, errors\ndef f():\n    from rtl.engine import Engine\n")
    assert imports_of(tree, set(modules())) == {"torch.nn", "golden.model", "golden.errors", "rtl.engine"}
    for folder in ("golden", "rtl", "cosim"):
        assert any(top(name) == folder for name in modules())
    against = {"golden.recordings": "torch", "golden.train": "cosim.flow", "rtl.engine": "golden.model", "cosim.flow": "torch"}
    for name, seen in against.items():
        with monkeypatch.context() as patch:
            patch.setattr(sys.modules[__name__], "imports", lambda _, seen=seen: frozenset({seen}))
            assert breaches(name), f"{name} importing {seen} must be a breach"


def test_help_is_quick_because_nothing_heavy_is_loaded():
    code = (
        "import sys, scripts.eskin\n"
        "heavy = {'torch', 'amaranth', 'matplotlib', 'cocotb', 'sklearn', 'scipy'} & set(sys.modules)\n"
        "sys.exit(', '.join(heavy) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
