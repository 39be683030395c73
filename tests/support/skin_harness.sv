// A board without a host (module accelerator): a converter's model on one side, the stimulator's line heard on the other.
//
// The taxels take the next frame of codes.bin (32-bit words) a tenth of a frame before it is due, counted from the first scan.
// In:  codes.bin; plus-args frames, tail (cycles after the last frame), limit (cycle that ends it whatever happens), fault_frame and
//      fault_kind (from when and how the converter misbehaves, by its model); with the macro FLASH
//      flash.bin, the bytes of a flash from its byte 2^20 on; with the macro HOST host.bin and last.bin, the bytes that a host sends from
//      cycle 20000 on (the part is in reset before) and in the middle of the tail, HOST_CLOCKS a bit
// Out: stim.txt  each byte on the stimulator's line, hex, and the cycle of its stop bit;  pins.txt  cycle, decision, decision_valid, led;
//      with HOST also host.txt  each byte that the host hears, hex
`timescale 1ns / 1ps

module skin_harness #(
    parameter integer TAXELS = 16, parameter integer CLASSES = 3, parameter integer PERIOD = 4000, parameter integer CLOCKS_PER_BIT = 104,
    parameter integer LINES = 1, parameter integer SELECTS = 1, parameter integer CYCLE_PS = 83333, parameter integer FRAME_BITS = 16,
    parameter integer CHANNELS = 16, parameter integer CHANNEL_BIT = 7, parameter integer DELAY = 2, parameter integer CODE_BIT = 0,
    parameter integer CODE_BITS = 12, parameter integer TAG_BIT = 12, parameter integer TAG_BITS = 4, parameter integer ZEROS = 0,
    parameter integer PIN_CODES = TAXELS, parameter integer ROWS = 1, parameter integer COLUMNS = 1, parameter integer FIRST = 1,
    parameter integer ASCENDING = 0, parameter integer SETTLE_PS = 0, parameter integer CLOCK_PS = 0, parameter integer CHIPS = 1,
    parameter integer HOST_CLOCKS = 4
) (
    input wire clk /* verilator public_flat_rw */
);
    integer cycle = 0;
    reg done /* verilator public_flat_rd */ = 1'b0;
    `PIN_WIRES
    wire stim_tx, led, decision_valid;
    wire [CLASSES-1:0] decision;
    wire [31:0] violations;
    reg [32*PIN_CODES-1:0] analog = 0;
    reg [2:0] misbehaves = 3'd0;
`ifdef FLASH
    wire flash_cs_n, flash_sclk, flash_mosi, flash_miso;
    spi_flash #(.CYCLE_PS(CYCLE_PS)) flash (.cs_n(flash_cs_n), .sclk(flash_sclk), .mosi(flash_mosi), .miso(flash_miso));
`define FLASH_PORTS .flash__cs_n(flash_cs_n), .flash__sclk(flash_sclk), .flash__mosi(flash_mosi), .flash__miso(flash_miso),
`else
`define FLASH_PORTS
`endif
`ifdef HOST
    wire rx;
    wire tx;
    host_line #(.CLOCKS(HOST_CLOCKS)) host (.clk(clk), .ending(end_at != 0 && cycle > end_at - tail / 2), .tx(tx), .rx(rx));
