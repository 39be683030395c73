"""rtl/top/standby.py: what crosses between its clocks, which designs it takes, and its plan; formal/top/standby.py proves its turns."""

from amaranth.hdl import Fragment

from eskin.golden.core import PRESETS, converter_plan
from eskin.rtl.top.standby import StandbyControl, cannot_sleep, standby_plan, start_cycles
from tests.support.table import each_row

PVDF = PRESETS["pvdf"].replace(feature_shift=(4,), scan_every=8, converter="ads7953")


def crossings(part: Fragment) -> set[tuple[str, str]]:
    """(register, domain of it) of every register that is read in a domain other than where it is driven."""
    owner, reads, logic = {}, [], {}

    def collect(inner: Fragment) -> None:
        for domain, statements in inner.statements.items():
            for statement in statements:
                if domain == "comb":
                    for signal in statement._lhs_signals():
                        logic.setdefault(id(signal), []).extend(statement._rhs_signals())
                    continue
                for signal in statement._lhs_signals():
                    owner[id(signal)] = domain
                    reads.extend((signal.name, domain, source) for source in statement._rhs_signals())
        for each, _, _ in inner.subfragments:
            collect(each)

    collect(part)
    found = set()
    while reads:
        name, domain, source = reads.pop()
        if owner.get(id(source), domain) != domain:
            found.add((name, domain))
        reads += [(name, domain, each) for each in logic.pop(id(source), ())]
    return found


def test_only_synchronisers_read_the_other_domain():
    assert crossings(Fragment.get(StandbyControl(2), None)) == {("stage0", "slow"), ("stage0", "sync")}


@each_row(
    "changes, clock_hz, why",
    [
        ({}, 12e6, ""),
        ({}, 10e6, "6, 12, 24, 48 MHz"),
        ({"scan_every": 1}, 12e6, "2000 scans a second leave 0.5"),
        ({"stimulator": "decisions"}, 12e6, "stimulator"),
        ({"converter": "ddc232", "clock_hz": 20e6, "scan_every": 1}, 12e6, "integrates"),
    ],
)
def test_designs_whose_clock_may_stop(changes, clock_hz, why):
    reason = cannot_sleep(PVDF.replace(**changes), clock_hz)
    assert why in reason and bool(why) == bool(reason)


def test_no_limit_is_broken_at_the_fastest_clock():
    """At 13.2 MHz for 12: an MCP3208 keeps its 1 MHz, an ADS7953 has 38 ns to answer and its wires 30, or `hz` sets their
    pace; a start lasts 100 us at 11 kHz."""
    fastest, slow = 1.1 * 12e6, 10e3
    mcp = standby_plan(PVDF.replace(converter="mcp3208x2"), 12e6)
    assert fastest / 2 / mcp.half <= 1e6 < fastest / 2 / (mcp.half - 1)
    ads, slower = standby_plan(PVDF, 12e6), PVDF.replace(converter=dict(name="ads7953", hz=2e6))
    assert 12e6 / ads.sclk_cycles == 6e6 and ads.transfers[-2:] == ((0, 0x1820), (0, 0))
    assert standby_plan(slower, 12e6).half == converter_plan(slower, 12e6).half == 3
    for clock_hz, half, cycles in (
        (6e6, 1, 1),
        (24e6, 2, 2),
        (48e6, 3, 4),
    ):  # from a falling clock to its line's register
        assert standby_plan(PVDF, clock_hz).half == half and cycles / (1.1 * clock_hz) >= 68e-9
    matrix = PVDF.replace(converter="matrix", rows=2, columns=4)
    assert standby_plan(matrix, 12e6).sclk_cycles == 2 and converter_plan(matrix, 12e6).sclk_cycles == 6
    unknown = PVDF.replace(converter=dict(name="spi", channel_bit=13))
    assert standby_plan(unknown, 12e6).half == converter_plan(unknown, 12e6).half == 3
    assert (start_cycles() - 1) / (1.1 * slow) < 100e-6 <= start_cycles() / (1.1 * slow)
