"""The generated Verilog is the design: Yosys proves every block of the text against the same block as Amaranth gives it.

Instances and products are boxes: the same on both sides once what goes into them is proved equal. Memories are
registers, and bits have two values: undefined ones of both sides are alike. Induction says that equal states stay equal
and give equal outputs; that both sides begin in the same state is compared register by register.
"""

import json
import re
from pathlib import Path
from typing import Any

from amaranth.back import rtlil
from amaranth.lib import wiring

from eskin.rtl.common.collisions import without_contents
from eskin.rtl.fpga.readable import ports_named
from eskin.rtl.fpga.tools import run_tool

PROVED: set[tuple[str, str]] = set()
"""Pairs of texts of a block, without its own name, that need no second proof."""


def _modules(text: str) -> dict[str, str]:
    """The modules of RTLIL or Verilog by name."""
    parts = re.split(r"^module \\?(?=\w)", text, flags=re.MULTILINE)[1:]
    return {re.split(r"[\s(]", part, maxsplit=1)[0]: part for part in parts}


def _script(block: str, others: list[str]) -> str:
    lines = []
    for side, read in (("gold", "read_rtlil gold.il"), ("gate", "read_verilog -sv gate.sv")):
        lines += ["design -reset", read, *(f"blackbox {other}" for other in others), "proc", "opt_expr"]
        lines += ["memory_collect", "memory_map", *["splitnets -driver"] * (side == "gold")]
        lines += ["rename -hide w:_*_", "opt_clean", f"rename {block} {side}", f"write_json {side}.json"]
        lines += [f"design -stash {side}"]
    lines += ["design -reset", "design -copy-from gold =A:blackbox"]
    lines += [*(f"design -copy-from {side} {side}" for side in ("gold", "gate")), "equiv_make gold gate both"]
    lines += ["hierarchy -top both", "opt_clean", "equiv_struct", "equiv_simple -ignore-unknown-cells"]
    lines += ["equiv_induct -ignore-unknown-cells", "equiv_status -assert", "select -assert-min 1 t:$equiv"]
    return "\n".join([*lines, ""])


def _same_start(gold: dict[str, Any], gate: dict[str, Any]) -> None:
    """Every register has a name that both sides know, and begins with the same bits."""
    starts, names = [], gold["netnames"].keys() & gate["netnames"].keys()
    for module in (gold, gate):
        flip_flops = (cell for cell in module["cells"].values() if re.match(r"\$\w*ff", cell["type"]))
        held = {bit for cell in flip_flops for bit in cell["connections"]["Q"]}
        nets, begin = module["netnames"], dict.fromkeys(held, "x")
        for net in nets.values():
            word = dict(zip(net["bits"], reversed(net["attributes"].get("init", "")), strict=False))
            begin |= {bit: value for bit, value in word.items() if bit in held}
        starts.append({name: [begin.get(bit) for bit in nets[name]["bits"]] for name in names})
        assert held <= {bit for name in names for bit in nets[name]["bits"]}
    differ = [name for name in names if starts[0][name] != starts[1][name]]
    assert not differ, f"begins otherwise: {differ}"


def prove(component: wiring.Component, top: str, text: str, folder: Path, only: str = "") -> int:
    """Prove ``text``, exported of ``component`` as module ``top``; how many blocks it has. ``only``: the blocks whose
    name ends so.

    Raises ToolError where a block is not proved.
    """
    folder.mkdir(exist_ok=True)
    design = without_contents(ports_named(rtlil.convert(component, name=top, emit_src=False)))
    (folder / "gold.il").write_text(design)
    (folder / "gate.sv").write_text(text)
    gold, gate = _modules(design), _modules(text)
    assert gold.keys() == gate.keys()
    for block in [name for name in gold if name.endswith(only)]:
        pair = (gold[block].replace(block, ""), gate[block].replace(block, ""))
        if pair in PROVED:
            continue
        (folder / "prove.ys").write_text(_script(block, [other for other in gold if other != block]))
        run_tool("yosys", ["-q", "prove.ys"], folder)
        sides = [(folder / f"{side}.json").read_text() for side in ("gold", "gate")]
        _same_start(
            *(json.loads(text)["modules"][side] for text, side in zip(sides, ("gold", "gate"), strict=True))
        )
        PROVED.add(pair)
    return len(gold)
