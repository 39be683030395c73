"""Counts what a netlist does in a co-simulation: the input of an energy estimate.

A counter beside the cells sees every cycle, so nothing is sampled: register bits that change, by block;
multipliers whose operands change (a multiplier with still operands does not switch); cycles in which
the chain says that it is busy. It counts
from a recording's first frame to its last decision, not while weights are loaded.

Two runs over the same recordings, at full pace and at a slower declared one, do the same frames and steps and
differ only in cycles without work: their difference is what an idle cycle costs, the rest is what frames and
steps cost.
"""

import re
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

from eskin.golden.core import Record

CELL = re.compile(
    r"^  (?P<type>SB_DFF\w*|TRELLIS_FF|SB_MAC16|MULT18X18D) "
    r"(?:#\(\n(?P<parameters>.*?)\n  \) )?(?P<name>\\\S+|\w+) *\(\n"
    r"(?P<ports>.*?)\n  \);$",
    re.MULTILINE | re.DOTALL,
)
PORT = re.compile(r"^    \.(\w+)\((.*)\),?$", re.MULTILINE)
ADDER, ADDER_BITS = re.compile(r"TOPADDSUB_LOWERINPUT\(\d+'\w*?0+\)"), 32
"""A block that adds its operands as they are: its output is a register like others."""
OPERANDS = {"SB_MAC16": re.compile(r"[AB]"), "MULT18X18D": re.compile(r"[AB]\d+")}
FILE = "activity.txt"


def instrument(verilog: str, block_of: Callable[[str], str]) -> str:
    """The netlist with counters, for Verilator: they write ``activity.txt`` when the simulation ends.

    Parameters
    ----------
    verilog:
        One flat module ``accelerator``, simulated in cosim/wrapper.sv.
    block_of:
        Block of a register by its name in the flat design.
    """
    bits: dict[str, list[tuple[int, str]]] = defaultdict(list)
    operands: list[str] = []
    for cell in CELL.finditer(verilog):
        ports, kind = dict(PORT.findall(cell["ports"])), cell["type"]
        adds = ADDER.search(cell["parameters"] or "")
        if adds or "Q" in ports:
            register = (ADDER_BITS, ports["O"]) if adds else (1, ports["Q"])
            bits[block_of(cell["name"].lstrip("\\"))].append(register)
        else:
            operands.append(", ".join(net for port, net in ports.items() if OPERANDS[kind].fullmatch(port)))
    lines = ["// what the netlist does while recordings are played", "integer activity_file;"]
    counts = {"cycles": "1", "busy": "64'(busy)"}

    def changes(name: str, width: int, value: str) -> str:
        """A value, and its value a cycle before."""
        lines.append(f"wire [{width - 1}:0] {name} = {{{value}}}; reg [{width - 1}:0] before_{name};")
        lines.append(f"always @(posedge clk) before_{name} <= {name};")
        return f"{name} ^ before_{name}"

    for index, (block, registers) in enumerate(sorted(bits.items())):
        width, nets = sum(wide for wide, _ in registers), ", ".join(net for _, net in registers)
        counts[f"toggles {block}"] = f"64'($countones({changes(f'now_{index}', width, nets)}))"
    changed = [f"|({changes(f'operands_{index}', 36, pair)})" for index, pair in enumerate(operands)]
    counts["multiplies"] = " + ".join(["64'd0", *(f"64'({term})" for term in changed)])
    counters = [f"counter_{number}" for number in range(len(counts))]
    for counter, amount in zip(counters, counts.values(), strict=True):
        lines.append(f"reg [63:0] {counter} = 0;")
        lines.append(f"always @(posedge clk) if (wrapper.measured) {counter} <= {counter} + {amount};")
    written = "".join(f"{label} %0d\\n" for label in counts)
    lines += [
        f'final begin activity_file = $fopen("{FILE}", "w");',
        f'$fwrite(activity_file, "{written}", {", ".join(counters)}); $fclose(activity_file); end',
    ]
    head, end = verilog.rsplit("endmodule", 1)
    return "\n".join([head, *lines, f"endmodule{end}"])


def read_count(work: Path) -> Record:
    """One run, from its work folder: cycles counted, and those in which the chain says that it is busy; toggles
    (of register bits, by block), multiplies (operands changed)."""
    rows = [line.rsplit(" ", 1) for line in (work / FILE).read_text().splitlines()]
    counted = {label.removeprefix("toggles "): int(count) for label, count in rows}
    return {name: counted.pop(name) for name in ("cycles", "busy", "multiplies")} | {"toggles": counted}
