"""The exported Verilog: the same text every time, free of what the simulators stumble over."""

import hashlib
import os
import subprocess
import sys

from eskin.golden.core import PRESETS
from eskin.rtl.fpga import generate as generating
from eskin.rtl.fpga.export import export
from eskin.rtl.fpga.generate import generate
from scripts import ROOT
from tests.support.random_models import random_integer_model
from tests.support.silent import forget
from tests.support.small_designs import SMALL, with_converter
from tests.support.table import refused


def test_a_converter_changes_no_text_of_the_chain(tmp_path):
    """Nothing of the interface is built without one, whatever its other fields are."""
    fields = with_converter("ads7953", taxels=8, sample_rate_hz=1000.0, clock_hz=2e6)
    model = random_integer_model(SMALL.replace(**fields), 1)
    converters = ("ads7953", dict(name="none", hz=1e6, code_shift=3))
    folders = [
        generate(model.config.replace(converter=converter), model.arrays, tmp_path / str(number))
        for number, converter in enumerate(converters)
    ]
    sensing, *others = ("sensing.sv" in {path.name for path in folder.iterdir()} for folder in folders)
    texts = {(folder / "accelerator.sv").read_text() for folder in folders}
    assert sensing and not any(others) and len(texts) == 1 and "cs_n" not in texts.pop()


def test_text_is_deterministic_portable_and_complete():
    config = PRESETS["pvdf"].replace(feature_shift=(3,), hidden=4)
    text = export(config)
    script = (
        "import hashlib; from eskin.golden.core import PRESETS; from eskin.rtl.fpga.export import export; "
        "text = export(PRESETS['pvdf'].replace(feature_shift=(3,), hidden=4)); "
        "print(hashlib.sha256(text.encode()).hexdigest())"
    )
    other = subprocess.run(
        [sys.executable, "-c", script],
        cwd=ROOT,
        env={**os.environ, "PYTHONHASHSEED": "77"},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert other.stdout.strip() == hashlib.sha256(text.encode()).hexdigest(), other.stderr
    assert "always @*" not in text and "always @(*)" not in text, (
        "always @* misses its time-zero event in Icarus"
    )
    assert str(ROOT) not in text and "/src" not in text, "no path of the machine that generated it"
    for port in "i__payload i__valid i__ready o__payload bus__addr busy probe__state__value clk rst".split():
        assert port in text


def test_a_folder_with_other_files_is_refused_and_an_earlier_one_replaced(tmp_path, monkeypatch):
    monkeypatch.setattr(generating, "verilog", lambda design, name: forget(design) or "")
    model = random_integer_model(SMALL, 5)
    other, out = tmp_path / "other", tmp_path / "out"
    other.mkdir()
    (other / "notes.txt").write_text("mine")
    with refused("other files in it; give a new folder with `out`"):
        generate(model.config, model.arrays, other)
    assert [path.name for path in tmp_path.rglob("*")] == ["other", "notes.txt"]
    for _ in range(2):
        generate(model.config, model.arrays, out)
        assert not (out / "left_over").exists()
        (out / "left_over").write_text("")
    assert {path.name for path in tmp_path.iterdir()} == {"other", "out"}
