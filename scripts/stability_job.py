"""The failure-mode suite, `eskin stability`: golden finds where the method fails, co-simulation confirms the worst of it.

Every experiment's record is kept by the content of what went into it (recordings, model, code), so that an interrupted run goes on where it
stopped.
"""

from __future__ import annotations

import hashlib
import json
import re
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cosim import upsets as bench_upsets
from cosim.netlist import Hardware
from golden import defences, stability, stability_memory, stability_numeric, stability_sensor, stability_stream
from golden.config import PRESETS, AcceleratorConfig
from golden.files import check_target, write_json
from golden.model import FloatModel, IntegerModel
from golden.recordings import Recordings
from golden.stability import Bench, Case
from golden.stability_page import PAGE, write_page
from golden.train import default_splits
from rtl.generate import generate
from rtl.memory_map import Register
from scripts import flow
from scripts import upset_campaign as campaign_steps
from scripts.defence_cost import hardware_cost
from scripts.link_upsets import upset_link
from scripts.main_job import code_version, fingerprint

CACHE = Path("build/stability_records")
"""Finished experiments by content; safe to delete."""
RESULT, RECOMMENDED = "stability.json", "recommended.json"
CONFIRMED = 3
"""Golden cases of each group, the weakest modes first, that are played into the hardware."""
STREAMED = 3
"""Recordings of the modes that need the hardware."""

UPSETS = 600
"""Single upsets of flip-flops, and of memory bits, in simulation; the bench's ``flips`` where that is less."""

MODULES = (stability_numeric, stability_stream, stability_sensor, stability_memory)
"""Loading them registers their modes."""

Progress = Callable[[str, int, int], None]


def run(
    model_dir: Path,
    recordings: Recordings,
    *,
    out: Path,
    names: Sequence[str] | None = None,
    cosim: bool = True,
    compare: bool = True,
    few: int = 100,
    seeds: int = 3,
    cache: Path = CACHE,
    progress: Progress | None = None,
    **bench_options: Any,
) -> dict[str, Any]:
    """Run the suite and write stability.json, stability.html and recommended.json (the configuration with the recommended defences).

    Parameters
    ----------
    names:
        Only these modes; None: all.
    cosim:
        Confirm the weakest golden cases in co-simulation, and run the modes that need the hardware.
    compare:
        Train and judge the defences by cross-validation; with ``cosim``, what each costs in hardware too (``hardware`` of its record).
    few, bench_options:
        As for ``golden.stability.Bench``.
    seeds:
        Seeds of the comparison of defences.

    Returns
    -------
    The result, as in stability.json: model, data, recordings, clean_accuracy, modes, not_run, weakest (names), defences, wall_s, passed.

    Raises
    ------
    InputError
        A folder that is no quantised model, an unknown mode, recordings without a touch.
    """
    begin = time.perf_counter()
    for name in (RESULT, RECOMMENDED, PAGE):
        check_target(out / name)
    bench = Bench(IntegerModel.load(model_dir), FloatModel.load(model_dir), recordings, few=few, **bench_options)
    keep = _Records(cache, _content(bench))
    hardware = _Hardware(bench, keep, progress) if cosim else None
    cases: dict[str, Case] = {}
    found = stability.run_modes(
        bench, names=names, remembered=keep.remembered, cases=cases, hardware=hardware.mode if hardware else None, progress=progress
    )
    if hardware:
        _confirm(bench, found["modes"], cases, hardware, progress)
    splits = default_splits(recordings, bench.config)
    base = undefended(bench.config)
    rows = defences.variants(recordings, base) if compare else []
    compared, front_ends = [], {}
    steps = len(rows) * (2 if cosim else 1) + bool(cosim)

    def costed(record: dict[str, Any], config: AcceleratorConfig) -> dict[str, Any]:
        return {**record, "hardware": hardware.cost(config) if hardware else None}

    for number, row in enumerate(rows):
        options = json.dumps([splits, seeds, row.config.to_dict()])
        (record,) = keep.remembered(
            f"defences {row.name} {options}",
            lambda row=row: defences.compare_defences(recordings, [row], splits, range(seeds), front_ends=front_ends),
        )
        compared.append(record)
        if progress:
            progress("defences, cross-validated", number + 1, steps)
    chosen = defences.recommended(recordings, base).replace(checksum=True, watchdog=True)
    if compared:
        chosen = chosen.replace(margin_threshold=compared[-1]["margin"][0]["threshold"])
        # the class is offered all the same: the threshold changes no accuracy
        compared.append({**compared[-1], "name": f"the same, watchdog, checksum, unsure below a margin of {chosen.margin_threshold}"})
        for number, config in enumerate([*(row.config for row in rows), chosen]):
            compared[number] = costed(compared[number], config)
            if progress:
                progress("defences, in hardware", len(rows) + number + 1, steps)
    passed = all(record["passed"] and (not record["rtl"] or record["rtl"]["bit_exact"]) for record in found["modes"])
    passed &= all(record["hardware"] is None or record["hardware"]["bit_exact"] for record in compared)
    result = {
        "model": str(model_dir), "data": str(recordings.source), "recordings": len(recordings), "clean_accuracy": bench.clean_accuracy,
        **found, "defences": compared, "passed": passed, "wall_s": round(time.perf_counter() - begin, 3),
    }  # fmt: skip
    write_json(out / RECOMMENDED, chosen.to_dict())
    write_json(out / RESULT, result)
    write_page(out, result)
    return result


