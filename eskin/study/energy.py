"""Energy of a touch and power of the waiting array: an estimate from counted activity and published
measurements, with its band.

    E(step)       = cycles * e_clock + register-bit toggles * e_toggle + multiply cycles * e_multiply
    E(touch)      = steps * E(step)                     (the recurrent cell, its normaliser and the decision)
    E(preprocess) = frames of a touch * (cycles * e_clock + toggles * e_toggle)
                                                        (a frame without a touch takes fewer cycles)
    P(idle)       = P(static) + clock * (e_clock + idle toggles * e_toggle) + frame rate * frame toggles * e_toggle
    P(average)    = P(idle) + touches a second * energy that the steps add
    hours         = 1000 mAh * 5 V / P(average)         (thesis, equation 5.1: 18 000 J)

`bitstream_power` is the same for the bitstream that `eskin build` makes, with its converter.

Activity is counted in co-simulated netlists (cosim/activity.py) or, for a build without recordings, taken
from the cycles of the schedule (`scheduled_activity`). No board was measured: one published source, one
board, small designs with little fan-out, no block RAM. A figure is therefore accurate within a factor,
`Part.band`, and never called a measurement.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from eskin.golden.core import AcceleratorConfig, Record, Result, converter_plan

BATTERY_J = 1000e-3 * 5.0 * 3600
"""The thesis's 1000 mAh, 5 V battery (equation 5.1)."""
CR2032_J = 225e-3 * 3.0 * 3600
"""A coin cell: 225 mAh at 3 V, the usual rating; losses of a regulator are in no figure."""
DAY_S = 86400.0
TOUCHES_PER_S = 1.0


@dataclass(frozen=True, kw_only=True)
class Part:
    """Published figures of a part.

    static_w: configured, clock at a stop or nearly so, all supplies. clock_j: joule a clock cycle, clock
    network and a little logic. toggle_j: a register bit that changes, with its carry, look-up table and
    wires. multiply_j: a multiplier whose operands changed. oscillator_w: for each clock of the part's own
    oscillator, Hz, the power of all supplies with a small counter. starting_w: of that oscillator while its output is off.
    boot_j, boot_s: energy and time of a start from
    flash; None: no figure. band: factor either way. rests_on: where the figures come from.
    """

    name: str
    static_w: float
    clock_j: float = 52e-12
    toggle_j: float = 0.2e-12
    multiply_j: float = 0.0
    oscillator_w: Mapping[float, float] = field(default_factory=dict)
    starting_w: float = 0.0
    boot_j: float | None = None
    boot_s: float = 0.0
    band: float
    rests_on: str


_RAILS_W = 4.1e-6 * 1.219 + (3.76 + 3.4 + 1.5) * 1e-6 * 3.283
"""Power of the UP5K's supply of the PLL and three I/O banks while the oscillator runs, by the source's
table."""
_OSCILLATOR_A = {6e6: 388.4e-6, 12e6: 645e-6, 24e6: 1162e-6, 48e6: 2184e-6}
_NO_OUTPUT_W = (
    _OSCILLATOR_A[6e6] * 1.219 + _RAILS_W - (_OSCILLATOR_A[48e6] - _OSCILLATOR_A[6e6]) / 7 * 1.219 - 151e-6
)
"""The line through the table's 6 and 48 MHz at 0 Hz, beyond the part's 151 uW: nobody measured it."""

PARTS = {
    part.name: part
    for part in (
        Part(
            name="iCE40UP5K",
            static_w=151e-6,
            multiply_j=24e-12,
            oscillator_w={hertz: amp * 1.219 + _RAILS_W for hertz, amp in _OSCILLATOR_A.items()},
            starting_w=_NO_OUTPUT_W,
            boot_j=0.54e-3,
            boot_s=70e-3,
            band=2.0,
            rests_on="fitted to one published set of measurements (github tinyvision-ai-inc/ice40_power: one board, "
            "all supplies, core at 1.219 V): 151 uW with a 10 kHz clock, all supplies; 52 pJ a clock cycle; "
            "0.2 pJ a register bit that changes; at most 24 pJ a multiply; 0.2 to 0.54 mJ a start from flash. "
            "The source has no figure for block RAM.",
        ),
        Part(
            name="LFE5U-25F",
            static_w=50e-3,
            multiply_j=24e-12,
            band=4.0,
            rests_on="no measured source: cycle, toggle and multiply as for the iCE40UP5K (both 40 nm), though this "
            "part's clock network is larger; static power of some tens of milliwatt from memory, taken as "
            "50 mW. Orders of magnitude, hence a band of 4.",
        ),
    )
}
"""Parts by the device name of their boards."""


