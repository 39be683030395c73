"""A board without a host, from the converter's pins to the bytes on the stimulator's line."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eskin.cosim import runner
from eskin.cosim.flow import converter_model
from eskin.cosim.netlist import Hardware
from eskin.golden.core import AcceleratorConfig
from tests.support.stimulator import StimulatorModel

BOARD = Path(__file__).with_name("skin_board.sv")
BAUD = 115200


@dataclass(frozen=True)
class Played:
    """What a recording made of the board. stim: (byte, cycle of its stop bit) on the stimulator's line, 256
    more where that was low. pins: (cycle, class or -1, valid, led) whenever one changes. violations: of the
    converter's data sheet. begun: a scan has begun. host: bytes on the line to the host."""

    stim: list[tuple[int, int]]
    pins: list[tuple[int, int, bool, bool]]
    violations: int
    begun: bool
    host: bytes = b""

    def model(self, config: AcceleratorConfig) -> StimulatorModel:
        """The stimulator after all of it."""
        interface = config.interface
        model = StimulatorModel(
            (
                interface.amplitude_limit,
                interface.delay_limit,
                interface.frequency_limit,
                interface.width_limit,
            )
        )
        model.feed(bytes(byte for byte, _ in self.stim))
        return model


def play(
    hardware: Hardware,
    config: AcceleratorConfig,
    codes: np.ndarray,
    *,
    tail_s: float,
    work: Path,
    builds: Path,
    fault_frame: int | None = None,
    fault_kind: int = 1,
    host: tuple[bytes, bytes] | None = None,
    host_clocks: int = 4,
    limit: int | None = None,
    limit_s: float = 900.0,
) -> Played:
    """One recording, codes (frames, taxels), from power-on; ``tail_s`` seconds of its last frame more.

    Parameters
    ----------
    config:
        With the clock that the board was built for; a frame must be a whole number of cycles.
    fault_frame, fault_kind:
        From this frame on the converter misbehaves as its model in cosim/converters says; kind 1: its data
        line stays low.
    host, host_clocks:
        For a design with the link: what a host sends at the beginning and in the middle of the tail, and the
        clocks of a bit.
    limit:
        Cycles after which it ends although no scan has begun.
    """
    clock = config.hardware.clock_hz
    parameters = {"BEATS": codes.shape[1], "CLASSES": config.classes, "CYCLE_PS": round(1e12 / clock)}
    models, options = converter_model(config)
    simulator = runner.build(
        "verilator",
        [*hardware.sources, *models],
        parameters,
        builds,
        options=[*hardware.options, *options],
        wrapper=BOARD,
        top=BOARD.stem,
    )
    work.mkdir(parents=True, exist_ok=True)
    np.save(work / "codes.npy", codes)
    settings = {
        "period": round(clock / config.sensor.scan_rate_hz),
        "stim_clocks": round(clock / BAUD),
        "host_clocks": host_clocks,
        "tail": round(tail_s * clock),
        "limit": limit or 1 << 40,
        "fault_frame": len(codes) + 1 if fault_frame is None else fault_frame,
        "fault_kind": fault_kind,
    }
    settings |= {name: data.hex() for name, data in zip(("host", "last"), host or (b"", b""), strict=True)}
    (work / "skin.json").write_text(json.dumps(settings))
    runner.run(simulator, work, limit_s=limit_s, bench="tests.support.skin_bench")
    result = json.loads((work / "result.json").read_text())
    heard = bytes(byte & 255 for byte, _ in result["host"]) if host is not None else b""
    stim, pins = ([*map(tuple, result[name])] for name in ("stim", "pins"))
    return Played(stim, pins, result["violations"], result["begun"], heard)


def expected_electrodes(
    rows: np.ndarray, frames: np.ndarray, config: AcceleratorConfig, burst_s: float
) -> list[int]:
    """Electrodes (0..23) that are switched on, in their order, for golden decisions that fall due with these
    frames: each that is not the position before, where that is still held, and that lasts for a burst."""
    interface, rate = config.interface, config.sensor.scan_rate_hz
    table = interface.electrodes or tuple(range(1, config.classes + 1))
    events = [(frame / rate, table[row[2]]) for row, frame in zip(rows, frames, strict=True)]
    found, now, until = [], 0, -1.0
    for number, (time, electrode) in enumerate(events):
        begins = electrode and (electrode != now or time > until)
        later = next((other for other in events[number + 1 :] if other[1] != electrode), None)
        if begins and (later is None or later[0] - time > burst_s):
            found.append(electrode - 1)
        now, until = electrode, time + interface.hold_s
    return found
