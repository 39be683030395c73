"""Upsets in simulation: one build of the design with `eskin.rtl.fpga.upsets`' inputs, played once for every upset of a list."""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from eskin.cosim.runner import SimulationError, build_bench

BENCH = Path(__file__).with_name("upset_bench.cpp")
UPSET_LIMIT_S = 30.0
"""Wall-clock limit for an upset, on average over a call."""

NONE = (0, 0, 0, 0, 0, -1)
"""The list's entry of a run without an upset."""
RESET, ARM_AGAIN, NO_ARM = 65535, 65534, 65533
"""In place of a register: the recording is left at that cycle by a reset, by the next one's arm, without either (which must go wrong)."""


def build(design: str, builds: Path, bench: Path = BENCH) -> Path:
    """The simulator of ``design`` (Verilog of `eskin.rtl.fpga.upsets`) under ``bench``, an unchanged one from ``builds``; its file.

    Raises
    ------
    InputError, SimulationError
        A tool is missing; the build fails.
    """
    return build_bench(design, bench, builds, "an upset campaign")


def stimulus(
    registers: Mapping[str, Any],
    boot: Sequence[tuple[int, int]],
    streams: Sequence[np.ndarray],
    *,
    sample_bits: int,
    limit: int,
    stop: bool = False,
) -> np.ndarray:
    """stimulus.bin.

    Parameters
    ----------
    registers:
        Register map (`eskin.rtl.fpga.generate.register_map`).
    boot:
        (register, word) writes that load the model.
    streams:
        Recordings, A/D codes (frames, taxels).
    limit:
        Cycles after which a wait is a hang.
    stop:
        End each run with the first global decision after the upset.
    """
    addresses, commands = registers["registers"], registers["bits"]["CONTROL"]
    mask = (1 << sample_bits) - 1
    head = [
        streams[0].shape[1],
        sample_bits,
        *(addresses[name] for name in ("CONTROL", "FAULTS", "STATUS", "TOUCHES")),
        commands["ARM"],
        commands["FINISH"],
        limit,
        int(stop),
        len(boot),
        *(address << 16 | word for address, word in boot),
        len(streams),
    ]
    parts = [np.array(head, dtype=np.uint32)]
    for stream in streams:
        parts += [np.array([len(stream)], dtype=np.uint32), (np.asarray(stream).reshape(-1) & mask).astype(np.uint32)]
    return np.concatenate(parts)


def play(
    simulator: Path,
    words: np.ndarray,
    upsets: Sequence[tuple[int, ...]],
    work: Path,
    *,
    jobs: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> list[dict[str, Any]]:
    """Run every upset (register, memory, word, bit, recording, cycle); one result each, as upset_bench.cpp says.

    Parameters
    ----------
    jobs:
        Processes that share the list.

    Raises
    ------
    SimulationError
        The simulator fails or takes too long.
    """
    shares = [list(upsets[start::jobs]) for start in range(jobs)]
    folders = [work / str(job) for job in range(jobs)]
    processes = []
    begin, limit_s = time.monotonic(), 60 + UPSET_LIMIT_S * len(upsets)
    try:
        for share, folder in zip(shares, folders, strict=True):
            folder.mkdir(parents=True, exist_ok=True)
            words.tofile(folder / "stimulus.bin")
            (folder / "upsets.txt").write_text("".join(" ".join(map(str, upset)) + "\n" for upset in share))
            (folder / "results.txt").write_text("")
            processes.append(subprocess.Popen([str(simulator)], cwd=folder))
        while any(process.poll() is None for process in processes):
            time.sleep(0.1)
            if progress:
                progress(sum((folder / "results.txt").read_bytes().count(b"\n") for folder in folders), len(upsets))
            if time.monotonic() - begin > limit_s:
                raise SimulationError(f"{len(upsets)} upsets took longer than {limit_s:.0f} s in {work}")
    finally:
        for process in processes:
            if process.poll() is None:
                process.kill()
                process.wait()
    results: list[dict[str, Any]] = [{} for _ in upsets]
    for job, (process, folder, share) in enumerate(zip(processes, folders, shares, strict=True)):
        lines = (folder / "results.txt").read_text().splitlines()
        if process.returncode or len(lines) != len(share):
            raise SimulationError(
                f"the simulation of upsets failed (status {process.returncode}, {len(lines)} of {len(share)} results) in {folder}"
            )
        results[job::jobs] = [json.loads(line) for line in lines]
    return results