class Activity(Result):
    """Activity of the hardware, averages of co-simulated recordings.

    step_cycles: cycles of a step. step_toggles, step_multiplies: in cell and classifier. touch_frames: frames of a
    touch, not counted: of the longest. frame_cycles, quiet_frame_cycles: of a frame of a touch, and of another one.
    frame_toggles: of a frame, in the rest. idle_toggles: a cycle without work. source: how it was found. recordings:
    how many were counted.
    """

    step_cycles: float
    step_toggles: float
    step_multiplies: float
    frame_cycles: float
    quiet_frame_cycles: float
    frame_toggles: float
    idle_toggles: float
    source: str
    recordings: int = 0
    touch_frames: float = 0.0


class Choice(Result):
    """A clock: waiting, and with a touch a second; ``hours`` of 1000 mAh at 5 V. An outside clock's own power is
    excluded."""

    name: str
    clock_hz: float
    idle_w: float
    average_w: float
    hours: float


class ConverterPower(Result):
    """Power of a converter that runs all the time; ``scanning_w``, were it to take nothing between scans; energy of the
    frames of a touch. None where no figure is at hand."""

    converter: str
    chips: int
    power_w: float | None
    scanning_w: float | None
    per_touch_j: float | None
    rests_on: str


class Estimate(Result):
    """Energy and power of a configuration on a part.

    clock_hz: the lowest that meets every budget; idle_w: with it from outside, always on. choices: clocks, with an
    outside one that stops between samples and each of the part's own oscillator that is fast enough. interface: the
    converter, in no other figure.
    """

    method: str
    band: float
    rests_on: str
    part: str
    activity: Activity
    clock_hz: float
    per_step_j: float
    per_touch_j: float
    preprocessing_per_touch_j: float
    touch_s: float
    static_w: float
    idle_w: float
    choices: list[Choice]
    interface: ConverterPower | None


class Power(Result):
    """Power that a battery sees: of a bitstream as it is built, and of its converter; an estimate.

    waiting_w: part_w and converter_w, without a touch. average_w: with deciding_w, which touches_per_minute add.
    oscillators_w: of part_w, the clocks that run. oscillator: which. days_...: at average_w, of a CR2032 and of
    1000 mAh at 5 V. switch_off: the pause between touches from which on a part that is off in it takes less.
    """

    touches_per_minute: float
    waiting_w: float
    average_w: float
    part_w: float
    oscillators_w: float
    converter_w: float
    deciding_w: float
    oscillator: str
    days_cr2032: float
    days_1000mah: float
    switch_off: str


COMPUTE_BLOCKS = ("cell", "classifier")
STEP_TOGGLES, FRAME_TOGGLES, ONSET_TOGGLES, IDLE_TOGGLES = 22.0, 24.0, 30.0, 4.0
FOLLOWING_TOGGLES = 11.0
"""Register bits that change in a cycle, for a design that was not counted: of a step, of a frame, of a frame
more with an onset detector, of an idle cycle, and of a frame with ``window_mode`` whole. All but
IDLE_TOGGLES are fitted to counted netlists (``python -m scripts.cost_model``)."""


def counted_activity(
    full: Record,
    slow: Record,
    *,
    frames: int,
    touch_frames: int,
    steps: int,
    step_cycles: float,
    quiet_frame_cycles: float,
    recordings: int,
) -> Activity:
    """Activity from two runs over the same recordings, at full pace and slower, which differ in idle cycles
    alone.

    Parameters
    ----------
    full, slow:
        cycles, busy (cycles), toggles (by block), multiplies of each run (eskin.cosim.activity.read_count).
    frames, touch_frames, steps:
        In all, of one run; those of touches, one a recording.
    step_cycles, quiet_frame_cycles:
        Most cycles of a step; of the schedule: cycles of a frame without a touch.
    """
    quiet = (frames - touch_frames) * quiet_frame_cycles
    # the two runs differ in idle cycles alone, so does what changed in them
    idling = sum(slow["toggles"].values()) - sum(full["toggles"].values())
    compute = sum(full["toggles"].get(block, 0) for block in COMPUTE_BLOCKS)
    return Activity(
        step_cycles=step_cycles,
        step_toggles=compute / steps,
        step_multiplies=full["multiplies"] / steps,
        touch_frames=touch_frames / recordings,
        frame_cycles=(slow["busy"] - steps * step_cycles - quiet) / touch_frames,
        quiet_frame_cycles=quiet_frame_cycles,
        frame_toggles=(sum(full["toggles"].values()) - compute) / frames,
        idle_toggles=max(0.0, idling / (slow["cycles"] - full["cycles"])),
        source="counted in the co-simulated netlist",
        recordings=recordings,
    )


