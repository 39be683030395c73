"""Functional coverage: which cases a bit-exact comparison has seen. A cross is a product of axes, a bin one case of it.

The words of an axis come from golden.core, so a new cell or kind of feature is a new bin. A bin that no configuration
can have is not counted: its reason is the refusal of that configuration.
"""

import itertools
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from operator import contains
from typing import Any, get_args, get_type_hints

import numpy as np
from annotated_types import Interval

from eskin.golden.core import FEATURE_KINDS, AcceleratorConfig, Arrays, InputError, QFormat, groups
from eskin.golden.core.config import GROUPS
from eskin.golden.core.converters import CONVERTERS
from eskin.golden.core.groups import GROUP_OF
from scripts import ROOT

Case = tuple[Any, ...]
"""A value for each axis."""
LARGEST = 65535
"""Bound of fields that count frames, codes or margins: no width follows from them alone."""
ROWS = ("sigmoid", "tanh", "value", "state", "tanh_of_state", "logit")
NARROWINGS = ("centred", "feature", *ROWS, "state code", "map")
"""Places of the chain where a value is narrowed (sections 3 to 5, 15 and 18)."""
PAIRS = [*itertools.combinations(FEATURE_KINDS, 2)]
HEADROOM = ("0", "1", "2", "3", "4 or more")
STALLS = {(False, False): "none", (True, False): "sender", (False, True): "receiver", (True, True): "both"}


@dataclass
class Seen:
    """A comparison without a difference.

    Attributes
    ----------
    expected: arrays of `eskin.golden.model.write_vectors`. played: result (`eskin.cosim.results.Played`). narrowed: narrowing and
    how a value was narrowed there. headroom: bits of the accumulator that no row needed.
    """

    config: AcceleratorConfig
    expected: Arrays
    played: Any
    narrowed: set[tuple[str, str]] = field(default_factory=set)
    headroom: set[str] = field(default_factory=set)


@dataclass(frozen=True)
class Cross:
    """A product of axes.

    Parameters
    ----------
    section:
        Of the specification.
    reason:
        Why its cases may differ.
    axes:
        The values of each axis.
    cases:
        The cases of a comparison; none where tests note them (`tests.support.covered.note`).
    never:
        Why a case cannot be, empty if it can.
    wish:
        The fields of a configuration in a case, for random designs.
    """

    name: str
    section: str
    reason: str
    axes: tuple[Sequence[Any], ...]
    cases: Callable[[Seen], Iterable[Case]] = lambda seen: ()
    never: Callable[[Case], str] = lambda case: ""
    wish: Callable[[Case], dict[str, Any]] = lambda case: {}

    def bins(self) -> dict[str, Case]:
        """Every case by its text."""
        return {text(case): case for case in itertools.product(*self.axes)}


def text(case: Case) -> str:
    """The name of a bin."""
    return ", ".join("+".join(part) if isinstance(part, tuple) else str(part) for part in case)


# ---------------------------------------------------------------------- configurations
def build(wish: dict[str, Any]) -> AcceleratorConfig:
    """A small configuration with these fields, the others fitted to them; ``pace`` is no field.

    Raises
    ------
    InputError
        No configuration has them.
    """
    wish = {name: value for name, value in wish.items() if name != "pace"}
    fields = {name: value for name, value in wish.items() if GROUP_OF[name] != "readout_rule"}
    own = {name: value for name, value in wish.items() if name not in fields}
    names = tuple("abc")
    if wish.get("cell") == "image":
        config = AcceleratorConfig.of_image(6, 7, ["conv 3 4", "dense 3"], names).replace(**fields)
    else:
        steps = wish.get("early_steps", 3)
        times = dict(
            pretrigger_frames=0, hop=2, window=4, steps=steps, touch_frames=4 * steps, rearm_frames=9
        )
        rest = dict(
            rest_frames=3 * (wish.get("rest", "none") != "none"),
            band_high=9,
            bias_format=QFormat(5, 2),
            dense_bias_format=QFormat(5, 2),
        )
        usual = dict(
            taxels=2, hidden=4, loadable=False, class_names=names, decision="last", store_per_window=2
        )
        usual |= dict(onset_span=wish.get("onset_hits", 1), trees=2, depth=2, nodes=4)
        config = AcceleratorConfig.of(**times | rest | usual | fields)
    if own.get("readout", "dense" if not own else "prototypes") == "prototypes":
        bits = own.get("state_code_bits", 4)
        shift = max(0, config.trajectory_format.width - bits - 1)
        own = dict(readout="prototypes", taught=1, state_code_shift=shift) | own
        config = config.replace(loadable=True).with_readout(**own)
    return config


