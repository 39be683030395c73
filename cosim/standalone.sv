// A board without a host (module accelerator, a netlist on its own oscillators) between a converter's model and its pins, under
// cosim/pins_bench.py. 10 ns of the simulation are a nominal cycle of the fast oscillator, as for the converter's model.
`timescale 1ns / 1ps
module standalone #(parameter integer BEATS = 16, CLASSES = 3) ();
    /* verilator public_flat_rw_on */
    reg [32*BEATS-1:0] analog = 0;
    reg [63:0] slow_half = 6000000, fast_half = 5000, start_up = 12000000;
    /* verilator public_flat_rd_on */
    wire led, decision_valid, unsure, power, moving;
    wire [CLASSES-1:0] decision;
    wire [31:0] violations;
    reg [31:0] scans = 0, cycles = 0, early = 0, awake = 0;
    reg moved = 1'b0;
    /* verilator public_off */
    wire asleep;
    `PIN_WIRES
    assign moving = `PORT_BUSY;
    assign power = dut.fast.CLKHFPU;
    converter #(`MODEL_PARAMETERS) model (`MODEL_PINS, .analog(analog), .fault(3'd0), .violations(violations), .asleep(asleep));
    accelerator dut (.*, `DESIGN_PINS);
    wire clock = dut.fast.CLKHF;
    always @(posedge clock) cycles <= cycles + 1;
    always @(posedge moving) moved = 1'b1;
    always @(negedge power) begin
        scans = scans + {31'd0, moved};
        early = dut.fast.violations;
        awake = awake + {31'd0, !asleep};
        moved = 1'b0;
    end
endmodule
