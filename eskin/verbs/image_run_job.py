"""`eskin run` on images: the stages of the main job that networks for images have."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

from eskin.golden.core.files import write_json
from eskin.golden.data.recordings import Recordings
from eskin.golden.model.model import IntegerModel, load_training
from eskin.golden.training import evaluate
from eskin.rtl.program.image_passes import plan_of
from eskin.verbs.flow import cosimulate
from eskin.verbs.generate_job import generate_design

COSIMULATED = 44
"""Images that are co-simulated without a wish, evenly over the classes."""


class Steps(Protocol):
    """What of the main job's stages is used here."""

    recordings: Recordings
    timings: list[dict[str, Any]]
    base: list[Any]

    def stage(self, name: str, packages: tuple[str, ...], options: Any, make: Callable[[Path, Any], None]) -> Path: ...
    def _train(self, folder: Path, notify: Any) -> None: ...
    def _quantise(self, trained: Path, folder: Path) -> None: ...
    def _evaluate(self, quantised: Path, folder: Path, notify: Any) -> None: ...
    def _test(self, quantised: Path) -> dict[str, Any] | None: ...
    def _data(self) -> dict[str, Any]: ...


def image_stages(steps: Steps, count: int | None, result: Path, begin: float) -> dict[str, Any]:
    """Run every stage on images, co-simulating ``count`` of them (None: COSIMULATED), and fill ``result`` with all but the page. The
    record, as in run.json: data, configuration, candidates, warnings, test, cosimulated, layer_cycles (number of a layer -> cycles, with
    those of the pool behind), checks, passed, timings, wall_s, ``images``."""
    trained = steps.stage("training", ("golden",), None, steps._train)
    quantised = steps.stage("quantisation", ("golden",), None, lambda folder, _: steps._quantise(trained, folder))
    model, training = IntegerModel.load(quantised / "model", images=True), load_training(quantised / "model")
    evaluated = steps.stage("evaluation", ("golden",), None, lambda folder, notify: steps._evaluate(quantised, folder, notify))
    tested = steps._test(quantised)
    numbers = steps.recordings.evenly(count or COSIMULATED)
    played = steps.recordings.subset(numbers)

    def simulate(folder: Path, notify: Any) -> None:
        move = lambda done, total: notify("simulated frames", done, total)  # noqa: E731
        outcome = cosimulate(model, played, numbers=numbers.tolist(), work=folder / "work", progress=move)
        if outcome["waves"]:
            shutil.copytree(outcome["waves"], folder / "waves")
            outcome["waves"] = "waves"
        write_json(folder / "result.json", outcome)
        shutil.rmtree(folder / "work")

    generated = steps.stage("Verilog", ("golden", "rtl"), None, lambda folder, _: _generate(model, folder, played))
    simulated = steps.stage("co-simulation", ("golden", "rtl", "cosim"), list(map(int, numbers)), simulate)

    shutil.rmtree(result, ignore_errors=True)
    result.mkdir()
    shutil.copytree(quantised / "model", result / "model")
    shutil.copytree(generated / "rtl", result / "rtl")
    shutil.copyfile(evaluated / "evaluate.json", result / "evaluate.json")
    outcome = json.loads((simulated / "result.json").read_text())
    if outcome["waves"]:
        shutil.copytree(simulated / "waves", result / "waves_cosim")
        outcome["waves"] = "waves_cosim"
    write_json(result / "cosim.json", outcome)
    checks = _checks(json.loads((evaluated / "evaluate.json").read_text()), outcome)
    record = {
        "images": True,
        "data": steps._data(),
        "configuration": {"name": model.config.name, "reasons": training.get("reasons", [])},
        "candidates": training.get("candidates"),
        "baselines": [],
        "warnings": _warnings(training, tested),
        "test": tested,
        "cosimulated": [int(number) for number in numbers],
        "layer_cycles": {str(one.number): one.cycles(model.config.hardware.lanes) for one in plan_of(model.config).passes},
        "checks": checks,
        "passed": all(check["held"] for check in checks),
        "timings": steps.timings,
        "wall_s": round(time.perf_counter() - begin, 3),
    }
    write_json(result / "run.json", record)
    return record


def _generate(model: IntegerModel, folder: Path, played: Recordings) -> None:
    generate_design(model, folder / "rtl", recordings=played)


def _warnings(training: dict[str, Any], tested: dict[str, Any] | None) -> list[str]:
    found = list(training.get("warnings", []))
    if tested and tested["seen_in_training"]:
        found.append(
            f"{tested['seen_in_training']} of the {tested['recordings']} images held back are in the training data too, so their figure "
            "says little: give --test images that are not in --data"
        )
    return found


def _checks(evaluated: dict[str, Any], outcome: dict[str, Any]) -> list[dict[str, Any]]:
    """What exit status 0 stands for: {name, held, detail} each."""
    integer, ideal, agreement = (f"{100 * evaluated[key]:.2f} %" for key in ("integer_accuracy", "float_accuracy", "agreement"))
    detail = f"integer {integer}, float {ideal} on the training data, agreement {agreement}"
    missed = [row["name"] for row in outcome["budgets"] if not row["reference"] and not row["met"]]
    compared = f"{outcome['compared_values']} values compared, {outcome['mismatches']} mismatches"
    return [
        {"name": "integer network decides as the float one", "held": evaluate.held(evaluated), "detail": detail},
        {"name": "hardware equals model", "held": outcome["bit_exact"], "detail": compared},
        {"name": "latency budgets", "held": not missed, "detail": f"missed: {', '.join(missed)}" if missed else "all met"},
    ]
