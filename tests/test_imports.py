"""Which folder imports which, that there is no circle, and that nothing is imported past the package. The
files are read, not run."""

import ast
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

from eskin.cli.common import VERBS, module_of, spellings

ROOT = Path(__file__).resolve().parent.parent
FOLDERS = ("golden", "rtl", "cosim")
"""Parts of the package that stand at the top of the checkout: links in eskin/ lead to them."""
WAY = (
    [
        ["golden.core"],
        ["golden.data"],
        ["golden.model"],
        ["data"],
        ["training"],
        ["choose", "exchange"],
        ["teach"],
        ["study"],
        ["pages"],
    ],
    [
        ["golden.core"],
        ["rtl.program"],
        ["rtl.common"],
        ["rtl.frontend", "rtl.engine", "rtl.decision", "rtl.host"],
        ["rtl.image"],
        ["rtl.interface"],
        ["rtl.top"],
        ["rtl.fpga", "rtl.views"],
        ["rtl.asic"],
    ],
)
"""Models and hardware, each in the order in which a folder may import from those before it, and from none
beside it."""

PLUMBING = {"", "jobs", "memo", "cli", "pages"}
"""Parts that change no result, nor does what they import."""

TORCH_MODULES = {"eskin.golden.model.straight_through", "eskin.golden.model.torch_model"}
"""Modules of the golden model that import torch."""
TORCH_FOLDERS = ("training", "choose", "teach", "exchange", "study")
"""Folders of eskin/ that may import torch."""


@cache
def modules() -> dict[str, Path]:
    """Every module of the project by its dotted name."""
    named = {}
    for folder in ("eskin", *FOLDERS, "scripts"):
        for path in sorted((ROOT / folder).rglob("*.py")):  # rglob follows no links
            parts = (
                *(("eskin",) if folder in FOLDERS else ()),
                *path.relative_to(ROOT).with_suffix("").parts,
            )
            named[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return named


def imports_of(tree: ast.AST, known: set[str]) -> set[str]:
    """Dotted names that the code imports, inside functions too. ``from eskin.golden import core`` counts as
    eskin.golden.core."""
    names: set[str] = set()
    skipped = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test) in ("TYPE_CHECKING", "typing.TYPE_CHECKING"):
            skipped |= {id(inner) for part in node.body for inner in ast.walk(part)}
    for node in ast.walk(tree):
        if id(node) in skipped:
            continue
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            names |= {f"{node.module}.{alias.name}" for alias in node.names} & known or {node.module or ""}
    return names


@cache
def tree_of(name: str) -> ast.Module:
    return ast.parse(modules()[name].read_text())


@cache
def imports(name: str) -> frozenset[str]:
    """What one module imports when it runs."""
    return frozenset(imports_of(tree_of(name), set(modules())))


@cache
def load_time_imports(name: str) -> frozenset[str]:
    """What one module imports at its top level, so whenever it is loaded."""
    body = [node for node in tree_of(name).body if not isinstance(node, (ast.FunctionDef, ast.ClassDef))]
    return frozenset(imports_of(ast.Module(body, []), set(modules())))


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


def beyond(worker: str, code: tuple[str, ...]) -> set[str]:
    """Modules on which the result of ``worker`` may depend that are not in ``code``, as `code_version` takes it."""
    seen, new = set[str](), {worker}
    while new:
        seen |= new
        new = {name for name in new if part(name) not in PLUMBING}
        new = {other for name in new for other in imports(name)} & {*modules()} - seen
    files = {name: modules()[name].relative_to(ROOT).as_posix().removeprefix("eskin/") for name in seen}
    within = lambda file: any(file == part or file.startswith(f"{part}/") for part in code)
    return {name for name, file in files.items() if not within(file) and part(name) not in PLUMBING}


def part(name: str) -> str:
    """``rtl.engine`` of ``eskin.rtl.engine.lanes``; the folder alone where it has no parts; ``scripts`` of
    the developers' tools."""
    words = name.split(".")
    if words[0] != "eskin":
        return "scripts" if words[0] == "scripts" else ""
    return ".".join(words[1:3] if words[1:2] in (["golden"], ["rtl"]) else words[1:2])


def place(folder: str, way: list[list[str]]) -> int | None:
    """Where on the way a folder stands."""
    return next((number for number, beside in enumerate(way) if folder in beside), None)


def breaches(name: str, used: frozenset[str] | None = None) -> list[str]:
    """Rules that module ``name`` breaks, with ``used`` in place of what it imports."""
    used = imports(name) if used is None else used
    own, broken = part(name), []
    for other in sorted(used):
        its = part(other)
        for way in WAY:
            here, there = place(own, way), place(its, way)
            if here is not None and there is not None and (there > here or (there == here and own != its)):
                broken.append(f"{own} imports {other}, which stands after or beside it")
        if own.startswith("golden") and its and not its.startswith("golden"):
            broken.append(f"golden imports {other}")
        if own.startswith("rtl") and its and not its.startswith("rtl") and its != "golden.core":
            broken.append(f"rtl imports {other}; of the golden model it takes golden.core alone")
        if other.partition(".")[0] in (*FOLDERS, "formal") or (
            other.partition(".")[0] in ("tests", "scripts") and own != "scripts"
        ):
            broken.append(f"{other} is imported past the package: it would be a second copy of the module")
        if own in ("data", *TORCH_FOLDERS) and its.startswith(("rtl", "cosim")):
            broken.append(f"{own} imports {other}: learning knows no hardware")
        torch = other == "torch" or other.startswith("torch.")
        if torch and own not in ("", "scripts", *TORCH_FOLDERS) and name not in TORCH_MODULES:
            broken.append(f"{own} imports torch")
    if own.startswith("rtl"):
        broken += [f"rtl loads {other}" for other in reached(name) if other.partition(".")[0] == "torch"]
    if own == "cosim":
        broken += [
            f"cosim loads {other}"
            for other in used | reached(name)
            if other.partition(".")[0] in ("torch", "amaranth")
            or (not part(other).startswith(("golden", "cosim")) and part(other))
        ]
    return broken


