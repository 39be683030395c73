"""Co-simulation from a converter's pins: every stage exact on what the converter gives, faults flagged,
nothing decided from them."""

import dataclasses
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from eskin.cosim import flow
from eskin.data import synthetic_recordings
from eskin.data.archive import load_archive
from eskin.golden.core import PRESETS, AcceleratorConfig, ConverterFault, InputError
from eskin.golden.data import Recordings
from eskin.golden.model import run, through_converter, write_vectors
from eskin.rtl.fpga.generate import generate, pack_decision
from eskin.training.made_up import random_recordings
from eskin.verbs.flow import BUILD, cosimulate
from tests.support.array_touches import REST, touches
from tests.support.random_models import random_integer_model
from tests.support.small_designs import SMALL
from tests.support.table import each_row
from tests.support.touch_cuts import beginnings

CONFIG = SMALL.replace(
    taxels=8, sample_bits=14, band_low=7600, band_high=8800, sample_rate_hz=1000.0, clock_hz=2e6
)
OTHERS = {
    "mcp3208x2": dict(converter="mcp3208x2"),
    "mcp3208 in series": dict(
        converter=dict(name="mcp3208x2", data_lines=1), taxels=16, sample_rate_hz=500.0
    ),
    "ad7476": dict(converter="ad7476"),
    "spi": dict(converter=dict(name="spi", channels=4, frame_bits=20, channel_bit=18, code_bits=16)),
    "spi, late codes with numbers": dict(
        converter=dict(
            name="spi",
            delay=1,
            frame_bits=24,
            channel_bit=3,
            code_bit=4,
            code_bits=14,
            tag_bit=18,
            tag_bits=3,
        )
    ),
    "ddc232": dict(converter=dict(name="ddc232", version="C"), clock_hz=6e6),
    "ddc232, 16 bits, other order": dict(
        converter=dict(name="ddc232", bits=16, first=3, ascending=True, code_offset=3000, code_shift=1),
        clock_hz=6e6,
    ),
    "matrix": dict(converter="matrix", taxels=20, rows=4, columns=5, sample_rate_hz=500.0),
    "ads7953, other clock and shift": dict(
        converter=dict(name="ads7953", hz=4e5, code_shift=-1, code_offset=-3900),
        clock_hz=1.7e6,
        sample_rate_hz=700.0,
    ),
}


DDC = dict(clock_hz=6e6, sample_rate_hz=1000.0, converter="ddc232")
ARRAYS = {
    "mpr121, 13 x 9": dict(
        converter=dict(name="mpr121", code_offset=647, code_shift=-1), rows=13, columns=9, sample_rate_hz=50.0
    ),
    "two mpr121, 13 x 9": dict(
        converter=dict(name="mpr121", chips=2, code_offset=647, code_shift=-1),
        rows=13,
        columns=9,
        sample_rate_hz=100.0,
    ),
    "matrix, 16 x 10": dict(
        converter=dict(name="matrix", code_offset=96, code_shift=0, hz=1e6),
        rows=16,
        columns=10,
        sample_rate_hz=100.0,
    ),
    "matrix, 13 x 9": dict(
        converter=dict(name="matrix", code_offset=96, code_shift=0, hz=1e6),
        rows=13,
        columns=9,
        sample_rate_hz=50.0,
    ),
}
"""At a clock that is low enough to simulate them in seconds."""


@pytest.mark.parametrize(("name", "model"), [("ad7476", "ad7476.sv"), ("adc128s102", "spi.sv")])
def test_a_chip_without_a_model_of_its_own_is_played_by_that_of_any_spi_converter(name, model):
    """The second is no row of ours: what a newcomer adds."""
    plan = SimpleNamespace(parameters=lambda config: {"LINES": 2})
    chip = SimpleNamespace(name=name, plan=lambda config, clock_hz: plan)
    clock = SimpleNamespace(clock_hz=1e9)
    config = SimpleNamespace(interface=SimpleNamespace(converter=chip), hardware=clock)
    sources, options = flow.converter_model(config)
    assert [path.name for path in sources] == ["pins.svh", model]
    assert options[:2] == (f"-DCONVERTER_{name}", "-DMODEL_PARAMETERS=.LINES(2),.CYCLE_PS(1000)")
    assert all(path.is_file() for path in sources)


