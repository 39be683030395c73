"""A board without a host is taught by its buttons: what it decides at its pins is what the golden stream decides
that was taught the same, also after its power was off."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from eskin.cosim.netlist import Hardware, netlist_hardware
from eskin.golden.core import InputError
from eskin.golden.model import IntegerModel, Stream, codes_of, random_integer_model
from eskin.golden.model.prototypes import forget, taught_in_use
from eskin.golden.model.taught_log import played, sizes
from eskin.rtl.fpga.export import _verilog
from eskin.rtl.fpga.synthesis import synthesise
from eskin.rtl.fpga.targets import target
from eskin.rtl.fpga.wiring import Wiring
from eskin.rtl.program.flash_image import FLASH_OFFSET, flash_contents, log_layout
from eskin.verbs.flow import BUILD
from tests.cosim.test_skin import CONFIG
from tests.support.skin import play

CHOOSE, TEACH = 1, 2
SHORT, HELD, AFTER = 65, 1100, 65
"""Frames, at 1000 a second, that a button is pressed, and that nobody does anything."""
CLOCK_HZ = 1.152e6
TOUCHES = 4


def button_model() -> IntegerModel:
    config = CONFIG.replace(
        loadable=True,
        clock_hz=CLOCK_HZ,
        converter_hz=CLOCK_HZ / 4,
        decision="last",
        steps=4,
        touch_frames=130,
    ).with_readout(readout="prototypes", prototypes=2, taught=3, state_code_bits=4, state_code_shift=10)
    return forget(random_integer_model(config, 1))


def touch(kind: int, again: int, frames: int) -> np.ndarray:
    """Frames of the touch of object ``kind``, a little different each time, and of nothing behind it."""
    shape, noise = np.random.default_rng(kind), np.random.default_rng(100 * again + kind)
    ends = shape.integers(300, 1500, (2, CONFIG.sensor.taxels)) * shape.choice(
        [-1, 1], (1, CONFIG.sensor.taxels)
    )
    course = np.linspace(*ends, frames) + noise.integers(-12, 13, (frames, CONFIG.sensor.taxels))
    return np.concatenate([2048 + course, np.full((AFTER, CONFIG.sensor.taxels), 2048.0)]).astype(np.int32)


class Session:
    """What is done to a board from power-on, and what a golden stream makes of it.

    shown: the class on its pins. refused: of every request, whether it was not carried out. nameless: requests before any
    class was shown, between which the lamp stays on. whole: frames of a touch that gives every step."""

    def __init__(self, model: IntegerModel) -> None:
        self.stream = Stream(model)
        self.frames, self.buttons = [], []
        self.finals: list[int] = []
        self.shown: int | None = None
        self.refused: list[bool] = []
        self.nameless = 0
        self.whole = model.config.last_frame + 20
        self.rest(60)

    def _add(self, frames: np.ndarray) -> None:
        self.frames += [frames]
        for decision in self.stream.push(frames):
            self.finals += [decision.label] * decision.is_global
            # local ones behind an early global one stay off the pins
            ends = self.stream.config.network.decision != "early" or decision.is_global
            self.shown = decision.label if ends else self.shown

    def rest(self, frames: int) -> None:
        self._add(np.full((frames, CONFIG.sensor.taxels), 2048, dtype=np.int32))

    def touch(self, kind: int, again: int, frames: int = 130) -> int:
        """The class that it is decided for."""
        self._add(touch(kind, again, frames))
        return self.finals[-1]

    def press(self, button: int, frames: int = SHORT) -> None:
        now = sum(map(len, self.frames))
        self.buttons += [(now, button), (now + frames, 0)]
        self.rest(frames + AFTER)
        self._asked(button, frames >= HELD)

    def touch_and_teach(self, kind: int, again: int, frames: int) -> None:
        """The button is pressed and released while the touch is open."""
        now = sum(map(len, self.frames)) + 10
        self.buttons += [(now, TEACH), (now + SHORT, 0)]
        self.touch(kind, again, frames)
        self.refused.append(True)

    def _asked(self, button: int, held: bool) -> None:
        if button == CHOOSE and not held:
            self.shown = 0 if self.shown is None else (self.shown + 1) % self.stream.config.classes
            return
        self.nameless += self.shown is None
        self.refused.append(self.shown is None)
        try:
            if self.shown is not None and button == CHOOSE:
                self.stream.forget(self.shown)
            elif self.shown is not None:
                self.stream.teach(self.shown, following=held)
        except InputError:
            self.refused[-1] = True

    def teach(self, label: int) -> None:
        """By the buttons, beginning with the class that the pins show."""
        while self.shown != label:
            self.press(CHOOSE)
        self.press(TEACH)


def plays(hardware: Hardware, session: Session, flash: bytes, work: Path):
    """The board does what the session says; what its flash holds then."""
    config = session.stream.config
    codes = codes_of(np.concatenate(session.frames), config)
    board = play(
        hardware, config, codes, tail_s=0.02, work=work, builds=BUILD / "simulators", flash=flash,
        buttons=session.buttons, limit_s=3000,
    )  # fmt: skip
    shown = [(label, valid) for _, label, valid, _ in board.pins] or [(-1, False)]
    finals = [now[0] for before, now in pairwise([(-1, False), *shown]) if now[1] and not before[1]]
    assert finals == session.finals and board.violations == 0 and not any(led for *_, led in board.pins)
    assert shown[-1][0] == (-1 if session.shown is None else session.shown)
    return board


def button_board(level: str, config, work: Path) -> Hardware:
    icebreaker = target("icebreaker")
    design = Wiring(config=config, target=icebreaker, sensing=True, flash=True).design(None, CLOCK_HZ, None)
    if level == "netlist":
        synthesise(design, icebreaker.family, work / "net")
        return netlist_hardware(work / "net" / "accelerator.v", "ice40", "icebreaker", probes=False)
    (work / "accelerator.v").write_text(_verilog(design, "accelerator"))
    return Hardware((work / "accelerator.v",))


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("level", ["rtl", "netlist"])
def test_wrong_until_taught_by_buttons_and_right_after_the_power_was_off(level, tmp_path):
    model = button_model()
    config, log = model.config, log_layout(model.config)
    hardware, flash = button_board(level, config, tmp_path), flash_contents(config, model.arrays)
    day = Session(model)
    truths = []
    for kind in range(TOUCHES):  # each is wrong, and taught
        truths.append((day.touch(kind, 0) + 1) % config.classes)
        day.teach(truths[-1])
    assert [day.touch(kind, 1) for kind in range(TOUCHES)] == truths
    board = plays(hardware, day, flash, tmp_path / "day")
    assert not board.refused and not any(day.refused)
    first, half = log.offset - FLASH_OFFSET, sizes(config)[0]
    kept = played(model, board.flash[first : first + 2 * half])
    assert (taught_in_use(kept) == taught_in_use(day.stream.model)).all()
    next_day = Session(kept)
    assert [next_day.touch(kind, 2) for kind in range(TOUCHES)] == truths
    again = plays(hardware, next_day, board.flash[: len(flash)], tmp_path / "next")
    assert again.flash == board.flash


def test_buttons_have_the_pins_behind_the_converters():
    board, config = target("icebreaker"), button_model().config
    pins = Wiring(config=config, target=board, sensing=True, flash=True).sites()
    assert [pins[name] for name in ("choose_n", "teach_n", "refused")] == list(board.pins[4:7])
    dense = config.with_readout(readout="dense")
    assert "teach_n" not in Wiring(config=dense, target=board, sensing=True, flash=True).sites()
    assert len(flash_contents(config, button_model().arrays)) == (
        log_layout(config).offset - FLASH_OFFSET + 2 * 4096
    )