`define HOST_PORTS .rx(rx), .tx(tx),
`else
`define HOST_PORTS
`endif
    accelerator dut (
        .clk(clk), `DESIGN_PINS, `FLASH_PORTS `HOST_PORTS .led(led), .decision(decision),
        .decision_valid(decision_valid), .stim_tx(stim_tx)
    );
    converter #(`MODEL_PARAMETERS) model (`MODEL_PINS, .analog(analog), .fault(misbehaves), .violations(violations));

    integer frames, tail, limit, fault_frame, fault_kind, codes, got, loaded = 0, taxel = 0, stim, pins, timer = 0, place = 10, begun = 0;
    integer next_at = 0, end_at = 0;
    reg [31:0] frame [0:PIN_CODES-1];
    reg [7:0] heard = 8'd0;
    reg [CLASSES+1:0] shown = 0;
    initial begin
        if (!$value$plusargs("frames=%d", frames)) frames = 0;
        if (!$value$plusargs("tail=%d", tail)) tail = 0;
        if (!$value$plusargs("limit=%d", limit)) limit = 32'h7fffffff;
        if (!$value$plusargs("fault_frame=%d", fault_frame)) fault_frame = 1 << 30;
        if (!$value$plusargs("fault_kind=%d", fault_kind)) fault_kind = 1;
        codes = $fopen("codes.bin", "rb");
        stim = $fopen("stim.txt", "w");
        pins = $fopen("pins.txt", "w");
        got = $fread(frame, codes);
        for (taxel = 0; taxel < PIN_CODES; taxel = taxel + 1) analog[32*taxel +: 32] = frame[taxel];
        loaded = 1;
    end
    always @(posedge clk) if (!done) begin
        cycle = cycle + 1;
        if (begun == 0 && (`PORT_BUSY) === 1'b1 && cycle > 2) begin
            begun = 1;
            next_at = cycle + PERIOD - PERIOD / 10;
        end
        if (begun == 1 && cycle == next_at) begin
            next_at = next_at + PERIOD;
            misbehaves <= loaded >= fault_frame ? fault_kind[2:0] : 3'd0;
            if (loaded < frames) begin
                got = $fread(frame, codes);
                for (taxel = 0; taxel < PIN_CODES; taxel = taxel + 1) analog[32*taxel +: 32] <= frame[taxel];
                loaded = loaded + 1;
                end_at = cycle + PERIOD + tail;
            end
        end
        if (timer > 0) timer = timer - 1;
        else if (place < 8) begin
            heard[place] = stim_tx;
            place = place + 1;
            timer = CLOCKS_PER_BIT - 1;
        end else if (place == 8) begin
            $fwrite(stim, "%h %0d\n", stim_tx === 1'b1 ? {1'b0, heard} : {1'b1, heard}, cycle);
            place = 10;
        end else if (stim_tx === 1'b0) begin
            place = 0;
            timer = CLOCKS_PER_BIT + CLOCKS_PER_BIT / 2 - 1;
        end
        if ({decision, decision_valid, led} !== shown) begin
            shown = {decision, decision_valid, led};
            $fwrite(pins, "%0d %b %b %b\n", cycle, decision, decision_valid, led);
        end
        if ((loaded == frames && end_at != 0 && cycle > end_at) || cycle > limit) begin
            $fwrite(pins, "end %0d begun %0d violations %0d\n", cycle, begun, violations);
            $fclose(stim);
            $fclose(pins);
            done <= 1'b1;
        end
    end
endmodule

// A host's side of the serial link: two files of bytes out, what it hears into a third.
module host_line #(parameter integer CLOCKS = 4) (input wire clk, input wire ending, input wire tx, output reg rx);
    integer out, last, heard, wait_out = 20000, bits_out = 0, wait_in = 0, place = 10, byte_out = -1;
    reg [7:0] in = 8'd0;
    reg [9:0] frame = 10'h3ff;
    reg first_done = 1'b0;
    initial begin
        rx = 1'b1;
        out = $fopen("host.bin", "rb");
        last = $fopen("last.bin", "rb");
        heard = $fopen("host.txt", "w");
    end
    always @(posedge clk) begin
        if (wait_out > 0) wait_out = wait_out - 1;
        else if (bits_out > 0) begin
            rx <= frame[0];
            frame = {1'b1, frame[9:1]};
            bits_out = bits_out - 1;
            wait_out = CLOCKS - 1;
        end
        if (wait_out == 0 && bits_out == 0) begin
            byte_out = -1;
            if (!first_done) byte_out = $fgetc(out);
            if (byte_out < 0) first_done = 1'b1;
            if (first_done && ending) byte_out = $fgetc(last);
            if (byte_out >= 0) begin
                frame = {1'b1, byte_out[7:0], 1'b0};
                bits_out = 10;
            end
        end
        if (wait_in > 0) wait_in = wait_in - 1;
        else if (place < 8) begin
            in[place] = tx;
            place = place + 1;
            wait_in = CLOCKS - 1;
        end else if (place == 8) begin
            $fwrite(heard, "%h\n", in);
            $fflush(heard);
            place = 10;
        end else if (tx === 1'b0) begin
            place = 0;
            wait_in = CLOCKS + CLOCKS / 2 - 1;
        end
    end
endmodule
