"""Hypothesis strategies of configurations and whole designs, and the number of examples: few in ``make
test``, many in long runs.

Two profiles (tests/conftest.py): "quick" draws the same examples every time; "long", of ``make fuzz`` and
``make designs``, draws new ones, after those that failed before (Hypothesis keeps them in .hypothesis and
makes them smaller).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import HealthCheck, Phase, reject, settings
from hypothesis import strategies as st

from eskin.cosim.simulation import Simulation
from eskin.golden.core import FEATURE_KINDS, AcceleratorConfig, InputError, QFormat
from eskin.golden.core.converters import SPI_CHIPS, code_format, code_shift
from eskin.golden.core.groups import GROUP_OF
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel, codes_of, samples_of
from eskin.rtl.program.schedule import lowest_clock_hz
from eskin.training.made_up import image_recordings, random_images, random_recordings
from eskin.verbs.cosim import cosimulate
from scripts.coverage import read, wishes
from scripts.crosses import build, refusal
from tests.support.image_scenes import random_image_model
from tests.support.random_models import random_integer_model

LONG = settings.get_current_profile_name() == "long"
GATED_CYCLES = 40
"""Cycles of a frame beyond what a design with a clock gate needs: more than its clock runs on."""


def examples(quick: int, long: int) -> settings:
    """So many examples, each of which may take seconds; only long runs make a failing one smaller, which may
    take minutes."""
    health = dict(deadline=None, suppress_health_check=list(HealthCheck))
    if LONG:
        return settings(max_examples=long, **health)
    return settings(max_examples=quick, derandomize=True, phases=(Phase.explicit, Phase.generate), **health)


FORMATS = {
    "weight_format": ((3, 1, 2), (5, 3, 7, 9)),
    "recurrent_format": ((3, 2, 1), (5, 4, 7)),
    "dense_format": ((3, 1), (5, 2, 7)),
    "bias_format": ((5, 2), (9, 4)),
    "dense_bias_format": ((5, 2), (9, 4)),
    "feature_format": ((4, 2), (8, 5, 3)),
    "state_format": ((2, 4), (12, 10, 7)),
    "logit_format": ((6, 3), (10, 5)),
}
"""Bits before and after the point, the simplest first."""
FIELDS: dict[str, tuple[Any, ...]] = {
    "hidden": (4, 5, 6, 7, 8, 9, 11),
    "clock_hz": (12e6,),
    "fault_activity": (0, 3),
    "gate_activation": ("sigmoid", "hard_sigmoid"),
    "decision": ("last", "vote", "early"),
    "early_margin": (0, 9),
    "margin_threshold": (0, 5),
    "gate_frac": (13, 14, 9, 4),
    "table_entries": (128, 64, 512, 1024),
    "lanes": (1, 2, 3, 4, 6, 9, 12, 16),
    "loadable": (True, False),
    "checksum": (False, True),
    "watchdog": (False, True),
    "activity_rule": ("sum", "change"),
    "integral_knee": (4, 0, 7),
    "integral_frac": (8, 5, 1),
    "feature_scale": ("array", "taxel"),
    "weight_sets": ("window", "one"),
}
"""Fields that depend on no other, the simplest value first: a failing design is made smaller towards it."""
KINDS = [kinds for size in (1, 2, 3, 5) for kinds in combinations(FEATURE_KINDS, size)]
RESTS = {
    "band": ("none", "initial", "tracked"),
    "baseline": ("tracked", "initial"),
    "immediate": ("none", "initial"),
}


def picking(draw: st.DrawFn) -> Callable[..., Any]:
    """``pick(a, b, ...)``: one of the options, drawn."""
    return lambda *options: draw(st.sampled_from(options))


MOST_CYCLES = 4000
"""Of a touch of a design with several wishes."""


def together(wishes: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Few wishes that hold all of these: joined while a configuration has them all. Networks for images stay alone."""
    found = []
    while wishes:
        joint: dict[str, Any] = {}
        left = []
        for wish in wishes:
            both = joint | wish
            kinds = {*joint.get("feature_kinds", ()), *wish.get("feature_kinds", ())}
            if kinds:
                both["feature_kinds"] = tuple(kind for kind in FEATURE_KINDS if kind in kinds)
            fits = all(both[name] == value for name, value in joint.items() if name != "feature_kinds")
            fits = fits and not (joint and (both.get("cell") == "image" or refusal(tuple(both.items()))))
            if fits and joint:
                config = build(both)
                sensor, beats = config.sensor, config.inputs
                if both.get("pace") == "declared":
                    beats = lowest_clock_hz(config) / sensor.sample_rate_hz
                cycles = config.last_frame * sensor.scan_every * beats
                fits = cycles + config.windows.steps * config.step_ideal < MOST_CYCLES
            if fits:
                joint = both
            else:
                left.append(wish)
        found.append(joint)
        wishes = left
    return found


