// A serial flash (W25Q128) as its data sheet has it: asleep until command 0xAB, then 0x03 with a 24-bit address reads on and on. Behind 0x06
// 0x02 programs: it clears bits of a page; 0x20 erases 4096 bytes. Both begin when CS rises, and 0x05 reads 1 until they are done, after 100 us
// here. A command in that time, or a byte programmed that is not erased, counts as wrong. flash_out.bin is what it holds at the end.
//
// DI is read when CLK rises, DO changes when CLK falls, highest bit first; DO floats (a pull-up holds it high) while the chip does not send.
// It holds flash.bin from byte 2^20 on and 0xFF elsewhere. Commands within 3 us of the end of 0xAB are not heard.
`timescale 1ns / 1ps

module spi_flash #(parameter integer CYCLE_PS = 83333) (input wire cs_n, input wire sclk, input wire mosi, output wire miso, input wire done, output reg [31:0] wrong);
    reg [7:0] bytes [0:65535];
    reg [31:0] heard = 32'd0, address = 32'd0;
    reg awake = 1'b0, wakes = 1'b0, reads = 1'b0, out = 1'b1;
    integer clocks = 0, woken = 0, file, got, place, size = 0;
    initial begin
        for (place = 0; place < 65536; place = place + 1) bytes[place] = 8'hff;
        file = $fopen("flash.bin", "rb");
        size = $fread(bytes, file);
        $fclose(file);
    end
    reg enabled = 1'b0, stats = 1'b0;
    reg [7:0] command = 8'd0;
    reg [31:0] target = 32'd0;
    integer busy_until = 0, changed;
    wire busy = $time / 10 < busy_until;
    always @(posedge done) begin
        file = $fopen("flash_out.bin", "wb");
        for (place = 0; place < 65536; place = place + 1) $fwrite(file, "%c", bytes[place]);
        $fclose(file);
    end
    initial wrong = 32'd0;
    always @(negedge cs_n) begin
        clocks = 0;
        reads = 1'b0;
        stats = 1'b0;
        awake = wakes && (($time / 10 - woken) * CYCLE_PS > 3000000);
    end
    always @(posedge cs_n) begin
        if (clocks == 8 && heard[7:0] == 8'hab) begin
            wakes = 1'b1;
            woken = $time / 10;
        end
        if (clocks == 8 && heard[7:0] == 8'h06) enabled = 1'b1;
        else if (clocks >= 32 && enabled && (command == 8'h02 || command == 8'h20)) begin
            enabled = 1'b0;
            busy_until = $time / 10 + 100000000 / CYCLE_PS;
            if (command == 8'h20)
                for (place = 0; place < 4096; place = place + 1) bytes[(target[15:0] & 16'hf000) + place] = 8'hff;
        end else if (clocks >= 32 && (command == 8'h02 || command == 8'h20)) wrong = wrong + 1;
        out = 1'b1;
    end
    always @(posedge sclk) if (!cs_n) begin
        heard = {heard[30:0], mosi};
        clocks = clocks + 1;
        if (clocks == 8) begin
            command = heard[7:0];
            stats = command == 8'h05;
            if (busy && !stats) wrong = wrong + 1;
        end
        if (clocks == 32) target = {8'd0, heard[23:0]};
        if (command == 8'h02 && enabled && clocks > 32 && clocks % 8 == 0) begin
            place = (target[15:0] & 16'hff00) | ((target[15:0] + (clocks / 8) - 5) & 16'h00ff);
            if (bytes[place] != 8'hff) wrong = wrong + 1;
            bytes[place] = bytes[place] & heard[7:0];
        end
        if (clocks == 32 && heard[31:24] == 8'h03 && awake) begin
            reads = 1'b1;
            address = {5'd0, heard[23:0], 3'd0};  // of a bit
        end
    end
    wire [31:0] byte_at = (address >> 3) - 32'h00100000;
    always @(negedge sclk) if (!cs_n && reads) begin
        out = byte_at < 65536 ? bytes[byte_at[15:0]][3'd7 - address[2:0]] : 1'b1;
        address = address + 1;
    end
    always @(negedge sclk) if (!cs_n && stats) out = clocks % 8 == 7 ? busy : 1'b0;
    assign miso = out;
endmodule
