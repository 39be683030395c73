"""Co-simulation from a converter's pins: every stage exact on what the converter gives, faults flagged,
nothing decided from them."""

import dataclasses
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from eskin.cosim import flow
from eskin.cosim.simulation import Simulation
from eskin.data import turn_recordings
from eskin.data.archive import load_archive
from eskin.golden.core import PRESETS, AcceleratorConfig, ConverterFault
from eskin.golden.core.converters.mpr121 import Mpr121
from eskin.golden.data import Recordings
from eskin.golden.model import run, through_converter
from eskin.rtl.fpga.generate import generate
from eskin.training.made_up import random_recordings
from eskin.verbs.cosim import cosimulate, expected_of
from tests.support.array_touches import REST, touches
from tests.support.link_flow import pack_decisions
from tests.support.random_models import random_integer_model
from tests.support.small_designs import SMALL, with_converter
from tests.support.touch_cuts import beginnings

CONFIG = SMALL.replace(
    taxels=8, sample_bits=14, band_low=7600, band_high=8800, sample_rate_hz=1000.0, clock_hz=2e6
)


QUICK = with_converter("ads7953", sample_rate_hz=2500.0)
"""As few cycles a frame as its scan leaves room for; one simulator serves whoever plays it."""
TAGGED = with_converter(
    "spi", delay=1, frame_bits=24, channel_bit=3, code_bit=4, code_bits=14, tag_bit=18, tag_bits=3
)
OTHER_ORDER = dict(bits=16, first=3, ascending=True, code_offset=3000, code_shift=1)
MATRIX = with_converter("matrix", taxels=20, rows=4, columns=5, sample_rate_hz=500.0)
RANDOM = {
    "ads7953": QUICK,
    "ads7953, one frame in eight": QUICK | {"scan_every": 8, "sample_rate_hz": 2000.0},
    "mcp3208x2": with_converter("mcp3208x2"),
    "mcp3208 in series": with_converter("mcp3208x2", data_lines=1, taxels=16, sample_rate_hz=500.0),
    "ad7476": with_converter("ad7476"),
    "spi": with_converter(
        "spi", channels=5, taxels=10, frame_bits=22, command=1 << 21, channel_bit=18, code_bits=16
    ),
    "spi, late codes with numbers": TAGGED,
    "ddc232": with_converter("ddc232", version="C", clock_hz=6e6),
    "ddc232, 16 bits, other order": with_converter("ddc232", clock_hz=6e6, **OTHER_ORDER),
    "matrix": MATRIX,
    "matrix of a cell": MATRIX | dict(taxels=1, rows=1, columns=1, hidden=32),  # which stays selected
    "ads7953, other clock and shift": with_converter(
        "ads7953", hz=4e5, code_shift=-1, code_offset=-3900, clock_hz=1.7e6, sample_rate_hz=700.0
    ),
}
SMALL_ARRAY = dict(rows=13, columns=9, sample_rate_hz=50.0)
CELLS = dict(code_offset=96, code_shift=0, hz=1e6)
ELECTRODES = dict(code_offset=647, code_shift=-1)
ARRAYS = {
    "mpr121, 13 x 9": with_converter("mpr121", **ELECTRODES, **SMALL_ARRAY),
    "two mpr121, 13 x 9": with_converter(
        "mpr121", chips=2, **ELECTRODES, **SMALL_ARRAY | {"sample_rate_hz": 100.0}
    ),
    "matrix, 16 x 10": with_converter("matrix", rows=16, columns=10, sample_rate_hz=100.0, **CELLS),
    "matrix, 13 x 9": with_converter("matrix", **CELLS, **SMALL_ARRAY),
}
"""At a clock that is low enough to simulate them in seconds."""
PIEZO = {"ddc232": {}, "spi": dict(channels=8, frame_bits=24, channel_bit=18, code_bits=16)}
"""The other two with their 16 and 20 bits, the rest as it comes."""
SCENE = {"ddc232": dict(bits=16, hz=3e6), "spi": PIEZO["spi"]}
CHIPS = ("ads7953", "mcp3208x2", "ad7476", "ddc232", "spi")
RECORDED = [f"{preset}: {chip}" for preset in ("pvdf", "thesis") for chip in CHIPS]