def undefended(config: AcceleratorConfig) -> AcceleratorConfig:
    """``config`` without its defences: what the comparison starts from. Where a defended one has a preset's name, its onset threshold and
    its hidden units are the preset's again."""
    plain = config.replace(
        fault_frames=0, fault_activity=0, onset_hits=1, onset_span=1, margin_threshold=0, checksum=False, watchdog=False
    )
    preset = PRESETS.get(config.name)
    if config.fault_frames and preset:
        plain = plain.replace(onset_threshold=preset.onset_threshold, hidden=preset.hidden)
    return plain


def _content(bench: Bench) -> str:
    """What every experiment's record depends on."""
    digest = hashlib.sha256()
    for model in (bench.model, bench.real):
        digest.update(model.config.to_json().encode())
        for name in sorted(model.arrays):
            digest.update(name.encode() + np.ascontiguousarray(model.arrays[name]).tobytes())
    options = [bench.few, bench.points, bench.long, bench.flips, bench.seed]
    digest.update(json.dumps([fingerprint(bench.recordings), code_version("golden"), options]).encode())
    return digest.hexdigest()


class _Records:
    """Finished records, a file each."""

    def __init__(self, folder: Path, content: str) -> None:
        self._folder, self._content = folder, content

    def remembered(self, name: str, make: Callable[[], Any]) -> Any:
        """The record of ``name``: the one that is kept, or ``make()``, which then is."""
        key = hashlib.sha256(json.dumps([self._content, name]).encode()).hexdigest()[:24]
        path = self._folder / f"{key}.json"
        try:
            return json.loads(path.read_text())
        except (OSError, ValueError):  # not made yet, or damaged: made again
            pass
        record = make()
        write_json(path, record)
        return record


