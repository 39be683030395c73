// Two Microchip MCP3208 as their data sheet (DS21298) describes them, on shared CS, clock and DIN (or with a CS of their own): 8 channels,
// 12 bits each. A start bit that is high, SGL/DIFF, D2 D1 D0, a clock in which the sample is taken, a null bit, B11 .. B0; what the chip
// says changes on falling edges. With CS high it sleeps and needs no time to wake. Until the null bit DOUT is not driven (a pull-up holds it high).
// fault: 1 DOUT stays low, 2 DOUT is not driven, 3 the second chip alone is missing.
`timescale 1ns / 1ps

module mcp3208 #(parameter integer CYCLE_PS = 83333) (
    input wire cs_n, input wire sclk, input wire din, output wire dout, input wire [255:0] analog, input wire [2:0] fault, output integer violations
);
    integer n = -1;  // clocks since the start bit; -1: it has not come
    integer fell = 0, rose = 0, edge_at = 0;
    reg [2:0] channel = 3'd0;
    reg [11:0] code = 12'd0;
    reg drives = 1'b0, level = 1'b0;
    initial violations = 0;

    function time ps(input integer since);  // picoseconds of the design's time since then
        ps = ($time / 10 - since) * CYCLE_PS;
    endfunction

    always @(negedge cs_n) begin
        if (rose != 0 && ps(rose) < 499900) violations = violations + 1;        // CS disable time, 500 ns
        fell = $time / 10;
        n = -1;
        drives = 1'b0;
    end
    always @(posedge cs_n) begin
        rose = $time / 10;
        drives = 1'b0;
    end
    always @(posedge sclk) if (!cs_n) begin
        if (edge_at != 0 && ps(edge_at) < 499900 && n >= 0) violations = violations + 1;  // half a period of 1 MHz, the limit at 2.7 V
        edge_at = $time / 10;
        if (n < 0) begin
            if (ps(fell) < 100000) violations = violations + 1;                 // CS fall to the first clock, 100 ns
            if (din) n = 0;
        end else n = n + 1;
        if (n == 1 && !din) violations = violations + 1;                        // differential: not what this array is wired for
        if (n >= 2 && n <= 4) channel = {channel[1:0], din};
        if (n == 5) code = analog[32*channel +: 12];
    end
    always @(negedge sclk) if (!cs_n) begin
        if (edge_at != 0 && ps(edge_at) < 499900) violations = violations + 1;
        edge_at = $time / 10;
        drives = n >= 5 && n <= 17;
        level = n == 5 ? 1'b0 : n >= 6 && n <= 17 ? code[17-n] : 1'b0;
    end
    assign dout = fault == 1 ? 1'b0 : fault == 2 || !drives ? 1'b1 : level;
endmodule

module converter #(
    parameter integer TAXELS = 16, parameter integer LINES = 2, parameter integer SELECTS = 1, parameter integer CYCLE_PS = 83333,
    parameter integer FRAME_BITS = 19, parameter integer CHANNELS = 8, parameter integer CHANNEL_BIT = 14, parameter integer DELAY = 0,
    parameter integer CODE_BIT = 0, parameter integer CODE_BITS = 12, parameter integer TAG_BIT = 0, parameter integer TAG_BITS = 0,
    parameter integer ZEROS = 0
) (
    input wire [SELECTS-1:0] cs_n, input wire sclk, input wire mosi, output wire [LINES-1:0] miso,
    input wire [32*TAXELS-1:0] analog, input wire [2:0] fault, output integer violations, output wire asleep
);
    assign asleep = &cs_n;
    // taxels of a chip: fewer than its channels where the array is small
    wire [511:0] inputs = {{(512-32*TAXELS > 0 ? 512-32*TAXELS : 1){1'b0}}, analog};
    wire [1:0] said;
    wire [31:0] first, second;
    mcp3208 #(.CYCLE_PS(CYCLE_PS)) one (
        .cs_n(cs_n[0]), .sclk(sclk), .din(mosi), .dout(said[0]), .analog(inputs[255:0]), .fault(fault == 3 ? 3'd0 : fault), .violations(first)
    );
    mcp3208 #(.CYCLE_PS(CYCLE_PS)) other (
        .cs_n(cs_n[SELECTS-1]), .sclk(sclk), .din(mosi), .dout(said[1]), .analog(inputs[511:256]), .fault(fault == 3 ? 3'd2 : fault),
        .violations(second)
    );
    assign miso = LINES == 2 ? said : SELECTS == 2 ? &said : said[0];
    always @* violations = first + (LINES + SELECTS > 2 ? second : 0);
endmodule
