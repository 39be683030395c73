"""The design with a way in for upsets: every flip-flop and every memory bit can be inverted at any clock
edge, in simulation."""

import re
import tempfile
from dataclasses import dataclass
from pathlib import Path

from amaranth.back import rtlil

from eskin.golden.core import AcceleratorConfig, Arrays
from eskin.rtl.common import bare
from eskin.rtl.fpga.tools import run_tool
from eskin.rtl.program.memory_map import memory_images
from eskin.rtl.top.accelerator import Accelerator

TOP = "accelerator"
PORTS = ("upset_register", "upset_memory", "upset_word", "upset_bit")
"""Inputs (16 bits each): the number of a register, or of a memory and a word of it, and the bit that is
inverted at the next clock edge. 0 = none."""
_REGISTER = re.compile(r"^(?P<indent> +)(?P<name>\\\S+ |\w+) ?<= (?P<value>.*);$")


@dataclass(frozen=True)
class Site:
    """Where upsets can come: a register (words 0) or a memory.

    number: its number at the port. name: in the flat design. width: bits. words: of a memory. output: a
    memory's output register.
    """

    number: int
    name: str
    width: int
    words: int = 0
    output: bool = False

    @property
    def block(self) -> str:
        """The part of the chain that it is in: its first two levels of hierarchy, without the memory or
        register itself."""
        parts = self.name.split(".")[:-1]
        return ".".join(parts[:2]) or "accelerator"


def with_upsets(config: AcceleratorConfig, arrays: Arrays | None = None) -> tuple[str, list[Site]]:
    """SystemVerilog of the chain without probes (module ``accelerator``, flat) with the inputs of `PORTS` and
    the output ``hung`` (the watchdog acts in this cycle), and its sites.

    ``arrays``: as for ``eskin.rtl.fpga.export.export``.

    Raises
    ------
    RuntimeError
        The text has a clocked process of a form not known here: an upset would be missing.
    """
    images = None if config.hardware.loadable or arrays is None else memory_images(config, arrays)
    design, ports = bare(Accelerator(config, images), ("probe",))
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "top.il", Path(folder) / "top.sv"
        source.write_text(rtlil.convert(design, name=TOP, ports=ports, emit_src=False))
        script = "read_rtlil top.il; proc -norom; flatten; opt_clean; memory_collect; write_verilog -sv -noattr top.sv"
        run_tool("yosys", ["-q", "-p", script], Path(folder))
        text = target.read_text()
    return _rewritten(text)


def _rewritten(text: str) -> tuple[str, list[Site]]:
    lines = text.split("\n")
    widths: dict[str, int] = {}
    depths: dict[str, int] = {}
    for line in lines:
        if declared := re.match(
            r"  reg (?:signed )?(?:\[(\d+):0\] )?(\\\S+ |\w+)(?: ?\[(\d+):0\])?(?: = .*)?;$", line
        ):
            name = declared[2].strip()
            widths[name] = int(declared[1] or 0) + 1
            if declared[3] is not None:
                depths[name] = int(declared[3]) + 1
    sites: list[Site] = []
    out: list[str] = []
    written: dict[str, int] = {}  # memory -> line of `out` behind which its upset goes
    block: list[str] = []
    for line in lines:
        if block or "always_ff @(posedge clk)" in line:
            block.append(line)
            single = "begin" not in block[0]
            if (single and len(block) == 1) or (not single and line != "  end"):
                continue
            out += _process(block, widths, depths, sites, written, len(out))
            block = []
        else:
            out.append(line)
    upsets: dict[int, list[str]] = {}
    end = next(number for number in range(len(out) - 1, -1, -1) if out[number] == "endmodule")
    for name, depth in depths.items():
        number = 1 + sum(site.words > 0 for site in sites)
        sites.append(Site(number, _plain(name), widths[name], depth))
        flip = f"if (upset_memory == {number}) {name} [upset_word] <= {name} [upset_word] ^ ({widths[name]}'d1 << upset_bit);"
        if name in written:
            upsets.setdefault(written[name], []).append(f"    {flip}")
        else:
            upsets.setdefault(end - 1, []).append(f"  always_ff @(posedge clk) {flip}")
    result = []
    for number, line in enumerate(out):
        result.append(line)
        result += upsets.get(number, [])
    final = "\n".join(result)
    hung = "\\accelerator.watchdog.hung " if "\\accelerator.watchdog.hung " in final else "1'b0"
    final = final.replace("module accelerator(", f"module accelerator(hung, {', '.join(PORTS)}, ", 1)
    ports = (
        "".join(f"  input [15:0] {port};\n" for port in PORTS) + f"  output hung;\n  assign hung = {hung};\n"
    )
    return final.replace(");\n", f");\n{ports}", 1), sites


def _plain(name: str) -> str:
    return name.removeprefix("\\").removeprefix("accelerator.")


def _process(
    block: list[str], widths, depths, sites: list[Site], written: dict[str, int], at: int
) -> list[str]:
    """A clocked process with upsets."""
    out = []
    for line in block:
        assigned = _REGISTER.match(line)
        if "<=" in line and assigned is None:  # the write of a memory's word: its name comes before an index
            name = re.findall(r"^(?:\\\S+|\w+)", line.strip())[0]
            if name not in depths:
                raise RuntimeError(f"a clocked process of an unknown form: {line.strip()}")
            written[name] = at
        if assigned is None:
            out.append(line)
            continue
        name = assigned["name"].strip()
        output = re.match(r"(\\\S+|\w+) +\[", assigned["value"]) if re.fullmatch(r"_\d+_", name) else None
        reads = output[1] if output and output[1] in depths else None
        number = 1 + sum(site.words == 0 for site in sites)
        label = f"{reads}.output" if reads else name
        sites.append(Site(number, _plain(label), widths[name], output=bool(reads)))
        flip = f"(upset_register == {number} ? {widths[name]}'d1 << upset_bit : {widths[name]}'d0)"
        value = assigned["value"]
        # through a wire: the operator in one expression with it would make a signed value unsigned
        if not reads:
            out[:0] = [f"  wire [{widths[name] - 1}:0] upset_of_{number} = {value};"]
            value = f"upset_of_{number}"
        out.append(f"{assigned['indent']}{assigned['name']} <= {value} ^ {flip};")
        if reads and len(assigned["indent"]) == 6:  # under a read enable: what it holds can be upset too
            out.append(f"    end else begin\n      {assigned['name']} <= {assigned['name']} ^ {flip};")
    return out
