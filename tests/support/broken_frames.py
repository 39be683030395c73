"""A scenario for a design behind a converter: the converter misbehaves for a while, and nothing is compared here."""

import json
from pathlib import Path

import cocotb
import numpy as np
from cocotb.triggers import Timer

from eskin.cosim.bench import CYCLE_NS, Bench


@cocotb.test()
async def play_with_a_fault(dut) -> None:
    """The first recording. Result: decisions (payload, cycle), taken (cycle in which each frame was through or lost), faults."""
    bench, decisions = Bench(dut), []
    await bench.start()
    for stage in ("sum", "fault", "feature", "state", "logit", "step"):
        bench.events.take[stage] = lambda _: None
    bench.events.take["decision"] = lambda values: decisions.extend(
        zip(values.codes.view(np.uint32).tolist(), values.cycles.tolist(), strict=True)
    )
    frames = bench.recordings[0]["codes"]
    at, lasts, kind = bench.settings["fault"]
    note = bench.events.take["scan"]

    async def misbehave() -> None:
        dut.misbehaves.value = kind
        await Timer((int(lasts * bench.source.period) - 1) * CYCLE_NS, "ns")
        dut.misbehaves.value = 0

    def scanned(values) -> None:
        note(values)
        if len(bench.source.scans) == at + 1:
            cocotb.start_soon(misbehave())

    bench.events.take["scan"] = scanned
    await bench.bus.command("ARM")
    await bench.until(dut.idle)
    bench.source.begin()
    await bench.source.send(frames)
    await bench.until(dut.through, 1e9)
    await bench.bus.command("FINISH")
    await bench.until(dut.idle)
    result = {"decisions": decisions, "taken": bench.source.accepted}
    result["faults"] = dut.faults.value.to_unsigned()
    Path("result.json").write_text(json.dumps(result))
