// Any SPI converter that the fields spi_... of a configuration describe; several share clock, command and select.
// fault: 1 lines stay low, 2 not driven (high), 3 no channel's number is heard.
`timescale 1ns / 1ps

module converter #(
    parameter integer TAXELS = 16, parameter integer LINES = 1, parameter integer SELECTS = 1, parameter integer CYCLE_PS = 83333,
    parameter integer FRAME_BITS = 16, parameter integer CHANNELS = 8, parameter integer CHANNEL_BIT = 0, parameter integer DELAY = 0,
    parameter integer CODE_BIT = 0, parameter integer CODE_BITS = 12, parameter integer TAG_BIT = 0, parameter integer TAG_BITS = 0,
    parameter integer ZEROS = 0
) (
    input wire [SELECTS-1:0] cs_n, input wire sclk, input wire mosi, output reg [LINES-1:0] miso,
    input wire [32*TAXELS-1:0] analog, input wire [2:0] fault, output integer violations, output wire asleep
);
    assign asleep = 1'b1;  // nothing is known of its sleep
    // asked[d]: the channel asked for d transfers ago; without a delay the answer follows the command in its transfer.
    integer asked [0:7];
    integer clocks = 0, k = 0, s = 0, channel = 0, position = 0;
    reg [31:0] in = 0, word = 0, number = 0;
    initial begin
        violations = 0;
        miso = {LINES{1'b1}};
        for (k = 0; k < 8; k = k + 1) asked[k] = 0;
    end
    task say;
        begin
            s = 0;
            while (s < SELECTS - 1 && cs_n[s]) s = s + 1;
            if (DELAY == 0) begin  // the command's bits so far
                number = clocks >= FRAME_BITS - CHANNEL_BIT ? in >> (clocks - FRAME_BITS + CHANNEL_BIT) : 0;
                channel = number & (1 << $clog2(CHANNELS)) - 1;
            end else channel = asked[DELAY-1];
            if (fault == 3) channel = 0;
            position = FRAME_BITS - 1 - clocks;
            for (k = 0; k < LINES; k = k + 1) begin
                word = analog[32*((s*LINES + k)*CHANNELS + channel) +: 32] << CODE_BIT;
                if (TAG_BITS > 0) word = word | channel << TAG_BIT;
                miso[k] = fault == 1 ? 1'b0 : fault == 2 || &cs_n || position < 0 ? 1'b1 : word[position];
            end
        end
    endtask
    always @(cs_n) begin
        if (&cs_n) begin
            if (clocks == FRAME_BITS) begin
                for (k = 7; k > 0; k = k - 1) asked[k] = asked[k-1];
                asked[0] = in >> CHANNEL_BIT & (1 << $clog2(CHANNELS)) - 1;
            end else if (clocks != 0) violations = violations + 1;
        end else begin
            clocks = 0;
            in = 0;
        end
        say;
    end
    always @(posedge sclk) if (!(&cs_n)) begin
        in = in << 1 | mosi;
        clocks = clocks + 1;
    end
    always @(negedge sclk) say;
endmodule