def tell(name: str, scene: str, config: AcceleratorConfig, result) -> None:
    """A row of the table in docs/interface.md."""
    way, clock = result["conversion"], config.hardware.clock_hz
    feature = " to ".join(f"{cycles}" for cycles in dict.fromkeys(way["feature_cycles"]))
    cells = [
        name,
        scene,
        f"{config.sensor.taxels} at {config.sensor.sample_rate_hz:g} Hz",
        f"{clock / 1e6:g} MHz",
    ]
    cells += [result["compared_values"], way["scan_cycles"], f"{way['jitter_cycles']:g}", feature]
    print("\n|", *(f"{cell} |" for cell in cells))


def array_case(name: str) -> tuple[AcceleratorConfig, Recordings]:
    """A configuration for a large array, and five recordings of a touch that slides over it."""
    one = ARRAYS[name]
    rows, columns = one["rows"], one["columns"]
    rate = dict(
        hop=6,
        window=13,
        touch_frames=60,
        pretrigger_frames=2,
        rearm_frames=12,
        sample_bits=12,
        band_low=0,
        band_high=REST + 200,
    )
    config = CONFIG.replace(taxels=rows * columns, clock_hz=2e6, **(rate | one))
    parts = []
    for seed in range(5):
        samples = touches(rows, columns, count=1, seed=seed, frames=60)[0]
        parts.append(np.concatenate([samples[-3:], samples[-3:], samples[-3:], samples, samples[-3:]]) * 4)
    offsets = np.concatenate([[0], np.cumsum([len(part) for part in parts])])
    labels = np.arange(5) % config.classes
    names = tuple(f"class {k}" for k in range(config.classes))
    return config, Recordings(np.concatenate(parts), offsets, labels, names, config.sensor.sample_rate_hz)


@pytest.mark.slow
@pytest.mark.parametrize("name", ARRAYS)
def test_generated_touches_on_large_arrays_from_the_pins(name, tmp_path):
    config, recordings = array_case(name)
    result = cosimulate(random_integer_model(config, 5), recordings, work=tmp_path)
    assert (
        result["passed"]
        and result["recordings"] == 5
        and result["decisions"] > 10
        and result["conversion"]["jitter_cycles"] == 0
    )
    tell(name, "generated touches", config, result)


PIEZO = {"ddc232": {}, "spi": dict(channels=8, frame_bits=24, channel_bit=18, code_bits=16)}
"""The other two with their 16 and 20 bits, the rest as it comes."""


def check(config, tmp_path, lengths=(300, 250)):
    recordings = random_recordings(config, lengths, seed=4)
    result = cosimulate(random_integer_model(config, 5), recordings, work=tmp_path)
    assert (
        result["mismatch_list"] == []
        and result["bit_exact"]
        and result["passed"]
        and result["compared_values"] > 300
    )
    assert result["conversion"]["faults"] == result["conversion"]["violations"] == result["overruns"] == 0
    return result


QUICK = CONFIG.replace(converter="ads7953", sample_rate_hz=2500.0)
"""As few cycles a frame as its scan leaves room for; one simulator serves whoever plays it."""


