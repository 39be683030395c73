// A force-sensitive matrix behind two multiplexers, an amplifier that needs SETTLE_PS to settle on a new cell, and an AD7476 as its data sheet
// describes it (see ad7476.sv), its sleep too. A sample that is taken too early is half the cell before. While `off`, nothing is at the amplifier,
// and it settles anew behind.
// fault: 1 SDATA stays low, 2 not driven (a pull-up holds it high), 3 a leading bit is not 0.
`timescale 1ns / 1ps

module converter #(
    parameter integer ROWS = 4, parameter integer COLUMNS = 4, parameter integer CYCLE_PS = 83333, parameter integer SETTLE_PS = 20000000
) (
    input wire [31:0] row, input wire [31:0] column, input wire off, input wire cs_n, input wire sclk, output wire miso,
    input wire [32*ROWS*COLUMNS-1:0] analog, input wire [2:0] fault, output integer violations, output wire asleep
);
    wire [31:0] cell_now = (row & 15) * COLUMNS + (column & 15);
    integer falls = -1, clocked = 0;
    longint at = 0, began = 0, waking = 0;
`ifdef SLEEPS
    reg down = 1'b1;  // the data sheet leaves it open
`else
    reg down = 1'b0;
`endif
    reg early = 1'b0;
    assign asleep = down && off;
    reg [31:0] previous = 0, selected = 0;
    reg [11:0] level = 0, held = 0;
    reg said;
    assign #(400000.0 / CYCLE_PS) miso = said;  // 40 ns behind CS or a falling edge
    initial begin
        violations = 0;
        said = 1'b1;
    end
    always @(cell_now) begin
        if (falls > 0 && falls < 16) violations = violations + 1;                    // the address moves during a conversion
        previous = selected;
        selected = cell_now;
        at = $time / 10;
    end
    always @(negedge off) at = $time / 10;
    always @(cs_n, negedge sclk) begin
        if (cs_n) begin
            if (falls >= 2) begin
                waking = down && falls >= 10 ? began : 0;
                down = falls < 10;
            end
            falls = -1;
        end else if (falls < 0) begin
            falls = 0;
            began = $time / 10;
            level = off ? 0 : analog[32*selected +: 12];
            early = !down && (off || (began - at) * CYCLE_PS < SETTLE_PS - CYCLE_PS || waking != 0 && (began - waking) * CYCLE_PS < 1000000);
            if (early) level = (level + analog[32*previous +: 12]) / 2;
            held = down ? $random : level;
        end else begin
            falls = falls + 1;
            if (falls == 10 && early) violations = violations + 1;  // a conversion, not a power-down
            if (falls > 1 && ($time / 10 - clocked) * CYCLE_PS < 50000) violations = violations + 1;  // 20 MHz at most
            clocked = $time / 10;
        end
        if (fault == 1) said = 1'b0;
        else if (fault == 2 || falls < 0 || falls > 15) said = 1'b1;
        else if (falls < 4) said = fault == 3 && falls == 2;
        else said = held[15 - falls];
    end
endmodule
