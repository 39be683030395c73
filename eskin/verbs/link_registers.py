"""A board behind the serial link as the C driver sees a design behind a bus (docs/specification.md, sections
9 and 17): its ``read`` and ``write`` functions."""

import numpy as np

from eskin.cosim.link import Link, LinkError
from eskin.cosim.scoreboard import unpack_decision
from eskin.golden.core import AcceleratorConfig
from eskin.golden.model.decision_word import NO_DECISION, decision_word
from eskin.rtl.program.memory_map import Control, Event, Register, ShellRegister, teach_registers


class LinkRegisters:
    """Byte offsets and words of 32 bits on one side, the link's packets on the other.

    Below 0x100 an access goes over the link. SAMPLE and SAMPLE_PAIR gather a frame, which is sent when it is
    whole; DECISION gives those that came meanwhile, oldest first. There is no interrupt: ENABLE does nothing.

    Parameters
    ----------
    link:
        Connected.
    """

    def __init__(self, link: Link, config: AcceleratorConfig) -> None:
        self._link, self._config = link, config
        self._names = {4 * int(register): register.name for register in (*Register, *teach_registers(config))}
        self._frame: list[int] = []
        self._given = 0

    def read(self, offset: int) -> int:
        """A register's word; 0 where there is none.

        Raises
        ------
        LinkError
            The device does not answer; a decision got lost on the line.
        """
        waiting = self._link.decisions[self._given :]
        if offset == 4 * ShellRegister.DECISION:
            if self._link.lost:
                raise LinkError("a decision got lost on the line: arm, and play the recording again")
            self._given += bool(waiting)
            return self._word(waiting[0]) if waiting else NO_DECISION
        if offset == 4 * ShellRegister.NEXT_TAXEL:
            return len(self._frame)
        if offset == 4 * ShellRegister.EVENTS:
            return Event.SPACE | (Event.DECISION if waiting else 0)
        return self._link.read(self._names[offset]) if offset in self._names else 0

    def write(self, offset: int, word: int) -> None:
        """Carried out when it returns.

        Raises
        ------
        LinkError
            As of `read`.
        """
        if offset == 4 * Register.CONTROL and word & Control.ARM:
            self._frame, self._given = [], 0
            self._link.begin()
        elif offset in (4 * ShellRegister.SAMPLE, 4 * ShellRegister.SAMPLE_PAIR):
            samples = [word & 0xFFFF, word >> 16][: 1 + (offset == 4 * ShellRegister.SAMPLE_PAIR)]
            self._frame = [*self._frame, *samples][: self._config.sensor.taxels]
            if len(self._frame) == self._config.sensor.taxels:
                self._link.feed(np.array([self._frame]))
                self._frame = []
        elif offset < 4 * min(ShellRegister) or offset in self._names:
            self._link.write([(offset // 4, word)])

    def _word(self, payload: int) -> int:
        return decision_word(self._config, unpack_decision(self._config, payload).values())
