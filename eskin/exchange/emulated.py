"""The exported C on an emulated core: its decisions, and the instructions they take."""

import struct
from pathlib import Path
from typing import Any

import numpy as np

from eskin.exchange import compiled, plain_c
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel, run

START, STACK, MEMORY, STOP = 0x10000, 0x3F0000, 0x400000, 0x3FFF00
"""Where the program lies, the stack's top, the size of the memory, and where a call returns to."""
PROGRAM = """#include "eskin_model.c"
eskin_state the_state;
eskin_decision the_decision;
int32_t the_codes[ESKIN_TAXELS];
void arm(void) { eskin_arm(&the_state); }
int frame(void) { return eskin_frame(&the_state, the_codes, &the_decision); }
int finish(void) { return eskin_finish(&the_state, &the_decision); }
void start(void) { arm(); frame(); finish(); }
"""


class Core:
    """A core with a program in its memory. unicorn, QEMU's emulator as a library, runs it.

    Parameters
    ----------
    name:
        One of `compiled.CORES`.
    elf:
        The program.
    """

    def __init__(self, name: str, elf: bytes) -> None:
        import unicorn
        from unicorn import arm_const, riscv_const

        self._thumb = name.startswith("Cortex")
        if self._thumb:
            self._cpu = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
            self._cpu.ctl_set_cpu_model(
                arm_const.UC_CPU_ARM_CORTEX_M0 if name == "Cortex-M0+" else arm_const.UC_CPU_ARM_CORTEX_M4
            )
            registers = arm_const.UC_ARM_REG_SP, arm_const.UC_ARM_REG_LR, arm_const.UC_ARM_REG_R0
        else:
            self._cpu = unicorn.Uc(unicorn.UC_ARCH_RISCV, unicorn.UC_MODE_RISCV32)
            registers = riscv_const.UC_RISCV_REG_SP, riscv_const.UC_RISCV_REG_RA, riscv_const.UC_RISCV_REG_A0
        self._stack, self._link, self._result = registers
        self._cpu.mem_map(0, MEMORY)
        table, entry, count = *struct.unpack_from("<I", elf, 28), *struct.unpack_from("<HH", elf, 42)
        for number in range(count):
            kind, offset, address, _, size = struct.unpack_from("<5I", elf, table + entry * number)
            if kind == 1:
                self._cpu.mem_write(address, elf[offset : offset + size])
        self.symbols = compiled.symbols(elf)
        self.instructions = self.cycles = 0
        self._known: dict[tuple[int, int], tuple[int, int]] = {}
        self._cpu.hook_add(unicorn.UC_HOOK_BLOCK, self._block)

    def _block(self, cpu: Any, address: int, size: int, _: Any) -> None:
        if (address, size) not in self._known:
            code, at, count, cycles = bytes(cpu.mem_read(address, size)), 0, 0, 0
            while at < size:
                (half,) = struct.unpack_from("<H", code, at)
                long = half >= 0xE800 if self._thumb else half & 3 == 3
                at, count, cycles = at + (4 if long else 2), count + 1, cycles + thumb_cycles(half)
            self._known[address, size] = count, cycles
        count, cycles = self._known[address, size]
        self.instructions += count
        self.cycles += cycles

    def call(self, name: str) -> int:
        """What the function returns; ``instructions`` counts on."""
        thumb = int(self._thumb)
        self._cpu.reg_write(self._stack, STACK)
        self._cpu.reg_write(self._link, STOP | thumb)
        self._cpu.emu_start(self.symbols[name] & ~1 | thumb, STOP)
        return self._cpu.reg_read(self._result)

    def write(self, name: str, values: np.ndarray) -> None:
        """Words of 32 bits into a variable."""
        self._cpu.mem_write(self.symbols[name], values.astype("<i4").tobytes())

    def read(self, name: str, count: int) -> tuple[int, ...]:
        """Words of 32 bits of a variable."""
        return tuple(np.frombuffer(self._cpu.mem_read(self.symbols[name], 4 * count), "<i4").tolist())


def thumb_cycles(half: int) -> int:
    """Cycles of a Thumb instruction on a Cortex-M0+ (Technical Reference Manual), memory without wait states,
    a multiplier of one cycle, every branch taken."""
    if half >> 9 in (0b1011010, 0b1011110):  # push, pop
        return 1 + (half & 0x1FF).bit_count() + 2 * (half >> 8 == 0xBD)
    if half >> 12 == 0b1100:  # ldm, stm
        return 1 + (half & 0xFF).bit_count()
    if half >> 11 == 0b01001 or 0b0101 <= half >> 12 <= 0b1001:  # ldr, str
        return 2
    if half >> 11 == 0b11110:  # bl
        return 3
    if half >> 12 in (0b1101, 0b1110) or half >> 8 == 0b01000111:  # b, bx
        return 2
    return 1


def play(model: IntegerModel, recordings: Recordings, core: str, folder: Path) -> dict[str, Any]:
    """Recordings through the exported C in ``folder`` on an emulated core.

    Returns
    -------
    dict
        core; decisions, different (from the golden model's); instructions and, of a Cortex-M0+, cycles
        (`thumb_cycles`): ``quiet`` (mean of a frame outside of touches), ``frame`` (mean of one inside
        without a decision), ``step`` (mean of one with a decision, less ``frame``), ``touch`` (all frames of
        a touch). NaN where there was none.
    """
    source, program = folder.absolute() / "emulated.c", folder.absolute() / "emulated.elf"
    source.write_text(PROGRAM)
    link = ("-g", "-Wl,-e,start", f"-Wl,--image-base={START:#x}", "-Wl,-z,norelro")
    try:
        compiled.compile_for(core, source, program, *link)
        cpu = Core(core, program.read_bytes())
    finally:
        source.unlink()
        program.unlink(missing_ok=True)
    trace = run(model, recordings)
    inside = [np.zeros(length + 1, dtype=bool) for length in recordings.lengths]
    for recording, start, onset in zip(
        trace.touches.recording, trace.touches.start_frame, trace.touches.onset_frame, strict=True
    ):
        inside[recording][max(onset, start) : start + model.config.last_frame] = True
    counts: dict[str, list[tuple[int, int]]] = {"quiet": [], "frame": [], "step": []}
    decisions = different = 0
    for number, calls in enumerate(plain_c.expected(trace, recordings)):
        due = {call[0]: tuple(call[1:]) for call in calls}
        cpu.call("arm")
        for frame, codes in enumerate(recordings.recording(number), 1):
            before = np.array([cpu.instructions, cpu.cycles])
            cpu.write("the_codes", codes)
            flags = cpu.call("frame")
            answer = (flags, *cpu.read("the_decision", 4)) if flags else None
            kind = "step" if flags else "frame" if inside[number][frame] else "quiet"
            counts[kind].append((cpu.instructions - before[0], cpu.cycles - before[1]))
            decisions += bool(flags)
            different += answer != due.get(frame)
        flags = cpu.call("finish")
        decisions += bool(flags)
        different += ((flags, *cpu.read("the_decision", 4)) if flags else None) != due.get(0)
    mean = {
        kind: np.mean(values, axis=0) if values else np.full(2, np.nan) for kind, values in counts.items()
    }
    mean["step"] = mean["step"] - mean["frame"]
    mean["touch"] = model.config.windows.steps * mean["step"] + model.config.last_frame * mean["frame"]
    instructions, cycles = ({kind: float(pair[part]) for kind, pair in mean.items()} for part in (0, 1))
    record = {"core": core, "decisions": decisions, "different": different, "instructions": instructions}
    return record | ({"cycles": cycles} if core == "Cortex-M0+" else {})
