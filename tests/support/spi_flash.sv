// A serial flash (W25Q128) as its data sheet has it: asleep until command 0xAB, then 0x03 with a 24-bit address reads on and on.
//
// DI is read when CLK rises, DO changes when CLK falls, highest bit first; DO floats (a pull-up holds it high) while the chip does not send.
// It holds flash.bin from byte 2^20 on and 0xFF elsewhere. Commands within 3 us of the end of 0xAB are not heard.
`timescale 1ns / 1ps

module spi_flash #(parameter integer CYCLE_PS = 83333) (input wire cs_n, input wire sclk, input wire mosi, output wire miso);
    reg [7:0] bytes [0:65535];
    reg [31:0] heard = 32'd0, address = 32'd0;
    reg awake = 1'b0, wakes = 1'b0, reads = 1'b0, out = 1'b1;
    integer clocks = 0, woken = 0, file, got, place;
    initial begin
        for (place = 0; place < 65536; place = place + 1) bytes[place] = 8'hff;
        file = $fopen("flash.bin", "rb");
        got = $fread(bytes, file);
        $fclose(file);
    end
    always @(negedge cs_n) begin
        clocks = 0;
        reads = 1'b0;
        awake = wakes && (($time / 10 - woken) * CYCLE_PS > 3000000);
    end
    always @(posedge cs_n) begin
        if (clocks == 8 && heard[7:0] == 8'hab) begin
            wakes = 1'b1;
            woken = $time / 10;
        end
        out = 1'b1;
    end
    always @(posedge sclk) if (!cs_n) begin
        heard = {heard[30:0], mosi};
        clocks = clocks + 1;
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
    assign miso = out;
endmodule
