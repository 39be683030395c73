"""The failure modes, a row each: what is disturbed and how far, the bound and its reason, and the variant that must fail."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from eskin.golden.stability import memory, numeric, sensor, stream
from eskin.golden.stability.core import GROUPS, ONE_TAXEL_MEAN, ONE_TAXEL_WORST, Bench, Mode, Outcome, harmless
from eskin.golden.stability.shapes import AGREED, AsInFloat, EachTaxel, MissingBits, QuietStretches, TaxelPairs, Whole

TWO_TAXELS_MEAN = 0.90
"""Share of the undisturbed accuracy that must be left when two taxels are gone, mean over the pairs: less sharp, not broken."""
EXCHANGED_MEAN = 0.5
MEAN_CHANGED = 0.02
"""Share of decisions that a bit flip, any one, may change on average: what a fault is worth until the checksum is read."""
ROUNDED = 0.5000001
"""Half an LSB, with room for the last digit of a float."""
BEGINS = (0.9, 0.75, 0.5, 0.25, 0.1, 0.0, -0.1)
"""Where in the touch a taxel fails, in touch lengths after the onset; later is milder."""

Bound = float | Callable[[Bench], float]
ACCURACY, BITS, CHANGED = "accuracy", "bits missing", "share of decisions changed"
QUIET, LOCAL = "share of quiet recordings with an onset", "share of local decisions as in float"
TO_FAILURE = "touch lengths from the onset to the failure"
OFFSET = "offset (standard deviations of the features)"
AS_EVALUATE = "the level below which `eskin evaluate` refuses a quantised model"
NEAREST = "an entry is the nearest code at the centre of its interval"
DETECTOR_IN_TIME = "the detector must find and mask it while the vote can still be saved"
LIKE_A_DEAD_ONE = "once masked a stuck taxel is a dead one"
NOT_FROM_A_TOUCH = "an offset that comes with the touch cannot be told from it: it may not cost more than the taxel itself"

# broken variants that several modes share
FLOOR = "floor instead of nearest"
ONE_ENTRY_OFF = "one entry off"
SHOWS_EVERYTHING = "the lowest bits of the last logits decide"
ANY_CODE = "one code off is a touch"
CARRIED = "the state is not cleared"
FULL_SCALE = "every feature at full scale"
THINNED = "a window is one sample and seven of eight frames are lost"
ONE_LISTENER = "a network that hears one taxel"
UNDEFENDED = "no detector, and a network that hears one taxel"

DEAD = EachTaxel(sensor.dead, -0.1, BEGINS, TO_FAILURE)
MASKED = EachTaxel(sensor.stuck_and_masked, -0.1, BEGINS, TO_FAILURE)


def _row(
    group: str,
    name: str,
    run: Callable[[Bench], Outcome],
    unit: str,
    because: str,
    breaks: str,
    *,
    measures: str = "",
    at_most: Bound | None = None,
    at_least: Bound | None = None,
    onset: bool = False,
    recurrent: bool = False,
    detector: bool = False,
) -> Mode:
    """A mode; exactly one of ``at_most`` and ``at_least`` is its bound."""
    bound = at_least if at_most is None else at_most
    if (at_most is None) == (at_least is None) or bound is None or group not in GROUPS:
        raise ValueError(f"mode '{name}': give one bound and one of {', '.join(GROUPS)}")
    return Mode(
        name=name,
        group=group,
        unit=unit,
        bound=bound,
        at_least=at_most is None,
        reason=because,
        run=run,
        breaks=breaks,
        measures=measures,
        onset=onset,
        recurrent=recurrent,
        detector=detector,
    )


def _table_interval(bench: Bench) -> float:
    """An interval of the tanh table in state LSB."""
    return float(2.0 ** (bench.config.formats.state_format.frac_bits - bench.config.tanh_frac))


# fmt: off
ROWS: tuple[Mode, ...] = (
    # numeric: rounding, saturation, widths, tables
    _row("numeric", "state error without reset", numeric.growth, "error at step t / error at step 20",
        "a contracting cell forgets its roundings: an error that grows would make long touches undecidable",
        "an error of the state that doubles every 20 steps", at_most=2.0,
        recurrent=True),
    _row("numeric", "rounding bias carried in the state", numeric.carried_bias, "state LSB",
        "truncation shifts every state by about an LSB a step, which accuracy does not show", FLOOR, at_most=0.25, recurrent=True),
    _row("numeric", "rounding bias of each narrowing", numeric.narrowing_bias, "LSB",
        "nearest is unbiased but for ties; half an LSB would be truncation", FLOOR, at_most=0.05),
    _row("numeric", "dead zone of the state update", numeric.dead_zone, "of full scale 1",
        "with an update gate of 1 - 1/64 the state remembers 64 steps, three touches; slower gates cannot move within a touch anyhow",
        "a state of 8 bits", at_most=1 / 64, recurrent=True),
    _row("numeric", "limit cycle after a touch", numeric.limit_cycle, "state LSB peak to peak",
        "a unit may rock within one interval of the tanh table; more would be an oscillation that arithmetic made",
        "wrap instead of saturate, every weight at full scale",
        at_most=_table_interval, recurrent=True),
    _row("numeric", "wrap at a narrowing of the cell", numeric.wraps, "results with the wrong sign or end of range",
        "a wrapped sum is wrong by the whole range; saturation is wrong by the excess",
        "wrap instead of saturate", at_most=0),
    _row("numeric", "wrap in the normaliser", numeric.normaliser_wrap, "features with the wrong sign",
        "a taxel beyond the range must read full scale, never the other sign",
        "centred sums keep their low 16 bits", at_most=0),
    _row("numeric", "accumulator width",
        MissingBits("accumulator_bits", numeric.row_bits, range(2, 17), "weight bits", "accumulator bits missing", "worst vector",
            numeric.bits_of_this_model),
        BITS, "the worst vector the formats allow must fit: no overflow is then reachable by any weights and any touch",
        "one bit less than the bound",
        measures="Gate and dense rows with every weight, feature and state at the end of its format, all signs agreeing, added up term "
        "by term; and with the weights of this model.", at_most=0),
    _row("numeric", "element-wise accumulator width",
        MissingBits("elementwise_bits", numeric.elementwise_bits, range(4, 17), "gate fraction bits", "bits missing", "worst operands"),
        BITS, "z h + (1 - z) n and the normaliser's product with every operand at its end must fit",
        "one bit less than the bound",
        measures="Gate times value sums (two gates at 1 where a cell allows it) and centred times scale, in plain integers.", at_most=0),
    _row("numeric", "window sum width", numeric.window_sum, BITS,
        "a taxel that jumps from one end of its range to the other for a whole window must fit",
        "one bit less than the worst sum needs", at_most=0),
    _row("numeric", "sigmoid table error", numeric.TableError(0, 16, numeric.exact_sigmoid, "error (gate LSB)"), "gate LSB", NEAREST,
        ONE_ENTRY_OFF, measures="Every entry against the sigmoid at the centre of the interval that addresses it.", at_most=ROUNDED,
        recurrent=True),
    _row("numeric", "tanh table error", numeric.TableError(1, 8, numeric.exact_tanh, "error (state LSB)"), "state LSB", NEAREST,
        ONE_ENTRY_OFF, measures="Every entry against tanh at the centre of the interval that addresses it.", at_most=ROUNDED,
        recurrent=True),
    _row("numeric", "table symmetry and order", numeric.table_shape, "entries",
        "s(-x) + s(x) = 1 and an odd tanh keep a symmetric input unbiased; a step back would make a gate ring", ONE_ENTRY_OFF,
        at_most=0, recurrent=True),
    _row("numeric", "table resolution", numeric.table_resolution, "share of decisions as with the exact functions",
        "an interval's width is the table's only error that grows with few entries",
        "a table of one value", at_least=0.98, recurrent=True),
    _row("numeric", "gate codes 0 and maximum", numeric.gate_ends, "wrong blends",
        "a gate at 1 must keep the state exactly and at 0 replace it exactly: z + (1 - z) = 1",
        "1 - z made by inverting bits", at_most=0,
        recurrent=True),
    _row("numeric", "ties", numeric.ties, "wrong decisions",
        "golden model and hardware must name the same class: the lowest index, for logits and for votes",
        "the last of equal classes", at_most=0),
    _row("numeric", "weight bits", AsInFloat("weight_bits", "weight bits", (12, 8, 7, 6, 5, 4, 3, 2), lambda config: config.weight_bits),
        LOCAL, AS_EVALUATE, "every weight 0",
        measures="Local decisions of the integer network as it is, equal to the float network's; the curve: other widths, post-training.",
        at_least=AGREED),
    _row("numeric", "state bits",
        AsInFloat("state_bits", "state bits", (16, 14, 12, 10, 8, 7, 6), lambda config: config.formats.state_format.width), LOCAL,
        AS_EVALUATE, "the state keeps its sign only",
        measures="The same against the bits of the hidden state.", at_least=AGREED, recurrent=True),
    _row("numeric", "feature bits",
        AsInFloat("feature_bits", "feature bits", (12, 10, 8, 7, 6, 5, 4), lambda config: config.formats.feature_format.width), LOCAL,
        AS_EVALUATE, "features lose their sign", measures="The same against the bits of a feature.", at_least=AGREED),
    _row("numeric", "touches outside the profiled range", numeric.outside_range, LOCAL,
        "logits have room for twice the profiled range; a touch twice as strong must not depend on saturation",
        "logits and states wrap",
        at_least=AGREED),
    _row("numeric", "normaliser constants", numeric.normaliser_error, "feature LSB",
        "half an LSB of rounding, a quarter of the dropped bits, and what a 16-bit scale adds",
        "the mean of another window length", at_most=1.0),
    _row("numeric", "windows off by a frame", numeric.window_edges, "wrong sums",
        "one frame more or less at a window's edge goes unseen in accuracy",
        "every window a frame late", at_most=0),
    _row("numeric", "cell variant", numeric.cell_variant, "of full scale 1",
        "a reset gate in the wrong place costs accuracy so little that only the states show it",
        "two gates exchanged", at_most=0.05,
        recurrent=True),
    # stream: touches in time, and what happens to frames
    _row("stream", "no touch",
        QuietStretches(stream.louder, 1.0, (1.0, 1.25, 1.5, 2.0, 3.0, 4.0), "noise and bursts / recorded",
            stream.stretches_and_frames, sampled=False),
        QUIET, "a decision without a touch is an invention", ANY_CODE,
        measures="The frames before each recording's touch alone, noise and motor bursts included: recordings in which an onset is found.",
        at_most=0, onset=True),
    _row("stream", "motor burst before the touch", stream.motor_burst, "share of recordings with an onset a window early",
        "a burst taken for the onset makes the touch fall out of its windows; half as much again is a motor's ageing", ANY_CODE,
        at_most=0.01, onset=True),
    _row("stream", "touch near the end of the stream", stream.late_touch, ACCURACY,
        "half of the steps must do: a cut touch is decided by the steps it has, and flagged partial",
        "the network answers after the last step only",
        at_least=ONE_TAXEL_WORST),
    _row("stream", "touch at frame 1", stream.touch_at_once, ACCURACY,
        "an array that is switched on while held must not be worse off than one with a dead taxel", SHOWS_EVERYTHING,
        at_least=ONE_TAXEL_WORST, onset=True),
    _row("stream", "two touches", stream.two_touches, "share of second touches decided as alone",
        "a touch must not know what came before it: state and sums are cleared", CARRIED, at_least=0.98, onset=True),
    _row("stream", "a touch while one is decided", stream.overlapping, ACCURACY,
        "the vote of the first three quarters stands: what comes then must not change the decision of the touch before",
        SHOWS_EVERYTHING, at_least=harmless),
    _row("stream", "one-sample glitch before the touch",
        QuietStretches(stream.glitch, sensor.SPIKE_CODES, (30, 100, 300, 1000, sensor.SPIKE_CODES, 10000, 30000),
            "height of the glitch (codes)", lambda bench, streams: f"{len(streams)} quiet stretches", log=True),
        QUIET, "one sample is no touch", "one sample is enough",
        measures="One sample of one taxel, each in turn, off by 3000 codes in the quiet frames before each touch: onsets found.", at_most=0,
        onset=True),
    _row("stream", "slow ramp through the band",
        QuietStretches(stream.ramp, 1.0, (0.5, 1.0, 2.0, 4.0, 8.0, 16.0), "ramp (deviations of the features a second)",
            stream.ramp_in_codes, log=True),
        QUIET, "temperature and charge drift move the rest level; what takes a second for a touch's usual height must not look like one",
        "the rest level is frozen after settling",
        measures="All taxels ramp by one standard deviation of the features a second before the touch: quiet recordings with an onset.",
        at_most=0, onset=True),
    _row("stream", "drift of all taxels",
        Whole(stream.drift, 0.25, (0.125, 0.25, 0.5, 1.0, 2.0), "drift in a touch (deviations of the features)",
            "a quarter of a deviation", log=True),
        ACCURACY, "the rest level is frozen in a touch: what drifts in one touch must stay small beside its features", FULL_SCALE,
        measures="All taxels ramp through the whole recording by a quarter of the features' standard deviation in a touch.",
        at_least=harmless),
    _row("stream", "mains hum",
        Whole(stream.hum, 2, (1, 2, 5, 10, 20, 50), "amplitude / noise at rest",
            lambda bench: f"twice the noise at rest of {bench.rest_noise:.2g} codes", log=True),
        ACCURACY, "a window of several hum periods averages it away", SHOWS_EVERYTHING,
        measures="50 Hz on all taxels, with twice the amplitude of the noise at rest.", at_least=harmless),
    _row("stream", "frames lost",
        Whole(stream.frames_lost, 0.01, (0.01, 0.03, 0.1, 0.2, 0.4), "share of frames lost", "one in a hundred", log=True), ACCURACY,
        "a link that loses one frame in a hundred is a bad one", THINNED,
        measures="One frame in a hundred is missing, at random; the stream closes up.", at_least=harmless),
    _row("stream", "frames repeated",
        Whole(stream.frames_repeated, 0.01, (0.01, 0.03, 0.1, 0.2, 0.4), "share of frames repeated", "one in a hundred", log=True),
        ACCURACY, "a link that repeats one frame in a hundred is a bad one", THINNED,
        measures="One frame in a hundred comes twice, at random.", at_least=harmless),
    _row("stream", "a gap in the touch",
        Whole(stream.gap, 0.01, (0.01, 0.03, 0.1, 0.3), "gap / touch", "a hundredth of the touch", log=True), ACCURACY,
        "a retry of the link takes some milliseconds", THINNED,
        measures="A hundredth of a touch's frames is missing in one piece, at a random place in the touch.", at_least=harmless),
    _row("stream", "wrong sample rate", stream.wrong_rate, ACCURACY, "an oscillator without a crystal is off by 5 %", THINNED,
        at_least=harmless),
    _row("stream", "stream shorter than the settling frames", stream.short_stream, "decisions",
        "what ends before the rest level is known can be no touch; it must end quietly",
        "no settling", at_most=0),
    _row("stream", "last two steps at the slowest clock", stream.last_steps, "share of the cycles there are",
        "two windows may end some frames apart: a step must be over before the next one's features are due",
        "a clock of two cycles a sample",
        at_most=1.0),
    # sensor: taxels
    _row("sensor", "one dead taxel, mean", DEAD.averaged, ACCURACY, "one of many taxels fails sooner or later; the array must go on",
        ONE_LISTENER,
        measures="Each taxel in turn rests without a sound from shortly before the touch on: mean over the taxels. Curve: when it dies.",
        at_least=ONE_TAXEL_MEAN),
    _row("sensor", "one dead taxel, worst", DEAD, ACCURACY, "no single taxel may carry the decision", ONE_LISTENER,
        measures="The same, the taxel that is missed most.", at_least=ONE_TAXEL_WORST),
    _row("sensor", "one taxel stuck at full scale, masked, mean", MASKED.averaged, ACCURACY, LIKE_A_DEAD_ONE, ONE_LISTENER,
        measures="Each taxel in turn at the highest code from shortly before the touch on, its mask bit set: mean over the taxels.",
        at_least=ONE_TAXEL_MEAN),
    _row("sensor", "one taxel stuck at full scale, masked, worst", MASKED, ACCURACY, LIKE_A_DEAD_ONE, ONE_LISTENER,
        measures="The same, the worst taxel.", at_least=ONE_TAXEL_WORST),
    _row("sensor", "one taxel stuck high from power-on", EachTaxel(sensor.stuck_from_start, 0, (0,), "from the first frame on"), ACCURACY,
        "a level that never moves is removed with the rest level or masked", ONE_LISTENER,
        measures="Each taxel in turn at the highest code from the first frame on: the worst one.", at_least=ONE_TAXEL_WORST),
    _row("sensor", "one taxel sticks high in the touch", EachTaxel(sensor.stuck("high"), 0.25, BEGINS, TO_FAILURE), ACCURACY,
        DETECTOR_IN_TIME, UNDEFENDED,
        measures="Each taxel in turn jumps to the highest code a quarter into the touch and stays: the worst one. Curve: when it sticks.",
        at_least=ONE_TAXEL_WORST, detector=True),
    _row("sensor", "one taxel sticks low in the touch", EachTaxel(sensor.stuck("low"), 0.25, BEGINS, TO_FAILURE), ACCURACY,
        DETECTOR_IN_TIME, UNDEFENDED,
        measures="Each taxel in turn falls to the lowest code a quarter into the touch and stays: the worst one.", at_least=ONE_TAXEL_WORST,
        detector=True),
    _row("sensor", "one taxel sticks high at the onset", EachTaxel(sensor.stuck("high"), 0.0, BEGINS, TO_FAILURE), ACCURACY,
        "the same bound as later in the touch: the first windows are lost until the detector has seen a whole block", UNDEFENDED,
        measures="Each taxel in turn jumps to the highest code with the onset and stays: the worst one.", at_least=ONE_TAXEL_WORST,
        detector=True),
    _row("sensor", "one taxel sticks high before the touch", EachTaxel(sensor.stuck("high"), -0.2, (-0.05, -0.1, -0.2, -0.4), TO_FAILURE),
        ACCURACY, "a jump of one taxel is an onset to the rule: the touch it opens must not swallow the real one", UNDEFENDED,
        measures="Each taxel in turn jumps to the highest code a fifth of a touch before the onset: the worst one; the first touch "
        "decides.", at_least=ONE_TAXEL_WORST, onset=True, detector=True),
    _row("sensor", "two taxels dead", TaxelPairs(sensor.dead_together, "dead taxels", (5, 6)), ACCURACY,
        "with two gone the array is less sharp, not broken", ONE_LISTENER,
        measures="Every pair of taxels dead from shortly before the touch on: mean over the pairs. Curve: number of dead taxels.",
        at_least=TWO_TAXELS_MEAN),
    _row("sensor", "one noisy taxel", EachTaxel(sensor.noisy, 3.0, (1, 2, 3, 5, 10, 20), "noise / rest noise", log=True), ACCURACY,
        "a loose contact is several times noisier than the rest; the window mean must hold it",
        "a window is one sample",
        measures="White noise of three times its own rest noise on each taxel in turn: the worst one.", at_least=harmless),
    _row("sensor", "gain of one taxel 20 % high", EachTaxel(sensor.gain_off, 0.2, (0.1, 0.2, 0.5, 1.0, 3.0), "gain error"), ACCURACY,
        "taxels of one film differ by as much", FULL_SCALE, measures="Each taxel in turn 20 % more sensitive: the worst one.",
        at_least=harmless),
    _row("sensor", "gain of one taxel 20 % low", EachTaxel(sensor.gain_off, -0.2, (-0.1, -0.2, -0.4, -0.6, -0.8), "gain error"), ACCURACY,
        "taxels of one film differ by as much, and they age", FULL_SCALE,
        measures="Each taxel in turn 20 % less sensitive: the worst one.", at_least=harmless),
    _row("sensor", "gains of all taxels within 20 %",
        Whole(sensor.gains, 0.2, (0.1, 0.2, 0.4, 0.6, 0.9), "largest gain error", "within 20 %"), ACCURACY, "another film of the same make",
        FULL_SCALE, measures="Every taxel with a gain of its own, drawn within +-20 %, one draw a recording.", at_least=harmless),
    _row("sensor", "offset of one taxel by one deviation up", EachTaxel(sensor.offset, 1.0, (0.25, 0.5, 1.0, 2.0, 4.0), OFFSET), ACCURACY,
        NOT_FROM_A_TOUCH, ONE_LISTENER,
        measures="Each taxel in turn shifted up by one standard deviation of the features at the onset: the worst one.",
        at_least=ONE_TAXEL_WORST),
    _row("sensor", "offset of one taxel by one deviation down", EachTaxel(sensor.offset, -1.0, (-0.25, -0.5, -1.0, -2.0, -4.0), OFFSET),
        ACCURACY, NOT_FROM_A_TOUCH, ONE_LISTENER,
        measures="Each taxel in turn shifted down by one standard deviation of the features at the onset: the worst one.",
        at_least=ONE_TAXEL_WORST),
    _row("sensor", "offset of all taxels at the onset",
        Whole(sensor.offset_of_all, 0.25, (0.125, 0.25, 0.5, 1.0, 2.0), OFFSET, "a quarter", log=True), ACCURACY,
        "a supply step of a quarter of the features' deviation is seen by every taxel alike", FULL_SCALE,
        measures="All taxels shifted together by a quarter of the features' standard deviation at the onset.", at_least=harmless),
    _row("sensor", "clipped signals",
        Whole(sensor.clipped, 4.0, (8, 4, 2, 1, 0.5, 0.25), "limit (deviations of the features)", "four deviations", log=True), ACCURACY,
        "an amplifier has room for four deviations of the features; what stays at a limit for a whole block is masked as stuck",
        FULL_SCALE, measures="Every taxel limited to four standard deviations of the features around its rest level.",
        at_least=ONE_TAXEL_WORST),
    _row("sensor", "spikes", Whole(sensor.spikes, 0.01, (0.003, 0.01, 0.03, 0.1, 0.3), "share of samples", "one in a hundred", log=True),
        ACCURACY, "recordings hold spikes of a few samples; the clip and the window mean must hold them", SHOWS_EVERYTHING,
        measures="One sample in a hundred of every taxel off by 3000 codes, either way, from the onset on.", at_least=harmless),
    _row("sensor", "two taxels exchanged", TaxelPairs(sensor.exchanged, "taxels that changed places", (7, 8), step=2, spared=0), ACCURACY,
        "nothing defends against a wiring mistake, which installation finds; at half of the decisions the array is of no use",
        "a network that hears nothing",
        measures="Every pair of taxels exchanged: mean over the pairs. Curve: taxels that changed places.", at_least=EXCHANGED_MEAN),
    _row("sensor", "failed taxels not found", sensor.missed, "share missed within two blocks",
        "the detector judges whole blocks: a taxel that sticks is in one by the end of the next",
        "no detector", at_most=0.0,
        detector=True),
    _row("sensor", "sound taxels masked", sensor.false_alarms, "share of recordings with a flag",
        "a detector that masks what is sound does more harm than good",
        "a detector that takes rest noise for silence", at_most=0.0, detector=True),
    # memory: bits that turn over
    _row("memory", "weight bit flips, mean", memory.weight_flips, CHANGED,
        "until the checksum is read an upset should seldom change a decision", SHOWS_EVERYTHING, at_most=MEAN_CHANGED),
    _row("memory", "weight bit flips, the worst", memory.worst_flip, CHANGED,
        "one upset must not turn most decisions before the checksum tells", SHOWS_EVERYTHING, at_most=0.5),
    _row("memory", "table bit flips", memory.table_flips, CHANGED, "one entry of many is seldom read", SHOWS_EVERYTHING,
        at_most=MEAN_CHANGED, recurrent=True),
    _row("memory", "normaliser constant bit flips", memory.constant_flips, "share of decisions changed by the worst of the 12 lower bits",
        "mean and scale stand in every feature: the lower bits must not matter much, the upper ones are the checksum's",
        "a scale of one",
        at_most=0.5),
    _row("memory", "configuration register bit flips", memory.register_flips, "share of decisions changed, mean",
        "registers are under the checksum; until it is read most flips must leave most decisions alone", SHOWS_EVERYTHING,
        at_most=0.25),
    _row("memory", "state bit flips", memory.state_flips, CHANGED,
        "a contracting cell forgets an upset within steps, and the vote covers them", SHOWS_EVERYTHING, at_most=MEAN_CHANGED,
        recurrent=True),
    _row("memory", "recovery at the next touch", memory.recovery, "share of next touches that differ",
        "the state is cleared at the start of a touch: an upset ends with its touch", CARRIED, at_most=0, recurrent=True),
)
# fmt: on

MODES: dict[str, Mode] = {one.name: one for one in ROWS}
"""Every mode by its name, in the order of the report."""


@dataclass(frozen=True)
class HardwareMode:
    """A mode that only the hardware can show; ``key`` names it to the co-simulation function.

    breaks: the broken variant in words.
    """

    name: str
    group: str
    key: str
    unit: str
    bound: float
    reason: str
    breaks: str


HARDWARE: tuple[HardwareMode, ...] = (
    HardwareMode(
        "stalls on both sides of the accelerator",
        "stream",
        "stalls",
        "values that differ",
        0,
        "a stream may pause at any cycle",
        "a decision counts as taken whether the receiver is ready or not",
    ),
    HardwareMode(
        "weight write during a touch",
        "memory",
        "probe",
        "values that differ, and a write that is not refused and flagged",
        0,
        "a touch is decided by one set of weights",
        "a touch does not lock the memories",
    ),
    HardwareMode(
        "reset at any cycle",
        "stream",
        "reset",
        "touches that differ afterwards",
        0,
        "a reset leaves nothing behind",
        "the next recording begins without arm",
    ),
    HardwareMode(
        "single flip-flop upsets",
        "memory",
        "flip-flops",
        "designs that hang beyond the watchdog's bound",
        0,
        "the watchdog returns to idle",
        "no watchdog",
    ),
    HardwareMode(
        "weight or constant upset flagged",
        "memory",
        "checksum",
        "flips not flagged before the next global decision",
        0,
        "the checksum covers weights, constants and configuration registers",
        "no checksum",
    ),
)
