"""Cost of a design before it is made: the model that the choice of `train` and `run` uses.

    E(touch) = frames * cycles of a frame * (e_clock + (FRAME_TOGGLES + ONSET_TOGGLES) * e_toggle)
             + steps * (cycles of a step * (e_clock + STEP_TOGGLES * e_toggle) + multiplies * e_multiply)

Cycles come from the schedule, e_... from `eskin.study.energy`. Cells are a sum over what the
design has (`parts_of`). These constants are fitted to counted netlists by ``python -m scripts.cost_model``,
which prints how far they are off (docs/energy.md). Block memories are counted in the elaborated design.
With ``window_mode`` whole FOLLOWING_TOGGLES stand in the place of FRAME_TOGGLES, and the touch is the longest.
"""

import dataclasses
from collections.abc import Hashable
from functools import lru_cache, partial

from eskin.choose.cost import PREFERENCES, Cost, CostModel, Prefer
from eskin.golden.core import EXTREMES, AcceleratorConfig, InputError
from eskin.pages.result import OnLanes
from eskin.rtl.fpga.block_memories import block_memories
from eskin.rtl.fpga.targets import TARGETS, Target
from eskin.rtl.fpga.targets import target as find_target
from eskin.rtl.image.image_engine import LANES as IMAGE_LANES
from eskin.rtl.program.schedule import decision_cycles, mean_frame_cycles, step_cycles
from eskin.study.energy import Activity, Estimate, Power, bitstream_power, estimate, scheduled_activity
from eskin.verbs.build import suited

CODE = ("rtl", "verbs/cost.py", "verbs/build.py", "cosim/latency.py")
"""Code on which these figures depend, beside golden."""
BOARD = "icebreaker"
"""The board that candidates are priced on unless another is named."""
CELLS = {
    "always": 572.5,
    "taxels": 1.2,
    "address bits": 5.5,
    "lanes": 35.6,
    "onset": 214.6,
    "kinds beyond the mean": 283.4,
    "few taxels": 293.7,
    "store": 322.5,
    "hops of a window": 16.3,
    "kinds of the store": 187.9,
    "extremes": 47.1,
    "extremes of the store": 14.3,
}
"""Logic cells of each part of a design, fitted to synthesised ones."""
IMAGE_CELLS = {"always": 1210.2, "lanes": 25.7}
"""The same of a network for images, within 9 % of three networks counted on 1 to 8 lanes."""
DEFENCE_CELLS = {"hits": 11, "detector": 58}
"""Logic cells of an onset rule that asks several times and of the fault detector, as docs/robustness.md counts
them."""
FEW_TAXELS = 4
"""Taxels up to which synthesis keeps their state in flip-flops, not in a memory."""
LINK_CELLS, LINK_BLOCKS = 471, 1
"""Cells and block memories of the host's link."""
COUNTED: dict[Hashable, int] = {}
"""Block memories by board and `sizes`: a search judges many networks that differ in precision alone."""


@lru_cache(maxsize=4096)
def cost_of(config: AcceleratorConfig, board: str = BOARD) -> Cost:
    """The cost of a configuration on the lanes that suit the board."""
    target = find_target(board)
    config = on_board(config, target)
    energy = estimated(config, target.device)
    return Cost(
        energy_touch_j=energy.per_touch_j + energy.preprocessing_per_touch_j,
        cells=cells_of(config),
        latency_s=decision_cycles(config) / target.clock_hz,
        touch_s=config.touch_s,
        average_w=energy.choices[0].average_w + ((energy.interface and energy.interface.scanning_w) or 0.0),
    )


def on_board(config: AcceleratorConfig, target: Target) -> AcceleratorConfig:
    """``config`` on lanes that suit the board. One of its multipliers stays for element-wise operations."""
    fitted, room = suited(config, target), target.room
    if room is None or not room.multipliers or fitted.hardware.lanes < room.multipliers:
        return fitted
    return fitted.with_lanes(room.multipliers - 1)


def _activity(config: AcceleratorConfig) -> Activity:
    """Of a design on its lanes, by the cycles of its schedule."""
    return scheduled_activity(config, step_cycles(config), *mean_frame_cycles(config), config.hardware.lanes)


def estimated(config: AcceleratorConfig, part: str) -> Estimate:
    """`eskin.study.energy.estimate` of a design."""
    return estimate(config, part, _activity(config), config.hardware.clock_hz)


def power_of(config: AcceleratorConfig, board: str = BOARD) -> Power:
    """Power of the bitstream with one touch a second, on the lanes and the clock that `cost_of` prices."""
    target = find_target(board)
    config = on_board(config, target)
    return bitstream_power(config, target.device, _activity(config), target.clock_hz)


