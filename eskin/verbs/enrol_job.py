"""`eskin enrol --evaluate`: one job per seed, its rows cached by content."""

import dataclasses
import time
from functools import partial
from pathlib import Path

from eskin.choose.choice import configure
from eskin.golden.core import AcceleratorConfig, Progress, Record, content_key
from eskin.golden.data import Recordings
from eskin.jobs import Jobs
from eskin.memo import Memo, code_version
from eskin.requests import EnrolRequest
from eskin.teach import enrol as evaluation
from eskin.training import LEARNING
from eskin.verbs.cost import CODE as COST
from eskin.verbs.cost import cost_model

CACHE = Path("build/enrolments")
"""Finished seeds by content, safe to delete."""
CODE = partial(code_version, *LEARNING, *COST)


def evaluate(
    request: EnrolRequest,
    recordings: Recordings,
    config: AcceleratorConfig | None,
    *,
    progress: Progress | None = None,
) -> Record:
    """Benefit of enrolment for each value of the requested groups, left out of the first training
    (``eskin.teach.enrol.judge``).

    ``config``: front end and network; None: the front end is chosen for each value without its recordings,
    the network GRU 12. Returns ``eskin.teach.enrol.summary``, with seeds, readout, setting, set_aside,
    data, wall_s.

    Raises
    ------
    InputError
        A group that is not there or has too few recordings; before anything is trained.
    """
    begin = time.perf_counter()
    group, ks = request.groups or [], request.ks
    values = evaluation.group_values(recordings, group, ks)
    content, keep = content_key(CODE(), recordings, list(group)), Memo(CACHE)
    jobs = Jobs(progress=progress, version=CODE)
    if config is not None:
        configs = [configure(recordings, config, cost_model()).config] * len(values)
    else:
        if progress:
            progress("choosing front ends without each part", 0, 0)
        without = partial(evaluation.front_ends_without, recordings, values, group, cost_model())
        chosen = keep.remembered(content, lambda: [one.to_dict() for one in without()])
        configs = [AcceleratorConfig.from_dict(fields) for fields in chosen]
    plain = [configuration.to_dict() for configuration in configs]
    ordered = tuple(sorted(set(ks)))
    questions = {
        content_key(content, ordered, plain, seed, request.readout): evaluation.EnrolmentTrial(
            tuple(group), ordered, tuple(configs), seed, request.readout
        )
        for seed in range(request.seeds)
    }
    judged = list(
        jobs.results(evaluation.judge, questions, recordings, keep=keep, what="seeds judged").values()
    )
    return evaluation.summary(group, judged) | {
        "readout": request.readout,
        "seeds": list(range(request.seeds)),
        "setting": dataclasses.asdict(evaluation.SETTINGS[True]),
        "set_aside": evaluation.SET_ASIDE,
        "data": str(recordings.source),
        "wall_s": time.perf_counter() - begin,
    }
