"""The failure modes, a row each: the disturbance and its size, the bound and its reason."""

from dataclasses import replace
from functools import partial

from eskin.study.stability import disturbances, numbers
from eskin.study.stability.core import (
    AGREED,
    COMMON_OFFSET,
    GROUPS,
    ONE_TAXEL_MEAN,
    ONE_TAXEL_WORST,
    AsInFloat,
    Experiment,
    Mode,
    harmless,
)

TWO_TAXELS_MEAN = 0.90
"""Share of the undisturbed accuracy that must be left without two taxels, mean over the pairs: less sharp,
not broken."""
EXCHANGED_MEAN = 0.5
MEAN_CHANGED = 0.02
"""Share of decisions that a bit flip, any one, may change on average: what a fault is worth until the
checksum is read."""
BEGINS = (0.9, 0.75, 0.5, 0.25, 0.1, 0.0, -0.1)
"""Times at which a taxel fails, in touch lengths after the onset; later is milder."""

ACCURACY, CHANGED = "accuracy", "share of decisions changed"
QUIET, LOCAL = "share of quiet recordings with an onset", "share of local decisions as in float"
TO_FAILURE = "touch lengths from the onset to the failure"
OFFSET = "offset (standard deviations of the features)"
AS_EVALUATE = "the level below which `eskin evaluate` refuses a quantised model"
DETECTOR_IN_TIME = "the detector must find and mask it in time for the vote"
LIKE_A_DEAD_ONE = "a masked stuck taxel equals a dead one"
NOT_FROM_A_TOUCH = "an offset at the onset looks like the touch: it may not cost more than the whole taxel"

DEAD = Experiment(partial(disturbances.stuck, end="rest"), -0.1, BEGINS, TO_FAILURE, over="taxels")
MASKED = Experiment(disturbances.stuck, -0.1, BEGINS, TO_FAILURE, over="taxels", masked=True)


NUMERIC, STREAM, SENSOR, MEMORY = (partial(Mode, group) for group in GROUPS)

