"""Adapt a model to a new mounting, person or position with a few touches; the bitstream stays.

Example: eskin enrol model --data few.npz --out model2 --with recordings.npz, or eskin enrol model --teach
few.npz --out model2, or eskin enrol --evaluate --data recordings.npz --group seq -k 1,2

Of --evaluate each seed is a job, its rows cached by content.
"""

import time
from dataclasses import asdict, fields
from functools import partial
from pathlib import Path

from eskin.cli.common import (
    CONFIG,
    DATA,
    JsonOptions,
    argument,
    load_data,
    option,
    progress_bars,
    recordings_for,
    show,
)
from eskin.golden.core import AcceleratorConfig, InputError, Record, Result, content_key
from eskin.golden.core.groups import Readout
from eskin.golden.model import check_model_target, load_config
from eskin.jobs import Jobs
from eskin.memo import Memo, code_version
from eskin.training import LEARNING
from eskin.training.settings import GroupSettings
from eskin.verbs.cost import CODE as COST
from eskin.verbs.cost import cost_model

ENROL_MODES = {
    "evaluate": (("evaluate", "data", "group"), ("readout", "k", "config", "seeds")),
    "teach": (("model", "teach", "out"), ()),
    "train": (("model", "data", "out"), ("with_",)),
}
"""Options of `eskin enrol`: what each mode needs, and what else it takes."""


class EnrolRequest(GroupSettings, JsonOptions):
    model: Path | None = argument("A quantised model folder; it is not changed.", None)
    data: str | None = option(f"Touches to train on, 1 to 5 per class; with --evaluate all. {DATA}")
    out: Path | None = option("Folder of the enrolled model: new, or an earlier model to replace.")
    with_: str | None = option(
        "Recordings of the first training, so that they are not forgotten.", None, "--with", metavar="D"
    )
    teach: str | None = option(
        "Touches to store as prototypes; nothing is trained.", None, "--teach", metavar="FEW"
    )
    evaluate: bool = option(
        "Report the gain for each value of --group left out of the training.", False, "--evaluate"
    )
    readout: Readout = option("With --evaluate: dense trains further, prototypes stores touches.", "dense")
    group: str | None = option("With --evaluate: group arrays A[,B..], such as mounting or person.")
    k: str = option("With --evaluate: touches to enrol per class.", "1,2,5", "-k", metavar="K[,K..]")
    config: str | None = option(f"With --evaluate. {CONFIG}")
    seeds: int = option("With --evaluate: number of seeds.", 3, min=1, max=1000)

    def check(self, mode: str) -> None:
        """Refuse what a mode (evaluate, teach, train) lacks, and what another mode takes."""
        needs, takes = ENROL_MODES[mode]
        for each in fields(self):
            given, name = getattr(self, each.name) != each.default, each.name.strip("_")
            where = f"eskin enrol{'' if mode == 'train' else f' --{mode}'}, {'MODEL' if name == 'model' else f'--{name}'}"
            if each.name in needs and not given:
                raise InputError(
                    f"{where}: is missing; give {', '.join(needs)}, or another mode (--evaluate, --teach FEW)"
                )
            if given and each.name not in (*needs, *takes, "json"):
                raise InputError(f"{where}: belongs to another mode; leave it out")

    @property
    def ks(self) -> list[int]:
        """The numbers of ``k``."""
        counts = [word.strip() for word in self.k.split(",")]
        if not all(word.isdecimal() and len(word) < 4 and 1 <= int(word) <= 100 for word in counts):
            raise InputError(
                f"-k {self.k[:40]}: is not a list of touches per class; give numbers from 1 to 100, such as 1,2,5"
            )
        return [int(word) for word in counts]


def command(request: EnrolRequest) -> Record | Result:
    mode = "evaluate" if request.evaluate else "teach" if request.teach is not None else "train"
    request.check(mode)
    if request.evaluate:
        result = evaluate(request)
        show("enrolments", **result)
        return result
    from eskin.teach.enrol import enrol, teach_folder

    assert request.model and request.out
    check_model_target(request.out)
    config = load_config(request.model)
    few = recordings_for(request.data or request.teach, config)
    old = recordings_for(request.with_ or None, config)
    if request.teach is not None:
        taught = teach_folder(request.model, few, request.out)
        show("teach", **dict(taught), out=request.out)
        return taught
    with progress_bars() as report:
        enrolled = enrol(request.model, few, request.out, old=old, progress=partial(report, "enrolment"))
    show("enrol", **dict(enrolled), out=request.out)
    return enrolled


CACHE = Path("build/enrolments")
"""Finished seeds by content, safe to delete."""
CODE = partial(code_version, *LEARNING, *COST)


def evaluate(request: EnrolRequest) -> Record:
    """Benefit of enrolment for each value of the requested groups, left out of the first training
    (``eskin.teach.enrol.judge``).

    Without a configuration the front end is chosen for each value without its recordings, and the network is GRU 12.
    Returns ``eskin.teach.enrol.summary``, with seeds, readout, setting, set_aside,
    data, wall_s.

    Raises
    ------
    InputError
        A group that is not there or has too few recordings; before anything is trained.
    """
    from eskin.choose.choice import configure
    from eskin.teach import enrol as evaluation

    begin = time.perf_counter()
    recordings, config = load_data(request.data or "", request.config)
    group, ks = tuple(request.groups or ()), sorted({*request.ks})
    values = evaluation.group_values(recordings, group, ks)
    content, keep, prices = content_key(CODE(), recordings, [*group]), Memo(CACHE), cost_model()
    with progress_bars() as progress:
        if config is not None:
            configs = [configure(recordings, config, prices).config] * len(values)
        else:
            progress("choosing front ends without each part", 0, 0)
            without = partial(evaluation.front_ends_without, recordings, values, group, prices)
            chosen = keep.remembered(content, lambda: [config.to_dict() for config in without()])
            configs = [AcceleratorConfig.from_dict(fields) for fields in chosen]
        plain = [config.to_dict() for config in configs]
        questions = {
            content_key(content, tuple(ks), plain, seed, request.readout): evaluation.EnrolmentTrial(
                group, tuple(ks), tuple(configs), seed, request.readout
            )
            for seed in range(request.seeds)
        }
        jobs = Jobs(progress=progress, version=CODE)
        judged = jobs.results(evaluation.judge, questions, recordings, keep=keep, what="seeds judged")
    return evaluation.summary(group, [*judged.values()]) | {
        "readout": request.readout,
        "seeds": [*range(request.seeds)],
        "setting": asdict(evaluation.SETTINGS[True]),
        "set_aside": evaluation.SET_ASIDE,
        "data": str(recordings.source),
        "wall_s": time.perf_counter() - begin,
    }