def test_imports_go_one_way():
    assert len(modules()) > 200 and not {name: broken for name in modules() if (broken := breaches(name))}


COMMAND_LINE = ("typer", "eskin.cli", "eskin.verbs")
OF_TOOLS = {"eskin.rtl.fpga.implementation", "eskin.rtl.fpga.targets", "eskin.cosim.runner"}
"""Modules that call programs with options of these; there only the sentences of errors are looked at."""


def sentences(tree: ast.AST, errors: bool = False) -> str:
    """All strings of the code that are no docstrings; ``errors``: only sentences of errors."""
    docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    parts = [node for node in ast.walk(tree) if isinstance(node, ast.Raise)] if errors else [tree]
    nodes = (node for part in parts for node in ast.walk(part) if id(node) not in docstrings)
    return "\n".join(
        node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)
    )


def namings(text: str) -> list[str]:
    """Options of verbs that sentences name, and fields in back quotes that no option sets."""
    options = [option for option in re.findall(r"--[a-z][a-z-]*", text) if option in spellings().values()]
    return options + [field for field in re.findall(r"`(\w+)`", text) if field not in spellings()]


def knows_no_command_line(name: str) -> bool:
    return part(name).partition(".")[0] in (*TORCH_FOLDERS, *FOLDERS) and part(name) != "exchange"


def test_only_verbs_know_the_command_line():
    learning = [name for name in modules() if knows_no_command_line(name)]
    assert len(learning) > 150
    for name in learning:
        used = {other for other in imports(name) if other.startswith(COMMAND_LINE)}
        named = namings(sentences(tree_of(name), name in OF_TOOLS))
        assert not used and not named, (name, used, named)
    tree = ast.parse(
        "def f():\n    'Of `--out`.'\n    raise InputError(f'--out {x}: is bad; leave `nonsense` out')"
    )
    assert namings(sentences(tree)) == namings(sentences(tree, True)) == ["--out", "nonsense"]


def test_no_module_has_two_names():
    """A file reached past its link would be loaded a second time, with classes that are not the first
    ones."""
    for folder in FOLDERS:
        done = subprocess.run(
            [sys.executable, "-c", f"import {folder}"], cwd=ROOT, capture_output=True, text=True, timeout=600
        )
        assert done.returncode == 1 and f"import eskin.{folder}" in done.stderr
    by_file = {}
    for name, module in list(sys.modules.items()):
        file = getattr(module, "__file__", None)
        if file and name != "__main__" and Path(file).resolve().is_relative_to(ROOT) and ".venv" not in file:
            by_file.setdefault(Path(file).resolve(), set()).add(name)
    assert by_file and not {path: names for path, names in by_file.items() if len(names) > 1}


def test_the_walk_sees_what_it_should():
    assert "eskin.golden.core.formats" in imports("eskin.golden.core.config") and "torch" in reached(
        "eskin.training.train"
    )
    tree = ast.parse(
        "import torch.nn\nfrom eskin.golden.model import model\ndef f():\n    from eskin.rtl.engine.engine "
        "import Engine\n"
    )
    assert imports_of(tree, set(modules())) == {
        "torch.nn",
        "eskin.golden.model.model",
        "eskin.rtl.engine.engine",
    }
    against = {
        "eskin.golden.data.recordings": ["torch", "eskin.golden.model.model", "golden.core.config"],
        "eskin.training.train": ["eskin.cosim.flow", "eskin.pages.report"],
        "eskin.rtl.engine.engine": [
            "eskin.golden.model.model",
            "eskin.rtl.frontend.normaliser",
            "eskin.rtl.top.accelerator",
        ],
        "eskin.rtl.program.schedule": ["eskin.rtl.common.fixed"],
        "eskin.cosim.flow": ["torch", "eskin.rtl.program.schedule"],
    }
    for name, wrong in against.items():
        for seen in wrong:
            assert breaches(name, frozenset({seen})), f"{name} importing {seen} must be a breach"


def test_help_is_quick_because_nothing_heavy_is_loaded():
    code = [
        "import sys, eskin.cli.main, eskin.data.load",
        "heavy = {'amaranth', 'cocotb'} & {*sys.modules}",
        f"import {', '.join(f'eskin.verbs.{module_of(verb)}' for verb in VERBS)}",
        "heavy |= {'torch', 'matplotlib', 'sklearn', 'scipy', 'pandas'} & {*sys.modules}",
        "sys.exit(', '.join(heavy) or 0)",
    ]
    done = subprocess.run(
        [sys.executable, "-c", "\n".join(code)], cwd=ROOT, capture_output=True, text=True, timeout=600
    )
    assert done.returncode == 0, done.stderr
