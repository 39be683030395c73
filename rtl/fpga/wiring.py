"""The contents of a board's part, the pins, and the wires between them."""

from dataclasses import dataclass

from eskin.golden.core import AcceleratorConfig, InputError, converter_plan
from eskin.rtl.fpga.open_drain import OpenDrain
from eskin.rtl.fpga.own_clocks import OnOwnClocks
from eskin.rtl.fpga.synthesis import Harness, PoweredOn
from eskin.rtl.fpga.targets import Target
from eskin.rtl.interface.i2c_master import I2C_PINS
from eskin.rtl.program.memory_map import Images
from eskin.rtl.top.accelerator import Accelerator
from eskin.rtl.top.standby import standby_plan
from eskin.rtl.top.system import BAUD, ClassPins, System, class_pin_count

STIMULATOR_PIN = 8
"""Index of the stimulator's pin among a board's free pins: the first of the second connector if there are two
of 8."""
SAID = {
    "clk": "the board's oscillator",
    "led": "lamp: a frame was broken",
    "stim_tx": "stimulator, RX (115200 baud)",
    "decision": "class",
    "decision_valid": "the decision is final",
    "unsure": "and not confident",
    **dict.fromkeys(("rx", "tx"), "the board's serial port"),
}
"""Connection of each port except the converter's."""


@dataclass(frozen=True, kw_only=True)
class Wiring:
    """A design on a board.

    link: a host's serial line. sensing: frames from the configuration's converter, its stimulator if it has
    one. Neither: onset to decision alone, in a harness. standby: on the part's own oscillators, of which the fast one
    runs for each scan; without a link.
    """

    config: AcceleratorConfig
    target: Target
    link: bool = False
    sensing: bool = False
    standby: bool = False

    def design(self, images: Images | None, clock_hz: float, baud: float | None) -> PoweredOn | OnOwnClocks:
        """The design, reset at power-on until its part is ready; alone, that belongs to the board's top,
        which is not there."""
        # long enough whichever of them it is
        hold = self.target.family.power_on_cycles(max(clock_hz, self.target.clock_hz))
        if not (self.sensing or (self.link and baud)):
            # nobody reads: registers and counters that could only be read are not there
            return PoweredOn(Harness(Accelerator(self.config, images), ("probe", "bus__r_")))
        top = System(
            self.config,
            images,
            host="link" if baud else None,
            source="converter" if self.sensing else "host",
            clock_hz=clock_hz,
            baud=baud or BAUD,
            class_pins=self.shown,
            plan=standby_plan(self.config, clock_hz) if self.standby else None,
        )
        shared = self.sensing and top.signature.members["pins"].signature == I2C_PINS
        inner = OpenDrain(top) if shared else top
        if self.standby:
            return OnOwnClocks(inner, self.config.sensor.scan_rate_hz, clock_hz)
        return PoweredOn(inner, hold)

    @property
    def shown(self) -> ClassPins:
        """The way in which the class is shown: one pin per class if the board has enough, otherwise its index
        as a number."""
        each = self.sensing or len(self._decisions("each")) <= len(self.target.pins)
        return "each" if each else "binary"

    def _decisions(self, shown: ClassPins) -> list[str]:
        count = class_pin_count(self.config, shown)
        names = ["decision"] if count == 1 else [f"decision[{k}]" for k in range(count)]
        return ["decision_valid", *names, *["unsure"] * bool(self.config.network.margin_threshold)]

    def sites(self) -> dict[str, str]:
        """Site of each port: the converter on the first free pins, in the order of a Pmod with SPI (select,
        data out, data in, clock; then more data in and selects), stimulator and decisions from
        `STIMULATOR_PIN` on; without one decisions on the first pins.

        Raises
        ------
        InputError
            The board has too few.
        """
        target, own = self.target, {} if self.standby else {"clk": self.target.clock_pin}
        if not (self.link or self.sensing):
            return own | dict(zip(("shift_in", "capture", "shift_out"), target.pins, strict=False))
        line = dict(zip(("rx", "tx"), target.uart, strict=True)) if self.link else {}
        wires, place = list(self._wires()), 0
        ports = self._decisions(self.shown)
        if self.sensing:
            ports = [*["stim_tx"] * (self.config.interface.stimulator != "none"), *ports]
            place = max(STIMULATOR_PIN, len(wires))
        if place + len(ports) > len(target.pins):
            helps = "another board or converter" if self.sensing else "another board, or `no_link`"
            raise InputError(
                f"`target` {target.name}: has {len(target.pins)} free pins, and {place + len(ports)} are needed; "
                f"use {helps}"
            )
        free = dict(zip(wires, target.pins, strict=False)) | dict(
            zip(ports, target.pins[place:], strict=False)
        )
        return own | {"led": target.led} | line | free

    def _wires(self) -> dict[str, str]:
        if not self.sensing:
            return {}
        config = self.config
        plan = standby_plan(config, config.hardware.clock_hz) if self.standby else converter_plan(config)
        wires: dict[str, str] = plan.wires(config.interface.converter.name)
        return wires

    def table(self) -> list[dict[str, str]]:
        """Each pin of a board with a converter: port, site of the part, and its connection."""
        wires, rows = self._wires(), []
        for port, site in self.sites().items():
            name, _, index = port.partition("[")
            to = wires.get(port) or SAID[name] + (f" {index.rstrip(']')}" if index else "")
            rows.append({"port": port, "site": site, "to": to})
        return rows
