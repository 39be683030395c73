"""Results of a co-simulation, as cosim.json holds them. The type of a figure names the function that joins the figures
of two parts of the recordings; where it names none, the first part's figure stands for both."""

import operator
from collections.abc import Sequence
from functools import reduce
from typing import Annotated, Any, Self

from eskin.cosim import latency
from eskin.cosim.latency import Budget
from eskin.cosim.scoreboard import KEPT, Mismatch, Scoreboard
from eskin.golden.core import AcceleratorConfig, Result

Sum = Annotated[int, operator.add]
Least = Annotated[int | None, min]
Most = Annotated[int | None, max]


class Stage(Result):
    """Values of a stage."""

    compared_values: Sum
    mismatches: Sum = 0


class Cycles(Result):
    """Clock cycles; None where nothing was counted."""

    step_ideal: int
    frame_max: Most
    step_min: Least
    step_max: Most
    decision_latency_max: Most


class GaveUp(Result):
    """Where the hardware stood still."""

    recording: int
    frame: int


class Conversion(Result):
    """What the converter's model counted: `eskin.golden.core.ConverterFault`, violations of its data sheet."""

    converter: str
    code_bits: int
    jitter_cycles: Annotated[float, max]
    faults: Annotated[int, operator.or_]
    violations: Sum


class Oscillator(Result):
    """A fast oscillator that runs for each scan: on for ``fast_on_s`` of ``seconds``, the share ``duty``; turned on
    ``starts`` times, in which the converter was read ``scans`` times."""

    fast_on_s: Annotated[float, operator.add]
    seconds: Annotated[float, operator.add]
    duty: float
    scans: Sum
    starts: Sum


class Answer(Result):
    """The answer of whoever played recordings: a bench in its simulator, or `eskin.cosim.bulk`.

    registers: read at the end. mismatch: the first difference, mismatch_list: in words. probe: weights were
    written during a touch. overruns: frames that were due while the chain was not ready for them."""

    frames: Sum
    steps: Sum
    decisions: Sum
    simulated_cycles: Sum
    overruns: Sum
    input_stalls: Sum
    stages: dict[str, Stage]
    cycles: Cycles
    registers: dict[str, int | None]
    mismatch: Mismatch | None
    mismatch_list: Annotated[list[str], operator.add]
    gave_up: GaveUp | None
    probe: bool
    wall_s: Annotated[float, operator.add] = 0
    conversion: Conversion | None = None
    oscillator: Oscillator | None = None

    @classmethod
    def of(cls, board: Scoreboard, *, frame_max: int, **counts: int) -> Self:
        """What a scoreboard has found: ``frame_max``, most cycles of a frame, and the fields of ``counts`` beside."""
        found = board.differing[0] if board.differing else None
        stages = {name: Stage(compared_values=count, mismatches=0) for name, count in board.compared.items()}
        gave_up = None
        if found:
            stages.setdefault(found.stage, Stage(compared_values=0)).mismatches = 1
            gave_up = found if found.stage == "input" else None
        cycles = Cycles(
            step_ideal=board.config.step_ideal,
            frame_max=frame_max,
            step_min=min(board.took, default=None),
            step_max=max(board.took, default=None),
            decision_latency_max=max(board.late, default=None),
        )
        return cls.model_validate(
            board.counts
            | counts
            | {
                "stages": stages,
                "cycles": cycles,
                "registers": {name: board.registers.get(name) for name in KEPT},
                "mismatch": found,
                "mismatch_list": [*map(str, board.differing)],
                "gave_up": gave_up and {"recording": gave_up.recording, "frame": gave_up.frame},
            }
        )


class Part(Answer):
    """What was played, and how. golden: what computed the expectation. waves: path or None. without_probes: the netlist
    as it is placed, played once more."""

    golden: str
    simulator: str
    level: str
    target: str | None
    lanes: int
    pace: str
    clock_hz: float
    stalls: bool
    seed: int
    waves: str | None
    cocotb_recordings: Sum
    bulk_recordings: Sum
    without_probes: "Placed | None" = None


class Played(Part):
    """cosim.json.

    verdict: ``gave up`` (the hardware stood still), ``differs``, ``no decision`` (no touch with a whole window),
    ``bit-exact``. mismatches: at most 1 where nothing was joined. passed: bit-exact, no budget missed, a decision compared. model_hash: as in
    config.json.
    """

    recordings: int
    compared_values: int
    mismatches: int
    budgets: list[Budget]
    cycles_per_s: int
    bit_exact: bool
    verdict: str
    passed: bool
    model_hash: str = ""


class Placed(Result):
    """The run of a netlist as it is placed, without probes; its cells by type."""

    compared_values: Sum
    mismatches: Sum
    bit_exact: Annotated[bool, operator.and_]
    mismatch_list: Annotated[list[str], operator.add]
    cells: dict[str, int]


def _joined(first: Any, second: Any, join: Any = None) -> Any:
    """Two parts' figures as one, by the function ``join`` where there is one."""
    if first is None or second is None:
        return second if first is None else first
    if join:
        return join(first, second)
    if isinstance(first, dict):
        return {key: _joined(first.get(key), second.get(key), KEPT.get(key)) for key in {**first, **second}}
    if not isinstance(first, Result):
        return first
    joins = {name: [*type(first).model_fields[name].metadata, None][0] for name in first.model_fields_set}
    values = {name: _joined(getattr(first, name), getattr(second, name), how) for name, how in joins.items()}
    return type(first).model_construct(**values)


def joined(config: AcceleratorConfig, parts: Sequence[Part]) -> Played:
    """One result from the results of parts of the recordings, in their order and played alike: counts and seconds
    are sums, cycles the extremes, budgets follow from these cycles; the registers are the last part's, with the
    faults of all and the longest step.
    """
    whole: Part = reduce(_joined, parts)
    compared, mismatches = (
        sum(getattr(stage, name) for stage in whole.stages.values())
        for name in ("compared_values", "mismatches")
    )
    exact, budgets = mismatches == 0 and compared > 0, latency.budgets(config, whole)
    # an expectation without a touch of a whole window never compared the network
    words = ["gave up"] * bool(whole.gave_up) + ["differs"] * (not exact)
    converter, placed = whole.conversion, whole.without_probes
    if whole.oscillator:
        whole.oscillator.duty = whole.oscillator.fast_on_s / whole.oscillator.seconds
    own = whole.model_dump(exclude_unset=True, include={*Part.model_fields})
    return Played(
        **own | {"wall_s": round(whole.wall_s, 3)},
        recordings=whole.cocotb_recordings + whole.bulk_recordings,
        compared_values=compared,
        mismatches=mismatches,
        budgets=budgets,
        cycles_per_s=round(whole.simulated_cycles / whole.wall_s),
        bit_exact=exact,
        verdict=[*words, "bit-exact" if whole.decisions else "no decision"][0],
        passed=exact
        and whole.decisions > 0
        and all(row.met or row.reference for row in budgets)
        and not (converter and (converter.faults or converter.violations))
        and (not placed or placed.bit_exact),
    )