@cache
def refusal(wish: tuple[tuple[str, Any], ...]) -> str:
    """Why no configuration has these fields, empty if one has them."""
    try:
        build(dict(wish))
    except InputError as error:
        return str(error).split("field ", 1)[-1]
    return ""


def of_fields(name: str, section: str, reason: str, **axes: Sequence[Any]) -> Cross:
    """The cross of fields of a configuration, with a case for each kind of feature. The side of the reset gate is the
    GRU's alone."""

    def cases(seen: Seen) -> Iterator[Case]:
        values = {field: seen.config.value(field) for field in axes}
        if "reset" in values and values["cell"] != "gru":
            values["reset"] = "before"
        each = ([value] if isinstance(value, str | int) else value for value in values.values())
        yield from (case for case in itertools.product(*each) if all(map(contains, axes.values(), case)))

    def wish(case: Case) -> dict[str, Any]:
        fields = dict(zip(axes, case, strict=True))
        return fields | ({"feature_kinds": (fields["feature_kinds"],)} if "feature_kinds" in fields else {})

    def never(case: Case) -> str:
        fields = wish(case)
        if fields.get("reset", "before") != "before" and fields["cell"] != "gru":
            return "reset is a field of the GRU"
        return refusal(tuple(fields.items()))

    return Cross(name, section, reason, tuple(axes.values()), cases, never, wish)


def _widths() -> Iterator[tuple[str, Any, Any]]:
    """Each field that sets a width or a count in hardware, its lowest and its highest value."""
    for group in ("sensor", "features", "network", "readout_rule", "formats", "hardware"):
        hints = get_type_hints(GROUPS[group], include_extras=True)
        for name, hint in hints.items():
            for bound in (each for each in getattr(hint, "__metadata__", ()) if isinstance(each, Interval)):
                if bound.le != LARGEST and name != "integral_knee":  # 30 takes touches of 16000 frames
                    yield name, bound.ge, bound.le
            if name.endswith("_format"):
                allowed = [fmt for fmt in map(_format, range(1, 20)) if _fits(group, name, fmt)]
                yield name, allowed[0], allowed[-1]
            if set(map(type, get_args(hint))) == {int}:
                yield name, min(get_args(hint)), max(get_args(hint))


