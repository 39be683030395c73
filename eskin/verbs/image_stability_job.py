"""The failure modes of a network for images, `eskin stability`: judged by the golden model, the weakest cases played into the hardware."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from eskin.golden.core.errors import InputError
from eskin.golden.core.files import check_target, write_json
from eskin.golden.core.jobs import Jobs
from eskin.golden.core.memo import Memo, code_version, content_key
from eskin.golden.data.recordings import Recordings
from eskin.golden.model.model import IntegerModel
from eskin.golden.stability import suite
from eskin.golden.stability.images import IMAGE_MODES, ImageBench
from eskin.pages.stability_page import PAGE, write_page
from eskin.verbs import flow
from eskin.verbs.stability_job import CACHE, CODE, CONFIRMED, RESULT, play_case


def judge_image_mode(bench: ImageBench, name: str) -> dict[str, Any]:
    """The record of one mode."""
    return suite.judge(IMAGE_MODES[name], bench)[0]


def run(
    model_dir: Path,
    recordings: Recordings,
    *,
    out: Path,
    names: Sequence[str] | None = None,
    cosim: bool = True,
    few: int = 100,
    workers: int | None = None,
    dask: str | None = None,
    cache: Path = CACHE,
    simulator: str = "verilator",
    progress: Callable[[str, int, int], None] | None = None,
    **bench_options: Any,
) -> dict[str, Any]:
    """Run the modes on a model of images and write stability.json and stability.html; parameters and result as for
    `eskin.verbs.stability_job.run`, without defences, which networks for images have none of.

    Raises
    ------
    InputError
        A folder that is no quantised model of images, or an unknown mode.
    """
    begin = time.perf_counter()
    for name in (RESULT, PAGE):
        check_target(out / name)
    for name in names or ():
        if name not in IMAGE_MODES:
            raise InputError(f"stability, mode '{name}': is unknown for images; the modes are {', '.join(IMAGE_MODES)}")
    bench = ImageBench(IntegerModel.load(model_dir, images=True), recordings, few=few, **bench_options)
    keep = Memo(cache)
    content = content_key(bench.model, recordings, code_version("golden"), [few, bench.flips, bench.seed])
    jobs = Jobs(workers=workers, dask=dask, progress=progress, version=CODE)
    pieces = {content_key(content, name): name for name in names or IMAGE_MODES}
    modes = list(jobs.results(judge_image_mode, pieces, bench, keep=keep, what="modes judged").values())
    playable = [record for record in suite.weakest(modes, len(modes)) if record["has_case"]][:CONFIRMED] if cosim else []
    for number, weak in enumerate(playable):
        if progress:
            progress("weakest cases co-simulated", number, len(playable))
        key = content_key(content, code_version("rtl", "cosim"), weak["name"])
        played = keep.remembered(key, partial(_played, bench, weak["name"], key, simulator))
        next(record for record in modes if record["name"] == weak["name"])["rtl"] = played
    passed = all(record["passed"] and (not record["rtl"] or record["rtl"]["bit_exact"]) for record in modes)
    result = {
        "model": str(model_dir),
        "data": str(recordings.source),
        "recordings": len(recordings),
        "clean_accuracy": bench.clean_accuracy,
        "modes": modes,
        "not_run": [],
        "weakest": [record["name"] for record in suite.weakest(modes)],
        "defences": [],
        "passed": passed,
        "wall_s": round(time.perf_counter() - begin, 3),
    }
    write_json(out / RESULT, result)
    write_page(out, result)
    return result


def _played(bench: ImageBench, name: str, key: str, simulator: str) -> dict[str, Any]:
    _, case = suite.judge(IMAGE_MODES[name], bench)
    assert case is not None  # its record says that it has one
    return play_case(bench, case, flow.BUILD / "stability" / key[:16], simulator)
