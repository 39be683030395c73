// Analog Devices AD7476A as its data sheet describes it, a chip a taxel on shared CS and clock (a Pmod AD1 has two): 12 bits, 16 clocks.
// CS falling takes the sample and puts out the first of four leading zeros; each falling edge of the clock puts out the next bit; after the
// sixteenth falling edge, and with CS high, SDATA is not driven (a pull-up holds it high).
// CS that rises between the second and the tenth falling edge powers it down; the next transfer of ten or more wakes it, whose data are not
// valid, and a sample 1 us after its beginning is.
// fault: 1 SDATA stays low, 2 not driven, 3 the last chip alone is missing.
`timescale 1ns / 1ps

module converter #(
    parameter integer TAXELS = 16, parameter integer LINES = 16, parameter integer SELECTS = 1, parameter integer CYCLE_PS = 83333,
    parameter integer FRAME_BITS = 16, parameter integer CHANNELS = 1, parameter integer CHANNEL_BIT = 0, parameter integer DELAY = 0,
    parameter integer CODE_BIT = 0, parameter integer CODE_BITS = 12, parameter integer TAG_BIT = 0, parameter integer TAG_BITS = 0,
    parameter integer ZEROS = 0
) (
    input wire [SELECTS-1:0] cs_n, input wire sclk, input wire mosi, output wire [LINES-1:0] miso,
    input wire [32*TAXELS-1:0] analog, input wire [2:0] fault, output integer violations, output reg asleep
);
    reg [11:0] held [0:TAXELS-1];
    integer falls = 0, k = 0, s = 0, at = 0, clocked = 0, waking = 0;
    reg [LINES-1:0] said;
    assign #(400000.0 / CYCLE_PS) miso = said;  // 40 ns behind CS or a falling edge
    initial begin
        violations = 0;
        asleep = 1'b0;
        said = {LINES{1'b1}};
    end
    always @(cs_n, negedge sclk) begin
        if (&cs_n) begin
            if (falls >= 2) begin
                waking = asleep && falls >= 10 ? at : 0;
                asleep = falls < 10;
            end
            falls = -1;
        end
        else if (falls < 0) begin
            falls = 0;
            at = $time / 10;
            if (waking != 0 && (at - waking) * CYCLE_PS < 1000000) violations = violations + 1;
            for (k = 0; k < TAXELS; k = k + 1) held[k] = asleep ? $random : analog[32*k +: 12];
        end else begin
            falls = falls + 1;
            if (falls > 1 && ($time / 10 - clocked) * CYCLE_PS < 50000) violations = violations + 1;  // 20 MHz at most
            clocked = $time / 10;
        end
        for (k = 0; k < LINES; k = k + 1) begin
            s = 0;
            while (s < SELECTS - 1 && cs_n[s]) s = s + 1;
            if (fault == 1) said[k] = 1'b0;
            else if (fault == 2 || falls < 0 || falls > 15 || (fault == 3 && s * LINES + k == TAXELS - 1)) said[k] = 1'b1;
            else said[k] = falls < 4 ? 1'b0 : held[s * LINES + k][15 - falls];
        end
    end
endmodule