def parts_of(config: AcceleratorConfig) -> dict[str, float]:
    """Number of each of CELLS in the design; address bits: of inputs and hidden units. An extreme is a word and its
    comparison, three times where it falls back to one of a hop, and is none of the kinds."""
    follows, extremes = config.follows_touch, len({*EXTREMES} & {*config.features.feature_kinds})
    kinds = max(config.kinds - extremes, 1) - 1
    falls_back = config.windows.window_mode == "free" and not config.opens_at_once
    hidden = config.network.hidden if config.recurrent else 0
    return {
        "always": 1,
        "taxels": config.sensor.taxels,
        "address bits": (config.inputs - 1).bit_length() + hidden.bit_length(),
        "lanes": config.hardware.lanes,
        "onset": not config.opens_at_once,
        "kinds beyond the mean": 0 if follows else kinds,
        "few taxels": config.sensor.taxels <= FEW_TAXELS and not config.opens_at_once and not follows,
        "store": follows,
        "hops of a window": config.windows.store_per_window if follows else 0,
        "kinds of the store": kinds if follows else 0,
        "extremes": 0 if follows else extremes * (3 if falls_back else 1),
        "extremes of the store": extremes if follows else 0,
    }


def cells_of(config: AcceleratorConfig) -> int:
    """Logic cells, onset to decision, by CELLS and DEFENCE_CELLS; of a network for images by IMAGE_CELLS."""
    if config.is_image:
        return round(IMAGE_CELLS["always"] + IMAGE_CELLS["lanes"] * config.hardware.lanes)
    defences = DEFENCE_CELLS["hits"] * (config.onset_rule.onset_span > 1)
    defences += DEFENCE_CELLS["detector"] * (config.faults.fault_frames > 0)
    return defences + round(sum(CELLS[name] * count for name, count in parts_of(config).items()))


def by_lanes(config: AcceleratorConfig) -> list[OnLanes]:
    """A network on every number of lanes that BOARD has multipliers for;
    one of them stays for element-wise operations, which images have none of. Trees have no lanes."""
    if config.is_forest:
        return []
    target = find_target(BOARD)
    most = target.room.multipliers if target.room else 1
    rows = []
    for lanes in IMAGE_LANES if config.is_image else range(1, most):
        if lanes <= most:
            on = suited(config, target, lanes)
            latency_s = decision_cycles(on) / target.clock_hz
            rows.append(OnLanes(lanes=lanes, latency_s=latency_s, cells=cells_of(on)))
    return rows


def sizes(config: AcceleratorConfig) -> Hashable:
    """Everything in a configuration that its memories depend on: of the formats only widths, and of a recurrent cell those
    that fill its table."""
    if config.is_image:
        return config
    formats = config.formats
    table = (formats.state_format, formats.gate_frac, formats.table_entries) if config.recurrent else ()
    widths = config.operand_bits, config.weight_bits, config.accumulator_bits, config.score_format.width
    features = dataclasses.replace(config.features, feature_shift=(), aligned_means=False)
    parts = config.sensor, config.rest_level, config.onset_rule, config.faults, config.windows, config.network
    return (
        *parts,
        features,
        config.mean_words,
        config.readout_rule,
        config.forest,
        config.hardware,
        widths,
        table,
    )


@lru_cache(maxsize=1024)
def blocks_of(config: AcceleratorConfig, board: str = BOARD) -> int:
    """Block memories, onset to decision; counted once for designs of the same `sizes`."""
    target: Target = find_target(board)
    config = on_board(config, target)
    key = board, sizes(config)
    if key not in COUNTED:
        COUNTED[key] = block_memories(config, target.family.name, target.family.blocks)
    return COUNTED[key]


def fits(config: AcceleratorConfig, board: str = BOARD) -> bool:
    """The board holds the design with its link, on as many lanes as it has multipliers for; weights of a
    recurrent cell may lie in large memories."""
    target = find_target(board)
    room = target.room
    if room is None:
        return False
    try:
        cells = cells_of(on_board(config, target))
    except InputError:  # lanes of a part without multipliers do not take these formats
        return False
    if cells + LINK_CELLS > room.cells:
        return False
    return any(
        blocks_of(variant, board) + LINK_BLOCKS <= room.blocks
        for variant in (config, config.replace(spare_blocks=True))
        if variant.recurrent or variant is config
    )


def cost_model(prefer: Prefer = "energy", board: str | None = None) -> CostModel:
    """Prices of candidates on the named board, which then has to hold them, or on BOARD.

    Raises
    ------
    InputError
        No such board or preference.
    """
    boards = [name for name in TARGETS if find_target(name).room]
    for option, value, choices in (("prefer", prefer, PREFERENCES), ("fits", board or BOARD, boards)):
        if value not in choices:
            raise InputError(f"--{option} {value}: is not known; use one of {', '.join(choices)}")
    name = board or BOARD
    return CostModel(
        cost_of=partial(cost_of, board=name),
        blocks_of=partial(blocks_of, board=name),
        fits=partial(fits, board=name),
        board=name,
        prefer=prefer,
        named=board is not None,
    )
