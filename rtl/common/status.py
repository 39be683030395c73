"""Status between the blocks of a chain: a signature a producer, seen from it, and one `connect` each."""

from amaranth.hdl import signed
from amaranth.lib import wiring
from amaranth.lib.wiring import Out

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common.ports import inputs, outputs


def probe(bits: int = 32) -> wiring.Signature:
    """One value a cycle, for benches: ``value`` where ``valid``."""
    return wiring.Signature(outputs("valid", value=signed(bits)))


FRAMES = wiring.Signature(outputs("offered", "taken", "first", "last"))
"""Beats at the input of a chain: one is offered, is taken; it is its frame's first, last."""

ENGINE = wiring.Signature(outputs("working", "overrun", "windows_open", "slot_done", "step_done"))
"""Status of an engine.

working: a window waits, or the program is on its way to where it waits for one. overrun: a window arrives while
both slots are full. windows_open: a window waits or is computed. slot_done: a slot of a step, up to its last logit,
ends with this cycle. step_done: the step's last logit is given in this cycle.
"""


def detector_status(config: AcceleratorConfig) -> wiring.Signature:
    """Status of what finds touches.

    armed, touch: state after the last frame that left. started: one cycle, a touch begins. framing_fault: one cycle,
    ``first`` or ``last`` of a beat did not agree with the taxel count. flags (taxels), raised, only with
    ``fault_frames``: as of `eskin.rtl.frontend.fault_detector.FaultDetector`; the flags are the content of the registers
    TAXEL_FAULTS while no frame is under way.
    """
    faults = {"flags": Out(config.sensor.taxels), "raised": Out(1)} if config.faults.fault_frames else {}
    return wiring.Signature(outputs("armed", "touch", "started", "framing_fault") | faults)


TEACHING = wiring.Signature(
    outputs("teach", "forget", "option", "loaded", "locked", "look", label=7)
    | inputs("refused", "done", in_use=8, place=9)
)
"""Commands to a readout that is taught, and its answers.

teach, forget: pulses. label: the class. option: teach the next touch; forget all classes. loaded: teach the touch
whose codes the host has written into the touch's own place. locked: a touch is open. look: read the word at the load
port's address, only while the readout is idle; place: that word from the next cycle on, while the address stays and
nothing else happens. refused: pulse, the readout ignored a command, or the touch that it was to teach next ended
incomplete. done: pulse, a touch is taught. in_use: number of places that hold a taught touch.
"""
