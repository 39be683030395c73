// A TI DDC232 as its data sheet (SBAS331) describes it: 32 charge integrators, each with two sides that take turns while CONV is high and low.
//
// An edge of CONV ends an integration; it is converted meanwhile, DVALID falls DELAY clocks after the edge, and the words are shifted out on
// falling DCLK, the first bit being there when DVALID falls. Twelve configuration bits are latched one by one on falling CLK_CFG; after
// them DOUT gives the readback: configuration, revision, pattern, again and again. Format bit 1: 20 bits, 0: the upper 16.
// Charge of the first integrations after a reset is not to be trusted: random here.
// fault: 1 DOUT stays low, 2 DVALID does not come, 3 the supply dips: configuration lost, readback wrong, no DVALID.
`timescale 1ns / 1ps

module converter #(
    parameter integer TAXELS = 16, parameter integer CYCLE_PS = 50000, parameter integer FIRST = 17, parameter integer ASCENDING = 0,
    parameter integer CLOCK_PS = 100000, parameter integer DELAY = 1382
) (
    input wire clk, input wire reset_n, input wire conv, input wire din_cfg, input wire clk_cfg, input wire dclk, output reg dvalid_n,
    output wire dout, input wire [32*TAXELS-1:0] analog, input wire [2:0] fault, output integer violations
);
    localparam integer QUIET_PS = 10000000;
    reg [11:0] configuration = 12'd0;
    integer bits_in = 0, k = 0, channel = 0, conversion = 0, integrations = 0, width = 20;
    reg [639:0] out = 640'd0;  // what is still to be shifted out, next bit on top
    reg reading_back = 1'b0;
    reg [31:0] word = 0;
    integer clk_at = 0, conv_at = 0, dclk_at = 0, reset_at = 0;
    localparam [71:0] PATTERN = 72'h30F066012480F69055;

    function time ps(input integer since);  // picoseconds of the design's time since then
        ps = ($time / 10 - since) * CYCLE_PS;
    endfunction

    initial begin
        violations = 0;
        dvalid_n = 1'b1;
    end
    reg [87:0] answer = 88'd0;

    always @(posedge clk) begin
        if (clk_at != 0 && ps(clk_at) < CLOCK_PS - 1) violations = violations + 1;   // its clock is too fast
        clk_at = $time / 10;
        if (reset_n && conversion > 0) begin
            conversion = conversion - 1;
            if (conversion == 0 && fault != 2 && fault != 3 && bits_in == 12) begin
                width = configuration[8] ? 20 : 16;
                out = 640'd0;
                for (k = 0; k < 32; k = k + 1) begin
                    channel = ASCENDING != 0 ? k + 1 : 32 - k;
                    if (channel >= FIRST && channel < FIRST + TAXELS && integrations > 3) word = analog[32*(channel-FIRST) +: 32];
                    else word = $random;
                    if (width == 20) out[639 - 20*k -: 20] = word[19:0];
                    else out[639 - 16*k -: 16] = word[15:0];
                end
                dvalid_n = 1'b0;
                reading_back = 1'b0;
            end
        end
    end
    always @(conv) if (reset_n === 1'b1) begin
        if (dclk_at != 0 && ps(dclk_at) < QUIET_PS) violations = violations + 1;     // DCLK just before an edge of CONV
        if (conv_at != 0 && integrations > 3 && ps(conv_at) < 166500000 - CYCLE_PS) violations = violations + 1;
        conv_at = $time / 10;
        conversion = DELAY;
        integrations = integrations + 1;
        dvalid_n = 1'b1;
    end
    always @(negedge clk_cfg) if (reset_n === 1'b1) begin
        if (ps(reset_at) < 900000000) violations = violations + 1;                   // it has not woken up
        configuration = {configuration[10:0], din_cfg};
        bits_in = bits_in + 1;
        if (bits_in == 12) begin
            reading_back = 1'b1;
            answer = {fault == 3 ? ~configuration : configuration, 4'd5, PATTERN};
            for (k = 0; k < 640; k = k + 1) out[639 - k] = answer[87 - k % 88];
            if (configuration[5:0] != 0) violations = violations + 1;                // reserved and test bits
        end
    end
    always @(posedge dclk) if (reset_n === 1'b1) begin
        if (conv_at != 0 && ps(conv_at) < QUIET_PS) violations = violations + 1;     // DCLK just after an edge of CONV
        if (!reading_back && dvalid_n) violations = violations + 1;                  // nothing is valid
        dclk_at = $time / 10;
    end
    always @(negedge dclk) if (reset_n === 1'b1) begin
        out = {out[638:0], 1'b0};
        dclk_at = $time / 10;
    end
    always @(negedge reset_n) begin
        reading_back = 1'b0;
        bits_in = 0;
        configuration = 12'd0;
        conversion = 0;
        integrations = 0;
        dvalid_n = 1'b1;
        conv_at = 0;
        dclk_at = 0;
    end
    always @(posedge reset_n) reset_at = $time / 10;
    assign dout = fault == 1 ? 1'b0 : out[639];
endmodule
