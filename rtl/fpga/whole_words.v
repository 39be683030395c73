// Techmap, after Yosys' memory_libmap: an iCE40 block memory that only ever writes whole words needs no byte mask beside its write enable.
// Yosys gives it one, the enable once more and inverted: a logic cell for each memory.
(* techmap_celltype = "$__ICE40_RAM4K_" *)
module whole_words (
    PORT_R_CLK, PORT_R_RD_EN, PORT_R_ADDR, PORT_R_RD_DATA, PORT_W_CLK, PORT_W_WR_EN, PORT_W_WR_BE, PORT_W_ADDR, PORT_W_WR_DATA
);
    parameter INIT = 0;
    parameter OPTION_HAS_BE = 1;
    parameter PORT_R_WIDTH = 16;
    parameter PORT_W_WIDTH = 16;
    parameter PORT_W_WR_BE_WIDTH = 16;
    parameter PORT_R_CLK_POL = 1;
    parameter PORT_W_CLK_POL = 1;
    // Numbers that are the same for bits of ports on the same net; bits that are constant.
    parameter _TECHMAP_BITS_CONNMAP_ = 0;
    parameter [16*_TECHMAP_BITS_CONNMAP_-1:0] _TECHMAP_CONNMAP_PORT_W_WR_BE_ = 0;
    parameter [15:0] _TECHMAP_CONSTMSK_PORT_W_WR_BE_ = 0;
    parameter [15:0] _TECHMAP_CONSTVAL_PORT_W_WR_BE_ = 0;

    input PORT_R_CLK, PORT_R_RD_EN, PORT_W_CLK, PORT_W_WR_EN;
    input [10:0] PORT_R_ADDR, PORT_W_ADDR;
    output [PORT_R_WIDTH-1:0] PORT_R_RD_DATA;
    input [15:0] PORT_W_WR_BE;
    input [PORT_W_WIDTH-1:0] PORT_W_WR_DATA;

    // One net for every bit that is not constant (a memory narrower than its words has bits that are never written).
    function one_net;
        input unused;
        integer bit;
        begin
            one_net = !_TECHMAP_CONSTMSK_PORT_W_WR_BE_[0];
            for (bit = 1; bit < 16; bit = bit + 1)
                one_net = one_net && (_TECHMAP_CONSTMSK_PORT_W_WR_BE_[bit]
                    || _TECHMAP_CONNMAP_PORT_W_WR_BE_[bit*_TECHMAP_BITS_CONNMAP_ +: _TECHMAP_BITS_CONNMAP_]
                    == _TECHMAP_CONNMAP_PORT_W_WR_BE_[0 +: _TECHMAP_BITS_CONNMAP_]);
        end
    endfunction
    wire _TECHMAP_FAIL_ = !OPTION_HAS_BE || !one_net(1'b0);
    wire [15:0] written = ~_TECHMAP_CONSTMSK_PORT_W_WR_BE_ | _TECHMAP_CONSTVAL_PORT_W_WR_BE_;

    $__ICE40_RAM4K_ #(
        .INIT(INIT), .OPTION_HAS_BE(OPTION_HAS_BE), .PORT_R_WIDTH(PORT_R_WIDTH), .PORT_W_WIDTH(PORT_W_WIDTH),
        .PORT_W_WR_BE_WIDTH(PORT_W_WR_BE_WIDTH), .PORT_R_CLK_POL(PORT_R_CLK_POL), .PORT_W_CLK_POL(PORT_W_CLK_POL)
    ) _TECHMAP_REPLACE_ (
        .PORT_R_CLK(PORT_R_CLK), .PORT_R_RD_EN(PORT_R_RD_EN), .PORT_R_ADDR(PORT_R_ADDR), .PORT_R_RD_DATA(PORT_R_RD_DATA),
        .PORT_W_CLK(PORT_W_CLK), .PORT_W_WR_EN(PORT_W_WR_EN & PORT_W_WR_BE[0]), .PORT_W_WR_BE(written), .PORT_W_ADDR(PORT_W_ADDR),
        .PORT_W_WR_DATA(PORT_W_WR_DATA)
    );
endmodule
