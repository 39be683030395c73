"""`eskin baselines`: other methods on the same recordings, finished runs kept by content."""

import json
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from eskin.golden.core import AcceleratorConfig, Progress, Record, check_target, write_json
from eskin.golden.data import Recordings
from eskin.jobs import Jobs
from eskin.memo import Memo, code_version
from eskin.requests import BaselinesRequest
from eskin.study import baselines
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
    methods: Sequence[baselines.Method] = tuple(baselines.METHODS.values()),
    folds: int = 5,
    seeds: int = 3,
    progress: Progress | None = None,
) -> Record:
    """Judge the methods on every split, ``folds`` each and ``seeds`` runs of a fold, and write baselines.json.

    ``config``: the front end that finds the touches. Without groups every split that it names is judged.
    Returns what `eskin.study.baselines.results` does, with wall_s.

    Raises
    ------
    InputError
        A folder or a group that cannot be used, before anything is trained.
    """
    begin = time.perf_counter()
    check_target(request.out / RESULT)
    splits = default_splits(recordings, config) if request.groups is None else [request.groups]
    for groups in splits:
        check_split(recordings, groups, folds)
    result = baselines.results(
        recordings,
        config,
        splits,
        methods=methods,
        folds=folds,
        seeds=range(seeds),
        jobs=Jobs(dask=request.dask, progress=progress, version=CODE),
        keep=Memo(CACHE),
        version=json.dumps([recordings.content, CODE()]),
    )
    result["wall_s"] = time.perf_counter() - begin
    write_json(request.out / RESULT, result)
    return result
