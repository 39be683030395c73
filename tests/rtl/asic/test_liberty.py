"""Liberty files: the cells read, corners by their conditions, and one sentence for a file of another kind."""

import gzip
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eskin.golden.core import InputError
from eskin.rtl.asic.buffers import buffer_of, insert
from eskin.rtl.asic.liberty import corners, read
from eskin.rtl.asic.synthesis import expression, model, process_of
from tests.support.strategies import examples
from tests.support.table import refused

HEAD = """library (made) {{ /* a
comment */ nom_voltage : 1.2; nom_temperature : {temperature}; leakage_power_unit : "1pW"; capacitive_load_unit (1,pf);
wire_load ("10k") {{ capacitance : 0.0003; }}
"""
CELLS = """
cell (sg13g2_nand2_1) { area : 7.25; cell_leakage_power : 80;
  pin (Y) { direction : "output"; function : "!(A*B)"; internal_power () { rise_power (t) { values ("1, 2", \\
    "3, 4"); } fall_power (t) { values ("0, 0", "0, 2"); } } }
  pin (A) { direction : "input"; capacitance : 0.003; } pin (B) { direction : "input"; capacitance : 0.003; } }
cell (sg13g2_xor2_1) { area : 14; pin (X) { direction : "output"; function : "(A^B)"; } pin (A) { direction : "input"; }
  pin (B) { direction : "input"; } }
cell (ff) { area : 49; ff (IQ, IQN) { clocked_on : "CLK"; next_state : "D"; clear : "!R"; }
  pin (Q) { direction : "output"; function : "IQ"; } pin (CLK) { direction : "input"; clock : true; } pin (D) { direction : "input"; }
  pin (R) { direction : "input"; } }
cell (la) { area : 31; latch (IQ, IQN) { enable : "G"; data_in : "D"; }
  pin (Q) { direction : "output"; function : "IQ"; } pin (G) { direction : "input"; } pin (D) { direction : "input"; } }
cell (sg13g2_tiehi) { area : 7; pin (L_HI) { direction : output; } } cell (sg13g2_tielo) { area : 7; }
"""
BUFFERS = "".join(
    f'cell (sg13g2_buf_{size}) {{ area : {area}; pin (X) {{ direction : output; function : "A"; }} pin (A) '
    "{ direction : input; } }\n"
    for size, area in ((1, 7), (4, 14.5), (16, 45))
)
GATE = """cell (gate) { area : 27; clock_gating_integrated_cell : "latch_posedge"; pin (C) { direction : input; clock : true;
  clock_gate_clock_pin : true; } pin (E) { direction : input; clock_gate_enable_pin : true; }
  pin (O) { direction : output; clock_gate_out_pin : true; } }
"""
MACRO = """cell (ram) { memory() { type : ram; address_width : 4; word_width : 8; } area : 900 ; pin (A_CLK) { direction : input;
  clock : "true" ;
  internal_power() { when : "A_MEN  & !A_WEN & A_REN"; rise_power("scalar"){ values (26.5); } fall_power("scalar"){ values (0); } }
  internal_power() { when : "A_MEN & A_WEN & !A_REN"
   rise_power("scalar"){ values (32.9); } } } }
"""


def file(folder: Path, name: str, body: str, temperature: float = 25, packed: bool = False) -> Path:
    text = (HEAD.format(temperature=temperature) + body + "}\n").encode()
    path = folder / name
    path.write_bytes(gzip.compress(text) if packed else text)
    return path


def test_cells_are_read_with_units_roles_and_states(tmp_path):
    library = read(file(tmp_path, "cells.lib.gz", CELLS + GATE + MACRO, packed=True))
    cells = library.cells
    kinds = {
        "sg13g2_nand2_1": "logic",
        "ff": "flip-flop",
        "la": "latch",
        "gate": "gate",
        "ram": "memory",
        "sg13g2_tiehi": "other",
    }
    assert {name: cells[name].kind for name in kinds} == kinds
    nand = cells["sg13g2_nand2_1"]
    assert (
        nand.area == 7.25
        and nand.leakage == pytest.approx(80e-12)
        and nand.pins["A"].capacitance == pytest.approx(3e-15)
    )
    assert nand.pins["Y"].toggle_j == pytest.approx((4 + 2) / 2 * 1e-12)
    assert cells["ff"].state["clear"] == "!R" and cells["la"].state["enable"] == "G"
    assert (
        cells["gate"].pins["E"].gate == "enable"
        and list(library.wire_loads) == ["10k"]
        and library.temperature == 25
    )
    assert (cells["ram"].words, cells["ram"].bits) == (16, 8)
    assert cells["ram"].access_j == pytest.approx({"read": 26.5e-12, "write": 32.9e-12})


