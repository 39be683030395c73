"""The cocotb bench of a board on the part's oscillators (cosim/standalone.sv), from power-on: the taxels take the next frame
when the fast oscillator starts, and when it stops the pins show what the golden model says after that frame.

``bench.json`` holds: vectors (the file of `eskin.cosim.standalone`), position (of the recording), off (share by which
both oscillators are), clock_hz, slow_hz, rate_hz, start_s.
"""

import json
from pathlib import Path

import cocotb
import numpy as np
from cocotb.triggers import FallingEdge, RisingEdge, SimTimeoutError, with_timeout
from cocotb.utils import get_sim_time

from eskin.golden.core import write_json

CYCLE_NS = 10.0
OVERDUE = 4
"""Periods of the scans without a start after which there will be none."""


@cocotb.test()
async def play(dut) -> None:
    """One recording, up to the first frame after which the pins differ, or the first scan that is not begun in time."""
    settings = json.loads(Path("bench.json").read_text())
    with np.load(settings["vectors"]) as archive:
        of = slice(*archive["offsets"][settings["position"] :][:2])
        codes, shown = archive["codes"][of], archive["shown"][of]
    ns = CYCLE_NS * settings["clock_hz"]  # of the simulation, for a nominal second
    slow_half_ps = round(500 * ns / settings["slow_hz"] / (1 + settings["off"]))
    slow_ns = slow_half_ps / 500
    period_ns = slow_ns * settings["slow_hz"] / settings["rate_hz"]
    dut.slow_half.value = slow_half_ps
    dut.fast_half.value = round(500 * CYCLE_NS / (1 + settings["off"]))
    dut.start_up.value = round(1000 * ns * settings["start_s"])
    starts, on_ns, found = list[float](), 0.0, ""
    pins, compared = "0", 0
    for number, frame in enumerate(codes):
        try:
            await with_timeout(RisingEdge(dut.power), round(OVERDUE * period_ns), "ns")
            starts.append(get_sim_time("ns"))
            dut.analog.value = int.from_bytes(frame.astype("<u4").tobytes(), "little")
            await with_timeout(FallingEdge(dut.power), round(OVERDUE * period_ns), "ns")
        except SimTimeoutError:
            found = f"scan {number + 1} is not over after {OVERDUE} periods"
            break
        on_ns += get_sim_time("ns") - starts[-1]
        late = starts[-1] - starts[0] - number * period_ns
        pins = f"{dut.decision.value}{dut.decision_valid.value}{dut.unsure.value}{dut.led.value}"
        scans = int(dut.scans.value)
        if not -0.01 <= late / slow_ns <= 1.01:
            found = f"scan {number + 1} begins {late / slow_ns:.1f} slow cycles after it is due"
        elif scans != number + 1:
            found = f"the converter is read {scans} times in {number + 1} scans"
        elif int(dut.awake.value):
            found = f"the converter is awake behind scan {number + 1}"
        if found or pins != shown[number]:
            break
        compared += 1
    write_json(
        "result.json",
        {
            "frames": max(1, len(starts)),
            "compared": compared,
            "starts": len(starts),
            "scans": int(dut.scans.value),
            "cycles": int(dut.cycles.value),
            "fast_on_s": on_ns / ns,
            "seconds": get_sim_time("ns") / ns,
            "violations": int(dut.violations.value),
            "early": int(dut.early.value),
            "found": found,
            "pins": pins,
        },
    )
