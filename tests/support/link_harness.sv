// A board on a desk: `board_top`, its serial pins driven and heard by the bench.
`timescale 1ns / 1ps

module link_harness #(parameter integer CLASSES = 3) (
    input wire clk /* verilator public_flat_rw */
);
    reg rst /* verilator public_flat_rw */ = 1'b0;
    reg rx /* verilator public_flat_rw */ = 1'b1;
    wire tx /* verilator public_flat_rd */;
    wire [CLASSES-1:0] decision /* verilator public_flat_rd */;
    wire decision_valid /* verilator public_flat_rd */;
    wire led;
    board_top dut (.clk(clk), .rst(rst), .rx(rx), .tx(tx), .decision(decision), .decision_valid(decision_valid), .led(led));
endmodule
