"""Acquisition: frames at the declared rate from a converter's pins, wiring only (docs/specification_interfaces.md
section 12)."""

from collections.abc import Callable
from typing import Any

from amaranth.hdl import Module, Mux
from amaranth.lib import stream, wiring

from eskin.golden.core import AcceleratorConfig, ConverterFault, SpiPlan, converter_plan
from eskin.golden.core.converters import sample_clock
from eskin.golden.core.converters.ddc232 import DdcPlan
from eskin.golden.core.converters.matrix import MatrixPlan
from eskin.golden.core.converters.mpr121 import MprPlan
from eskin.rtl.common import drive, forward, inputs, outputs, sample_layout
from eskin.rtl.interface.converter_ports import FAULT_BITS
from eskin.rtl.interface.ddc232_converter import Ddc232Converter
from eskin.rtl.interface.frame_guard import FrameGuard
from eskin.rtl.interface.matrix_converter import MatrixConverter
from eskin.rtl.interface.mpr121_converter import Mpr121Converter
from eskin.rtl.interface.sample_clock import SampleClock
from eskin.rtl.interface.sample_narrower import SampleNarrower
from eskin.rtl.interface.spi_converter import SpiConverter

COMPONENTS: dict[type, Callable[..., Any]] = {
    SpiPlan: SpiConverter,
    DdcPlan: Ddc232Converter,
    MatrixPlan: lambda plan, taxels: MatrixConverter(plan),
    MprPlan: lambda plan, taxels: Mpr121Converter(plan),
}
"""Components that carry out a plan, with the arguments (plan, taxels); each has the ports of
`eskin.rtl.interface.converter_ports.converter_ports`."""


class Acquisition(wiring.Component):
    """SampleClock -> converter -> SampleNarrower -> FrameGuard.

    Parameters
    ----------
    clock_hz:
        Frequency of the ``sync`` domain; default: the configuration's.
    plan:
        By which the converter is read where scans are started from outside; default: the configuration's at ``clock_hz``,
        and a sample clock.

    Members
    -------
    run : In(1)
        Frames are wanted: the first scan begins at once. With a ``plan`` a scan begins in each cycle in which it is high.
    resting : Out(1), only with a ``plan``
        The converter's port does not move.
    o : Out(stream of sample_layout)
        Good frames.
    sampling : Out(1)
        One cycle, in which a scan begins.
    handing : Out(1)
        A frame is being forwarded.
    broken : Out(1)
        One cycle: a frame is missing on ``o``.
    fault : Out(bits of ConverterFault)
        Faults, in the cycles in which they are known.
    pins : Out
        The converter's.

    The time from the last code to the first beat is 2 cycles. A scan begins in the cycle of the sample clock
    (`SampleClock` has its jitter); one that is due while the scan before goes on is left out: LATE. None
    begins while the converter is being set up.
    """

    def __init__(self, config: AcceleratorConfig, clock_hz: float | None = None, plan: Any = None):
        self._config, self._clock_hz, self._started = (
            config,
            clock_hz or config.hardware.clock_hz,
            plan is not None,
        )
        plan = plan or converter_plan(config, self._clock_hz)
        self.converter = COMPONENTS[type(plan)](plan, config.sensor.taxels)
        super().__init__(
            inputs("run")
            | outputs(
                o=stream.Signature(sample_layout(config)),
                sampling=1,
                handing=1,
                broken=1,
                fault=FAULT_BITS,
                pins=self.converter.pins.signature,
            )
            | (outputs("resting") if self._started else {})
        )

    def elaborate(self, platform):
        m = Module()
        config = self._config
        m.submodules.converter = converter = self.converter
        tick = self.run
        if self._started:
            m.d.comb += self.resting.eq(~converter.busy & ~converter.away)
        else:
            m.submodules.clock = clock = SampleClock(
                *sample_clock(self._clock_hz, config.sensor.scan_rate_hz)
            )
            forward(m, self, clock, "run")
            tick = clock.tick
        m.submodules.narrower = narrower = SampleNarrower(config)
        m.submodules.guard = guard = FrameGuard(config)
        forward(m, self, converter, "pins")
        forward(m, self, guard, "o", "handing")
        missed = tick & converter.busy & ~converter.away
        m.d.comb += [
            converter.start.eq(tick),
            self.sampling.eq(tick & ~converter.busy & ~converter.away),
            narrower.code.eq(converter.put.code),
        ]
        drive(m, guard.put, valid=converter.put.valid, place=converter.put.place, sample=narrower.sample)
        drive(m, guard, finished=converter.finished, bad=converter.fault.any())
        drive(
            m,
            self,
            broken=guard.broken | missed,
            fault=Mux(converter.finished, converter.fault, 0)
            | Mux(guard.late | missed, int(ConverterFault.LATE), 0),
        )
        return m
