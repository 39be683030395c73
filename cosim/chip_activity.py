"""Counters beside the cells of a chip's netlist, a row a frame: the input of its energy."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

FILE = "chip.txt"
STATE_KINDS = ("clock", "read", "write")
"""Counted where they are high; other nets where they change."""


def instrument(verilog: str, kinds: Sequence[str], nets: Sequence[Sequence[str]], enable: str | None, first: str) -> str:
    """The netlist with counters, for Verilator. Each beat of a frame's first taxel ends a row of ``chip.txt``: clock cycles, clocked ones,
    decisions handed on, and a number for each group of ``nets``.

    Parameters
    ----------
    kinds:
        Of each group; of ``STATE_KINDS`` cycles are counted, else changes.
    enable:
        Net without which no edge passes the chain's gate; None: it has none.
    first:
        What tells a frame's first taxel.
    """
    lines = [
        "integer chip_file;",
        f'initial chip_file = $fopen("{FILE}", "w");',
        "wire counting = harness.mode == 4 || harness.mode == 5;",
        f"wire row_ends = counting && i__valid && i__ready && {first};",
        "reg [31:0] row_cycles = 0, row_clocked = 0, row_decisions = 0;",
    ]
    for group, (kind, names) in enumerate(zip(kinds, nets, strict=True)):
        joined = ",\n".join(names)  # tens of thousands; a line holds fewer
        lines += [f"wire [{len(names) - 1}:0] now_{group} = {{{joined}}};", f"reg [31:0] count_{group} = 0;"]
        if kind not in STATE_KINDS:
            lines.append(f"reg [{len(names) - 1}:0] before_{group};")
    lines += [f"wire edge_passes = {enable or 1};", "always @(posedge clk) begin", "row_cycles <= row_cycles + 1;"]
    lines += ["if (o__valid && o__ready) row_decisions <= row_decisions + 1;", "if (edge_passes) begin", "row_clocked <= row_clocked + 1;"]
    for group, kind in enumerate(kinds):
        counted = f"now_{group}" if kind in STATE_KINDS else f"now_{group} ^ before_{group}"
        lines.append(f"count_{group} <= count_{group} + 32'($countones({counted}));")
        if kind not in STATE_KINDS:
            lines.append(f"before_{group} <= now_{group};")
    values = ["row_cycles", "row_clocked", "row_decisions", *(f"count_{group}" for group in range(len(nets)))]
    lines += [
        "end",
        f'if (row_ends) $fwrite(chip_file, "{" ".join(["%0d"] * len(values))}\\n", {", ".join(values)});',
        "end",
        "final $fclose(chip_file);",
    ]
    head, end = verilog.rsplit("endmodule", 1)
    return head + "\n".join(lines) + "\nendmodule" + end


def frames(work: Path) -> np.ndarray:
    """What was counted from each frame's first taxel to the next one's: (frames - 1, 3 + groups)."""
    rows = np.loadtxt(work / FILE, dtype=np.int64, ndmin=2)
    return np.diff(rows, axis=0)
