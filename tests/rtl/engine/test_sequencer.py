"""Words slot by slot, repeats, waiting, beginning again: against the microcode's own unrolled words."""

import pytest
from amaranth.hdl import ResetInserter, Signal

from eskin.golden.core import PRESETS, QFormat
from eskin.rtl.engine.sequencer import Sequencer
from eskin.rtl.program.microcode import ADDRESSES, CONTROLS, Microcode
from eskin.rtl.program.schedule import schedule
from tests.support.stream_bench import simulate

FIELDS = (*ADDRESSES, *CONTROLS)


def microcode(lanes: int, **changes) -> Microcode:
    small = {"taxels": 4, "hidden": 4, "state_format": QFormat(4, 12), **changes}
    return Microcode(schedule(PRESETS["thesis"].replace(lanes=lanes, **small)))


@pytest.fixture(scope="module", params=[1, 3])
def code(request) -> Microcode:
    return microcode(request.param)


def play(code: Microcode, cycles: int, go=lambda cycle: 1, restart=lambda cycle: 0, reset=lambda cycle: 0):
    """(cycle, word, ended) of every slot that ended, and the cycles spent waiting."""
    dut, taken, waits, anew = Sequencer(code), [], [], Signal()

    async def bench(ctx):
        fields = [getattr(dut.word, name) for name in FIELDS]
        ticks = aiter(ctx.tick().sample(dut.enable, dut.waiting, dut.ended, *fields))
        for cycle in range(cycles):
            for signal, value in ((dut.go, go(cycle)), (dut.restart, restart(cycle)), (anew, reset(cycle))):
                ctx.set(signal, value)
            _, _, enable, waiting, ended, *values = await anext(ticks)
            if enable:
                taken.append((cycle, dict(zip(FIELDS, values, strict=True)), ended))
            if waiting:
                waits.append(cycle)
            assert ended <= enable

    simulate(ResetInserter(anew)(dut), bench)
    return taken, waits


def check(code: Microcode, taken, passes: list[bool]) -> None:
    """The words taken are the program's: the prologue and a step, then steps with a prologue where ``passes``
    says so."""
    words = [{name: word[name] for name in FIELDS} for word in code.unrolled()]
    first = [None] * code.idle_words + list(range(len(words)))
    order = list(first)
    for with_prologue in passes:
        order += first if with_prologue else range(code.again, len(words))
    assert len(taken) <= len(order), "give more passes"
    for (_, word, _), number in zip(taken, order, strict=False):
        if number is None:
            assert not any(
                word[name] for name in CONTROLS if any(other[name] != words[0][name] for other in words)
            )
        else:
            assert word == words[number]
    assert [ended for _, _, ended in taken] == [
        int(number == len(words) - 1) for number in order[: len(taken)]
    ]


def test_restart_is_looked_at_in_the_last_word_but_two(code):
    # slots up to that word's last, in cycle `before`
    before = code.idle_words + sum(word["repeat"] + 1 for word in code.words[:-2])
    for cycle, seen in ((before - 1, False), (before, True), (before + 1, False)):
        if code.words[-3]["repeat"] == 0 or seen:
            taken, _ = play(
                code, code.idle_words + 3 * len(code.slots), restart=lambda now, cycle=cycle: now == cycle
            )
            check(code, taken, [seen, False, False])


def test_waiting_freezes_the_slot_until_go(code):
    wait = code.idle_words + code.wait
    late = wait + 40
    taken, waits = play(code, wait + 100, go=lambda cycle: cycle == late)
    check(code, taken, [False] * 3)
    assert waits[:40] == list(range(wait + 1, late + 1))
    assert [cycle for cycle, _, _ in taken][wait - 1 : wait + 3] == [wait, late, late + 1, late + 2]
    assert len(waits) == 40, "go is only asked for at the wait"


def test_a_checked_program_is_right_word_by_word_and_a_changed_word_is_told():
    code = microcode(3, checksum=True)

    class Changed(Sequencer):
        """One bit of the first word inverted."""

        def elaborate(self, platform):
            m = super().elaborate(platform)
            init = m.submodules.program.init
            init[0] = {**init[0], "turns": 1 - init[0]["turns"]}
            return m

    def told(dut) -> set[int]:
        cycles = set()

        async def bench(ctx):
            ctx.set(dut.go, 1)
            for cycle in range(2 * len(code.slots)):
                _, _, enable, wrong = await ctx.tick().sample(dut.enable, dut.wrong)
                if enable and wrong:
                    cycles.add(cycle)

        simulate(dut, bench)
        return cycles

    assert told(Sequencer(code)) == set() and told(Changed(code)) == {1}, "the first word comes in cycle 1"
