"""`eskin enrol --evaluate`: every seed a piece of work of its own, its rows kept by content."""

import dataclasses
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from eskin.choose.choose_front_end import configure
from eskin.golden.core import AcceleratorConfig, Jobs, Memo, Record, code_version, content_key
from eskin.golden.data import Recordings
from eskin.golden.model import with_network
from eskin.teach import enrol
from eskin.teach.enrol import Question
from eskin.training import LEARNING
from eskin.verbs.cost import CODE as COST
from eskin.verbs.cost import market

CACHE = Path("build/enrolments")
"""Finished seeds by content, safe to delete."""
CODE = partial(code_version, *LEARNING, *COST)


def judge(recordings: Recordings, question: Question) -> list[Record]:
    """The rows of one seed; in a worker."""
    return enrol.judge(recordings, question)


def choose(shared: tuple[Recordings, list[str], Record], values: dict[str, np.ndarray]) -> list[Record]:
    """The configuration chosen without each value's recordings; in a worker."""
    recordings, group, network = shared
    configs = enrol.front_ends_without(recordings, values, group, market(), **network)
    return [config.to_dict() for config in configs]


def evaluate(
    recordings: Recordings,
    config: AcceleratorConfig | None,
    *,
    group: Sequence[str],
    ks: Sequence[int] = (1, 2, 5),
    layers: enrol.Layers = "all",
    old: bool = True,
    draw: enrol.Draw = "random",
    cell: str | None = None,
    reset: str | None = None,
    hidden: int | None = None,
    seed: int = 0,
    seeds: int = 3,
    readout: str = "dense",
    new_class: bool = False,
    jobs: Jobs,
    cache: Path = CACHE,
) -> Record:
    """What enrolment brings on each value of ``group``, left out of the first training
    (``eskin.teach.enrol.judge``).

    Parameters
    ----------
    config:
        Front end and network; None: the front end is chosen for each value without its recordings, the
        network GRU 12.
    old:
        Enrol with the recordings of the first training; False: with the new touches alone.
    draw:
        Which touches are enrolled: drawn at ``random`` by the seed, or the ``first`` of each class in the
        archive.
    seed, seeds:
        First seed, number of seeds.
    readout:
        ``dense``: trained on; ``prototypes``: taught, of no touch too.
    new_class:
        With prototypes and a ``config``: each class in turn is what no network knows, in place of each value.
    jobs:
        Where the seeds are judged.

    Returns
    -------
    ``eskin.teach.enrol.summary``, with seeds, layers, old, setting, set_aside, data, wall_s.

    Raises
    ------
    InputError
        A group that is not there or has too few recordings; before anything is trained.
    """
    begin = time.perf_counter()
    values = enrol.group_values(recordings, group, (0,) if new_class else ks)
    content, keep = content_key(CODE(), recordings, list(group)), Memo(cache)
    network: Record = {"cell": cell, "reset": reset, "hidden": hidden}
    if config is not None:
        configs = [with_network(configure(recordings, config, market()).config, **network)] * len(values)
    else:
        pieces = {content_key(content, network): values}
        (chosen,) = jobs.results(
            choose, pieces, (recordings, list(group), network), keep=keep, what="front ends chosen"
        ).values()
        configs = [AcceleratorConfig.from_dict(fields) for fields in chosen]
    numbers = list(range(seed, seed + seeds))
    options = (tuple(sorted(set(ks))), layers, old, draw)
    kinds = () if readout == "dense" else (readout,) + ("new class",) * new_class
    plain = [configuration.to_dict() for configuration in configs]
    questions = {
        content_key(content, options, plain, number, *kinds): Question(
            tuple(group), *options, tuple(configs), number, readout, new_class
        )
        for number in numbers
    }
    judged = list(jobs.results(judge, questions, recordings, keep=keep, what="seeds judged").values())
    result = enrol.summary(group, layers, old, judged, readout)
    return result | {
        "readout": readout,
        "new_class": new_class,
        "seeds": numbers,
        "layers": layers,
        "old": old,
        "draw": draw,
        "setting": dataclasses.asdict(enrol.SETTINGS[layers, old]),
        "set_aside": enrol.SET_ASIDE,
        "data": str(recordings.source),
        "wall_s": time.perf_counter() - begin,
    }
