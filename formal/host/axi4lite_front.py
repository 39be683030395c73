"""AXI4-Lite: the protocol's rules, one access and one response a request."""

from amaranth.hdl import Module, Mux, Signal

from eskin.rtl.host.axi4lite_front import Axi4LiteFront
from formal.proof import Bug, assume, before, free, placed, proof, prove


@proof(
    "a response stays until it is taken, comes after its request and once; each request is one access with its "
    "own address and data, which hold until the shell is done; a read does not wait for two writes",
    depth=3,
    reduced="none",
    quick=True,
    bugs=(
        Bug(
            "a write acts again while its response waits",
            "& ~self.s_axi_awready & ~self.s_axi_bvalid",
            "& ~self.s_axi_awready",
        ),
        Bug(
            "a request acts again while it is taken",
            "readable = self.s_axi_arvalid & ~self.s_axi_arready &",
            "readable = self.s_axi_arvalid &",
        ),
        Bug("a response does not wait", "(self.s_axi_rvalid & ~self.s_axi_rready)", "0"),
        Bug(
            "a write begins without its data",
            "writable = self.s_axi_awvalid & self.s_axi_wvalid &",
            "writable = self.s_axi_awvalid &",
        ),
        Bug("the choice changes under way", "Mux(busy, chosen, writable", "Mux(0, chosen, writable"),
        Bug("data are kept of a write too", "with m.If(ends & ~write):", "with m.If(ends):"),
    ),
)
def one_access_one_response(m: Module) -> None:
    dut = placed(Axi4LiteFront())
    request = dut.request
    channels = {"aw": ("awaddr",), "w": ("wdata", "wstrb"), "ar": ("araddr",)}
    port = lambda name: getattr(dut, f"s_axi_{name}")
    free(request.done, request.r_data, port("bready"), port("rready"))
    for name, payload in channels.items():
        free(port(f"{name}valid"), *map(port, payload))
        waits = before(port(f"{name}valid") & ~port(f"{name}ready"), f"{name}_waits")
        for signal in payload:
            assume(~waits | port(f"{name}valid") & (port(signal) == before(port(signal), f"was_{signal}")))
    open_ = before(request.valid & ~request.done, "open")
    assume(~request.done | open_)  # as the shell answers
    accepted = {name: port(f"{name}valid") & port(f"{name}ready") for name in ("aw", "w", "b", "ar", "r")}
    ends = request.valid & request.done
    # ---- requests
    prove(~open_ | request.valid, "an access holds")
    for name in ("write", "whole", "address", "w_data"):
        value = getattr(request, name)
        prove(
            ~open_ | ((value == before(value, f"was_{name}")) if name in ("write", "address") else 1),
            f"{name} holds",
        )
    prove(~(request.valid & request.write) | port("awvalid") & port("wvalid"), "a write is asked for")
    prove(~(request.valid & ~request.write) | port("arvalid"), "a read is asked for")
    address = Mux(request.write, port("awaddr"), port("araddr"))
    prove(
        ~request.valid | (request.address == address[2:]) & (request.w_data == port("wdata")),
        "of the request",
    )
    prove(request.whole == port("wstrb").all(), "all bytes")
    prove(
        (accepted["aw"] == accepted["w"]) & (accepted["aw"] == before(ends & request.write, "wrote_now")),
        "taken when done",
    )
    prove(accepted["ar"] == before(ends & ~request.write, "read_now"), "read taken when done")
    # ---- responses
    for response, channel in (("b", "aw"), ("r", "ar")):
        owed = Signal(name=f"owed_{response}")
        valid = port(f"{response}valid")
        m.d.sync += owed.eq(accepted[channel] | owed & ~accepted[response])
        prove(valid == owed, f"{response}: one response, from the cycle after its request until it is taken")
        prove(~(accepted[channel] & owed), f"{response}: one at a time")
        prove(port(f"{response}resp") == 0, "OKAY")
    value = Signal(32, name="value")
    with m.If(ends & ~request.write):
        m.d.sync += value.eq(request.r_data)
    prove(port("rdata") == value, "what was read")
    # ---- turns
    passed = Signal(2, name="passed")  # writes that ended while a read could have begun
    could = port("arvalid") & ~port("arready") & ~port("rvalid")
    m.d.sync += passed.eq(Mux(~could, 0, passed + (ends & request.write)))
    prove(passed <= 1, "a read waits for one write at most")
    # ---- for the induction
    for response, channel, way in (("b", "aw", request.write), ("r", "ar", ~request.write)):
        under_way = request.valid & way
        prove(
            ~under_way | ~port(f"{response}valid") & ~port(f"{channel}ready"),
            f"{response}: none is owed under way",
        )
    prove(dut.busy == open_, "busy")
    prove(~open_ | (dut.chosen == before(request.write, "was_chosen")), "chosen")
    prove((passed == 0) | ~could | ~(dut.busy & dut.chosen), "turn")
