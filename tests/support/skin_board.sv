// A board without a host (module accelerator) between a converter's model and its pins; tests/support/skin_bench.py plays it.
`timescale 1ns / 1ps
module skin_board #(parameter integer BEATS = 16, CLASSES = 3, CYCLE_PS = 83333) ();
    /* verilator public_flat_rw_on */
    reg [32*BEATS-1:0] analog = 0;
    reg [2:0] misbehaves = 0;
    reg rx = 1'b1;
    /* verilator public_flat_rd_on */
    wire stim_tx, tx, led, decision_valid, moving;
    wire [CLASSES-1:0] decision;
    wire [CLASSES+1:0] shown = {decision, decision_valid, led};
    wire [31:0] violations;
    /* verilator public_off */
    reg clk = 1'b0;
    always #5 clk = ~clk;
    `PIN_WIRES
    assign moving = `PORT_BUSY;
    converter #(`MODEL_PARAMETERS) model (`MODEL_PINS, .analog(analog), .fault(misbehaves), .violations(violations));
    accelerator dut (.*, `DESIGN_PINS);
endmodule