def array_case(name: str) -> tuple[AcceleratorConfig, Recordings]:
    """A configuration for a large array, and five recordings of a touch that slides over it."""
    array = ARRAYS[name]
    rows, columns = array["rows"], array["columns"]
    config = CONFIG.replace(
        taxels=rows * columns,
        hop=6,
        window=13,
        touch_frames=60,
        pretrigger_frames=2,
        rearm_frames=12,
        sample_bits=12,
        band_low=0,
        band_high=REST + 200,
        **array,
    )
    slides = np.stack([touches(rows, columns, count=1, seed=k, frames=60)[0] for k in range(5)])
    rest, labels = slides[:, -3:], np.arange(5) % config.classes
    samples = 4 * np.concatenate([rest, rest, rest, slides, rest], axis=1)
    offsets, names = samples.shape[1] * np.arange(6), tuple(f"class {k}" for k in range(config.classes))
    return config, Recordings(np.vstack(samples), offsets, labels, names, config.sensor.sample_rate_hz)


def case_of(name: str, shared_data: Path) -> tuple[AcceleratorConfig, Recordings]:
    """Configuration and recordings: random ones, touches on an array, or five of a data set at the declared pace."""
    if name in ARRAYS:
        return array_case(name)
    if name in RANDOM:
        config = CONFIG.replace(**RANDOM[name])
        return config, random_recordings(config, (300, 250), seed=4)
    preset, chip = name.split(": ")
    if preset == "pvdf":  # piezo taxels, around whose rest level the converter's 4096 codes lie
        made = load_archive(shared_data / "pvdf_indent" / "recordings.npz")
        fields = {"feature_shift": (4,)} | with_converter(
            chip, **PIEZO.get(chip, dict(code_offset=-27352, code_shift=0))
        )
    else:  # the scene, whose 16 bits are rounded
        made, fields = (
            turn_recordings(persons=1, trials=2, rows=4, columns=4, sample_rate_hz=3000),
            with_converter(chip, **SCENE.get(chip, {})),
        )
    config = PRESETS[preset].replace(**fields)
    return config, beginnings(made, config)


@pytest.mark.parametrize(
    "name",
    ["ads7953", *(pytest.param(n, marks=pytest.mark.slow) for n in [*[*RANDOM][1:], *ARRAYS, *RECORDED])],
)
def test_exact_from_the_pins(name, shared_data, tmp_path):
    config, recordings = case_of(name, shared_data)
    model = random_integer_model(config, 3 if name in RECORDED else 5)
    result = cosimulate(model, recordings, Simulation(), work=tmp_path)
    way, sensor, clock_hz = result.conversion, config.sensor, config.hardware.clock_hz
    row = (name, sensor.taxels, sensor.sample_rate_hz, clock_hz, result.compared_values, way.jitter_cycles)
    print("\n", *row, sep=" | ")  # a row of docs/figures.md
    assert result.passed and result.pace == "declared", result.mismatch_list
    assert result.recordings == len(recordings) and result.compared_values > 300
    assert result.decisions > (10 if name in ARRAYS else 0)
    assert way.faults == way.violations == result.overruns == 0
    assert way.jitter_cycles < (1 if name in RANDOM else 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "limits"),
    [
        ({}, 0),
        ({"first": 1}, 1),  # its first data are not awaited
        ({"interval": 3}, 1),  # four samples in 32 ms, and a frame in 20
    ],
)
def test_an_mpr121_sleeps_between_samples_and_has_new_data_for_each_frame(
    change, limits, tmp_path, monkeypatch
):
    config, recordings = array_case("mpr121, 13 x 9")
    config = config.replace(converter=config.interface.converter.replace(hz=1e5))  # the start takes 6 ms
    awake = Mpr121.plan
    monkeypatch.setattr(Mpr121, "plan", lambda *which: dataclasses.replace(awake(*which).sleeping, **change))
    assert Mpr121().plan(config).longest == 2
    result = cosimulate(random_integer_model(config, 5), recordings.subset([0]), Simulation(), work=tmp_path)
    assert result.bit_exact and (result.conversion.violations > 0) == bool(limits)
    assert result.passed == (not limits)