def scheduled_activity(
    config: AcceleratorConfig,
    step_cycles: int,
    frame_cycles: float,
    quiet_frame_cycles: float,
    multipliers: int,
) -> Activity:
    """Activity of a design that was not counted: cycles of the schedule, every multiplier busy as often as
    there are products, STEP_TOGGLES and FRAME_TOGGLES or FOLLOWING_TOGGLES (with ONSET_TOGGLES) register bits
    changing in a busy cycle.

    Parameters
    ----------
    step_cycles, frame_cycles, quiet_frame_cycles:
        Of the schedule. multipliers: cells of the netlist (a design without them multiplies in its logic).
    """
    frame_toggles = FOLLOWING_TOGGLES if config.follows_touch else FRAME_TOGGLES
    frame_toggles += ONSET_TOGGLES * (not config.opens_at_once)
    return Activity(
        step_cycles=step_cycles,
        step_toggles=STEP_TOGGLES * step_cycles,
        step_multiplies=(config.multiplies + config.inputs) if multipliers and not config.is_forest else 0,
        touch_frames=config.last_frame,
        frame_cycles=frame_cycles,
        quiet_frame_cycles=quiet_frame_cycles,
        frame_toggles=frame_toggles * frame_cycles,
        idle_toggles=IDLE_TOGGLES,
        source="cycles of the schedule; register bits that change in a busy cycle as fitted to counted netlists",
    )


def estimate(config: AcceleratorConfig, part: Part | str, activity: Activity, clock_hz: float) -> Estimate:
    """The energy of one configuration on one part.

    Parameters
    ----------
    part:
        A part or its name in `PARTS`.
    clock_hz:
        The lowest clock that meets every budget: the outside clock of the first two choices below.
    """
    part = PARTS[part] if isinstance(part, str) else part
    steps, rate, frames = config.windows.steps, config.sensor.scan_rate_hz, activity.touch_frames
    toggles, multiplies = activity.step_toggles * part.toggle_j, activity.step_multiplies * part.multiply_j
    per_step, switched = activity.step_cycles * part.clock_j + toggles + multiplies, toggles + multiplies
    switching = activity.frame_toggles * part.toggle_j  # of a frame, beyond its cycles
    frame = activity.frame_cycles * part.clock_j + switching
    idle_toggles = activity.idle_toggles * part.toggle_j
    # With the clock always on a step's cycles are among those that run anyhow.
    on = part.static_w + clock_hz * (part.clock_j + idle_toggles) + rate * switching
    stopped = part.static_w + rate * (activity.quiet_frame_cycles * part.clock_j + switching)
    more_cycles = activity.frame_cycles - activity.quiet_frame_cycles  # of a frame in a touch
    choices: list[Choice] = []

    def choice(name: str, hertz: float, idle: float, added: float) -> None:
        average = idle + TOUCHES_PER_S * added
        hours = BATTERY_J / average / 3600
        choices.append(Choice(name=name, clock_hz=hertz, idle_w=idle, average_w=average, hours=hours))

    choice("outside clock, always on", clock_hz, on, steps * switched)
    added = steps * per_step + frames * more_cycles * part.clock_j
    choice("outside clock, stops between samples", clock_hz, stopped, added)
    for hertz, watt in sorted(part.oscillator_w.items()):
        if hertz >= clock_hz:
            idle = watt + hertz * idle_toggles + rate * switching
            choice(f"own oscillator, {hertz / 1e6:g} MHz", hertz, idle, steps * switched)
    return Estimate(
        method=f"estimate: {activity.source}, times published figures of the part",
        band=part.band,
        rests_on=part.rests_on,
        part=part.name,
        activity=activity,
        clock_hz=clock_hz,
        per_step_j=per_step,
        per_touch_j=steps * per_step,
        preprocessing_per_touch_j=frames * frame,
        touch_s=frames / rate,
        static_w=part.static_w,
        idle_w=on,
        choices=choices,
        interface=converter_power(config),
    )


def converter_power(config: AcceleratorConfig) -> ConverterPower | None:
    """Highest power of the converter while it runs all the time; None without a converter."""
    converter = config.interface.converter
    if converter.name == "none":
        return None
    plan = converter_plan(config)
    found = ConverterPower(
        converter=converter.name,
        chips=plan.chips,
        power_w=None,
        scanning_w=None,
        per_touch_j=None,
        rests_on="no figure of its data sheet at hand",
    )
    if converter.watt is not None:
        found.power_w = power = plan.chips * converter.watt
        found.scanning_w = power * plan.scan_cycles / config.hardware.clock_hz * config.sensor.scan_rate_hz
        found.per_touch_j = power * config.touch_s
        found.rests_on = f"{converter.stated}; never idle, so an upper figure at this rate; not measured"
    return found


