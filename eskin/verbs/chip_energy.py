"""Energy of a chip's netlist from its activity on recordings: steps, frames, waiting, whole touches.

A recording is played at a slow pace, so that the clock stops between frames where it can, and everything is
counted frame by frame. A step costs what the frames around its decision cost beyond those of the same touch
without one. What a cycle without an edge costs is known from the clock's first net, so that any clock can be
asked about.
"""

import dataclasses
from collections.abc import Sequence
from operator import ne
from pathlib import Path

import numpy as np

from eskin.cosim.device import Accelerator, Design
from eskin.cosim.latency import limits
from eskin.golden.core import AcceleratorConfig, InputError, Record
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel, run
from eskin.rtl.asic.liberty import WireLoad
from eskin.rtl.asic.nets import BAND, Costs, Nets, costs
from eskin.rtl.asic.synthesis import models
from eskin.rtl.fpga.generate import boot_writes, pack_decision, register_map
from eskin.rtl.program.schedule import lowest_clock_hz, schedule
from eskin.study.energy import TOUCHES_PER_S
from eskin.study.first_touches import first_touches

BUILDS = Path("build/simulators")
ZEPTO = 1e-21
"""Joule of the unit in which a netlist adds up."""
NEAR = 3
"""Frames on either side of a step whose energy may belong to its decision; fewer where windows follow
closely."""
DRAIN_CYCLES = 48
"""Cycles of a slow frame beyond two a taxel: enough for the clock to stop within it."""
METHOD = (
    "changes of nets from cycle to cycle at gate level, Liberty energy and capacitance, wire load; no glitches, "
    "no clock tree, no layout"
)


def with_touches(model: IntegerModel, recordings: Recordings, count: int) -> tuple[np.ndarray, Recordings]:
    """``count`` recordings with a whole touch, spread over the classes: their numbers, and they themselves, cut
    a hop after it; where none goes on so long, each to its end.

    Raises
    ------
    InputError
        None has a whole touch.
    """
    config = model.config
    recordings = recordings.scanned(config.sensor.scan_every)
    touches, ends = first_touches(config, recordings)
    touches = touches.take(~touches.partial)
    if not len(having := touches.recording):
        raise InputError(
            f"recordings '{recordings.source}': none has a whole touch; energy needs one: look at their onsets with "
            "'eskin inspect'"
        )
    after = touches.start_frame - 1 + config.last_frame + config.windows.hop
    longer = having[after <= recordings.lengths[having]]
    having = longer if len(longer) else having
    numbers = having[recordings.subset(having).evenly(min(count, len(having)))]
    return numbers, recordings.subset(numbers).until(ends[numbers])


def _resting(recordings: Recordings, frames: int) -> Recordings:
    """The first of ``recordings``, with its last frame repeated ``frames`` times, because the frames after a
    decision belong to the energy of its step."""
    one = recordings.subset([0])
    samples = np.concatenate([one.samples, np.repeat(one.samples[-1:], frames, axis=0)])
    return dataclasses.replace(one, samples=samples, offsets=np.array([0, len(samples)]))


def counting(nets: Nets, cost: Costs) -> str:
    """The netlist in Verilog. Output ``joule`` is the energy so far in `ZEPTO` joule, and ``edges`` the number of
    edges behind the gate before all others (without one, of all)."""
    counted: dict[str, list[tuple[str, float]]] = {"joule": [], "edges": []}

    def joined(bits: Sequence[int | str]) -> str:
        names = [f"n{bit}" if isinstance(bit, int) else f"1'b{bit}" for bit in reversed(bits)]
        return names[0] if len(names) == 1 else "{" + ",\n".join(names) + "}"  # no edge of {n} is seen

    def count(kind: str, joule: float, clock: str, when: str = "1") -> None:
        """Edges of ``clock``."""
        toggle = f"toggle_{len(lines)}"
        lines.append(f"reg {toggle} = 0; always @(posedge {clock}) if ({when}) {toggle} <= ~{toggle};")
        counted[kind].append((toggle, joule))

    ports, lines = nets.module["ports"], [f"wire n{net};" for net in {*nets.driver, *nets.receivers}]
    for name, port in ports.items():
        ends = joined(port["bits"]), name
        lines.append("assign {} = {};".format(*ends if port["direction"] == "input" else reversed(ends)))
    for name, kind in nets.cells.items():
        pins = {pin: joined(bits) for pin, bits in nets.module["cells"][name]["connections"].items() if bits}
        lines.append(
            f"{kind.name} c{len(lines)} ({', '.join(f'.{pin}({ends})' for pin, ends in pins.items())});"
        )
        if kind.kind == "memory":
            enable, write, read = (pins[f"A_{pin}"] for pin in ("MEN", "WEN", "REN"))
            for access, when in (("write", write), ("read", f"{read} & ~{write}")):
                count("joule", kind.access_j[access], pins["A_CLK"], f"{enable} & {when}")
    for net, joule in cost.joule.items():
        if cost.kind[net] == "clock":
            count("joule", joule, f"n{net}")
        else:
            counted["joule"].append((f"n{net}", joule))
    (first, *others) = (name for name, *_ in nets.receivers[nets.clock])
    gate = nets.cells[first].gate_pins.get("output")
    trunk = nets.module["cells"][first]["connections"][gate][0] if gate and not others else nets.clock
    count("edges", ZEPTO, f"n{trunk}")
    for output, each in counted.items():
        top, amounts = (
            len(each) - 1,
            (f"cost[{k}] = 64'd{round(joule / ZEPTO)};" for k, (_, joule) in enumerate(each)),
        )
        values = ",\n".join(value for value, _ in reversed(each))
        lines += [
            f"generate if (1) begin : counter_{output}",
            f"reg [63:0] sum = 0; reg [63:0] cost [0:{top}]; reg [{top}:0] was; wire [{top}:0] now = {{{values}}}; integer k;",
            *("initial begin", *amounts, f"end assign {output}__count = sum;"),
            f"always @(posedge clk) begin for (k = 0; k <= {top}; k = k + 1) if (now[k] != was[k]) sum = sum + cost[k];",
            "was <= now; end end endgenerate",
        ]
    heads = [f"{port['direction']} [{len(port['bits']) - 1}:0] {name}" for name, port in ports.items()]
    heads += [f"output [63:0] {output}__count" for output in counted]
    cells = {cell.name: cell for cell in nets.cells.values()}
    text = [f"module accelerator ({', '.join(heads)});", *lines, "endmodule", models(cells.values())]
    return "\n".join(text)


