// Memories as a chip has them. Read ports are registered, the old word where a write meets a read, as Yosys' own mapping has them.
// A latch opens for the half cycle after the edge that took word and address: what is written at an edge is there in the next cycle.
(* techmap_celltype = "$mem_v2" *)
module latch_memory (RD_CLK, RD_EN, RD_ARST, RD_SRST, RD_ADDR, RD_DATA, WR_CLK, WR_EN, WR_ADDR, WR_DATA);
    parameter MEMID = "", SIZE = 2, OFFSET = 0, ABITS = 1, WIDTH = 1, INIT = 0;
    parameter RD_PORTS = 1, RD_CLK_ENABLE = 1, RD_CLK_POLARITY = 1, RD_TRANSPARENCY_MASK = 0, RD_COLLISION_X_MASK = 0;
    parameter RD_WIDE_CONTINUATION = 0, RD_CE_OVER_SRST = 0, RD_ARST_VALUE = 0, RD_SRST_VALUE = 0, RD_INIT_VALUE = 0;
    parameter WR_PORTS = 1, WR_CLK_ENABLE = 1, WR_CLK_POLARITY = 1, WR_PRIORITY_MASK = 0, WR_WIDE_CONTINUATION = 0;
    input [RD_PORTS-1:0] RD_CLK, RD_EN, RD_ARST, RD_SRST;
    input [RD_PORTS*ABITS-1:0] RD_ADDR;
    output reg [RD_PORTS*WIDTH-1:0] RD_DATA;
    input [WR_PORTS-1:0] WR_CLK;
    input [WR_PORTS*WIDTH-1:0] WR_EN, WR_DATA;
    input [WR_PORTS*ABITS-1:0] WR_ADDR;

    reg [WIDTH-1:0] taken;  // no reset: only what is written counts
    wire [WIDTH-1:0] word [0:SIZE-1];
    wire bank;  // the word that waits and the words' gates see the clock only where something is written
    always @(posedge bank) taken <= WR_DATA[WIDTH-1:0];
    \$__CLOCK_GATE bank_gate (.CLK(WR_CLK[0]), .CE(WR_EN[0]), .GCLK(bank));
    genvar k, p;
    generate
        for (k = 0; k < SIZE; k = k + 1) begin : words
            wire open;
            \$__CLOCK_GATE gate (.CLK(bank), .CE(WR_ADDR[ABITS-1:0] == k + OFFSET), .GCLK(open));
            \$dlatch #(.WIDTH(WIDTH), .EN_POLARITY(1'b1)) bits (.EN(open), .D(taken), .Q(word[k]));
        end
        for (p = 0; p < RD_PORTS; p = p + 1) begin : reads
            wire [ABITS-1:0] at = RD_ADDR[p*ABITS +: ABITS] - OFFSET;
            always @(posedge RD_CLK[p]) if (RD_EN[p]) RD_DATA[p*WIDTH +: WIDTH] <= word[at];
        end
    endgenerate
endmodule
