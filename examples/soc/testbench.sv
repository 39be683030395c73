// Plays frames.hex into the system and shows what it says on its serial line. CONVERTER: through a model of the converter at its pins, a frame
// from scan to scan; otherwise as the latest frame, PERIOD cycles apart, from the first line on. FLASH: the program comes out of flash.bin.
// The last line counts cycles since the first frame, those in which the CPU works, the most of them in a frame, frames that came while the
// one before was still being fed, and limits of the converter's data sheet that were broken.
`timescale 1ns / 1ps

module testbench #(
    parameter integer TAXELS = 16, parameter integer FRAMES = 1, parameter integer PERIOD = 4000, parameter integer DIVISOR = 12,
    parameter integer CYCLE_PS = 83333
);
    reg clk = 1'b0;
    always #5 clk = !clk;
    reg [15:0] frames[0:FRAMES*TAXELS-1];
    initial $readmemh("frames.hex", frames);
    integer frame = 0, k;
    wire tx, led;
    reg first = 1'b0, next = 1'b0;  // the first frame is there; a frame is over

`ifdef FLASH
    wire flash_cs_n, flash_sclk, flash_mosi, flash_miso;
    spi_flash #(.CYCLE_PS(CYCLE_PS)) flash (.cs_n(flash_cs_n), .sclk(flash_sclk), .mosi(flash_mosi), .miso(flash_miso));
`endif
`ifdef CONVERTER
    `PIN_WIRES
    reg [32*TAXELS-1:0] analog;
    wire [31:0] violations;
    integer resting = 0;
    converter #(`MODEL_PARAMETERS) model (`MODEL_PINS, .analog(analog), .fault(3'd0), .violations(violations));
    always @(posedge clk) begin
        first <= first | `PORT_BUSY;
        resting <= `PORT_BUSY ? 0 : resting + 1;
        next <= first && resting == PERIOD / 16;
    end
`else
    reg [16*TAXELS-1:0] latest;
    reg due = 1'b0;
    integer timer = -1, missed = 0;
    wire [31:0] violations = 0;
    always @(posedge clk) begin
        timer <= timer == PERIOD - 1 ? 0 : timer + (timer >= 0 || heard == "\n" ? 1 : 0);
        due <= timer == 0;
        first <= first | due;
        next <= first && timer == PERIOD - 1;
        if (due && first && led) missed <= missed + 1;
    end
`endif
    always @*
        for (k = 0; k < TAXELS; k = k + 1)
`ifdef CONVERTER
            analog[32*k +: 32] = {16'd0, frames[frame*TAXELS + k]};
`else
            latest[16*k +: 16] = frames[frame*TAXELS + k];
`endif

    soc dut (
`ifdef CONVERTER
        `DESIGN_PINS,
`else
        .frame(latest), .due(due),
`endif
`ifdef FLASH
        .flash__cs_n(flash_cs_n), .flash__sclk(flash_sclk), .flash__mosi(flash_mosi), .flash__miso(flash_miso),
`endif
        .clk(clk), .tx(tx), .led(led)
    );

    longint cycles = 0, works = 0;
    integer busy = 0, most = 0;
    always @(posedge clk)
        if (first) begin
            cycles <= cycles + 1;
            if (led) works <= works + 1;
            busy <= next ? 0 : busy + (led ? 1 : 0);
            if (next) begin
                if (busy > most) most <= busy;
                frame <= frame + 1;
                if (frame == FRAMES - 1) begin
`ifdef CONVERTER
                    $display("cycles %0d works %0d most %0d missed 0 violations %0d", cycles, works, most, violations);
`else
                    $display("cycles %0d works %0d most %0d missed %0d violations %0d", cycles, works, most, missed, violations);
`endif
                    $finish;
                end
            end
        end

    reg [7:0] heard = 8'd0;  // the character that came last
    reg [7:0] bits = 8'd0;
    integer clocks = -1;  // since the start bit began
    always @(posedge clk)
        if (clocks < 0) clocks <= tx === 1'b0 ? 0 : -1;
        else begin
            clocks <= clocks + 1;
            if (clocks % DIVISOR == DIVISOR / 2) begin
                bits <= {tx, bits[7:1]};
                if (clocks / DIVISOR == 9) begin
                    $write("%c", bits);
                    if (bits == "\n") $fflush;
                    heard <= bits;
                    clocks <= -1;
                end
            end
        end
endmodule
