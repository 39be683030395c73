// NXP MPR121 as data sheet and application notes describe it: one or two chips on one I2C bus, at 0x5A and 0x5B, 12 electrodes each.
//
// After a soft reset (0x63 to register 0x80) every register is 0 but CONFIG2, which is 0x24. Registers are written in stop mode only (ELE_EN
// of ECR 0). While it runs, registers 0x04 + 2n and 0x05 + 2n hold the ten bits of electrode n; addresses count up within a message.
// A burst takes the levels of the instant at which it begins. New data come every SFI samples of ESI (CONFIG2), the first so long after the
// start: a burst that is earlier, or the second in a row that finds the data of the one before, is a violation. Checked, too: the clock low 1.3 us,
// high 0.6 us, the bus free 1.3 us.
// fault: 1 no chip answers, 2 SDA is held low, 3 the chips have lost their supply: registers as after power-on, CONFIG2 wrong,
// 4 the last chip loses its supply for a moment: it answers, stopped, with registers as after power-on.
`timescale 1ns / 1ps

module converter #(
    parameter integer ELECTRODES = 12, parameter integer CHIPS = 1, parameter integer CYCLE_PS = 83333
) (
    input wire scl_low, input wire sda_low, output wire sda,
    input wire [32*ELECTRODES-1:0] analog, input wire [2:0] fault, output integer violations
);
    wire scl = !scl_low;
    reg pulls = 1'b0;
    assign sda = !(sda_low || pulls || fault == 2);
    reg [7:0] registers [0:511];
    reg running [0:1];
    integer reset_at [0:1];
    integer fresh_at [0:1];  // start, or the burst before
    reg [1:0] stale = 2'd0;  // is such a second burst a violation
    integer k = 0, bits = 0, chip = 0, pointer = 0, count = 0, fell = 0, rose = 0, stopped = 0, samples = 0;
    reg [7:0] in = 8'd0, out = 8'd0;
    reg listening = 1'b0, sending = 1'b0, first = 1'b0, mine = 1'b0, nack = 1'b0;
    reg [31:0] level = 0;

    function time ps(input integer since);  // picoseconds of the design's time since then
        ps = ($time / 10 - since) * CYCLE_PS;
    endfunction

    task power_on(input integer which);
        begin
            for (k = 0; k < 256; k = k + 1) registers[256*which + k] = 8'd0;
            registers[256*which + 8'h5D] = fault == 3 ? 8'h00 : 8'h24;
            running[which] = 1'b0;
            fresh_at[which] = 0;
            reset_at[which] = $time / 10;
        end
    endtask
    initial begin
        violations = 0;
        reset_at[0] = 0;
        reset_at[1] = 0;
        power_on(0);
        power_on(1);
    end
    always @(fault) if (fault == 3) begin
        power_on(0);
        power_on(1);
    end
    wire dips = fault == 4;
    always @(posedge dips) power_on(CHIPS - 1);  // an edge: Verilator runs a block without one again and again while its condition holds

    task latch;  // levels into the registers of filtered data
        begin
            samples = registers[256*chip + 8'h5D][4:3] == 0 ? 4 : registers[256*chip + 8'h5D][4:3] == 1 ? 6 : registers[256*chip + 8'h5D][4:3] == 2 ? 10 : 18;
            if (running[chip] && ps(fresh_at[chip]) < (64'd1000000000 * samples << registers[256*chip + 8'h5D][2:0])) begin
                if (stale[chip]) violations = violations + 1;
                stale[chip] = 1'b1;
            end else stale[chip] = 1'b0;
            fresh_at[chip] = $time / 10;
            for (k = 0; k < 12; k = k + 1) begin
                count = CHIPS == 2 ? 11 * chip + k : k;
                level = running[chip] && k < (CHIPS == 2 ? 11 : 12) && count < ELECTRODES ? analog[32*count +: 32] : 0;
                registers[256*chip + 4 + 2*k] = level[7:0];
                registers[256*chip + 5 + 2*k] = {6'd0, level[9:8]};
            end
        end
    endtask
    task write(input [7:0] value);
        begin
            if (pointer == 8'h80) begin
                if (value == 8'h63) power_on(chip);
            end else begin
                if (ps(reset_at[chip]) < 999000000) violations = violations + 1;             // it has not woken up
                if (running[chip] && pointer != 8'h5E) violations = violations + 1;          // only in stop mode
                else registers[256*chip + pointer] = value;
                if (pointer == 8'h5E) begin
                    if (value[3:0] != 0 && (registers[256*chip + 8'h41] == 0 || registers[256*chip + 8'h5C] == 0)) violations = violations + 1;
                    running[chip] = value[3:0] != 0;                                         // thresholds and filter are set first
                    fresh_at[chip] = $time / 10;
                    stale[chip] = 1'b1;
                end
            end
            pointer = (pointer + 1) % 256;
        end
    endtask

    always @(sda) if (scl) begin
        if (!sda) begin                                                                      // start
            if (stopped != 0 && ps(stopped) < 1300000) violations = violations + 1;
            bits = 0;
            listening = 1'b1;
            sending = 1'b0;
            first = 1'b1;
        end else begin                                                                       // stop
            listening = 1'b0;
            sending = 1'b0;
            stopped = $time / 10;
        end
        pulls = 1'b0;
    end
    always @(posedge scl) begin
        if (fell != 0 && ps(fell) < 1299000) violations = violations + 1;
        rose = $time / 10;
        if (listening) begin
            if (bits < 8) in = {in[6:0], sda};
            else nack = sda;
            bits = bits + 1;
        end
    end
    always @(negedge scl) begin
        if (rose != 0 && ps(rose) < 599000) violations = violations + 1;
        fell = $time / 10;
        pulls = 1'b0;
        if (listening && bits == 8) begin                                                    // the acknowledge
            if (!sending) begin
                if (first) begin
                    chip = in[7:1] - 7'h5A;
                    mine = chip >= 0 && chip < CHIPS && fault != 1;
                end
                pulls = mine;
            end
        end else if (listening && bits == 9) begin
            bits = 0;
            if (sending) begin
                if (nack) listening = 1'b0;
            end else if (!mine) listening = 1'b0;
            else if (first) begin
                sending = in[0];
                first = 1'b0;
                count = 0;
                if (!in[0]) pointer = -1;
                else if (pointer == 4) latch;
            end else if (pointer < 0) pointer = in;
            else write(in);
        end
        if (listening && sending && bits < 8) begin
            if (bits == 0) begin
                out = registers[256*chip + pointer];
                pointer = (pointer + 1) % 256;
            end
            pulls = !out[7 - bits];
        end
    end
endmodule
