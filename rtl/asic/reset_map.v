// A register whose reset goes before its enable, with an enable alone, so that a clock gate can have it.
(* techmap_celltype = "$sdffe" *)
module enabled_or_reset (CLK, SRST, EN, D, Q);
    parameter WIDTH = 1, CLK_POLARITY = 1, EN_POLARITY = 1, SRST_POLARITY = 1;
    parameter [WIDTH-1:0] SRST_VALUE = 0;
    input CLK, SRST, EN;
    input [WIDTH-1:0] D;
    output [WIDTH-1:0] Q;

    wire reset = SRST_POLARITY ? SRST : ~SRST;
    wire enable = EN_POLARITY ? EN : ~EN;
    \$dffe #(.WIDTH(WIDTH), .CLK_POLARITY(CLK_POLARITY), .EN_POLARITY(1'b1)) register (
        .CLK(CLK), .EN(enable | reset), .D(reset ? SRST_VALUE : D), .Q(Q));
endmodule
