// A TI ADS7953 as its data sheet (SLAS605) describes it: 16 channels, 12 bits, serial port of 16 clocks a frame.
//
// Manual mode: a word that is clocked in during frame N sets the multiplexer in frame N+1; that channel is converted when frame N+2 begins,
// and comes out in it: number in bits 15..12, code in 11..0. Data change on falling clock edges and are good on rising ones.
// DI05 powers it down with the sixteenth clock of the frame behind; where the register has it no more, a frame's beginning powers it up,
// which takes 1 us, and the conversion of that frame is not valid.
// fault: 1 SDO stays low, 2 SDO is not driven (a pull-up holds it high), 3 the multiplexer does not move.
`timescale 1ns / 1ps

module converter #(
    parameter integer TAXELS = 16,
    parameter integer LINES = 1,
    parameter integer SELECTS = 1,
    parameter integer CYCLE_PS = 83333,  // a cycle of the design; the simulation's clock has 10 ns whatever it stands for
    parameter integer FRAME_BITS = 16, parameter integer CHANNELS = 16, parameter integer CHANNEL_BIT = 7, parameter integer DELAY = 2,
    parameter integer CODE_BIT = 0, parameter integer CODE_BITS = 12, parameter integer TAG_BIT = 12, parameter integer TAG_BITS = 4,
    parameter integer ZEROS = 0
) (
    input wire [SELECTS-1:0] cs_n, input wire sclk, input wire mosi, output wire [LINES-1:0] miso,
    input wire [32*TAXELS-1:0] analog, input wire [2:0] fault, output integer violations, output reg asleep
);
    reg [3:0] multiplexer = 4'd0, wanted = 4'd0;
    reg manual = 1'b0;
    reg [15:0] out = 16'd0, in = 16'd0;
    integer clocks = 0;
    reg down = 1'b0, goes = 1'b0;  // DI05 of the register, and as this frame began
    time fell = 0, rose = 0, clocked = 0, woke = 0;
    initial begin
        violations = 0;
        asleep = 1'b0;
    end

    function time ps(input time since);  // picoseconds of the design's time since then
        ps = ($time - since) * CYCLE_PS / 10;
    endfunction

    always @(negedge cs_n[0]) begin
        if (rose != 0 && ps(rose) < 40000) violations = violations + 1;      // CS high between frames
        fell = $time;
        out = {multiplexer, analog[32*multiplexer +: 12]};                    // sampled when the frame begins
        if (!asleep && woke != 0 && ps(woke) < 1000000) violations = violations + 1;
        if (asleep) out = $random;
        if (asleep && !down) begin
            woke = $time;
            asleep = 1'b0;
        end
        goes = down;
        multiplexer = fault == 3 ? multiplexer : wanted;                      // and the next channel is switched in during it
        clocks = 0;
    end
    always @(posedge sclk) if (!cs_n[0]) begin
        if (clocks == 0 && ps(fell) < 20000) violations = violations + 1;     // CS fall to first clock
        if (clocks != 0 && ps(clocked) < 50000) violations = violations + 1;  // 20 MHz at most
        clocked = $time;
        in = {in[14:0], mosi};
        clocks = clocks + 1;
    end
    always @(negedge sclk) if (!cs_n[0]) out = {out[14:0], 1'b0};
    always @(posedge cs_n[0]) begin
        rose = $time;
        if (clocks == 16) begin
            if (goes) asleep = 1'b1;
            if (in[15:12] == 4'b0001) begin
                manual = 1'b1;
                if (in[11]) down = in[5];
                if (in[11]) wanted = in[10:7];
                if (in[11] && in[4]) violations = violations + 1;             // the number would not come back with the code
            end else if (in[15:12] != 4'b0000) violations = violations + 1;   // a mode that this model does not know
        end
    end
    wire level = fault == 1 ? 1'b0 : fault == 2 || cs_n[0] ? 1'b1 : out[15];
    assign #(380000.0 / CYCLE_PS) miso[0] = level;                            // 38 ns behind CS or a falling edge
endmodule
