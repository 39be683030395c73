"""The accelerator behind a converter: pins in, decisions out (docs/specification_interfaces.md section 12). Wiring, and
the effect of a broken frame."""

from typing import Any

from amaranth.hdl import Module, Mux, Signal
from amaranth.lib import stream, wiring

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import decision_layout, drive, forward, inputs, outputs, sample_layout, struct
from eskin.rtl.host.control import FedBy, bus_signature
from eskin.rtl.interface.acquisition import Acquisition
from eskin.rtl.interface.converter_ports import FAULT_BITS
from eskin.rtl.program.memory_map import Control, Images, Register
from eskin.rtl.top.accelerator import Accelerator


class Sensing(wiring.Component):
    """Acquisition -> Accelerator.

    A broken frame is dropped. The chain restarts as after an ARM command, so no decision comes from a
    touch with a gap. The next good frame is the first of a new recording.

    Parameters
    ----------
    images, clock_hz, fed_by, plan:
        As for `Accelerator` and `Acquisition`.

    Members
    -------
    run : In(1)
        As of `Acquisition`.
    resting : Out(1), only with a ``plan``
        Nothing moves, neither at the converter nor in the chain.
    o : Out(stream of decision_layout), bus : In, busy : Out(1), probe : Out
        As of `Accelerator`. The bus keeps its right of way: an ARM waits for a cycle without an access, and
        for the frame that is being forwarded.
    frame : Out(struct: valid, ready, payload)
        The frames that the accelerator gets, for benches and for what else reads frames.
    fault : Out(bits of ConverterFault)
        Faults, in the cycles in which they are known.
    broken : Out(1)
        One cycle: a frame is missing.
    sampling : Out(1)
        One cycle, in which a scan begins.
    pins : Out
        The converter's.
    """

    def __init__(
        self,
        config: AcceleratorConfig,
        images: Images | None = None,
        *,
        clock_hz: float | None = None,
        fed_by: FedBy | None = None,
        plan: Any = None,
    ):
        self.acquisition, self._started = Acquisition(config, clock_hz, plan), plan is not None
        self.accelerator = Accelerator(config, images, fed_by)
        frame = struct("valid", "ready", payload=sample_layout(config))
        super().__init__(
            inputs("run")
            | outputs(o=stream.Signature(decision_layout(config)))
            | inputs(bus=bus_signature())
            | outputs(
                "busy",
                probe=self.accelerator.probe.signature,
                frame=frame,
                fault=FAULT_BITS,
                broken=1,
                sampling=1,
                pins=self.acquisition.pins.signature,
            )
            | (outputs("resting") if self._started else {})
        )

    def elaborate(self, platform):
        m = Module()
        m.submodules.acquisition = acquisition = self.acquisition
        m.submodules.accelerator = accelerator = self.accelerator
        wiring.connect(m, acquisition.o, accelerator.i)
        forward(m, self, accelerator, "o", "probe")
        forward(m, self, acquisition, "run", "pins", "fault", "broken", "sampling")
        broken = Signal()  # a frame is missing and the chain does not know yet
        arm = Signal()
        bus, inner = self.bus, accelerator.bus
        m.d.comb += arm.eq(broken & ~acquisition.handing & ~bus.w_stb & ~bus.r_stb)
        drive(
            m,
            inner,
            addr=Mux(arm, int(Register.CONTROL), bus.addr),
            w_data=Mux(arm, int(Control.ARM), bus.w_data),
            w_stb=bus.w_stb | arm,
            r_stb=bus.r_stb,
        )
        m.d.comb += [
            bus.r_data.eq(inner.r_data),
            self.busy.eq(accelerator.busy | acquisition.handing | broken),
        ]
        drive(
            m, self.frame, valid=acquisition.o.valid, ready=acquisition.o.ready, payload=acquisition.o.payload
        )
        if self._started:
            m.d.comb += self.resting.eq(acquisition.resting & ~self.busy)
        m.d.sync += broken.eq((broken | acquisition.broken) & ~arm)
        return m
