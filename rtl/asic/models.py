"""Verilog of a process's cells from what its Liberty file says they do, for simulation: no delays, and states
that begin at random."""

from collections.abc import Iterable

from eskin.rtl.asic.liberty import Cell
from eskin.rtl.asic.synthesis import macro_verilog


def expression(function: str) -> str:
    """A Liberty function in Verilog's operators."""
    return function.replace("*", "&").replace("+", "|").replace("!", "~")


def model(cell: Cell) -> str:
    """The module of a cell."""
    pins = {name: pin for name, pin in cell.pins.items() if pin.direction in ("input", "output")}
    if cell.kind == "memory":
        start = f"integer k;\ninitial for (k = 0; k < {cell.words}; k = k + 1) memory[k] = $urandom;\ninitial A_DOUT = $urandom;\nendmodule\n"
        return macro_verilog(cell).replace("endmodule\n", start)
    lines = [
        f"module {cell.name} ({', '.join(pins)});",
        *(f"{pin.direction} {name};" for name, pin in pins.items()),
    ]
    if cell.kind == "gate":
        role = cell.gate_pins
        lines += [
            "reg open;",
            "initial open = $urandom;",
            f"always @* if (!{role['clock']}) open = {role['enable']};",
            f"assign {role['output']} = {role['clock']} & open;",
        ]
    elif cell.state:
        state, inverse = cell.state["state"], cell.state["inverse"]
        lines += [f"reg {state};", f"wire {inverse} = ~{state};", f"initial {state} = $urandom;"]
        forced = [
            (expression(cell.state[key]), level)
            for key, level in (("clear", 0), ("preset", 1))
            if key in cell.state
        ]
        tests = "".join(f"if ({condition}) {state} {{0}} {level}; else " for condition, level in forced)
        if cell.kind == "flip-flop":
            edge, following = expression(cell.state["clocked_on"]), expression(cell.state["next_state"])
            lines += [
                f"wire clock = {edge};",
                *(f"wire force_{level} = {condition};" for condition, level in forced),
            ]
            edges = "".join(f" or posedge force_{level}" for _, level in forced)
            body = "".join(f"if (force_{level}) {state} <= {level}; else " for _, level in forced)
            lines.append(f"always @(posedge clock{edges}) {body}{state} <= {following};")
        else:
            lines.append(
                f"always @* {tests.format('=')}if ({expression(cell.state['enable'])}) {state} = "
                f"{expression(cell.state['data_in'])};"
            )
    lines += [
        f"assign {name} = ({expression(pin.function)});"
        for name, pin in pins.items()
        if pin.direction == "output" and pin.function
    ]
    return "\n".join([*lines, "endmodule", ""])


def models(cells: Iterable[Cell]) -> str:
    """Modules of all ``cells``."""
    return "".join(model(cell) for cell in cells)
