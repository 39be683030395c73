"""A memory of registers in place of `amaranth.lib.memory.Memory`, for proofs that must name a memory's
words."""

from contextlib import ExitStack, contextmanager
from types import SimpleNamespace
from unittest import mock

from amaranth.asserts import AnySeq
from amaranth.hdl import Array, Elaboratable, Module, Mux, Shape, Signal, Value
from amaranth.utils import ceil_log2


class OpenMemory(Elaboratable):
    """The ports of a memory that the blocks use, with two freedoms of the real one: first contents are
    arbitrary, and so is a word that is read in the cycle that writes it (rtl/common/collisions.py). A proof
    that holds for it holds for the real memory.

    Attributes
    ----------
    words:
        The registers; their names begin with ``free_``, which makes formal/run.py leave out their initial
        values.
    reads, writes:
        Their ports.
    """

    def __init__(self, *, shape, depth: int, init=(), attrs=None) -> None:
        if len(list(init)):
            raise ValueError("a memory with contents stays what it is")
        self.layout, self.shape, self.depth = shape, Shape.cast(shape), depth
        self.words = Array(Signal(self.shape, name=f"free_word_{k}") for k in range(depth))
        self.reads: list = []
        self.writes: list = []

    def _port(self, kind: list, name: str):
        port = SimpleNamespace(
            addr=Signal(ceil_log2(self.depth), name=f"{name}_addr"),
            data=Signal(self.layout, name=f"free_{name}_data"),
            en=Signal(name=f"{name}_en", init=name == "read"),
        )
        kind.append(port)
        return port

    def read_port(self):
        """Read port as of the real memory: a cycle late, only with ``en``."""
        return self._port(self.reads, "read")

    def write_port(self):
        """Write port as of the real memory, without granularity."""
        return self._port(self.writes, "write")

    def elaborate(self, platform):
        m = Module()
        for port in self.writes:
            with m.If(port.en):
                m.d.sync += self.words[port.addr].eq(Value.cast(port.data))
        for port in self.reads:
            collides = Value.cast(0)
            for other in self.writes:
                collides = collides | (other.en & (other.addr == port.addr))
            with m.If(port.en):
                m.d.sync += Value.cast(port.data).eq(Mux(collides, AnySeq(self.shape), self.words[port.addr]))
        return m


@contextmanager
def opened(*modules):
    """Within it the named modules make `OpenMemory`; gives the list that collects them in the order of their
    making."""
    made: list[OpenMemory] = []

    def make(**arguments):
        made.append(OpenMemory(**arguments))
        return made[-1]

    with ExitStack() as stack:
        for module in modules:
            stack.enter_context(mock.patch.object(module, "Memory", make))
        yield made