class Turn(NamedTuple):
    """Seconds of a turn of the part's own oscillator: from power to output, of the scan, and of all that follows.
    awake: share of time in which the converter is."""

    start_s: float
    scan_s: float
    after_s: float
    awake: float


def bitstream_power(
    config: AcceleratorConfig,
    part: Part | str,
    activity: Activity,
    clock_hz: float,
    per_minute: float = 60.0,
    turn: Turn | None = None,
    awake: str = "",
) -> Power:
    """Power of the bitstream that `eskin build` makes.

    Parameters
    ----------
    clock_hz:
        Of the bitstream. per_minute: touches.
    turn:
        Of the part's own oscillator, which runs for each scan (`eskin.rtl.top.standby`). None: the board's clock never
        stops; ``awake`` says why.
    """
    part = PARTS[part] if isinstance(part, str) else part
    switched = activity.step_toggles * part.toggle_j + activity.step_multiplies * part.multiply_j
    steps, converter, rate_hz = config.windows.steps, config.interface.converter, config.sensor.scan_rate_hz
    if turn is None:
        share, clock_w, added = 1.0, clock_hz * part.clock_j, steps * switched
        why = f": {awake}" if awake else ""
        oscillator = f"{clock_hz / 1e6:g} MHz from outside, always on{why}; the oscillator's own supply is not included"
    else:
        running_w = part.oscillator_w[clock_hz] - part.static_w
        share = rate_hz * (turn.scan_s + turn.after_s)
        clock_w = share * running_w + rate_hz * turn.start_s * part.starting_w
        frames = config.last_frame * (activity.frame_cycles - activity.quiet_frame_cycles)
        added = steps * switched + (steps * activity.step_cycles + frames) / clock_hz * running_w
        oscillator = (
            f"own 10 kHz; own {clock_hz / 1e6:g} MHz for {1e3 * (turn.scan_s + turn.after_s):.2g} ms of each of "
            f"{rate_hz:g} scans a second, {1e3 * turn.start_s:g} ms after its start, which nobody has measured"
        )
    changes = share * clock_hz * activity.idle_toggles + rate_hz * activity.frame_toggles
    part_w = part.static_w + clock_w + changes * part.toggle_j
    deciding_w = per_minute / 60 * added
    converter_w = 0.0
    if (found := converter_power(config)) is not None and found.power_w is not None:
        reading = 1.0
        if turn is not None and converter.asleep_watt is not None:
            reading = turn.awake
        elif converter.sleeps_unselected:
            reading = (found.scanning_w or 0.0) / found.power_w
        asleep_w = found.chips * (converter.asleep_watt or 0.0)
        converter_w = reading * found.power_w + (1 - reading) * asleep_w
    waiting_w = part_w + converter_w
    average_w = waiting_w + deciding_w
    return Power(
        touches_per_minute=per_minute,
        waiting_w=waiting_w,
        average_w=average_w,
        part_w=part_w,
        oscillators_w=clock_w,
        converter_w=converter_w,
        deciding_w=deciding_w,
        oscillator=oscillator,
        days_cr2032=CR2032_J / average_w / DAY_S,
        days_1000mah=BATTERY_J / average_w / DAY_S,
        switch_off=_switch_off(part, waiting_w),
    )


def _switch_off(part: Part, waiting_w: float) -> str:
    """Advice without hardware: off between touches, against waiting; empty where the part has no figure."""
    if part.boot_j is None:
        return ""
    return (
        f"where pauses between touches last longer than {part.boot_j / waiting_w:.2g} s, switch the part off in them: a start "
        f"from flash takes {1e3 * part.boot_j:.2g} mJ and {1e3 * part.boot_s:.0f} ms, in which a touch is not seen; a comparator "
        "on the sensor (1 to 5 uW) wakes it"
    )


def in_words(power: ConverterPower) -> str:
    """A row of a table."""
    if power.power_w is None or power.scanning_w is None or power.per_touch_j is None:
        return f"{power.converter}: {power.rests_on}"
    many = f"{power.chips} chips, " if power.chips > 1 else ""
    asleep = f"{1e3 * power.scanning_w:.3g} mW if it sleeps between scans"
    figures = f"{1e3 * power.power_w:.3g} mW at most, {asleep}, {1e3 * power.per_touch_j:.3g} mJ a touch"
    return f"{figures} ({many}{power.rests_on}); in no other figure"
