"""`eskin baselines`: other methods on the same recordings, finished runs kept by content."""

import itertools
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from eskin.golden.core import (
    AcceleratorConfig,
    InputError,
    Progress,
    Record,
    check_target,
    content_key,
    write_json,
)
from eskin.golden.data import Recordings
from eskin.jobs import Jobs
from eskin.memo import Memo, code_version
from eskin.requests import BaselinesRequest
from eskin.study.baselines import METHODS, Method, Scene, judge
from eskin.training import LEARNING
from eskin.training.splits import check_split, default_splits

CACHE = Path("build/baseline_runs")
"""Finished runs by content, safe to delete."""
CODE = partial(code_version, *LEARNING)
RESULT = "baselines.json"


def run(
    request: BaselinesRequest,
    recordings: Recordings,
    config: AcceleratorConfig,
    *,
    methods: Sequence[Method] = tuple(METHODS.values()),
    folds: int = 5,
    seeds: int = 3,
    progress: Progress | None = None,
) -> Record:
    """Judge the methods on every split, ``folds`` each and ``seeds`` runs of a fold, one job each, and write
    baselines.json.

    ``config``: the front end that finds the touches. Without groups every split that it names is judged.

    Returns
    -------
    rows (`judge`, best first within a split), left_out (method, split, reason), recordings, classes, config,
    seeds, folds, data, wall_s.

    Raises
    ------
    InputError
        A folder or a group that cannot be used, before anything is trained; or no method can be judged.
    """
    begin = time.perf_counter()
    check_target(request.out / RESULT)
    splits = default_splits(recordings, config) if request.groups is None else [request.groups]
    for groups in splits:
        check_split(recordings, groups, folds)
    content = [recordings.content, CODE(), config.to_dict(), seeds, folds]
    pieces = {
        content_key("baseline", *content, method.name, list(groups)): (method, groups, range(seeds), folds)
        for method, groups in itertools.product(methods, splits)
    }
    jobs, scene = Jobs(dask=request.dask, progress=progress, version=CODE), Scene.of(recordings, config)
    outcomes = jobs.results(judge, pieces, scene, keep=Memo(CACHE), what="methods judged")
    judged = list(zip(pieces.values(), outcomes.values(), strict=True))
    rows = [outcome for _, outcome in judged if "refused" not in outcome]
    left_out = [
        {"method": method.name, "split": " and ".join(groups) or "recordings", "reason": outcome["refused"]}
        for (method, groups, *_), outcome in judged
        if "refused" in outcome
    ]
    if not rows:
        raise InputError(
            f"baselines: no method works on these recordings; the first one reports: {left_out[0]['reason']}"
        )
    order = [list(groups) for groups in splits]
    result = {
        "rows": sorted(rows, key=lambda row: (order.index(row["groups"]), -row["accuracy"])),
        "left_out": left_out,
        "data": str(recordings.source),
        "recordings": len(recordings),
        "classes": len(recordings.class_names),
        "config": config.to_dict(),
        "seeds": seeds,
        "folds": folds,
        "wall_s": time.perf_counter() - begin,
    }
    write_json(request.out / RESULT, result)
    return result