@pytest.mark.parametrize("scan_every", [1, 4])
def test_ads7953_from_its_pins(scan_every, tmp_path):
    """Also of a source too fast for the chip, of which it scans one frame in four."""
    rate = {"scan_every": scan_every, "sample_rate_hz": scan_every * QUICK.sensor.sample_rate_hz}
    result = check(QUICK.replace(**rate), tmp_path)
    assert result["frames"] == 550
    assert result["pace"] == "declared" and result["conversion"]["jitter_cycles"] < 1
    assert (
        result["conversion"]["scan_cycles"] < 0.9 * 800 and max(result["conversion"]["feature_cycles"]) < 100
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", OTHERS)
def test_the_others_from_their_pins(name, tmp_path):
    result = check(CONFIG.replace(**OTHERS[name]), tmp_path)
    assert result["conversion"]["jitter_cycles"] < 1


def play_with_a_fault(
    config, kind: int, tmp_path, recordings=None, at: int = 150, frames: int = 3, lasts: int = 3
):
    """``frames`` broken frames from ``at`` on, by a fault that lasts so many frames: (fault bits, decisions
    before, after; golden ones of the good frames before, after). While a chip is set up anew no frame is lost
    in the simulation: the taxels wait."""
    model = random_integer_model(config, 5)
    config = model.config
    recordings, codes = through_converter(recordings or random_recordings(config, (400,), seed=6), config)
    total = len(recordings.samples)
    design = generate(config, model.arrays, tmp_path / "design")
    vectors = write_vectors(tmp_path / "vectors.npz", run(model, recordings), recordings, codes=codes)
    run_ = flow.Run.of(design, vectors, pace="declared", builds=BUILD / "simulators")
    fault = {"fault": (at, lasts, kind)}
    said, _ = run_.play(tmp_path / "run", fault, bench="tests.support.broken_frames")
    halves: tuple[list, list] = [], []
    for word, cycle in said["decisions"]:
        halves[cycle > said["taken"][at + frames - 1]].append(word)
    golden = []
    for low, high in ((0, at), (at + frames, total)):
        part = dataclasses.replace(
            recordings, samples=recordings.samples[low:high], offsets=np.array([0, high - low])
        )
        rows, _ = run(model, part).streams["decision"]
        golden.append([pack_decision(config, row) for row in rows])
    # no end of a recording where the frames break: no partial decision
    golden[0] = [word for word in golden[0] if not word >> 30 & 1]
    return said["faults"], halves, golden


STUCK, ORDER, SILENT, READBACK = (ConverterFault[name] for name in ("STUCK", "ORDER", "SILENT", "READBACK"))
FAST = dict(clock_hz=4e6)
SET_UP = dict(frames=1, lasts=8)
MATRIX = OTHERS["matrix"]
FAULTS = [
    (QUICK, 3, ORDER, {}),
    *((QUICK, kind, STUCK, {}) for kind in (1, 2)),
    *(
        (CONFIG.replace(**FAST, **fields), kind, STUCK | ORDER, {})
        for fields in (
            dict(taxels=16, converter="mcp3208x2"),
            dict(taxels=16, converter="ad7476"),
            OTHERS["spi, late codes with numbers"],
        )
        for kind in (1, 2, 3)
    ),
    *((CONFIG.replace(**DDC), kind, flag, SET_UP) for kind, flag in ((1, STUCK), (2, SILENT), (3, READBACK))),
    *((CONFIG.replace(**MATRIX), kind, flag, {}) for kind, flag in ((1, STUCK), (2, STUCK), (3, ORDER))),
    *(("mpr121, 13 x 9", kind, flag, {}) for kind, flag in ((1, SILENT), (2, SILENT), (3, READBACK))),
    ("two mpr121, 13 x 9", 4, READBACK, {}),
]
"""Configuration, or name of an array; kind of the fault; one of these bits is told; how long it lasts."""


@pytest.mark.parametrize(
    ("config", "kind", "flagged", "options"),
    [pytest.param(*row, marks=[pytest.mark.slow] * (number > 0)) for number, row in enumerate(FAULTS)],
)
def test_a_fault_is_flagged_and_the_chain_begins_anew_when_it_is_over(
    config, kind, flagged, options, tmp_path
):
    if isinstance(config, str):
        config, recordings = array_case(config)
        first = recordings.subset(np.array([0]))
        options = dict(recordings=first, at=3, frames=1, lasts=1)
    faults, halves, golden = play_with_a_fault(config, kind, tmp_path, **options)
    assert faults & flagged and len(golden[1]) > 3
    assert halves[0] == golden[0] and halves[1] == golden[1]


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("converter", ["ads7953", "mcp3208x2", "ad7476", "ddc232", "spi"])
@pytest.mark.parametrize("preset", ["pvdf", "thesis"])
def test_five_recordings_at_the_declared_pace(preset, converter, shared_data, tmp_path):
    """Piezo taxels, around whose rest level the converter's 4096 codes lie; the scene, whose 16 bits are rounded."""
    if preset == "pvdf":
        chip = PIEZO.get(converter, dict(code_offset=-27352, code_shift=0))
        fields = dict(feature_shift=(4,))
        made = load_archive(shared_data / "pvdf_indent" / "recordings.npz")
    else:
        chip = {"ddc232": dict(bits=16, hz=3e6), "spi": PIEZO["spi"]}.get(converter, {})
        fields = {}
        made = synthetic_recordings(persons=1, trials=2)
    config = PRESETS[preset].replace(converter=dict(name=converter, **chip), **fields)
    result = cosimulate(random_integer_model(config, 3), beginnings(made, config), work=tmp_path)
    tell(converter, preset, config, result)
    assert result["passed"] and result["recordings"] == 5 and result["decisions"] > 0
    assert result["conversion"]["jitter_cycles"] == 0


BIG = dict(converter="matrix", taxels=160, rows=16, columns=10)
MPR = dict(converter="mpr121", taxels=117, rows=13, columns=9)
DDC_FAST = dict(converter="ddc232", clock_hz=20e6)
REFUSED = [
    (
        dict(converter=dict(name="mcp3208x2", data_lines=1)),
        r"16 transfers of 2 chips in series at 1 MHz take 324 us, and of 333 us a frame at 3000 Hz 300 may be used.*at most 2777 Hz",
        2777.0,
    ),
    (
        dict(converter="ads7953", sample_rate_hz=6000.0),
        "18 transfers at 2 MHz take 156 us.*at most 5769 Hz",
        5769.0,
    ),
    (
        dict(converter=dict(name="spi", channel_bit=0)),
        "field converter.channel_bit: is 0 with the code's first bit at 11",
        None,
    ),
    (dict(converter="mcp3208x2", taxels=40), "two chips have 16 channels", None),
    (
        DDC_FAST | dict(converter=dict(name="ddc232", version="C")),
        r"DVALID comes up to 277 us after CONV \(version C at 5 MHz\).*at most 2235 Hz",
        2235.0,
    ),
    (
        DDC_FAST | dict(converter=dict(name="ddc232", first=1)),
        "32 words of 20 bits at 2 MHz.*at most 2131 Hz",
        2131.0,
    ),
    (
        dict(converter=dict(name="ddc232", version="C"), clock_hz=12e6, sample_rate_hz=2500.0),
        "a rate of at most 1582 Hz works as it is",
        1582.0,
    ),
    (
        dict(converter="ddc232", sample_rate_hz=7000.0),
        "integrates for 166.5 us at least: give at most 6006",
        None,
    ),
    (
        BIG | dict(sample_rate_hz=300.0),
        r"160 cells of 28.8 us, 20 of them to settle .settle_s., take 4600 us.*; a rate of at most 195 Hz works",
        195.0,
    ),
    (
        MPR | dict(taxels=135, rows=15, sample_rate_hz=100.0),
        "converter.chips: is 1; 15 rows and 9 columns are 13 electrodes and 12 are there",
        None,
    ),
    (BIG | dict(converter="mpr121", sample_rate_hz=100.0), "both are odd, or set chips 2", None),
    (
        MPR | dict(sample_rate_hz=2000.0),
        r"12 electrodes over I2C at 375 kHz take 799 us.*at most 1126 Hz works as it is",
        1126.0,
    ),
]
"""Fields, what is said, and the rate that then works."""


@each_row(("fields", "said", "rate"), REFUSED)
def test_what_cannot_keep_up_is_refused_with_the_rate_that_works(fields, said, rate):
    with pytest.raises(InputError, match=said):
        PRESETS["thesis"].replace(**fields)
    if rate:
        PRESETS["thesis"].replace(**fields | dict(sample_rate_hz=rate))


def test_without_a_converter_nothing_of_the_interface_is_built(monkeypatch):
    """The same Verilog as without the group: nothing of its folder is so much as made, and the fields change
    no text."""
    from amaranth.back import rtlil

    from eskin.rtl.interface import acquisition
    from eskin.rtl.top.board import Board

    def refuse(*_, **__):
        raise AssertionError("an interface was built")

    monkeypatch.setattr(acquisition.Acquisition, "__init__", refuse)
    model = random_integer_model(CONFIG, 1)
    other = model.config.replace(converter=dict(name="none", hz=1e6, code_shift=3))
    texts = [
        rtlil.convert(Board(config, clock_hz=12e6), name="board_top", emit_src=False)
        for config in (model.config, other)
    ]
    assert texts[0] == texts[1] and "converter" not in texts[0] and "cs_n" not in texts[0]


@pytest.mark.slow
def test_generated_files_of_a_configuration_with_a_converter(tmp_path):
    model = random_integer_model(CONFIG.replace(converter="ads7953"), 1)
    folder = generate(model.config, model.arrays, tmp_path / "design")
    assert "module sensing(" in (folder / "sensing.sv").read_text()
    assert not (
        generate(model.config.replace(converter="none"), model.arrays, tmp_path / "plain") / "sensing.sv"
    ).exists()
    assert Path(folder / "accelerator.sv").read_text() == (tmp_path / "plain" / "accelerator.sv").read_text()
