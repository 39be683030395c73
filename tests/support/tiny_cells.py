"""A process of a dozen cells and one memory, made up, in Liberty files as a chip's tests need them; the real
one where it is beside us."""

from pathlib import Path

import pytest

PDK = Path(__file__).resolve().parents[3] / "shared" / "pdk" / "ihp-sg13g2"
LOGIC = {
    "inv_1": (5.4, "Y", "!A"),
    "buf_1": (7.3, "X", "A"),
    "buf_4": (14.5, "X", "A"),
    "nand2_1": (7.3, "Y", "!(A*B)"),
    "nor2_1": (7.3, "Y", "!(A+B)"),
    "xor2_1": (14.5, "X", "(A^B)"),
}
"""Area, output and its function of one or two inputs."""
TABLE = '{name} (two) {{ values ("{0}, {1}", "{1}, {2}"); }}'
HEAD = """library (tiny_{corner}) {{ nom_voltage : {voltage}; nom_temperature : {temperature}; leakage_power_unit : "1pW";
time_unit : "1ns"; capacitive_load_unit (1,pf); voltage_unit : "1V"; current_unit : "1mA"; pulling_resistance_unit : "1kohm";
input_threshold_pct_rise : 50; input_threshold_pct_fall : 50; output_threshold_pct_rise : 50; output_threshold_pct_fall : 50;
slew_lower_threshold_pct_rise : 20; slew_upper_threshold_pct_rise : 80; slew_lower_threshold_pct_fall : 20;
slew_upper_threshold_pct_fall : 80; delay_model : table_lookup; default_max_transition : 2.5;
lu_table_template (two) {{ variable_1 : input_net_transition; variable_2 : total_output_net_capacitance; index_1 ("0.02, 2");
  index_2 ("0.001, 0.3"); }}
power_lut_template (two) {{ variable_1 : input_net_transition; variable_2 : total_output_net_capacitance; index_1 ("0.02, 2");
  index_2 ("0.001, 0.3"); }}
wire_load ("10k") {{ resistance : 0; capacitance : 0.0003; slope : 20; fanout_length (1, 10); fanout_length (5, 90); }}
"""
MEMORY_PINS = ("A_MEN", "A_WEN", "A_REN", "A_DLY", "A_ADDR", "A_DIN", "A_BM")
MEMORY = """memory() { type : ram; address_width : 8; word_width : 16; } pin (A_DOUT) { direction : output; }
pin (A_CLK) { direction : input; clock : true; capacitance : 0.01;
  internal_power() { when : "A_MEN & !A_WEN & A_REN"; rise_power("scalar") { values (26.5); } fall_power("scalar") { values (0); } }
  internal_power() { when : "A_MEN & A_WEN & !A_REN"; rise_power("scalar") { values (32.9); } fall_power("scalar") { values (0); } } }
"""


def _input(name: str, more: str = "") -> str:
    return f"pin ({name}) {{ direction : input; capacitance : 0.003; {more} }}\n"


def _output(name: str, function: str, of: str, kind: str, times: float, more: str = "") -> str:
    delays = "".join(
        TABLE.format(0.03 * times, 0.05 * times, 0.1 * times, name=table)
        for table in ("cell_rise", "cell_fall", "rise_transition", "fall_transition")
    )
    power = TABLE.format(0.004, 0.004, 0.004, name="rise_power") + TABLE.format(
        0.002, 0.002, 0.002, name="fall_power"
    )
    timing = "".join(f'timing () {{ related_pin : "{pin}"; {kind} {delays} }}\n' for pin in of)
    says = f'function : "{function}";' if function else ""
    return f"pin ({name}) {{ direction : output; {says} max_capacitance : 0.3; {more} {timing} internal_power () {{ {power} }} }}\n"


def _cell(name: str, area: float, *parts: str) -> str:
    return f"cell (sg13g2_{name}) {{ area : {area}; cell_leakage_power : 80;\n{''.join(parts)}}}\n"


SETUP = """timing () { related_pin : "CLK"; timing_type : setup_rising;
  rise_constraint (scalar) { values ("0.05"); } fall_constraint (scalar) { values ("0.05"); } }
"""
"""Of the flip-flop's input; by it OpenSTA knows a register."""


def library(corner: str) -> str:
    """The text of the file of a corner, ``typ`` or ``slow``, which is twice as slow."""
    times, edge = {"typ": 1.0, "slow": 2.0}[corner], "timing_type : rising_edge;"
    text = HEAD.format(corner=corner, voltage=1.2, temperature=25 if corner == "typ" else 125)
    for name, (area, out, function) in LOGIC.items():
        pins = [pin for pin in "AB" if pin in function]
        text += _cell(name, area, *map(_input, pins), _output(out, function, pins, "", times))
    clock = _input("CLK", "clock : true;")
    state = 'ff (IQ, IQN) { clocked_on : "CLK"; next_state : "D"; clear : "!RESET_B"; }\n'
    text += _cell(
        "dfrbpq_1",
        49,
        state,
        clock,
        _input("D", SETUP),
        _input("RESET_B"),
        _output("Q", "IQ", ["CLK"], edge, times),
    )
    state = 'latch (IQ, IQN) { enable : "GATE"; data_in : "D"; }\n'
    text += _cell("dlhq_1", 31, state, _input("GATE"), _input("D"), _output("Q", "IQ", ["GATE"], edge, times))
    gate = 'clock_gating_integrated_cell : "latch_posedge";\n'
    pins = _input("CLK", "clock : true; clock_gate_clock_pin : true;") + _input(
        "GATE", "clock_gate_enable_pin : true;"
    )
    text += _cell(
        "lgcp_1",
        27,
        gate,
        pins,
        _output("GCLK", "", ["CLK"], "timing_sense : positive_unate;", times, "clock_gate_out_pin : true;"),
    )
    for name, pin, value in (("tiehi", "L_HI", 1), ("tielo", "L_LO", 0)):
        text += _cell(name, 7.3, f'pin ({pin}) {{ direction : output; function : "{value}"; }}\n')
    return text + (_memory() if corner == "typ" else "") + "}\n"


def _memory() -> str:
    return _cell("ram", 9000, MEMORY, *map(_input, MEMORY_PINS))


def memory_library() -> str:
    """The memory in a separate file, typical."""
    return HEAD.format(corner="typ", voltage=1.2, temperature=25) + _memory() + "}\n"


def liberty_files(process: str, folder: Path) -> list[Path]:
    """The files of ``process``: ``tiny``, written into ``folder``, or ``real``, else the test is skipped."""
    if process == "real":
        if not PDK.is_dir():
            pytest.skip("no Liberty files of SG13G2 beside the checkout")
        return sorted(PDK.glob("*.lib"))
    for corner in ("typ", "slow"):
        (folder / f"{corner}.lib").write_text(library(corner))
    return sorted(folder.glob("*.lib"))