def test_corners_follow_from_what_files_say(tmp_path):
    typ, slow = read(file(tmp_path, "a.lib", CELLS)), read(file(tmp_path, "b.lib", CELLS, 125))
    found = corners([slow, typ, read(file(tmp_path, "m.lib", MACRO))])
    assert (
        found["slow"] == [slow] and found["typ"][0] is typ and len(found["typ"]) == 2 and found["fast"] == []
    )
    with refused("no file holds standard cells of the typical corner"):
        corners([slow])
    with refused(r"a\.lib and a\.lib both hold cells of the typ corner"):
        corners([typ, typ])


TOKENS = re.findall(
    r'"[^"]*"|[\w.]+|\s+|.', HEAD.format(temperature=25) + CELLS + BUFFERS + GATE + MACRO + "}", re.DOTALL
)
ODD = st.sampled_from(
    ["", "(", ")", "{", "}", ";", ":", ",", '"', "1e400", "nan", "-1", "x", "\n", "()", '"1e, 2"', "\\"]
)


@examples(300, 3000)
@given(st.dictionaries(st.integers(0, len(TOKENS) - 1), ODD, min_size=1, max_size=4))
def test_a_damaged_library_is_read_or_refused_in_one_sentence(tmp_path, changes):
    (tmp_path / "x.lib").write_text("".join(changes.get(place, token) for place, token in enumerate(TOKENS)))
    try:
        library = read(tmp_path / "x.lib")
        process_of("ihp-sg13g2", corners([library])["typ"])
        for cell in library.cells.values():
            model(cell)
    except InputError as error:
        assert "\n" not in str(error)


def test_models_say_what_cells_do_and_begin_at_random(tmp_path):
    cells = read(file(tmp_path, "a.lib", CELLS + GATE + MACRO)).cells
    assert expression("!(A*B)+C") == "~(A&B)|C"
    assert "assign Y = (~(A&B));" in model(cells["sg13g2_nand2_1"])
    for name in ("ff", "la", "gate", "ram"):
        assert "$urandom" in model(cells[name])
    assert "posedge force_0" in model(cells["ff"]) and "always @(posedge clock) IQ <= D;" in model(
        cells["la"]
    )


def test_nets_with_many_receivers_get_trees_of_buffers_and_the_clock_does_not(tmp_path):
    cells = read(file(tmp_path, "cells.lib", CELLS + BUFFERS + GATE)).cells
    flip_flops = {
        f"f{k}": {"type": "ff", "connections": {"CLK": [2], "D": [3], "R": ["1"], "Q": [100 + k]}}
        for k in range(50)
    }
    source = {"type": "ff", "connections": {"CLK": [2], "D": [4], "R": ["1"], "Q": [3]}}
    module = {
        "ports": {"clk": {"bits": [2]}},
        "netnames": {"last": {"bits": [200]}},
        "cells": flip_flops | {"source": source},
    }
    assert buffer_of(cells).name == "sg13g2_buf_1"
    assert insert(module, cells, 16) == 4
    reached, driver = [], {}
    for cell in module["cells"].values():
        if cell["type"] == "sg13g2_buf_1":
            driver[cell["connections"]["X"][0]] = cell["connections"]["A"][0]
    for k in range(50):
        reached.append(module["cells"][f"f{k}"]["connections"]["D"][0])
        assert driver[reached[-1]] == 3
    assert max(map(reached.count, reached)) <= 16 and min(driver) > 200
    assert all(cell["connections"]["CLK"] == [2] for cell in flip_flops.values())