STUCK, ORDER, SILENT, READBACK = (ConverterFault[name] for name in ("STUCK", "ORDER", "SILENT", "READBACK"))
FAST = dict(clock_hz=4e6, taxels=16)
TOLD = [
    (QUICK, (STUCK, STUCK, ORDER)),
    *((with_converter(chip, **FAST), 3 * (STUCK | ORDER,)) for chip in ("mcp3208x2", "ad7476")),
    (TAGGED | {"clock_hz": 4e6}, 3 * (STUCK | ORDER,)),
    (with_converter("ddc232", clock_hz=6e6), (STUCK, SILENT, READBACK)),
    (MATRIX, (STUCK, STUCK, ORDER)),
    ("mpr121, 13 x 9", (SILENT, SILENT, READBACK)),
    ("two mpr121, 13 x 9", (0, 0, 0, READBACK)),
]
"""Configuration, or name of an array; of faults of kind 1, 2 ... the bits one of which is told."""
FAULTS = [(fields, kind, flag) for fields, flags in TOLD for kind, flag in enumerate(flags, 1) if flag]


@pytest.mark.parametrize(
    ("fields", "kind", "flagged"),
    [
        pytest.param(*row, marks=[pytest.mark.slow] * (row[1:] != (3, ORDER) or row[0] is not QUICK))
        for row in FAULTS
    ],
)
def test_a_fault_is_flagged_and_the_chain_begins_anew_when_it_is_over(fields, kind, flagged, tmp_path):
    """Broken frames in a recording; decisions are golden before them, and again behind them."""
    at, frames, lasts = 150, 3, 3  # that are broken, from this one on, by a fault that lasts so many
    if isinstance(fields, str):
        model = random_integer_model(array_case(fields)[0], 5)
        made, at, frames, lasts = array_case(fields)[1].subset([0]), 3, 1, 1
    else:
        model = random_integer_model(CONFIG.replace(**fields), 5)
        made = random_recordings(model.config, (400,), seed=6)
        if fields["converter"]["name"] == "ddc232":
            frames, lasts = 1, 8  # it is set up anew; meanwhile the taxels wait, in the simulation
    config = model.config
    recordings, codes = through_converter(made, config)
    design = generate(config, model.arrays, tmp_path / "design")
    vectors = expected_of(model, recordings, tmp_path / "vectors.npz", codes=codes)
    played = flow.Run.of(design, vectors, Simulation(pace="declared"))
    result = played.play(tmp_path / "run", {"fault": (at, lasts, kind)}, bench="tests.support.broken_frames")
    halves: tuple[list, list] = [], []
    for word, cycle in result["decisions"]:
        halves[cycle > result["taken"][at + frames - 1]].append(word)
    golden = []
    for low, high in ((0, at), (at + frames, len(recordings.samples))):
        offsets = np.array([0, high - low])
        part = dataclasses.replace(recordings, samples=recordings.samples[low:high], offsets=offsets)
        golden.append(pack_decisions(config, run(model, part).streams["decision"][0]))
    # no end of a recording where the frames break: no partial decision
    assert halves[0] == [word for word in golden[0] if not word >> 30 & 1]
    assert halves[1] == golden[1] and len(golden[1]) > 3 and result["faults"] & flagged


@pytest.mark.parametrize(("name", "model"), [("ad7476", "ad7476.sv"), ("adc128s102", "spi.sv")])
def test_a_chip_without_a_model_of_its_own_is_played_by_that_of_any_spi_converter(name, model):
    """The second is no row of ours: what a newcomer adds."""
    plan = SimpleNamespace(parameters=lambda config: {"LINES": 2})
    chip = SimpleNamespace(name=name, plan=lambda config, clock_hz: plan)
    clock = SimpleNamespace(clock_hz=1e9)
    config = SimpleNamespace(interface=SimpleNamespace(converter=chip), hardware=clock)
    sources, options = flow.converter_model(config)
    assert [path.name for path in sources if path.is_file()] == ["pins.svh", model]
    assert "-DMODEL_PARAMETERS=.LINES(2),.CYCLE_PS(1000)" in options