HIT = {bin for bins in read()["hits"].values() for bin in bins} if LONG else set()
WISHES = together(wishes(HIT)) if LONG else []
"""Fields that nothing has covered yet: in long runs most designs begin with some of them."""


@st.composite
def configurations(draw: st.DrawFn, wish: Mapping[str, Any] | None = None) -> AcceleratorConfig:
    """Configurations of recordings that the project takes, without converter: cells, sizes, formats, windows,
    onsets, lanes; with the fields of ``wish``."""

    pick, wish = picking(draw), dict(wish or {})
    (cell, reset), lane_type = (
        pick(("gru", "before"), ("gru", "after"), ("lstm", "before"), ("linear", "before")),
        pick("plain", "dsp"),
    )
    taxels, classes = pick(4, 5, 6, 7, 8, 9, 12, 16, 17, 21, 1, 2, 3, 256), pick(2, 3, 4, 5, 7, 128)
    sample = QFormat(pick(12, 8, 10, 16, 6, 2), 0, pick(False, True))
    low, span = sample.min_code, sample.max_code - sample.min_code
    taxels, onset = wish.get("taxels", taxels), wish.get("onset") or pick(*RESTS)
    modes = ("touch", "free") if wish.get("decision") == "early" else ("touch", "free", "whole")
    mode = wish.get("window_mode") or pick(*modes)
    hop, steps, check = pick(2, 3, 4, 5, 7, 8), pick(1, 2, 3, 4, 5, 6), pick(1, 2, 4)
    steps = wish.get("steps", max(steps, wish.get("early_steps", 1)))
    window, pretrigger, cut = 2 * hop, 0, 0
    if mode == "touch":
        window, cut = window + pick(0, 1), pick(0, 1, hop, 2 * hop - 2)
        pretrigger = 0 if onset == "immediate" else pick(0, 1, 3, 6)
    rest = wish.get("rest") or pick(*RESTS[onset])
    hits, of_frames = pick((1, 1), (2, 3), (3, 3))
    fields = {name: draw(st.sampled_from(options)) for name, options in FIELDS.items()}
    fields |= {
        name: QFormat(*(draw(st.sampled_from(bits)) for bits in options)) for name, options in FORMATS.items()
    }
    store, longest = pick(2, 4, 6), hop * (steps - 1) + window - cut
    if mode == "whole":
        longest = hop * steps * pick(1, 3, 9)
        fields["decision"] = "vote" if fields["decision"] == "vote" else "last"
    fields |= dict(
        name="random",
        taxels=taxels,
        sample_rate_hz=1000.0,
        scan_every=pick(1, 1, 2, 4, 16),
        sample_bits=sample.width,
        sample_signed=sample.signed,
        masked_taxels=pick((), (0,), (taxels - 1, 1)) if taxels > 2 else (),
        rest=rest,
        rest_frames=0 if rest == "none" else pick(1, 2, 5, 8),
        clip=pick(0, 7, span // 4),
        onset=onset,
        band_low=low + span * 3 // 8,
        band_high=low + span * 5 // 8,
        onset_mean_frames=check * pick(1, 2, 4, 8),
        onset_check_frames=check,
        onset_threshold=max(1, span // pick(40, 16)),
        rearm_frames=pretrigger + 9 + pick(0, 1, 7),
        onset_hits=hits,
        onset_span=of_frames,
        fault_frames=(pick(0, 0, 4) if sample.width >= 4 else 0) * check,
        window_mode=mode,
        pretrigger_frames=pretrigger,
        touch_frames=longest,
        store_per_window=store,
        hop=hop,
        window=window,
        steps=steps,
        cell=cell,
        reset=reset,
        class_names=tuple(f"c{k}" for k in range(classes)),
        early_steps=min(steps, pick(1, 2)),
        lane_type=lane_type,
    )
    if wish.get("cell") == "trees" or (cell == "linear" and pick(False, True)):
        trees, depth = pick(3, 1, 2, 5), pick(3, 1, 2, 6)
        nodes = min(trees * ((1 << depth) - 1), trees + pick(6, 0, 20))
        fields |= dict(cell="trees", trees=trees, depth=depth, nodes=nodes)
    fields |= {name: value for name, value in wish.items() if GROUP_OF[name] != "readout_rule"}
    try:
        config = AcceleratorConfig.of(**fields)
        block = max(1, math.gcd(hop, *config.window_lengths) // pick(1, 2, 3, 64))
        kinds = wish.get("feature_kinds") or pick(*KINDS)
        return config.replace(feature_kinds=kinds, activity_block=block)
    except InputError:
        reject()


@dataclass(frozen=True)
class Design:
    """A configuration, the seed of weights and recordings, and whether both sides stall at random."""

    config: AcceleratorConfig
    seed: int
    stalls: bool

    @classmethod
    def of(cls, fields: Mapping[str, Any]) -> Design:
        """A design as tests/failing_designs.json keeps it."""
        return cls(AcceleratorConfig.from_dict(fields["config"]), fields["seed"], fields["stalls"])

    @property
    def model(self) -> IntegerModel:
        """Random weights."""
        return (random_image_model if self.config.is_image else random_integer_model)(self.config, self.seed)


@st.composite
def designs(draw: st.DrawFn) -> Design:
    """Whole designs: of recordings, as on a chip, behind a converter; of images."""

    pick = picking(draw)
    wish = dict(pick(*WISHES)) if WISHES and pick(True, True, True, False) else {}
    pace = wish.pop("pace", "")
    rule = {name: value for name, value in wish.items() if GROUP_OF[name] == "readout_rule"}
    image = wish.get("cell") == "image"
    config, stalls = draw(configurations({} if image else wish)), pace == "stalls" or pick(False, True)
    chip = "none" if wish else pick("none", "none", "none", *SPI_CHIPS, "spi", "matrix")
    try:
        if (
            rule.get(
                "readout",
                "prototypes" if rule else "dense" if image else pick("dense", "dense", "prototypes"),
            )
            != "dense"
        ):
            config = with_prototypes(pick, config)
            config = config.with_readout(**asdict(config.readout_rule) | rule)
        if image or (not wish and pick(False, False, False, True)):
            config = _of_images(pick, config)
        elif chip != "none":
            config, stalls = _behind(pick, config, chip), False
        else:  # as a process's chips have it; not with an FPGA's lanes
            gate = config.hardware.lane_type != "dsp" and pick(False, True)
            phase = config.hardware.lane_type == "plain" and pick(False, True)
            config = config.replace(one_port=pick(False, True), clock_gate=gate, one_phase=phase)
        design = Design(config, pick(*range(1, 100)), stalls)
        assert design.model
    except InputError:
        reject()
    return design


@st.composite
def taught_designs(draw: st.DrawFn) -> Design:
    """Designs that are taught over the bus, as on an FPGA or on a chip."""

    pick = picking(draw)
    try:
        config = with_prototypes(pick, draw(configurations()), places=(2, 1, 3, 7))
        chip = config.hardware.lane_type != "dsp" and pick(False, True)
        config = config.replace(one_port=pick(False, True), clock_gate=chip and pick(False, True))
        design = Design(config, pick(*range(1, 100)), stalls=False)
        assert design.model
    except InputError:
        reject()
    return design


def with_prototypes(
    pick: Callable[..., Any], config: AcceleratorConfig, places: tuple[int, ...] = (2, 0, 1, 3, 7)
) -> AcceleratorConfig:
    """The nearest prototype decides, with so many places a class for touches that are taught."""
    bits, taught = pick(4, 3, 5, 8), pick(*places)
    rule = dict(prototypes=pick(1, 2, 3, 5), taught=taught, state_code_bits=bits)
    rule["state_code_shift"] = max(0, config.trajectory_format.width - bits - pick(1, 0, 2, 3))
    if taught:
        rule |= dict(taught_shift=pick(0, 1, 3), spare_classes=pick(0, 1) if config.classes > 2 else 0)
    if config.network.decision != "vote":  # about as far as random trajectories are from each other
        rule["unknown_above"] = (config.trajectory_width << bits) // 60 * pick(0, 15, 10, 20)
    return config.replace(loadable=True).with_readout(readout="prototypes", **rule)


def _behind(pick: Callable[..., Any], config: AcceleratorConfig, chip: str) -> AcceleratorConfig:
    """The configuration behind a converter: frames come at its pace, at a clock that is low enough for
    Icarus.

    Not the ddc232 and mpr121: their frames take thousands of cycles. The shift is the default, either way as
    the widths are: by another most samples would lie beyond the converter's ends.
    """
    taxels, clock, rate = config.sensor.taxels, pick(2e6, 1.7e6), pick(2000.0, 3000.0, 900.0)
    fields: dict[str, Any] = dict(clock_hz=clock, sample_rate_hz=rate)
    converter: dict[str, Any] = dict(name=chip, code_offset=pick(None, 0, 60, -40))
    if chip == "mcp3208x2":
        converter["data_lines"] = pick(0, 1)
    elif chip == "matrix":
        rows = pick(*(rows for rows in (1, 2, 3, 4, 5, 7) if taxels % rows == 0))
        fields |= dict(rows=rows, columns=taxels // rows)
        converter["settle_s"] = pick(2e-6, 0.0, 9e-6)
    elif chip == "spi":
        code, bits, numbered = pick(0, 2), pick(12, 8, 14), pick(0, 5)
        end = code + bits + numbered
        converter |= dict(channels=pick(taxels, 1, 2, 4), delay=pick(0, 1, 2), code_bit=code, code_bits=bits)
        converter |= dict(tag_bit=code + bits, tag_bits=numbered, frame_bits=end + 6, channel_bit=end)
        converter["data_lines"] = pick(0, 1, 2)
    config = config.replace(converter=converter, **fields)
    if lowest_clock_hz(config) > clock:
        reject()
    return config


def _of_images(pick: Callable[..., Any], config: AcceleratorConfig) -> AcceleratorConfig:
    """A network for images: up to three convolutions, each with or without a pool, one or two dense
    layers."""
    layers: list[str] = []
    for _ in range(pick(1, 0, 2, 3)):
        layers += [f"conv {pick(3, 1, 5)} {pick(4, 1, 3, 5, 9)}", *["pool"] * pick(1, 0)]
    classes = pick(3, 2, 4, 9)
    layers += [*pick((), ("dense 5",), ("dense 8",)), f"dense {classes}"]
    names, hardware = tuple(f"c{k}" for k in range(classes)), config.hardware
    made = AcceleratorConfig.of_image(pick(4, 5, 6, 9), pick(4, 5, 7, 10), layers, names, clock_hz=12e6)
    return made.with_lanes(pick(4, 8, 1, 2, 16), pick("plain", "dsp")).replace(
        checksum=hardware.checksum, watchdog=hardware.watchdog
    )


def _never_stuck(recordings: Recordings, config: AcceleratorConfig) -> Recordings:
    """Every second taxel kept off the ends of the converter's range: a line that is all at one end is a
    fault, its frame is dropped."""
    codes, step = codes_of(recordings.samples, config), 1 << max(code_shift(config), 0)
    codes[:, ::2] = np.clip(codes[:, ::2], step, code_format(config).max_code - step)
    return replace(recordings, samples=samples_of(codes, config))


def touched(design: Design, touches: Sequence[int]) -> Recordings:
    """Short recordings with time for so many touches each; with none it ends soon after the rest is measured."""
    config = design.config
    rest, rearm = config.rest_level.rest_frames, config.onset_rule.rearm_frames
    whole = rest + config.windows.pretrigger_frames + config.last_frame + 2 * config.windows.hop
    lengths = [count * (whole + rearm + 10) - rearm if count else rest + 3 for count in touches]
    return random_recordings(config, lengths, design.seed)


def differences(design: Design, folder: Path) -> list[str]:
    """What of a few short recordings is not golden at every stage, on Icarus, which builds fastest; behind a
    converter also broken frames and limits of its data sheet that are not kept."""
    model = design.model
    config = model.config
    how = Simulation(simulator="icarus", stalls=design.stalls, seed=design.seed, builds=folder / "simulators")
    if config.is_image:
        recordings = image_recordings(config, random_images(config, 3, design.seed))
    else:
        recordings = touched(design, (2, 1, 0))
    if config.interface.converter.name != "none":
        recordings = _never_stuck(recordings, config)
    if config.hardware.clock_gate:  # which stops the clock between frames only
        clock = lowest_clock_hz(config) + GATED_CYCLES * config.sensor.scan_rate_hz
        how = replace(how, pace="declared", clock_hz=clock)
    result = cosimulate(model, recordings, how, work=folder)
    way = result.conversion
    wrong = way is not None and (way.faults or way.violations)
    broken = [f"{way.faults} faults, {way.violations} violations"] if way and wrong else []
    return [*result.mismatch_list, *broken, *([] if result.bit_exact else ["not bit-exact"])]
