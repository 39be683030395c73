"""The iCE40's DSP block, SB_MAC16, as lanes and adders use it."""

from typing import Any

from amaranth.hdl import ClockSignal, Const, Instance, Value

OTHER_PINS = (
    *("AHOLD", "BHOLD", "CHOLD", "DHOLD", "IRSTTOP", "IRSTBOT", "ORSTTOP", "ORSTBOT", "OHOLDTOP", "OHOLDBOT"),
    *("OLOADTOP", "OLOADBOT", "ADDSUBTOP", "ADDSUBBOT", "CI", "ACCUMCI", "SIGNEXTIN"),
)


def sb_mac16(out: Value, enable: Value, a: Value, b: Value, load: Value, **ports: Any) -> Instance:
    """An SB_MAC16 that is clocked where ``enable``, whose registered sum of 32 bits is ``out``; ``load``: inputs C and
    D; ``ports``: parameters and further pins, which are 0 otherwise."""
    return Instance(
        "SB_MAC16",
        p_TOPOUTPUT_SELECT=1,
        p_BOTOUTPUT_SELECT=1,
        p_TOPADDSUB_CARRYSELECT=2,
        i_CLK=ClockSignal(),
        i_CE=enable,
        i_A=a,
        i_B=b,
        i_C=load[16:],
        i_D=load[:16],
        o_O=out,
        **{f"i_{pin}": Const(0) for pin in OTHER_PINS} | ports,
    )
