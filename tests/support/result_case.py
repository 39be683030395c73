"""A small made-up result of the main job: recordings, a random model, and what each stage would have said."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np

from eskin.cosim.results import Cycles, Played
from eskin.golden.core import Result, write_json
from eskin.golden.data import Recordings
from eskin.golden.model import FloatModel, pipeline
from eskin.training.evaluate import Evaluation
from eskin.training.made_up import random_recordings
from eskin.training.quantise import profile, range_records
from eskin.training.record import Training
from eskin.training.stage_error import LogitError
from eskin.training.times import step_times
from eskin.verbs.cost import power_of
from eskin.verbs.parts import parts_of
from tests.support.random_models import random_float_model, random_integer_model
from tests.support.small_designs import TRACKED

ROW_KEYS = set(
    "method split accuracy spread parameters multiplies bytes train_s decision_us hardware".split()
)
"""Of each row of baselines.json."""


CONFIG = TRACKED.replace(
    name="made",
    rest_frames=16,
    onset_mean_frames=8,
    clip=200,
    hop=4,
    window=8,
    class_names=("smooth", "rough<b>"),
    volt_per_code=1e-3,
)
STAGE_COUNTS = {"sum": 1201, "feature": 1203, "state": 1305, "logit": 407, "decision": 509, "status": 11}


FROZEN = json.loads((Path(__file__).parents[1] / "eskin/frozen_results.json").read_text())
"""Results of the verbs, rows that add no key left out."""


def recordings(count: int = 12) -> Recordings:
    """Recordings with an onset each, in two groups."""
    made = random_recordings(CONFIG, [300] * count, seed=3)
    return dataclasses.replace(
        made,
        source="made-up <set>",
        groups={"person": np.arange(count) // 4},
        volt_per_code=CONFIG.sensor.volt_per_code,
    )


def some(kind: type[Result], **fields: Any) -> Any:
    """A part of a result with some fields alone."""
    return kind.model_construct(**fields)


def but(result: Result, **fields: Any) -> Any:
    """``result`` with other fields."""
    return result.model_copy(update=fields)


def float_model() -> FloatModel:
    """A float network with random weights."""
    return random_float_model(CONFIG, 5)


def training_record(loaded: Recordings) -> Training:
    """A training record with two splits."""
    touches = pipeline.find_touches(CONFIG, loaded)
    times = step_times(CONFIG, touches)
    split = {
        "groups": ["person"],
        "folds": 3,
        "seeds": [0, 1, 2],
        "float_accuracy": 0.9731,
        "integer_accuracy": 0.9642,
        "agreement": 0.9913,
        "integer_spread": 0.0234,
        "standard_error": 0.021,
        "range": [0.75, 1.0],
        "integer_by_seed": [0.9642],
        "decision_time_s": 0.25,
        "per_step": [
            {
                "step": k + 1,
                "time_s": float(time),
                "float_accuracy": 0.5 + 0.09 * k,
                "integer_accuracy": 0.5 + 0.08 * k,
            }
            for k, time in enumerate(times)
        ],
        "per_fold": [
            {
                "held_out": "person 0",
                "recordings": 4,
                "integer_accuracy": 0.75,
                "float_accuracy": 0.8,
                "agreement": 0.9,
            }
        ],
        "confusion": [[17, 1, 0], [0, 15, 3]],
    }
    return Training(
        seed=0,
        recipe={"name": "onset"},
        data=loaded.source,
        recordings=len(loaded),
        parameters=CONFIG.parameter_count,
        ranges=range_records(CONFIG, profile(float_model(), touches)),
        versions={"torch": "9.8.7"},
        cross_validation=[split, {**split, "groups": [], "integer_accuracy": 0.8877}],
    )


def evaluation(count: int, *, agreement: float = 0.9954, integer: float = 0.9844) -> Evaluation:
    """What eskin.training.evaluate says."""
    return Evaluation.model_validate(
        FROZEN["evaluate"]
        | dict(
            recordings=count,
            float_accuracy=0.9857,
            integer_accuracy=integer,
            agreement=agreement,
            logit_error=LogitError(mean=0.0432, max=0.98, stage="accumulators"),
            not_touched=2,
            partial=0,
            chance=0.5,
            class_names=CONFIG.network.class_names,
            source="made-up <set>",
            passed=integer >= 0.9757 and agreement >= 0.98,
        )
    )


def cosimulation(
    count: int, *, pace: str = "full", clock_hz: float = 12e6, mismatches: int = 0, missed: str = ""
) -> Played:
    """What eskin.cosim.flow says."""
    names = ("step",) if pace == "full" else ("frame", "step", "decision")
    rows = [(name, 8e-3, 97 / clock_hz, name != missed, False) for name in names] + [
        ("reference: LSTM on a GPU", 5e-3, 6e-3, False, True)
    ]
    fields = ("name", "limit_s", "measured_s", "met", "reference")
    stages = {stage: {"compared_values": n, "mismatches": 0} for stage, n in STAGE_COUNTS.items()}
    stages["state"]["mismatches"] = mismatches
    return Played.model_validate(
        FROZEN["cosim"]
        | dict(
            recordings=count,
            cocotb_recordings=count,
            bulk_recordings=0,
            frames=300 * count,
            steps=5 * count,
            decisions=6 * count,
            simulated_cycles=123456,
            compared_values=sum(STAGE_COUNTS.values()),
            mismatches=mismatches,
            stages=stages,
            bit_exact=not mismatches,
            verdict="differs" if mismatches else "bit-exact",
            clock_hz=clock_hz,
            cycles=Cycles(
                frame_max=16, step_min=91, step_max=97, step_ideal=CONFIG.step_ideal, decision_latency_max=73
            ),
            cycles_per_s=82304,
            pace=pace,
            budgets=[dict(zip(fields, row, strict=True), margin_s=row[1] - row[2]) for row in rows],
            mismatch_list=[f"recording 3, stage state: number {i}" for i in range(mismatches)],
            passed=not mismatches and not missed,
        )
    )


def make_result(folder: Path) -> Path:
    """Every file of a result but the page."""
    loaded = recordings()
    model = random_integer_model(CONFIG, seed=2)
    float_model().save(folder / "model", training_record(loaded))
    model.save(folder / "model")
    write_json(folder / "evaluate.json", evaluation(len(loaded)))
    write_json(folder / "cosim.json", cosimulation(10))
    write_json(folder / "cosim_declared.json", cosimulation(2, pace="declared"))
    write_json(folder / "cosim_lowest.json", cosimulation(3, pace="declared", clock_hz=711e3))
    run = {
        "data": {
            "source": loaded.source,
            "recordings": len(loaded),
            "frames": loaded.frames,
            "taxels": 4,
            "sample_rate_hz": 500.0,
            "sha256": "abc123",
            "classes": {"smooth": 6, "rough<b>": 6},
            "groups": {"person": 3},
            "lengths": {"min": 300, "median": 300.0, "max": 300},
        },
        "configuration": {"name": "made", "reasons": ["made for a test"]},
        "cosimulated": [0, 1],
        "passed": True,
        "lowest_clock_hz": 711e3,
        "checks": [{"name": "hardware equals model", "held": True, "detail": "0 mismatches"}],
        "power": power_of(model.config),
        "parts": parts_of(model),
        "timings": [{"stage": "training", "wall_s": 12.3, "cached": False}],
        "wall_s": 20.0,
    }
    write_json(folder / "run.json", run)
    return folder


def edit(path: Path, **changes: Any) -> None:
    """Change fields of a JSON file; None takes a field out."""
    value = json.loads(path.read_text())
    for field, content in changes.items():
        if content is None:
            del value[field]
        else:
            value[field] = content
    path.write_text(json.dumps(value))
