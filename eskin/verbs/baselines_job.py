"""`eskin baselines`: every method on every split a piece of work of its own, its runs kept by content."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from eskin.choose.choose_front_end import configure
from eskin.golden.core import (
    AcceleratorConfig,
    InputError,
    Jobs,
    Memo,
    Progress,
    Record,
    check_target,
    code_version,
    content_key,
    replacing,
    write_json,
)
from eskin.golden.data import Recordings
from eskin.pages.baselines_chart import chart
from eskin.rtl.views.schedule_view import save_figure
from eskin.study.baselines import judge as judging
from eskin.study.baselines.judge import Judging
from eskin.study.baselines.registry import METHODS, choose_methods
from eskin.study.baselines.rows import nearest, orders, row_of
from eskin.study.baselines.scene import Scene, array_shape
from eskin.study.baselines.transfer import LEARNT_NOT, read_weights
from eskin.training import LEARNING
from eskin.training.splits import check_split, default_splits
from eskin.verbs.cost import CODE as COST
from eskin.verbs.cost import market

CACHE = Path("build/baseline_runs")
"""Finished runs by content, safe to delete."""
CODE = partial(code_version, *LEARNING)
RESULT, CHART = "baselines.json", "baselines"
COMMON = ("golden", "data", "training", "choose")
"""What every run depends on, beside ``eskin/study/baselines/judge.py``, ``scene.py`` and the file of its
family."""
FILES: dict[str, tuple[str, ...]] = {
    "ours": ("recurrent",),
    "thesis": ("recurrent",),
    "simple": ("simple",),
    "tensor": ("tensor", "simple"),
    "tiles": ("tiles",),
    "transfer": ("transfer", "tiles"),
}
"""Modules of ``eskin/study/baselines`` by family: another method there trains only its own family again."""


@dataclass(frozen=True, eq=False)
class Shared:
    """What all pieces see: recordings, front end, shape of the array, weights of a pretrained network."""

    recordings: Recordings
    config: AcceleratorConfig
    shape: tuple[int, int]
    weights: dict[str, np.ndarray] | None = None


@lru_cache(maxsize=1)
def _scene(shared: Shared) -> Scene:
    return Scene.of(shared.recordings, shared.config, shared.shape, shared.weights)


def judge(shared: Shared, piece: Judging) -> Record:
    """One piece, in a worker, which finds the touches once."""
    return judging.judge(_scene(shared), piece)


def front_end(
    recordings: Recordings,
    user_config: AcceleratorConfig | None,
    group: Sequence[str] | None,
    folds: int,
    cache: Path,
    progress: Progress | None,
) -> tuple[AcceleratorConfig, list[str]]:
    """The front end asked for, or the one chosen by evidence, which is kept too; and the reasons."""
    if user_config is not None:
        choice = configure(recordings, user_config, market(), groups=group, folds=folds, progress=progress)
        return choice.config, list(choice.reasons)
    key = content_key(
        "front end", code_version(*COMMON, *COST), recordings, None if group is None else list(group), folds
    )

    def choose() -> Record:
        choice = configure(recordings, None, market(), groups=group, folds=folds, progress=progress)
        return {"config": choice.config.to_dict(), "reasons": list(choice.reasons)}

    choice = Memo(cache).remembered(key, choose)
    return AcceleratorConfig.from_dict(choice["config"]), choice["reasons"]


def keys_of(pieces: Sequence[Judging], shared: Shared) -> dict[str, Judging]:
    """The name of each piece's result: data, front end, shape, what is asked, and the code that it runs
    through."""
    common = [code_version(*COMMON), shared.recordings, shared.config.to_dict(), list(shared.shape)]
    code = {}
    for family, modules in FILES.items():
        code[family] = code_version(
            *(f"study/baselines/{name}.py" for name in ("judge", "scene", "method", *modules))
        )
    if shared.weights is not None:
        code["transfer"] += content_key(*(part for named in shared.weights.items() for part in named))
    keys = [
        content_key(
            *common,
            code[piece.method.family],
            piece.method.name,
            list(piece.groups),
            list(piece.seeds),
            piece.folds,
        )
        for piece in pieces
    ]
    return dict(zip(keys, pieces, strict=True))


def run(
    recordings: Recordings,
    user_config: AcceleratorConfig | None = None,
    *,
    methods: Sequence[str] | None = None,
    group: Sequence[str] | None = None,
    folds: int = 5,
    seed: int = 0,
    seeds: int = 3,
    shape: str | None = None,
    weights: str | Path | None = None,
    full: bool = False,
    out: Path,
    workers: int | None = None,
    dask: str | None = None,
    cache: Path = CACHE,
    progress: Progress | None = None,
) -> Record:
    """Judge the methods on every split; write baselines.json and the chart into ``out``.

    Parameters
    ----------
    methods:
        Names or families; None: every one that is not only for ``full``.
    group:
        Group names of the one split; None: every split that the configuration names.
    shape, weights:
        Rows and columns of the array (``4x4``); a file for ``dcnn``
        (``eskin.study.baselines.transfer.read_weights``).
    full:
        Every number of windows, and every seed for methods that are otherwise judged with one.
    seed, seeds, folds:
        First seed, number of seeds, folds of each split.

    Returns
    -------
    As in baselines.json: rows (``eskin.study.baselines.rows.row_of``), nearest, orders, left_out (method,
    split, reason), notes, reasons,
        data, recordings, classes, shape, config, seeds, folds, wall_s.

    Raises
    ------
    InputError
        Before anything is trained: an unknown method or group, too few recordings for the folds, a shape of
        other taxels, another network's weights.
    """
    begin = time.perf_counter()
    check_target(out / RESULT)
    names = choose_methods(methods, full)
    arrays = None if weights is None else read_weights(weights)
    if group is not None:
        check_split(recordings, group, folds)
    config, reasons = front_end(recordings, user_config, group, folds, cache, progress)
    splits = [list(group)] if group is not None else default_splits(recordings, config)
    for groups in splits:
        check_split(recordings, groups, folds)
    shared = Shared(recordings, config, array_shape(config, shape), arrays)
    every = tuple(range(seed, seed + seeds))
    pieces = []
    for method in (METHODS[name] for name in names):
        of_method = every[:1] if method.one_seed and not full else every
        pieces += [Judging(method, tuple(groups), of_method, folds) for groups in splits]
    jobs = Jobs(workers=workers, dask=dask, progress=progress, version=CODE)
    outcomes = jobs.results(judge, keys_of(pieces, shared), shared, keep=Memo(cache), what="methods judged")
    rows, left_out = [], []
    for piece, outcome in zip(pieces, outcomes.values(), strict=True):
        if "refused" in outcome:
            split = " and ".join(piece.groups) or "recordings"
            left_out.append({"method": piece.method.name, "split": split, "reason": outcome["refused"]})
        else:
            rows.append(row_of(piece.method, piece.groups, outcome["runs"]))
    if not rows:
        raise InputError(
            f"baselines: no method can be judged on these recordings; the first says: {left_out[0]['reason']}"
        )
    by_split = [[row for row in rows if row["groups"] == groups] for groups in splits]
    result = {
        "rows": rows,
        "nearest": [nearest(same_split) for same_split in by_split if same_split],
        "orders": [order for same_split in by_split for order in orders(same_split)],
        "left_out": left_out,
        "notes": [LEARNT_NOT] if "dcnn" in names and arrays is None else [],
        "reasons": reasons,
        "data": str(recordings.source),
        "recordings": len(recordings),
        "classes": len(recordings.class_names),
        "shape": list(shared.shape),
        "config": config.to_dict(),
        "seeds": list(every),
        "folds": folds,
        "wall_s": time.perf_counter() - begin,
    }
    figure = chart(result)
    for kind in ("png", "svg"):
        with replacing(out / f"{CHART}.{kind}") as temporary:
            save_figure(figure, kind)(temporary)
    write_json(out / RESULT, result)
    return result
