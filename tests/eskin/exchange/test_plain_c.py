"""The model as plain C against the golden model: every decision of random designs, under both compilers' warnings
and sanitizers; sizes on microcontrollers; and all recordings."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eskin.data import load_recordings
from eskin.exchange import plain_c
from eskin.golden.core import FEATURE_KINDS, AcceleratorConfig, QFormat
from eskin.golden.model import IntegerModel, run, run_images
from eskin.training.made_up import random_images, random_recordings
from eskin.verbs.export import export_c
from tests.support.c_played import MODELS, differences, front_end, with_failing_taxels
from tests.support.c_played import model_of as model_on
from tests.support.image_scenes import random_image_model
from tests.support.random_models import random_integer_model
from tests.support.strategies import configurations, examples
from tests.support.table import refused

GCC = ("gcc", "-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-O1")
SANITIZED = (*GCC, "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
IMAGES = AcceleratorConfig.of_image(
    9,
    10,
    ("conv 5 3", "pool", "conv 3 4", "conv 1 5", "pool", "dense 8", "dense 3"),
    ("cup", "ball", 'a "?\\ é'),
)
RING = AcceleratorConfig.of(
    taxels=5, sample_rate_hz=1000.0, sample_bits=10, rest="none", onset="band", band_low=400, band_high=600,
    window_mode="touch", pretrigger_frames=24, touch_frames=33, hop=4, window=9, steps=9, rearm_frames=34,
    decision="vote", fault_frames=4, masked_taxels=(1,), hidden=5,
)  # fmt: skip
"""Five windows end in the frames that an onset replays and three with the last frame; taxels fail before, among and
after these."""
EVENTS = RING.replace(sample_bits=2, band_low=1, band_high=2, fault_frames=0)
"""Codes of two levels: means with fraction bits."""
FOLLOWING = RING.replace(
    window_mode="whole", window=8, touch_frames=100, steps=3, store_per_window=2, rearm_frames=5,
    feature_kinds=FEATURE_KINDS, activity_block=2, cell="linear", decision="last",
)  # fmt: skip
"""Touches of every end, of which some fill the store several times."""


def model_of(config: AcceleratorConfig, seed: int) -> IntegerModel:
    return (random_image_model if config.is_image else random_integer_model)(config, seed)


def verdict(folder: Path, *compiler: str, prefix: str = "eskin") -> str:
    """What the check of ``folder`` says, built by ``compiler``."""
    sources = [f"{prefix}_model.c", f"{prefix}_check.c"]
    subprocess.run([*compiler, *sources, "-o", "check"], cwd=folder, check=True)
    return subprocess.run(["./check"], cwd=folder, capture_output=True, text=True).stdout


TREES = RING.replace(cell="trees", decision="last", trees=5, depth=4, nodes=40)


def exported(config: AcceleratorConfig, seed: int, folder: Path) -> dict:
    """A model with random weights in ``folder``, whose check plays recordings that reach most rules."""
    model, recordings = model_of(config, seed), None
    if not config.is_image:
        before = config.rest_level.rest_frames + config.windows.pretrigger_frames
        whole = before + config.last_frame + 2 * config.windows.hop
        lengths = (2 * whole + config.onset_rule.rearm_frames + 20, whole + 10, before + 3, 4 * whole)
        if config.faults.fault_frames:
            lengths += (lengths[0],) * 12
        recordings = random_recordings(model.config, lengths, seed)
        if config.faults.fault_frames:
            recordings = with_failing_taxels(model.config, recordings)
    return export_c(model, folder, recordings=recordings)


@examples(3, 400)
@given(configurations(), st.integers(1, 99))
def test_random_models_decide_as_the_golden_one(tmp_path_factory, config, seed):
    folder = tmp_path_factory.mktemp("c") / "exported"
    count = exported(config, seed, folder)["decisions"]
    assert verdict(folder, *SANITIZED) == f"{count} decisions compared, 0 different\n"


@pytest.mark.parametrize(
    "config", [IMAGES, RING, EVENTS, FOLLOWING, TREES], ids=["image", "ring", "events", "following", "trees"]
)
def test_images_and_replayed_windows_decide_as_the_golden_model(config, tmp_path):
    count = exported(config, 3, tmp_path / "c")["decisions"]
    assert count > 3
    assert verdict(tmp_path / "c", *SANITIZED) == f"{count} decisions compared, 0 different\n"


@pytest.mark.parametrize(
    "config, right, wrong",
    [
        (RING, "if (s->in_hop == 4)", "if (s->in_hop == 5)"),
        (RING, "second = v[best];", "second = v[c];"),
        (RING, "~(~v >> n) : v >> n", "-(-v >> n) : v >> n"),
        (RING, "s->flag_age[i] > (uint16_t)back", "s->flag_age[i] > 0 * back"),
        (RING, "s->flag_age[i]++;", ";"),
        (FOLLOWING, "[2 * k + 1][i];", "[2 * k][i];"),
        (FOLLOWING, "highest_of[2 * k + 1][i] >", "highest_of[2 * k][i] >"),
        (FOLLOWING, "s->doublings++;", ";"),
        (FOLLOWING, "hop = 0; hop < stop", "hop = first; hop < stop"),
        (FOLLOWING, "(k < m ? k : m - 1)", "(k < m ? k : 0)"),
        (TREES, "window < s->step ? window : s->step", "window"),
        (TREES, "value > THRESHOLD", "value >= THRESHOLD"),
        (TREES, "if (SUBTRAHEND[node] != INPUT[node])", "if (0)"),
        (TREES, "if (SUBTRAHEND[node] != INPUT[node])", ""),
    ],
)
def test_the_comparison_finds_a_bug_in_the_c(config, right, wrong, tmp_path):
    exported(config, 3, tmp_path / "c")
    source = tmp_path / "c" / plain_c.SOURCE
    text = source.read_text()
    assert right in text
    source.write_text(text.replace(right, wrong))
    assert " 0 different" not in verdict(tmp_path / "c", "gcc", "-std=c99", "-O1")


def test_a_check_of_nothing_fails(tmp_path):
    exported(TREES, 3, tmp_path)
    vectors = tmp_path / plain_c.VECTORS
    vectors.write_text(re.sub(r"(RECORDINGS|CALLS_EXPECTED) \d+", r"\1 0", vectors.read_text()))
    assert verdict(tmp_path, "gcc", "-std=c99").startswith("0 decisions")
    assert subprocess.run(["./check"], cwd=tmp_path, check=False).returncode == 1


SIXTEEN_BIT = """#include <stdio.h>
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/pgmspace.h>
#include <avr/sleep.h>
#include "eskin_model.h"
static const {kind} VALUES[] PROGMEM = {{ {values} }};
static const int16_t LENGTHS[] PROGMEM = {{ {lengths} }};
static int put(char letter, FILE *stream)
{{
    (void)stream;
    UDR0 = letter;
    return 0;
}}
static FILE port = FDEV_SETUP_STREAM(put, NULL, _FDEV_SETUP_WRITE);
static eskin_decision d;
static void tell(int recording, int frame, int said)
{{
    if (said)
        printf("call %d %d %d %ld %ld %ld %ld\\n", recording, frame, said, d.cls, d.margin, d.step, d.local_cls);
}}
int main(void)
{{
    const {kind} *value = VALUES;
    int recording;
    UCSR0B = 1 << TXEN0;
    stdout = &port;
    for (recording = 0; recording < {recordings}; recording++) {{
        {play}
    }}
    puts("end");
    cli();
    sleep_mode();
}}
"""
PLAY_FRAMES = """static eskin_state state;
        static int32_t codes[ESKIN_TAXELS];
        int frame, i;
        eskin_arm(&state);
        for (frame = 1; frame <= (int)pgm_read_word(&LENGTHS[recording]); frame++) {
            for (i = 0; i < ESKIN_TAXELS; i++)
                codes[i] = (int16_t)pgm_read_word(value++);
            tell(recording, frame, eskin_frame(&state, codes, &d));
        }
        tell(recording, 0, eskin_finish(&state, &d));"""
PLAY_IMAGES = """static uint8_t pixels[ESKIN_HEIGHT * ESKIN_WIDTH];
        int i;
        for (i = 0; i < ESKIN_HEIGHT * ESKIN_WIDTH; i++)
            pixels[i] = pgm_read_byte(value++);
        (void)LENGTHS;
        tell(recording, 0, eskin_image(pixels, &d));"""
TOUCHES = dict(fault_frames=0, masked_taxels=(), pretrigger_frames=4)
WITH_16_BIT_INT = {
    "image": IMAGES,
    "GRU before": RING.replace(**TOUCHES),
    "GRU after": RING.replace(**TOUCHES, reset="after", state_format=QFormat(4, 12)),
    "LSTM": RING.replace(**TOUCHES, cell="lstm", state_format=QFormat(4, 12)),
    "integrals": RING.replace(
        cell="linear", decision="last", feature_kinds=("mean", "integral"), integral_knee=0, integral_frac=12
    ),
}
# clang 22 (ziglang 0.17) makes an endless loop of a network for images with -Os, and is right with -O0, -O1 and -O2
AVR = ("avr-gcc", "-mmcu=atmega1284p", "-Os", "-std=c99", "-Wall", "-Wextra", "-Werror")
CLANG_AVR = (
    sys.executable, "-m", "ziglang", "cc", "-target", "avr-freestanding-none", "-mcpu=atmega1284p", "-ffreestanding",
    "-Wno-avr-rtlib-linking-quirks", "-fno-sanitize=all", "-O2", *GCC[1:-1],
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("kind", WITH_16_BIT_INT)
def test_a_processor_with_an_int_of_16_bits_decides_the_same(kind, tmp_path):
    """simavr runs an ATmega1284P; clang compiles the model, avr-gcc what plays it."""
    pytest.importorskip("ziglang", reason="ziglang (extra soc) is not installed")
    for tool in ("simavr", "avr-gcc"):
        if not shutil.which(tool):
            pytest.skip("gcc-avr, avr-libc and simavr are not installed")
    config = WITH_16_BIT_INT[kind]
    model, folder = model_of(config, 5), tmp_path / "c"
    if config.is_image:
        values = random_images(config, 4, 5)
        lengths, calls = [1] * 4, plain_c.expected_of_images(run_images(model, values))
    else:
        recordings = random_recordings(config, (150, 60, 150, 150), 5)
        values, lengths = recordings.samples, recordings.lengths.tolist()
        calls = plain_c.expected(run(model, recordings), recordings)
    export_c(model, folder)
    list_of = lambda numbers: ", ".join(map(str, numbers))
    program = SIXTEEN_BIT.format(
        kind="uint8_t" if config.is_image else "int16_t",
        values=list_of(values.ravel().tolist()),
        lengths=list_of(lengths),
        recordings=len(lengths),
        play=PLAY_IMAGES if config.is_image else PLAY_FRAMES,
    )
    (folder / "main.c").write_text(program)
    for command in (
        [*CLANG_AVR, "-c", plain_c.SOURCE, "-o", "model.o"],
        [*AVR, "main.c", "model.o", "-o", "program.elf"],
    ):
        subprocess.run(command, cwd=folder, check=True)
    simulated = subprocess.run(
        ["timeout", "300", "simavr", "-m", "atmega1284p", "-f", "16000000", "program.elf"],
        cwd=folder,
        capture_output=True,
        text=True,
    )
    said = simulated.stdout + simulated.stderr
    made = [tuple(map(int, call.split())) for call in re.findall(r"call ([-\d ]+)", said)]
    assert "end" in said and len(made) > 3, said
    assert made == [(number, *call) for number, of_one in enumerate(calls) for call in of_one]


SKETCH = """#include <{include}>
static eskin_state state;
int main()
{{
    int32_t codes[ESKIN_TAXELS] = {{ 0 }};
    eskin_decision decision;
    eskin_arm(&state);
    return eskin_frame(&state, codes, &decision);
}}
"""


def test_the_folder_is_a_library_of_arduino_and_a_module_of_zephyr(tmp_path):
    """As Arduino builds it: every C file of the folder, then a sketch in C++ with the header that is named. Zephyr finds
    the sources where its module says."""
    folder = tmp_path / "c"
    exported(RING, 6, folder)
    lines = (folder / "library.properties").read_text().splitlines()
    properties = dict(line.split("=", 1) for line in lines)
    wanted = "name version author maintainer sentence paragraph category url architectures"
    assert set(wanted.split()) <= properties.keys() and all(properties.values())
    assert re.fullmatch(r"\d+\.\d+\.\d+", properties["version"])
    for source in folder.glob("*.c"):
        subprocess.run([*GCC, "-Wno-pedantic", "-DARDUINO=10819", "-c", source.name], cwd=folder, check=True)
    (tmp_path / "sketch.cpp").write_text(SKETCH.format(include=properties["includes"]))
    built = ["g++", "-Wall", "-Werror", "-DARDUINO=10819", f"-I{folder}", "sketch.cpp", *folder.glob("*.o")]
    subprocess.run([*built, "-o", "sketch"], cwd=tmp_path, check=True)
    assert subprocess.run([tmp_path / "sketch"]).returncode == 0
    module = (folder / "zephyr" / "module.yml").read_text()
    place = folder / re.search(r"^build:\n  cmake: (\w+)$", module, re.MULTILINE)[1]
    named = re.findall(r"\((\.\.[\w./]*)\)", (place / "CMakeLists.txt").read_text())
    assert len(named) == 2 and all((place / name).exists() for name in named)


BOTH = """#include <string.h>
#include "left_model.h"
#include "Right2_model.h"
int main(void)
{
    static left_state state;
    left_decision decision;
    Right2_decision of_image;
    const int32_t codes[LEFT_TAXELS] = { 0 };
    const uint8_t pixels[RIGHT2_HEIGHT * RIGHT2_WIDTH] = { 0 };
    left_arm(&state);
    left_frame(&state, codes, &decision);
    return Right2_image(pixels, &of_image) != 3 || strcmp(left_class_name(0), "eskin_ESKIN_0");
}
"""


def test_two_models_go_into_one_program(tmp_path):
    """A network for recordings and one for images; the class's name stays what it is."""
    names = {"left": RING.replace(class_names=("eskin_ESKIN_0", "b", "c")), "Right2": IMAGES}
    for prefix, config in names.items():
        folder = tmp_path / prefix
        result = export_c(model_of(config, 3), folder, prefix=prefix)
        said = verdict(folder, *SANITIZED, prefix=prefix)
        assert said == f"{result['decisions']} decisions compared, 0 different\n"
        assert f"includes={prefix}_model.h" in (folder / "library.properties").read_text().splitlines()
        assert f"../{prefix}_model.c" in (folder / "zephyr" / "CMakeLists.txt").read_text()
    (tmp_path / "main.c").write_text(BOTH)
    sources = [f"{prefix}/{prefix}_model.c" for prefix in names]
    command = [*SANITIZED, "-Ileft", "-IRight2", "main.c", *sources, "-o", "both"]
    subprocess.run(command, cwd=tmp_path, check=True)
    assert subprocess.run([tmp_path / "both"]).returncode == 0
    for wrong in ("", "2left", "a b", "a;x", "é", "x" * 41):
        with refused("--prefix .*: is not a prefix for names in C"):
            export_c(model_of(RING, 3), tmp_path / "no", prefix=wrong)
    assert not (tmp_path / "no").exists()


@pytest.mark.slow
@pytest.mark.parametrize("kind", MODELS)
@pytest.mark.parametrize("name", ["pvdf", "fabric", "biotac", "synthetic"])
def test_all_recordings_decide_the_same(name, kind, shared_data, tmp_path):
    archive = next(shared_data.glob(f"{name}*/recordings.npz"), name)
    recordings = load_recordings(str(archive))
    result = differences(model_on(front_end(name, recordings), kind), recordings, tmp_path / "c")
    assert result["different"] == 0 and result["decisions"] > 20 * 200, result


def test_the_header_says_what_a_code_of_each_taxel_is_worth():
    model = random_integer_model(AcceleratorConfig.of(taxels=4, volt_per_code=(0.1, 0.1, 1e-5, 2.0)), 1)
    assert "#define ESKIN_LSB { 0.1, 0.1, 1e-05, 2.0 }" in plain_c.sources(model)["eskin_model.h"]
    unknown = random_integer_model(AcceleratorConfig.of(taxels=4), 1)
    assert "ESKIN_LSB" not in plain_c.sources(unknown)["eskin_model.h"]
