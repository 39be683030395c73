"""A checked program: a changed word is told. That words come slot by slot is proved in formal/engine/sequencer.py
and compared in tests/rtl/engine/test_engine.py."""

from eskin.golden.core import PRESETS, QFormat
from eskin.rtl.engine.sequencer import Sequencer
from eskin.rtl.program.microcode import Microcode
from eskin.rtl.program.schedule import schedule
from tests.support.stream_bench import simulate


def test_a_checked_program_is_right_word_by_word_and_a_changed_word_is_told():
    config = PRESETS["thesis"].replace(
        lanes=3, taxels=4, hidden=4, state_format=QFormat(4, 12), checksum=True
    )
    code = Microcode(schedule(config))

    class Changed(Sequencer):
        """One bit of the first word inverted."""

        def elaborate(self, platform):
            m = super().elaborate(platform)
            init = m.submodules.program.init
            init[0] = {**init[0], "turns": 1 - init[0]["turns"]}
            return m

    def wrong_words(dut) -> set[int]:
        cycles = set()

        async def bench(ctx):
            ctx.set(dut.go, 1)
            for cycle in range(2 * len(code.slots)):
                _, _, enable, wrong = await ctx.tick().sample(dut.enable, dut.wrong)
                if enable and wrong:
                    cycles.add(cycle)

        simulate(dut, bench)
        return cycles

    assert wrong_words(Sequencer(code)) == set() and wrong_words(Changed(code)) == {1}, (
        "the first word comes in cycle 1"
    )