def measured(
    model: IntegerModel, nets: Nets, voltage: float, wire: WireLoad, leakage_w: float, recordings: Recordings
) -> Record:
    """The energies of `asic.json`, in joule, of one recording with a whole touch.

    Parameters
    ----------
    model:
        With the chip's configuration.
    leakage_w:
        Of the whole chip.

    Raises
    ------
    InputError
        No recording has a whole touch.
    """
    config = model.config
    chosen = _resting(with_touches(model, recordings, 1)[1], config.windows.hop)
    trace, cost = run(model, chosen), costs(nets, voltage, wire)
    design, boot = Design(counting(nets, cost), BUILDS, quick=True), boot_writes(config, model.arrays)
    device = Accelerator(design, config, register_map(config), boot, probes=False)
    device.command("ARM")
    device.forget()  # what a chain not yet reset may have offered
    marks = []
    for frame in chosen.recording(0):
        marks.append([device.state.decisions, device.get("edges__count"), device.get("joule__count")])
        device.frames(frame[None], 2 * config.sensor.taxels + DRAIN_CYCLES)
    # from each frame to the next one's first taxel
    decided, edges, joule = np.diff(marks, axis=0).T
    device.command("FINISH")
    decisions = device.streams()["decision"][0].view(np.uint32).tolist()
    expected = [pack_decision(config, row) for row in trace.streams["decision"][0]]
    differing = sum(map(ne, decisions, expected)) + abs(len(decisions) - len(expected))
    onset = int(trace.touches.onset_frame[trace.first[0]]) - 1
    clock = max(lowest_clock_hz(config), schedule(config).decision_cycles / limits(config)["decision"])
    spent = joule * ZEPTO + cost.root_j * edges
    return summary(config, decided, edges, spent, onset, cost.root_j, leakage_w, clock) | {
        "bit_exact": not differing and bool(decisions),
        "mismatches": differing,
        "compared_values": len(expected),
    }


def summary(
    config: AcceleratorConfig,
    decisions: np.ndarray,
    edges: np.ndarray,
    frame: np.ndarray,
    onset: int,
    root_j: float,
    leakage_w: float,
    clock_hz: float,
) -> Record:
    """Energies from what each frame costs.

    Parameters
    ----------
    decisions, edges:
        Of each frame; edges of the clock behind its first gate.
    frame:
        Joule of each frame, edges of the clock included.
    onset:
        Number of the frame at which the touch begins.
    """
    decided = np.flatnonzero(decisions)
    near = np.zeros(len(frame), bool)
    around = NEAR + schedule(config).step_cycles // (2 * config.sensor.taxels + DRAIN_CYCLES)
    around = min(around, max(1, (config.windows.hop - 1) // 2 - 1))
    for row in decided:
        near[max(0, row - around) : row + around + 1] = True
    plain = ~near
    plain[: decided[0]] = plain[decided[-1] + 1 :] = False
    quiet = slice(NEAR, max(NEAR + 1, onset - around))
    hop, rate = config.windows.hop, config.sensor.scan_rate_hz
    period, steps, frames = clock_hz / rate, config.windows.steps, config.last_frame

    def whole(
        which: np.ndarray | slice,
    ) -> float:  # of a frame at that clock: its edges, and the first net in cycles without one
        return float(frame[which].mean() + root_j * (period - edges[which].mean()))

    step = float((frame[near].sum() - near.sum() * frame[plain].mean()) / steps)
    idle_w = leakage_w + rate * whole(quiet)
    average_w = idle_w + TOUCHES_PER_S * steps * step
    energies = {
        "step_j": step,
        "interval_j": hop * whole(plain) + step + leakage_w * hop / rate,
        "waiting_cycle_j": root_j,
        "leakage_w": leakage_w,
        "touch_j": frames * whole(plain) + steps * step + leakage_w * frames / rate,
        "idle_w": idle_w,
        "average_w": average_w,
    }
    return energies | {"band": BAND, "interval_frames": hop, "clock_hz": clock_hz, "method": METHOD}
