"""Payloads between the parts of the image engine."""

from amaranth.hdl import unsigned
from amaranth.lib import data
from amaranth.utils import ceil_log2

from eskin.rtl.common import struct
from eskin.rtl.program.image_passes import ImagePlan


def pass_layout(plan: ImagePlan) -> data.StructLayout:
    """A pass as `eskin.rtl.program.image_passes.Word` has it; addresses are as wide as the memories
    require."""
    address = unsigned(plan.address_bits)
    return struct(
        radius=2,
        pool=1,
        dense=1,
        last=1,
        pairs=int(plan.pairs),
        shift=5,
        columns=8,
        rows=8,
        groups=8,
        last_group=8,
        channels=address,
        row=address,
        kernel_row=address,
        group=address,
        weights=address,
        corner=address,
        addends=address,
    )


def tap_layout(plan: ImagePlan) -> data.StructLayout:
    """A tap: addresses of its activation and weights."""
    return struct("valid", activation=unsigned(plan.address_bits), weight=unsigned(plan.address_bits))


def sum_layout(plan: ImagePlan) -> data.StructLayout:
    """Sums that leave the lanes: do they open or close a pool's window, and how many lanes count, less one.

    ``alone``: only the left place of a pair lies in the map.
    """
    lanes = max(1, ceil_log2(plan.lanes))
    return struct("valid", "opens", "closes", alone=int(plan.pairs), lanes=lanes)