# fmt: off
MODES: dict[str, Mode] = {mode.name: mode for mode in (
    # numeric: rounding, saturation, bits
    NUMERIC("state error without reset", numbers.growth, "error at step t / error at step 20",
        "the state must not accumulate rounding errors, or long touches fail", at_most=2.0, needs="state"),
    NUMERIC("weight bits",
        AsInFloat("weight_bits", "weight bits", (12, 8, 7, 6, 5, 4, 3, 2), lambda config: config.weight_bits),
        LOCAL, AS_EVALUATE,
        "Share of local decisions in which integer and float network agree. Curve: other widths, without retraining.", at_least=AGREED,
        needs="weights"),
    NUMERIC("state bits",
        AsInFloat("state_bits", "state bits", (16, 14, 12, 10, 8, 7, 6),
            lambda config: config.formats.state_format.width),
        LOCAL, AS_EVALUATE, "The same for the bits of the hidden state.", at_least=AGREED,
        needs="state"),
    NUMERIC("feature bits",
        AsInFloat("feature_bits", "feature bits", (12, 10, 8, 7, 6, 5, 4),
            lambda config: config.formats.feature_format.width),
        LOCAL, AS_EVALUATE, "The same for the bits of a feature.", at_least=AGREED),
    NUMERIC("touches outside the profiled range", numbers.outside_range, LOCAL,
        "logits have room for twice the profiled range; a touch twice as strong must not depend on "
        "saturation", at_least=AGREED),
    # stream: touches in time, and what happens to frames
    STREAM("no touch",
        Experiment(disturbances.louder, 1.0, (1.0, 1.25, 1.5, 2.0, 3.0, 4.0), "noise and bursts / recorded",
            disturbances.stretches_and_frames, "quiet"),
        QUIET, "without a touch there must be no decision",
        "Only the frames before the touch, with noise and motor bursts: share of recordings with an onset.", at_most=0, needs="onset"),
    STREAM("motor burst before the touch",
        Experiment(disturbances.burst, 1.5, (1.0, 1.5, 2.0, 3.0, 4.0, 6.0), "burst / recorded", "half as much again",
            early=True),
        "share of recordings with an onset a window early",
        "a burst mistaken for the onset moves the windows off the touch; a motor that ages is half as loud again",
        "All samples before the touch times 1.5, with motor bursts: share of onsets more than a window too "
        "early.", at_most=0.01, needs="onset"),
    STREAM("touch near the end of the stream",
        Experiment(disturbances.cut_short, 0.5, (1.0, 0.75, 0.5, 0.35, 0.25, 0.15, 0.1, 0.05), "share of the steps "
                                                                                    "there are",
            "half of the steps"), ACCURACY,
        "half of the steps must be enough: a cut touch uses the steps it has and is flagged partial",
        "The stream ends in the middle of the touch, and the completed steps decide. Curve: other shares of the "
        "steps.", at_least=ONE_TAXEL_WORST),
    STREAM("touch at frame 1",
        Experiment(disturbances.without_lead, 0, (400, 200, 128, 96, 64, 32, 0), "quiet frames before the onset",
            "none"), ACCURACY,
        "an array that is touched at power-on must do no worse than one with a dead taxel",
        "The stream begins at the onset, so the rest level settles within the touch. Curve: quiet frames before the "
        "onset.", at_least=ONE_TAXEL_WORST, needs="onset"),
    STREAM("two touches", disturbances.two_touches, "share of second touches with an unchanged decision",
        "an earlier touch must have no effect: state and sums are cleared", at_least=0.98,
        needs="onset"),
    STREAM("a touch while one is decided",
        Experiment(disturbances.overlapped, 0.75, (0.9, 0.75, 0.6, 0.5, 0.4, 0.25), "where in the touch the second "
                                                                         "begins",
            "the last quarter"), ACCURACY,
        "the vote of the first three quarters must hold against a second touch", "A touch of another class is added "
        "to the last quarter of the touch; the decision must be that of the first.", at_least=harmless),
    STREAM("one-sample glitch before the touch",
        Experiment(disturbances.glitch, disturbances.SPIKE_CODES, (30, 100, 300, 1000, disturbances.SPIKE_CODES, 10000,
            30000), "height of the glitch (codes)", disturbances.stretches_and_frames, "quiet", log=True, sampled=True),
        QUIET, "a single sample is no touch",
        "One sample of each taxel in turn is off by 3000 codes in the quiet frames before the touch: share with an "
        "onset.", at_most=0, needs="onset"),
    STREAM("slow ramp through the band",
        Experiment(disturbances.ramp, 1.0, (0.5, 1.0, 2.0, 4.0, 8.0, 16.0),
            "ramp (deviations of the features a second)", disturbances.ramp_in_codes, "quiet", log=True, sampled=True),
        QUIET,
        "temperature and charge move the rest level; a rise to the usual height in a second must not look like a touch",
        "All taxels rise by one standard deviation of the features per second before the touch: share with an "
        "onset.", at_most=0, needs="onset"),
    STREAM("drift of all taxels",
        Experiment(disturbances.drift, 0.25, (0.125, 0.25, 0.5, 1.0, 2.0),
            "drift in a touch (deviations of the features)", "a quarter of a deviation", log=True),
        ACCURACY, "the rest level is frozen during a touch, so drift within one touch must stay small",
        "All taxels drift through the whole recording, by a quarter of the features' standard deviation per touch.", at_least=harmless),
    STREAM("mains hum",
        Experiment(disturbances.hum, 2, (1, 2, 5, 10, 20, 50), "amplitude / noise at rest",
            lambda bench: f"twice the noise at rest of {bench.rest_noise.max():.2g} codes", log=True),
        ACCURACY, "a window averages over several periods of the hum",
        "A 50 Hz sine on all taxels, with twice the amplitude of the noise at rest.", at_least=harmless),
    STREAM("frames lost",
        Experiment(disturbances.frames_lost, 0.01, (0.01, 0.03, 0.1, 0.2, 0.4), "share of frames lost",
            "one in a hundred", log=True),
        ACCURACY, "only a bad link loses one frame in a hundred",
        "One frame in a hundred is missing at random, without a gap in the stream.", at_least=harmless),
    STREAM("frames repeated",
        Experiment(disturbances.frames_repeated, 0.01, (0.01, 0.03, 0.1, 0.2, 0.4), "share of frames repeated",
            "one in a hundred", log=True),
        ACCURACY, "only a bad link repeats one frame in a hundred",
        "One frame in a hundred is repeated at random.", at_least=harmless),
    STREAM("a gap in the touch",
        Experiment(disturbances.gap, 0.01, (0.01, 0.03, 0.1, 0.3), "gap / touch", "a hundredth of the touch", log=True),
        ACCURACY, "a retry of the link takes some milliseconds",
        "A block of a hundredth of the touch's frames is missing at a random place in the touch.",
        at_least=harmless),
    STREAM("wrong sample rate",
        Experiment(disturbances.rate_off, 0.05, (0.02, 0.05, 0.1, 0.2, 0.4), "error of the rate", over="ways"), ACCURACY,
        "an oscillator without a crystal is off by 5 %",
        "The stream is sampled 5 % too fast and 5 % too slow; the lower accuracy counts.", at_least=harmless),
    STREAM("class without the touch", disturbances.without_touch, "share of recordings recognised",
        "a class recognised without the touch comes from the rest level, the time of the onset or the length",
        at_most=lambda bench: bench.remember("leak", lambda: disturbances.leak_of(bench)).limit, needs="onset"),
    # sensor: taxels
    SENSOR("one dead taxel, mean", replace(DEAD, mean=True), ACCURACY,
        "one of many taxels fails sooner or later, and the array must still work",
        "Each taxel in turn stays at its rest level from shortly before the touch: mean over the taxels. Curve: time "
        "of the failure.", at_least=ONE_TAXEL_MEAN),
    SENSOR("one dead taxel, worst", DEAD, ACCURACY, "the decision must not depend on a single taxel",
        "The same for the taxel whose loss costs most.", at_least=ONE_TAXEL_WORST),
    SENSOR("one taxel stuck at full scale, masked, mean", replace(MASKED, mean=True), ACCURACY, LIKE_A_DEAD_ONE,
        "Each taxel in turn stays at the highest code from shortly before the touch, with its mask bit set: mean over "
        "the taxels.", at_least=ONE_TAXEL_MEAN),
    SENSOR("one taxel stuck at full scale, masked, worst", MASKED, ACCURACY, LIKE_A_DEAD_ONE,
        "The same for the worst taxel.", at_least=ONE_TAXEL_WORST),
    SENSOR("one taxel stuck high from power-on",
        Experiment(disturbances.stuck_from_start, 0, (0,), "from the first frame on", over="taxels"), ACCURACY,
        "a level that never moves is removed with the rest level or masked",
        "Each taxel in turn stays at the highest code from the first frame: the worst one.",
        at_least=ONE_TAXEL_WORST),
    SENSOR("one taxel sticks high in the touch",
        Experiment(disturbances.stuck, 0.25, BEGINS, TO_FAILURE, over="taxels"), ACCURACY, DETECTOR_IN_TIME,
        "Each taxel in turn jumps to the highest code a quarter into the touch and stays: the worst one. Curve: time "
        "of the failure.", at_least=ONE_TAXEL_WORST, needs="detector"),
    SENSOR("one taxel sticks low in the touch",
        Experiment(partial(disturbances.stuck, end="low"), 0.25, BEGINS, TO_FAILURE, over="taxels"), ACCURACY, DETECTOR_IN_TIME,
        "Each taxel in turn falls to the lowest code a quarter into the touch and stays: the worst one.",
        at_least=ONE_TAXEL_WORST, needs="detector"),
    SENSOR("one taxel sticks high at the onset",
        Experiment(disturbances.stuck, 0.0, BEGINS, TO_FAILURE, over="taxels"), ACCURACY,
        "the same bound as later in the touch: the first windows are lost until the detector has seen a "
        "whole block",
        "Each taxel in turn jumps to the highest code with the onset and stays: the worst one.",
        at_least=ONE_TAXEL_WORST, needs="detector"),
    SENSOR("one taxel sticks high before the touch",
        Experiment(disturbances.stuck, -0.2, (-0.05, -0.1, -0.2, -0.4), TO_FAILURE, over="taxels"), ACCURACY,
        "the rule sees the jump of one taxel as an onset, which must not hide the real touch",
        "Each taxel in turn jumps to the highest code a fifth of a touch before the onset: the worst one;"
        " the first touch decides.", at_least=ONE_TAXEL_WORST, needs="onset detector"),
    SENSOR("two taxels dead", Experiment(disturbances.dead_together, 2, (), "dead taxels", over="pairs", mean=True), ACCURACY,
        "without two taxels the array must still work",
        "Every pair of taxels dead from shortly before the touch on: mean over the pairs. Curve: number "
        "of dead taxels.", at_least=TWO_TAXELS_MEAN),
    SENSOR("one noisy taxel",
        Experiment(disturbances.noisy, 3.0, (1, 2, 3, 5, 10, 20), "noise / rest noise", over="taxels", log=True), ACCURACY,
        "a loose contact is several times noisier than the rest, and the window mean must filter it",
        "White noise of three times its own rest noise on each taxel in turn: the worst one.",
        at_least=harmless),
    SENSOR("gain of one taxel 20 % high",
        Experiment(disturbances.gain_off, 0.2, (0.1, 0.2, 0.5, 1.0, 3.0), "gain error", over="taxels"), ACCURACY,
        "taxels of one film differ by as much", "Each taxel in turn is 20 % more sensitive: the worst one.",
        at_least=harmless),
    SENSOR("gain of one taxel 20 % low",
        Experiment(disturbances.gain_off, -0.2, (-0.1, -0.2, -0.4, -0.6, -0.8), "gain error", over="taxels"), ACCURACY,
        "taxels of one film differ by as much, and they age",
        "Each taxel in turn is 20 % less sensitive: the worst one.", at_least=harmless),
    SENSOR("gains of all taxels within 20 %",
        Experiment(disturbances.gains, 0.2, (0.1, 0.2, 0.4, 0.6, 0.9), "largest gain error", "within 20 %"), ACCURACY,
        "another film of the same type must work",
        "Every taxel has a random gain error within +-20 %, drawn for each recording.", at_least=harmless),
    SENSOR("offset of one taxel by one deviation up",
        Experiment(disturbances.offset, 1.0, (0.25, 0.5, 1.0, 2.0, 4.0), OFFSET, over="taxels"), ACCURACY, NOT_FROM_A_TOUCH,
        "Each taxel in turn shifted up by one standard deviation of the features at the onset: the worst "
        "one.", at_least=ONE_TAXEL_WORST),
    SENSOR("offset of one taxel by one deviation down",
        Experiment(disturbances.offset, -1.0, (-0.25, -0.5, -1.0, -2.0, -4.0), OFFSET, over="taxels"), ACCURACY, NOT_FROM_A_TOUCH,
        "Each taxel in turn shifted down by one standard deviation of the features at the onset: the "
        "worst one.", at_least=ONE_TAXEL_WORST),
    SENSOR("offset of all taxels at the onset",
        Experiment(disturbances.offset, COMMON_OFFSET, (0.125, 0.25, 0.5, 1.0, 2.0), OFFSET, "a quarter",
            log=True),
        ACCURACY, "a supply step of a quarter of the features' deviation shifts every taxel alike",
        "All taxels shifted together by a quarter of the features' standard deviation at the onset.",
        at_least=harmless),
    SENSOR("clipped signals",
        Experiment(disturbances.clipped, 4.0, (8, 4, 2, 1, 0.5, 0.25), "limit (deviations of the features)",
            "four deviations", log=True),
        ACCURACY,
        "an amplifier passes four deviations of the features; a taxel at a limit for a whole block is masked as stuck",
        "Every taxel limited to four standard deviations of the features around its rest level.",
        at_least=ONE_TAXEL_WORST),
    SENSOR("spikes",
        Experiment(disturbances.spikes, 0.01, (0.003, 0.01, 0.03, 0.1, 0.3), "share of samples", "one in a hundred",
            log=True),
        ACCURACY, "recordings contain spikes of a few samples; clip and window mean must filter them",
        "One sample in a hundred of every taxel is off by 3000 codes, up or down, after the onset.",
        at_least=harmless),
    SENSOR("two taxels exchanged",
        Experiment(disturbances.exchanged, 2, (), "exchanged taxels", over="pairs", mean=True), ACCURACY,
        "no defence covers a wiring mistake, which installation finds; with half of the decisions wrong the array is useless",
        "Every pair of taxels is exchanged: mean over the pairs. Curve: number of exchanged taxels.",
        at_least=EXCHANGED_MEAN),
    SENSOR("failed taxels not found", disturbances.missed, "share missed within two blocks",
        "the detector checks whole blocks, so a stuck taxel fills one by the end of the next", at_most=0.0,
        needs="detector"),
    SENSOR("sound taxels masked", disturbances.false_alarms, "share of recordings with a flag",
        "a detector that masks sound taxels does more harm than good", at_most=0.0, needs="detector"),
    # memory: bits that turn over
    MEMORY("weight bit flips, mean", numbers.weight_flips, CHANGED,
        "until the host reads the checksum, an upset should seldom change a decision",
        "Bits of weights and biases inverted, one at a time: mean share of decisions changed.",
        at_most=MEAN_CHANGED),
    MEMORY("weight bit flips, the worst", replace(numbers.weight_flips, worst=True), CHANGED,
        "one upset must not change most decisions before the checksum reports it",
        "Bits of weights and biases inverted, one at a time: the worst one.", at_most=0.5),
    MEMORY("table bit flips", numbers.table_flips, CHANGED, "one entry of many is rarely used",
        "Bits of entries of both activation tables inverted, one at a time: mean share of decisions changed.",
        at_most=MEAN_CHANGED, needs="state"),
    MEMORY("normaliser constant bit flips", numbers.constant_flips,
        "share of decisions changed by the worst small flip",
        "a flip that moves features no more than a supply step must seldom change a decision; the checksum finds larger ones",
        "Bits of the normaliser's mean and scale inverted, one at a time, if they move no input by more than a supply "
        "step (RMS).", at_most=MEAN_CHANGED),
    MEMORY("configuration register bit flips", numbers.register_flips,
        "share of decisions changed, mean",
        "the checksum covers the registers; until the host reads it, few decisions may change",
        "Every bit of onset threshold, band, clip, rearm count and mask inverted, one at a time, on the whole front end.",
        at_most=0.25),
    MEMORY("state bit flips", numbers.state_flips, CHANGED,
        "a contracting cell forgets an upset within a few steps, and the vote covers these", at_most=MEAN_CHANGED,
        needs="state"),
    # what only the hardware can show, by its key (eskin/verbs/stability_job.py)
    STREAM("stalls on both sides of the accelerator", "stalls", "values that differ",
        "a stream may pause at any cycle", at_most=0),
    MEMORY("weight write during a touch", "probe",
        "values that differ, or a write that is not refused and flagged",
        "one touch must use one set of weights", at_most=0, needs="loadable"),
    STREAM("reset at any cycle", "reset", "touches that differ afterwards",
        "a reset clears everything", at_most=0),
)}
# fmt: on
"""Every mode by its name, in the order of the report."""
