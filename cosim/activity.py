"""Counts what a netlist does in a co-simulation: the input of an energy estimate.

A counter beside the cells sees every cycle, so nothing is sampled: register bits that change, by block;
multipliers whose operands change (a multiplier with still operands does not switch); block RAM reads; reads
and writes of the large memories of one port. It counts from a recording's first frame to its last decision,
not while weights are loaded.

Two runs over the same recordings, at full pace and at a slower declared one, do the same frames and steps and
differ only in cycles without work: their difference is what an idle cycle costs, the rest is what frames and
steps cost.
"""

import re
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

CELL = re.compile(
    r"^  (?P<type>SB_DFF\w*|TRELLIS_FF|SB_MAC16|MULT18X18D|SB_RAM40_4K\w*|DP16KD|SB_SPRAM256KA) "
    r"(?:#\(\n(?P<parameters>.*?)\n  \) )?(?P<name>\\\S+|\w+) *\(\n"
    r"(?P<ports>.*?)\n  \);$",
    re.MULTILINE | re.DOTALL,
)
PORT = re.compile(r"^    \.(\w+)\((.*)\),?$", re.MULTILINE)
ADDER, ADDER_BITS = re.compile(r"TOPADDSUB_LOWERINPUT\(\d+'\w*?0+\)"), 32
"""A block that adds its operands as they are: its output is a register like others."""
OPERANDS = {"SB_MAC16": re.compile(r"[AB]"), "MULT18X18D": re.compile(r"[AB]\d+")}
READ_ENABLES = {"SB_RAM40_4K": (("RE", "RCLKE"),), "DP16KD": (("CEA",), ("CEB",))}
LARGE = "SB_SPRAM256KA"
FILE = "activity.txt"


@dataclass(frozen=True, kw_only=True)
class Count:
    """One run: cycles counted, register-bit toggles by block, multiplies (operands changed), block RAM reads,
    uses of large memories."""

    cycles: int
    toggles: dict[str, int]
    multiplies: int
    ram_reads: int
    large_uses: int = 0


def instrument(verilog: str, block_of: Callable[[str], str]) -> str:
    """The netlist with counters, for Verilator: they write ``activity.txt`` when the simulation ends.

    Parameters
    ----------
    verilog:
        One flat module ``accelerator``, simulated in cosim/wrapper.sv.
    block_of:
        Block of a register by its name in the flat design.
    """
    bits: dict[str, list[tuple[str, int]]] = defaultdict(list)
    operands: list[str] = []
    reads: list[str] = []
    uses: list[str] = []
    for cell in CELL.finditer(verilog):
        ports = dict(PORT.findall(cell["ports"]))
        kind = cell["type"]
        adds = ADDER.search(cell["parameters"] or "")
        if adds or "Q" in ports:
            bits[block_of(cell["name"].lstrip("\\"))].append(
                (ports["O"], ADDER_BITS) if adds else (ports["Q"], 1)
            )
        elif kind in OPERANDS:
            operands.append(
                ", ".join(value for port, value in ports.items() if OPERANDS[kind].fullmatch(port))
            )
        elif kind == LARGE:
            uses.append(ports["CHIPSELECT"])
        else:
            enables = READ_ENABLES["DP16KD" if kind == "DP16KD" else "SB_RAM40_4K"]
            reads += [" && ".join(ports.get(port) or "1'h1" for port in names) for names in enables]
    lines = [
        "// what the netlist does while recordings are played",
        "wire counting = wrapper.measured;",
        "integer activity_file;",
    ]
    counters: dict[str, str] = {}

    def count(label: str, name: str, amount: str) -> None:
        lines.append(f"reg [63:0] {name} = 0;")
        lines.append(f"always @(posedge clk) if (counting) {name} <= {name} + {amount};")
        counters[label] = name

    def held(name: str, width: int, value: str) -> None:
        lines.append(f"wire [{width - 1}:0] {name} = {{{value}}};")
        lines.append(f"reg [{width - 1}:0] before_{name}; always @(posedge clk) before_{name} <= {name};")

    count("cycles", "activity_cycles", "1")
    for index, (block, nets) in enumerate(sorted(bits.items())):
        held(f"now_{index}", sum(wide for _, wide in nets), ", ".join(net for net, _ in nets))
        count(f"toggles {block}", f"toggles_{index}", f"64'($countones(now_{index} ^ before_now_{index}))")
    for index, pair in enumerate(operands):
        held(f"operands_{index}", 36, pair)
    changed = [f"operands_{index} != before_operands_{index}" for index in range(len(operands))]
    for name, terms in (("multiplies", changed), ("ram_reads", reads), ("large_uses", uses)):
        count(name, name, " + ".join(["64'd0", *(f"64'({term})" for term in terms)]))
    written = "".join(f"{label} %0d\\n" for label in counters)
    lines += [
        f'final begin activity_file = $fopen("{FILE}", "w");',
        f'$fwrite(activity_file, "{written}", {", ".join(counters.values())});',
        "$fclose(activity_file); end",
    ]
    head, end = verilog.rsplit("endmodule", 1)
    return head + "\n".join(lines) + "\nendmodule" + end


def read_count(work: Path) -> Count:
    """Counters that one run wrote into its work folder."""
    rows = [line.split() for line in (work / FILE).read_text().splitlines()]
    single = {row[0]: int(row[1]) for row in rows if len(row) == 2}
    return Count(
        cycles=single["cycles"],
        toggles={row[1]: int(row[2]) for row in rows if len(row) == 3},
        multiplies=single["multiplies"],
        ram_reads=single["ram_reads"],
        large_uses=single["large_uses"],
    )