def _format(width: int) -> QFormat:
    return QFormat(min(3, (width + 1) // 2), width - min(3, (width + 1) // 2))


def _fits(group: str, name: str, value: Any) -> bool:
    try:
        GROUPS[group](**{name: value})
    except InputError:
        return False
    return True


WIDTHS = {name: {"lowest": low, "highest": high} for name, low, high in _widths()}


def _size(value: Any) -> Any:
    return getattr(value, "width", value)


NEEDS: dict[str, dict[str, Any]] = {
    "integral_frac": {"feature_kinds": ("integral",)},
    # where no deviation changes its sign, a sum of magnitudes is the same wherever blocks end
    "activity_block": {"feature_kinds": ("activity",), "activity_rule": "change"},
    "early_steps": {"decision": "early"},
}
"""Fields without effect but with others, and values of those."""
RECURRENT = "hidden", "table_entries", "weight_format", "recurrent_format", "bias_format", "state_format"


def _agreed(rows: np.ndarray) -> int:
    """Most steps of a touch in a row with one class, of rows of decisions."""
    local = rows[rows[:, 0] == 0, 1:3]
    ends = np.flatnonzero((np.diff(local, axis=0) != (1, 0)).any(axis=1))
    return max(np.diff([-1, *ends, len(local) - 1]))


def _width_cases(seen: Seen) -> Iterator[Case]:
    """Of a run with decisions: whole windows, and blocks, have come."""
    config, rows = seen.config, seen.expected["decision"]
    for name, ends in WIDTHS.items() if len(rows) else ():
        value = _size(config.value(name))
        if (
            (config.has_prototypes or GROUP_OF[name] != "readout_rule")
            and (config.recurrent or name not in RECURRENT)
            and all(
                np.isin(needed, config.value(other)).all() for other, needed in NEEDS.get(name, {}).items()
            )
            and (name != "early_steps" or _agreed(rows) >= value)
        ):
            yield from ((name, end) for end, at in ends.items() if value == _size(at))


def _width_wish(case: Case) -> dict[str, Any]:
    """The field, and those that must go with it: products of inputs may not be finer than recurrent ones."""
    name, value = case[0], WIDTHS[case[0]][case[1]]
    beside = dict(NEEDS.get(name, {}))
    if GROUP_OF[name] == "readout_rule":
        beside["readout"] = "prototypes"
    if name in ("weight_format", "recurrent_format"):
        beside = dict.fromkeys(("weight_format", "recurrent_format"), value) | {"state_format": QFormat(4, 8)}
    elif name in ("feature_format", "state_format"):
        state = QFormat(max(value.int_bits, 6 - value.frac_bits), value.frac_bits)
        beside = {"feature_format": value, "state_format": state, "logit_format": QFormat(8, 4)}
    elif name == "activity_block":
        beside |= {"hop": 64, "window": 128, "touch_frames": 512}
    elif name == "sample_bits":
        beside = {"onset": "immediate"}  # whatever the samples are
    elif name == "spare_classes":
        beside |= {"class_names": tuple(f"c{k}" for k in range(value + 2))}
    elif name == "state_code_shift" and value:
        beside |= {"state_format": QFormat(3, 13), "feature_format": QFormat(3, 13), "state_code_bits": 3}
    return beside | {name: value}


# ---------------------------------------------------------------------- stimulus
TOUCHES = (
    *("none", "one", "several", "next to each other", "in the first frame", "cut without a step"),
    *("cut after step 1", "cut after another step", "cut before the last step"),
)


def _touch_cases(seen: Seen) -> Iterator[Case]:
    """Of each recording: how many touches there are, and where its end cuts the last."""
    config, arrays = seen.config, seen.expected
    if config.is_image:
        return
    mode, steps, offsets = config.windows.window_mode, config.windows.steps, arrays["decision_offsets"]
    lengths = np.diff(arrays["offsets"])
    for place, count in enumerate(arrays["touches"].tolist()):
        yield mode, ("none", "one", "several")[min(count, 2)]
        begin, end = arrays["open"][place].tolist()
        if count and begin == config.rest_level.rest_frames + 1:
            yield mode, "in the first frame"
        if count > 1 and count * (config.last_frame + config.onset_rule.rearm_frames + 1) >= lengths[place]:
            yield mode, "next to each other"
        rows = arrays["decision"][slice(*offsets[place : place + 2].tolist())]
        if count == 1 and end > lengths[place] and not len(rows):
            yield mode, "cut without a step"
        if len(rows) and rows[-1, 4] and not config.follows_touch:
            done = int(rows[-1, 1]) + 1
            yield mode, "cut after step 1" if done == 1 else "cut after another step"
            if done == steps - 1:
                yield mode, "cut before the last step"


def _touch_never(case: Case) -> str:
    mode, way = case
    cut = mode == "whole" and way.startswith("cut") and way != "cut without a step"
    return "a touch of mode whole has all its windows (section 2)" * cut


def end_states(config: AcceleratorConfig, arrays: Arrays) -> Iterator[tuple[int, str]]:
    """State of the detector after the last frame of each recording, where the vectors show it."""
    for place, count in enumerate(arrays["touches"].tolist()):
        length = int(arrays["offsets"][place + 1] - arrays["offsets"][place])
        if not count and length <= config.rest_level.rest_frames:
            yield place, "settling"
        elif arrays["status"][place] & 1:
            yield place, "armed"
        elif count == 1:
            yield place, "touch" if arrays["open"][place, 1] > length else "rearm"


def _command_cases(seen: Seen) -> Iterator[Case]:
    if seen.config.is_image:
        return
    states, mode = dict(end_states(seen.config, seen.expected)), seen.config.windows.window_mode
    for place, state in states.items():
        yield "FINISH", state, mode
        if state != "touch" and place + 1 < len(seen.expected["touches"]):
            yield "ARM", state, mode  # the next recording's


def _taxel_cases(seen: Seen) -> Iterator[Case]:
    masked, faulty = seen.config.sensor.masked_taxels, np.any(seen.expected.get("flags"))
    yield seen.config.onset_rule.onset, STATES[bool(masked), bool(faulty)]


STATES = {
    (False, False): "in use",
    (True, False): "masked",
    (False, True): "faulty",
    (True, True): "masked and faulty",
}


def _sample_cases(seen: Seen) -> Iterator[Case]:
    config = seen.config
    fmt, samples = config.sample_format, seen.expected["samples"]
    if fmt.signed:
        samples = samples.astype(np.uint16).view(np.int16)
    for end, code in (("lowest", fmt.min_code), ("highest", fmt.max_code)):
        if (samples == code).any():
            yield config.sensor.sample_signed, end


# ---------------------------------------------------------------------- protocol, arithmetic
@cache
def blocks() -> list[str]:
    """Components of rtl/ with a stream ``i`` and a stream ``o``."""
    found = []
    for path in sorted((ROOT / "rtl").rglob("*.py")):
        for part in path.read_text().split("\nclass ")[1:]:
            if all(re.search(rf"\b{port}=(stream|beat)", part) for port in "io"):
                found.append(part.split("(")[0])
    return found


def _pace_cases(seen: Seen) -> Iterator[Case]:
    pace = "stalls" if seen.played.stalls else seen.played.pace
    yield pace, seen.config.network.cell, seen.config.hardware.lane_type


def _register_cases(seen: Seen) -> Iterator[Case]:
    yield from (("idle", "read"), ("busy", "read"))  # behind ARM and FINISH
    if seen.config.hardware.loadable:
        yield "idle", "write"
    if seen.played.probe:
        yield "touch", "write"
    if (seen.expected["open"][:, 1] > seen.expected["open"][:, 0] + 40).any():
        yield "touch", "read"


FLAGS = {"WRITE_REFUSED": 1, "INPUT_STALLED": 2, "OVERRUN": 8, "TAXEL": 64}


def _flag_cases(seen: Seen) -> Iterator[Case]:
    word = seen.played.registers.get("FAULTS") or 0
    yield from ((name,) for name, bit in FLAGS.items() if word & bit)


def _narrowing_never(case: Case) -> str:
    floor = case[0] == "centred" and case[1] in ("down", "up", "tie")
    return "centred is a floor (section 3): nothing is rounded" * floor


def _tie_cases(seen: Seen) -> Iterator[Case]:
    rows = seen.expected["decision"]
    for scope, of in (("a step", rows[rows[:, 0] == 0]), ("a touch", rows[rows[:, 0] == 1])):
        if (of[:, 3] == 0).any():
            yield scope, seen.config.network.decision, seen.config.readout_rule.readout


CROSSES = [
    of_fields(
        "network",
        "5, 7, 18",
        "each is another program of the engine and another end of it in the classifier",
        cell=get_args(groups.Cell),
        reset=get_args(groups.Reset),
        readout=get_args(groups.Readout),
        decision=get_args(groups.Decision),
    ),
    of_fields(
        "front end",
        "2, 3",
        "blocks are left out, and counters begin at other frames, by these five together",
        onset=get_args(groups.OnsetRule),
        rest=get_args(groups.Rest),
        window_mode=get_args(groups.WindowMode),
        feature_kinds=FEATURE_KINDS,
        feature_scale=get_args(groups.FeatureScale),
    ),
    Cross(
        "kinds together",
        "2, 3",
        "two kinds of a taxel meet in the order of beats, in the memory of sums and in the constants",
        (PAIRS, get_args(groups.FeatureScale)),
        lambda seen: [
            (pair, seen.config.features.feature_scale)
            for pair in itertools.combinations(seen.config.features.feature_kinds, 2)
        ],
        wish=lambda case: {"feature_kinds": case[0], "feature_scale": case[1]},
    ),
    of_fields(
        "lanes",
        "4",
        "rows are dealt to lanes, the last slot of a gate is partly empty, and dsp lanes add later",
        lanes=range(1, 17),
        lane_type=get_args(groups.LaneType),
    ),
    of_fields(
        "scan",
        "2",
        "frames are dropped before the detector counts",
        scan_every=get_args(get_type_hints(groups.Sensor)["scan_every"]),
        window_mode=get_args(groups.WindowMode),
    ),
    Cross(
        "converter and bus",
        "12, 17",
        "each has its own front, and both stand around one chain",
        (("none", *CONVERTERS), ("none", "wishbone", "axi4lite")),
        lambda seen: [(seen.config.interface.converter.name, "none")],
    ),
    Cross(
        "widths",
        "1, 8",
        "a width that is one bit short shows at the ends of the field alone",
        (tuple(WIDTHS), ("lowest", "highest")),
        _width_cases,
        lambda case: refusal(tuple(_width_wish(case).items())),
        _width_wish,
    ),
    Cross(
        "touches",
        "2, 7",
        "each ends another counter of detector, windows and classifier",
        (get_args(groups.WindowMode), TOUCHES),
        _touch_cases,
        _touch_never,
    ),
    Cross(
        "commands",
        "7",
        "a command meets the detector in each of its states",
        (("ARM", "FINISH"), ("settling", "armed", "touch", "rearm"), get_args(groups.WindowMode)),
        _command_cases,
    ),
    Cross(
        "taxels",
        "2, 10",
        "a taxel out of use is left out of the rule and of the features at different places",
        (get_args(groups.OnsetRule), tuple(STATES.values())),
        _taxel_cases,
        wish=lambda case: {
            "onset": case[0],
            "masked_taxels": (0,) if "masked" in case[1] else (),
            "fault_frames": 4 * ("faulty" in case[1]),
        },
    ),
    Cross(
        "samples",
        "2",
        "sums and deviations are largest there",
        ((False, True), ("lowest", "highest")),
        _sample_cases,
        wish=lambda case: {"sample_signed": case[0]},
    ),
    Cross(
        "stalls of blocks",
        "2",
        "a beat is lost or doubled where one side waits and the other does not",
        (tuple(blocks()), tuple(STALLS.values())),
    ),
    Cross(
        "pace",
        "7",
        "stalls shift frames against steps, each cell takes other times",
        (("full", "stalls", "declared"), get_args(groups.Cell), get_args(groups.LaneType)),
        _pace_cases,
        wish=lambda case: dict(zip(("pace", "cell", "lane_type"), case, strict=True)),
    ),
    Cross(
        "register access",
        "7, 11",
        "a write in a touch is refused, a read shows the moment",
        (("idle", "touch", "busy"), ("read", "write")),
        _register_cases,
    ),
    Cross("flags", "7, 11", "each is set in one place", (tuple(FLAGS),), _flag_cases),
    Cross(
        "narrowing",
        "1, 3, 4, 5, 15, 18",
        "rounding and saturation are wrong at a tie or at one end",
        (NARROWINGS, ("down", "up", "tie", "high", "low")),
        lambda seen: seen.narrowed,
        _narrowing_never,
    ),
    Cross(
        "ties",
        "1, 7",
        "the lowest class wins",
        (("a step", "a touch"), get_args(groups.Decision), get_args(groups.Readout)),
        _tie_cases,
        wish=lambda case: dict(zip(("decision", "readout"), case[1:], strict=True)),
    ),
    Cross(
        "accumulator",
        "4",
        "an accumulator that is too narrow wraps with the largest sum alone",
        (HEADROOM,),
        lambda seen: [(bits,) for bits in seen.headroom],
    ),
]
"""All crosses."""