# ---------------------------------------------------------------------- the hardware
class _Hardware:
    """Co-simulation for the suite, and what its designs cost."""

    def __init__(
        self, bench: Bench, keep: _Records, progress: Progress | None = None, *, work: Path = flow.BUILD / "stability",
        simulator: str = "verilator",
    ) -> None:  # fmt: skip
        self._bench, self._keep, self._progress, self._work, self._simulator = bench, keep, progress, work, simulator
        self._version = code_version("rtl", "cosim")

    def cost(self, config: AcceleratorConfig) -> dict[str, Any]:
        """What ``config`` costs (scripts.defence_cost)."""
        name = f"cost {self._version} {json.dumps(config.to_dict())}"
        return self._keep.remembered(name, lambda: hardware_cost(config, self._bench.recordings))

    def confirm(self, name: str, case: Case) -> dict[str, Any]:
        """Play a golden case; {bit_exact, recordings, compared_values, mismatches, probe}."""
        return self._keep.remembered(f"rtl {self._version} {name}", lambda: self._play(case))

    def _play(self, case: Case, **options: Any) -> dict[str, Any]:
        result = flow.cosimulate(case.model or self._bench.model, case.recordings, work=self._work, simulator=self._simulator, **options)
        wanted = ("bit_exact", "recordings", "compared_values", "mismatches", "frames", "simulated_cycles", "mismatch_list")
        return {key: result[key] for key in wanted} | {"probe": result["probe"]}

    def mode(self, key: str) -> dict[str, Any] | None:
        """A mode of ``golden.stability.HARDWARE``; None where there is no way to run it."""
        return self._keep.remembered(f"rtl {self._version} {key}", lambda: self.measure(key))

    def measure(self, key: str, *, broken: bool = False) -> dict[str, Any] | None:
        """The same, always run; ``broken``: on the mode's broken variant, which must come out beyond the bound."""
        return (self._run if key in BROKEN_DESIGNS else self.upsets)(key, broken=broken)

    def upsets(self, key: str, *, broken: bool = False) -> dict[str, Any]:
        """Upsets in the generated design (scripts/upset_campaign.py): ``reset``, ``flip-flops`` or ``checksum``; ``broken``: without what
        defends against them."""
        begin = time.perf_counter()
        campaign = self._campaign(checksum=not (broken and key == "checksum"), watchdog=not (broken and key == "flip-flops"))
        count, seed = min(UPSETS, self._bench.flips), self._bench.seed
        options = {
            "keep": lambda name, make: self._keep.remembered(f"rtl {self._version} {broken} {name}", make),
            "progress": (lambda done, total: self._progress(f"{key} in simulation", done, total)) if self._progress else None,
        }  # fmt: skip
        if key == "reset":
            ways = (bench_upsets.NO_ARM,) if broken else (bench_upsets.RESET, bench_upsets.ARM_AGAIN)
            records = campaign_steps.leave_recordings(campaign, count // 4, seed, ways=ways, **options)
            value = sum(record["differs"] for record in records)
            what, detail = f"a reset or a new arm at each of {len(records)} cycles of a recording with two touches", {"runs": len(records)}
        elif key == "flip-flops":
            detail = campaign_steps.summary(campaign_steps.upset_flip_flops(campaign, count, seed, **options))
            of_link = options["keep"]("link", lambda: upset_link(
                campaign.scenario.model.config, count // 2, seed, builds=flow.BUILD / "simulators", work=self._work / "link"
            ))  # fmt: skip
            dumb = sum(not (record["answers"] and record["decides"]) for record in of_link)
            value = detail["hangs"] + dumb
            what = f"{campaign_steps.in_words(detail)}; of {len(of_link)} more in the serial link {dumb} leave it without an answer"
            detail["link"] = {"flips": len(of_link), "hangs": dumb}
        else:
            detail = campaign_steps.flagged_by_kind(campaign_steps.upset_constants(campaign, count, seed, **options))
            value = sum(flips - flagged for flips, flagged in detail.values())
            what = "; ".join(f"{kind}: {flagged} of {flips} flagged" for kind, (flips, flagged) in detail.items())
        return {"value": value, "worst_case": what, "detail": detail, "wall_s": round(time.perf_counter() - begin, 3)}

    def _campaign(self, **defences: bool) -> campaign_steps.Campaign:
        """The model under test with checksum and watchdog, or without one of them."""
        model, clean = self._bench.model, self._bench.clean
        played = IntegerModel(model.config.replace(**{"checksum": True, "watchdog": True, **defences}), model.arrays, model.source)
        given = self._bench.remember(f"upset scenario {defences}", lambda: campaign_steps.scenario(played, clean))
        return campaign_steps.Campaign.build(given, flow.BUILD / "simulators", self._work / "upsets")

    def _run(self, key: str, *, broken: bool = False) -> dict[str, Any] | None:
        begin = time.perf_counter()
        clean, config = self._bench.clean, self._bench.config
        if key == "probe" and not config.loadable:
            return None  # weights in ROM: there is nothing to write
        options: dict[str, Any] = {"hardware": self._broken_design(key)} if broken else {}
        rtl = self._play(Case(clean.subset(clean.evenly(STREAMED))), **{key: True}, **options)
        probe = rtl["probe"]
        taken = 0 if probe is None else int(not (probe["after"] & 1 == 1 and probe["cleared"] & 1 == 0))
        what = f"{rtl['compared_values']} values of {rtl['recordings']} recordings compared"
        return {"value": rtl["mismatches"] + taken, "worst_case": what, "rtl": rtl, "wall_s": round(time.perf_counter() - begin, 3)}

    def _broken_design(self, key: str) -> Hardware:
        """The generated design of the model under test, broken as ``BROKEN_DESIGNS`` says."""
        model, folder = self._bench.model, self._work / "broken" / key
        text = (generate(model.config, model.arrays, folder / "design") / "accelerator.sv").read_text()
        broken = folder / "accelerator.sv"
        broken.write_text(BROKEN_DESIGNS[key](text))
        return Hardware((broken,))


def _replaced(pattern: str, by: str, text: str) -> str:
    """``text`` with ``pattern`` replaced, which must be there once in its first module, the top."""
    top, end, rest = text.partition("endmodule")
    top, count = re.subn(pattern, by, top, flags=re.DOTALL)
    if count != 1:
        raise RuntimeError(f"the generated design has {count} places for a broken variant, {pattern}")
    return top + end + rest


def _never_waits(text: str) -> str:
    """The classifier takes the receiver for ready in every cycle."""
    return _replaced(r"\.o__ready\(o__ready\)", ".o__ready(1'b1)", text)


def _never_locks(text: str) -> str:
    """Every word that is written to MEMORY_DATA reaches a memory."""
    taken = f"assign load__enable = bus__w_stb & (bus__addr == {int(Register.MEMORY_DATA)});"
    return _replaced(r"(\\accelerator\.control  control [^;]*\.load__enable\()load__enable(\))", rf"{taken}\n  \1\2", text)


BROKEN_DESIGNS: dict[str, Callable[[str], str]] = {"stalls": _never_waits, "probe": _never_locks}
"""The modes that play recordings: key -> what makes the broken variant of the generated Verilog."""


def _confirm(bench: Bench, records: list[dict[str, Any]], cases: dict[str, Case], hardware: _Hardware, progress: Progress | None) -> None:
    """Give the weakest modes that have a golden case the verdict of the hardware."""
    weakest = [record for record in stability.weakest(records, len(records)) if record["has_case"]]
    of_group = [[record for record in weakest if record["group"] == group][:CONFIRMED] for group in stability.GROUPS]
    playable = [record for group in of_group for record in group]
    for number, record in enumerate(playable):
        name = record["name"]
        if name not in cases:  # its record was kept from an earlier run
            _, cases[name] = stability.judge(stability.MODES[name], bench)
        record["rtl"] = hardware.confirm(name, cases[name])
        if progress:
            progress("weakest cases in co-simulation", number + 1, len(playable))
