"""`eskin baselines`: other methods on the same recordings, finished runs kept by content."""

import json
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from eskin.golden.core import (
    AcceleratorConfig,
    Jobs,
    Memo,
    Progress,
    Record,
    check_target,
    code_version,
    write_json,
)
from eskin.golden.data import Recordings
from eskin.study import baselines
from eskin.training import LEARNING
from eskin.training.splits import default_splits, split_folds

CACHE = Path("build/baseline_runs")
"""Finished runs by content, safe to delete."""
CODE = partial(code_version, *LEARNING)
RESULT = "baselines.json"


def run(
    recordings: Recordings,
    config: AcceleratorConfig,
    *,
    methods: Sequence[baselines.Method] = tuple(baselines.METHODS.values()),
    group: Sequence[str] | None = None,
    folds: int = 5,
    seeds: int = 3,
    out: Path,
    workers: int | None = None,
    dask: str | None = None,
    progress: Progress | None = None,
) -> Record:
    """Judge the methods on every split and write baselines.json into ``out``.

    Parameters
    ----------
    config:
        The front end that finds the touches.
    group:
        Group names of the one split; None: every split that the configuration names.
    workers, dask, progress:
        As for ``eskin.golden.core.jobs.Jobs``.

    Returns
    -------
    As `eskin.study.baselines.results`, with wall_s.

    Raises
    ------
    InputError
        A folder or a group that cannot be used, before anything is trained.
    """
    begin = time.perf_counter()
    check_target(out / RESULT)
    splits = default_splits(recordings, config) if group is None else [list(group)]
    for groups in splits:
        split_folds(recordings, groups, folds, None)
    result = baselines.results(
        recordings,
        config,
        splits,
        methods=methods,
        folds=folds,
        seeds=range(seeds),
        jobs=Jobs(workers=workers, dask=dask, progress=progress, version=CODE),
        keep=Memo(CACHE),
        version=json.dumps([recordings.content, CODE()]),
    )
    result["wall_s"] = time.perf_counter() - begin
    write_json(out / RESULT, result)
    return result
