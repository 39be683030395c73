"""A board without a host, from the converter's pins to the bytes on the stimulator's line."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eskin.cosim import runner
from eskin.cosim.flow import converter_model, converter_parameters
from eskin.cosim.netlist import Hardware
from eskin.golden.core import AcceleratorConfig
from tests.support.stimulator import StimulatorModel

HARNESS = Path(__file__).with_name("skin_harness.sv")
FLASH = Path(__file__).with_name("spi_flash.sv")
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
        one = config.interface
        model = StimulatorModel((one.amplitude_limit, one.delay_limit, one.frequency_limit, one.width_limit))
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
    flash: bytes | None = None,
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
    flash:
        What the board's flash holds at the image's place; the design reads its model there.
    host, host_clocks:
        For a design with the link: what a host sends at the beginning and in the middle of the tail, and the
        clocks of a bit.
    limit:
        Cycles after which it ends although no scan has begun.
    """
    clock = config.hardware.clock_hz
    parameters = converter_parameters(config) | {"TAXELS": config.sensor.taxels, "CLASSES": config.classes}
    parameters |= {"PERIOD": round(clock / config.sensor.scan_rate_hz), "CLOCKS_PER_BIT": round(clock / BAUD)}
    parameters |= {"HOST_CLOCKS": host_clocks} if host else {}
    models, options = converter_model(config)
    macros = ["-DFLASH"] * (flash is not None) + ["-DHOST"] * (host is not None)
    simulator = runner.build(
        "verilator",
        [*hardware.sources, *models, *[FLASH] * (flash is not None)],
        parameters,
        builds,
        options=[*hardware.options, *options, *macros],
        wrapper=HARNESS,
        top=HARNESS.stem,
    )
    work.mkdir(parents=True, exist_ok=True)
    codes.astype(">u4").tofile(work / "codes.bin")
    settings = {"frames": len(codes), "tail": round(tail_s * clock), "fault_kind": fault_kind}
    settings |= {
        name: value for name, value in (("fault_frame", fault_frame), ("limit", limit)) if value is not None
    }
    if flash is not None:
        (work / "flash.bin").write_bytes(flash)
    if host is not None:
        (work / "host.bin").write_bytes(host[0])
        (work / "last.bin").write_bytes(host[1])
    runner.run(simulator, work, plusargs=settings, limit_s=limit_s, bench="tests.support.skin_bench")
    stim = [
        (int(word, 16), int(cycle))
        for word, cycle in (line.split() for line in (work / "stim.txt").read_text().splitlines())
    ]
    *lines, end = (line.split() for line in (work / "pins.txt").read_text().splitlines())
    pins = [
        (int(cycle), int(one_hot, 2).bit_length() - 1, valid == "1", led == "1")
        for cycle, one_hot, valid, led in lines
    ]
    heard = (
        bytes(int(word, 16) for word in (work / "host.txt").read_text().split()) if host is not None else b""
    )
    return Played(stim, pins, int(end[-1]), end[3] == "1", heard)


def expected_electrodes(
    rows: np.ndarray, frames: np.ndarray, config: AcceleratorConfig, burst_s: float
) -> list[int]:
    """Electrodes (0..23) that are switched on, in their order, for golden decisions that fall due with these
    frames: each that is not the one before, where that is still held, and that lasts for a burst."""
    one, rate = config.interface, config.sensor.scan_rate_hz
    table = one.electrodes or tuple(range(1, config.classes + 1))
    events = [(frame / rate, table[row[2]]) for row, frame in zip(rows, frames, strict=True)]
    found, now, until = [], 0, -1.0
    for number, (time, electrode) in enumerate(events):
        begins = electrode and (electrode != now or time > until)
        later = next((other for other in events[number + 1 :] if other[1] != electrode), None)
        if begins and (later is None or later[0] - time > burst_s):
            found.append(electrode - 1)
        now, until = electrode, time + one.hold_s
    return found
