// Behaviour of the Gowin cells that Yosys ships as black boxes only, in the settings that its Gowin flow writes. Another setting ends the
// simulation, and a port or parameter that is not here does not build: nothing is simulated as something that it is not.
//
// SP, SDPB, DPB: 2048 bytes of 8 bits; SPX9, SDPX9B, DPX9B: of 9; words of 1, 2 or 4 bits of a byte (of 8 alone), or of 1, 2 or 4 bytes. No output register.
// MULT9X9, MULT18X18, MULT36X36: no register. IOBUF: Yosys' own model drives its input.
`timescale 1ns / 1ps

`define GOWIN_INIT \
    parameter [287:0] INIT_RAM_00 = 0, INIT_RAM_01 = 0, INIT_RAM_02 = 0, INIT_RAM_03 = 0, INIT_RAM_04 = 0, INIT_RAM_05 = 0, \
    parameter [287:0] INIT_RAM_06 = 0, INIT_RAM_07 = 0, INIT_RAM_08 = 0, INIT_RAM_09 = 0, INIT_RAM_0A = 0, INIT_RAM_0B = 0, \
    parameter [287:0] INIT_RAM_0C = 0, INIT_RAM_0D = 0, INIT_RAM_0E = 0, INIT_RAM_0F = 0, INIT_RAM_10 = 0, INIT_RAM_11 = 0, \
    parameter [287:0] INIT_RAM_12 = 0, INIT_RAM_13 = 0, INIT_RAM_14 = 0, INIT_RAM_15 = 0, INIT_RAM_16 = 0, INIT_RAM_17 = 0, \
    parameter [287:0] INIT_RAM_18 = 0, INIT_RAM_19 = 0, INIT_RAM_1A = 0, INIT_RAM_1B = 0, INIT_RAM_1C = 0, INIT_RAM_1D = 0, \
    parameter [287:0] INIT_RAM_1E = 0, INIT_RAM_1F = 0, INIT_RAM_20 = 0, INIT_RAM_21 = 0, INIT_RAM_22 = 0, INIT_RAM_23 = 0, \
    parameter [287:0] INIT_RAM_24 = 0, INIT_RAM_25 = 0, INIT_RAM_26 = 0, INIT_RAM_27 = 0, INIT_RAM_28 = 0, INIT_RAM_29 = 0, \
    parameter [287:0] INIT_RAM_2A = 0, INIT_RAM_2B = 0, INIT_RAM_2C = 0, INIT_RAM_2D = 0, INIT_RAM_2E = 0, INIT_RAM_2F = 0, \
    parameter [287:0] INIT_RAM_30 = 0, INIT_RAM_31 = 0, INIT_RAM_32 = 0, INIT_RAM_33 = 0, INIT_RAM_34 = 0, INIT_RAM_35 = 0, \
    parameter [287:0] INIT_RAM_36 = 0, INIT_RAM_37 = 0, INIT_RAM_38 = 0, INIT_RAM_39 = 0, INIT_RAM_3A = 0, INIT_RAM_3B = 0, \
    parameter [287:0] INIT_RAM_3C = 0, INIT_RAM_3D = 0, INIT_RAM_3E = 0, INIT_RAM_3F = 0
`define GOWIN_CONTENTS { \
    INIT_RAM_3F[32*BYTE-1:0], INIT_RAM_3E[32*BYTE-1:0], INIT_RAM_3D[32*BYTE-1:0], INIT_RAM_3C[32*BYTE-1:0], INIT_RAM_3B[32*BYTE-1:0], \
    INIT_RAM_3A[32*BYTE-1:0], INIT_RAM_39[32*BYTE-1:0], INIT_RAM_38[32*BYTE-1:0], INIT_RAM_37[32*BYTE-1:0], INIT_RAM_36[32*BYTE-1:0], \
    INIT_RAM_35[32*BYTE-1:0], INIT_RAM_34[32*BYTE-1:0], INIT_RAM_33[32*BYTE-1:0], INIT_RAM_32[32*BYTE-1:0], INIT_RAM_31[32*BYTE-1:0], \
    INIT_RAM_30[32*BYTE-1:0], INIT_RAM_2F[32*BYTE-1:0], INIT_RAM_2E[32*BYTE-1:0], INIT_RAM_2D[32*BYTE-1:0], INIT_RAM_2C[32*BYTE-1:0], \
    INIT_RAM_2B[32*BYTE-1:0], INIT_RAM_2A[32*BYTE-1:0], INIT_RAM_29[32*BYTE-1:0], INIT_RAM_28[32*BYTE-1:0], INIT_RAM_27[32*BYTE-1:0], \
    INIT_RAM_26[32*BYTE-1:0], INIT_RAM_25[32*BYTE-1:0], INIT_RAM_24[32*BYTE-1:0], INIT_RAM_23[32*BYTE-1:0], INIT_RAM_22[32*BYTE-1:0], \
    INIT_RAM_21[32*BYTE-1:0], INIT_RAM_20[32*BYTE-1:0], INIT_RAM_1F[32*BYTE-1:0], INIT_RAM_1E[32*BYTE-1:0], INIT_RAM_1D[32*BYTE-1:0], \
    INIT_RAM_1C[32*BYTE-1:0], INIT_RAM_1B[32*BYTE-1:0], INIT_RAM_1A[32*BYTE-1:0], INIT_RAM_19[32*BYTE-1:0], INIT_RAM_18[32*BYTE-1:0], \
    INIT_RAM_17[32*BYTE-1:0], INIT_RAM_16[32*BYTE-1:0], INIT_RAM_15[32*BYTE-1:0], INIT_RAM_14[32*BYTE-1:0], INIT_RAM_13[32*BYTE-1:0], \
    INIT_RAM_12[32*BYTE-1:0], INIT_RAM_11[32*BYTE-1:0], INIT_RAM_10[32*BYTE-1:0], INIT_RAM_0F[32*BYTE-1:0], INIT_RAM_0E[32*BYTE-1:0], \
    INIT_RAM_0D[32*BYTE-1:0], INIT_RAM_0C[32*BYTE-1:0], INIT_RAM_0B[32*BYTE-1:0], INIT_RAM_0A[32*BYTE-1:0], INIT_RAM_09[32*BYTE-1:0], \
    INIT_RAM_08[32*BYTE-1:0], INIT_RAM_07[32*BYTE-1:0], INIT_RAM_06[32*BYTE-1:0], INIT_RAM_05[32*BYTE-1:0], INIT_RAM_04[32*BYTE-1:0], \
    INIT_RAM_03[32*BYTE-1:0], INIT_RAM_02[32*BYTE-1:0], INIT_RAM_01[32*BYTE-1:0], INIT_RAM_00[32*BYTE-1:0] }

// A port of WIDTH bits at address ad, which counts bits (bytes of 9 as 8): its low bits enable the bytes of a word that has several.
// MODE, what a write reads: 0 nothing, 1 its own data, 2 what was there.
module gowin_ram #(
    parameter integer BYTE = 9, WIDTH_A = 9, WIDTH_B = 9, MODE_A = 0, MODE_B = 0, PLAIN = 1,
    parameter [2048*BYTE-1:0] CONTENTS = 0
) (
    input clka, cea, wea, reseta, input [2:0] selecta, input [13:0] ada, input [4*BYTE-1:0] da, output reg [4*BYTE-1:0] qa,
    input clkb, ceb, web, resetb, input [2:0] selectb, input [13:0] adb, input [4*BYTE-1:0] db, output reg [4*BYTE-1:0] qb
);
    localparam integer BYTES_A = WIDTH_A > BYTE ? WIDTH_A / BYTE : 1, BYTES_B = WIDTH_B > BYTE ? WIDTH_B / BYTE : 1;
    localparam integer PART_A = WIDTH_A > BYTE ? BYTE : WIDTH_A, PART_B = WIDTH_B > BYTE ? BYTE : WIDTH_B;
    reg [BYTE-1:0] bytes[0:2047];
    reg [BYTE-1:0] fresh_a, fresh_b;
    integer n, a, b;
    initial begin
        qa = 0;
        qb = 0;
        for (n = 0; n < 2048; n = n + 1) bytes[n] = CONTENTS[BYTE*n +: BYTE];
        if (!PLAIN || !(WIDTH_A <= 4 && BYTE == 8 || WIDTH_A == BYTE * BYTES_A) || !(WIDTH_B <= 4 && BYTE == 8 || WIDTH_B == BYTE * BYTES_B)) begin
            $display("a block memory in a setting that is not modelled: %m");
            $fatal;
        end
    end
    // first byte, and first bit within it, of the word at an address
    wire [10:0] byte_a = ada[13:3] & ~(BYTES_A - 1), byte_b = adb[13:3] & ~(BYTES_B - 1);
    wire [2:0] bit_a = PART_A < 8 ? ada[2:0] & ~(PART_A - 1) : 3'd0, bit_b = PART_B < 8 ? adb[2:0] & ~(PART_B - 1) : 3'd0;

    always @(posedge clka)
        if (cea)
            for (a = 0; a < BYTES_A; a = a + 1) begin
                fresh_a = bytes[byte_a + a];
                if (wea && MODE_A == 2 || !wea) qa[PART_A*a +: PART_A] <= fresh_a[bit_a +: PART_A];
                if (wea && (BYTES_A == 1 || ada[a])) fresh_a[bit_a +: PART_A] = da[PART_A*a +: PART_A];
                if (wea && MODE_A == 1) qa[PART_A*a +: PART_A] <= fresh_a[bit_a +: PART_A];
                if (wea) bytes[byte_a + a] <= fresh_a;
            end

    always @(posedge clkb)
        if (ceb)
            for (b = 0; b < BYTES_B; b = b + 1) begin
                fresh_b = bytes[byte_b + b];
                if (web && MODE_B == 2 || !web) qb[PART_B*b +: PART_B] <= fresh_b[bit_b +: PART_B];
                if (web && (BYTES_B == 1 || adb[b])) fresh_b[bit_b +: PART_B] = db[PART_B*b +: PART_B];
                if (web && MODE_B == 1) qb[PART_B*b +: PART_B] <= fresh_b[bit_b +: PART_B];
                if (web) bytes[byte_b + b] <= fresh_b;
            end

    always @(posedge clka or posedge clkb)
        if (reseta || resetb || selecta != 0 || selectb != 0) begin
            $display("a block memory is reset or not selected, which is not modelled: %m");
            $fatal;
        end
endmodule

module SP #(
    parameter READ_MODE = 0, WRITE_MODE = 0, BIT_WIDTH = 32, BLK_SEL = 0, RESET_MODE = "SYNC",
`GOWIN_INIT
) (output [31:0] DO, input [31:0] DI, input [2:0] BLKSEL, input [13:0] AD, input WRE, CLK, CE, OCE, RESET);
    localparam integer BYTE = 8;
    gowin_ram #(.BYTE(BYTE), .WIDTH_A(BIT_WIDTH), .WIDTH_B(BYTE), .MODE_A(WRITE_MODE), .PLAIN(READ_MODE == 0 && BLK_SEL == 0), .CONTENTS(`GOWIN_CONTENTS)) ram (
        .clka(CLK), .cea(CE), .wea(WRE), .reseta(RESET), .selecta(BLKSEL), .ada(AD), .da(DI), .qa(DO),
        .clkb(1'b0), .ceb(1'b0), .web(1'b0), .resetb(1'b0), .selectb(3'd0), .adb(14'd0), .db(32'd0), .qb());
endmodule

module SPX9 #(
    parameter READ_MODE = 0, WRITE_MODE = 0, BIT_WIDTH = 36, BLK_SEL = 0, RESET_MODE = "SYNC",
`GOWIN_INIT
) (output [35:0] DO, input [35:0] DI, input [2:0] BLKSEL, input [13:0] AD, input WRE, CLK, CE, OCE, RESET);
    localparam integer BYTE = 9;
    gowin_ram #(.BYTE(BYTE), .WIDTH_A(BIT_WIDTH), .WIDTH_B(BYTE), .MODE_A(WRITE_MODE), .PLAIN(READ_MODE == 0 && BLK_SEL == 0), .CONTENTS(`GOWIN_CONTENTS)) ram (
        .clka(CLK), .cea(CE), .wea(WRE), .reseta(RESET), .selecta(BLKSEL), .ada(AD), .da(DI), .qa(DO),
        .clkb(1'b0), .ceb(1'b0), .web(1'b0), .resetb(1'b0), .selectb(3'd0), .adb(14'd0), .db(36'd0), .qb());
endmodule

module SDPB #(
    parameter READ_MODE = 0, BIT_WIDTH_0 = 32, BIT_WIDTH_1 = 32, BLK_SEL_0 = 0, BLK_SEL_1 = 0, RESET_MODE = "SYNC",
`GOWIN_INIT
) (output [31:0] DO, input [31:0] DI, input [2:0] BLKSELA, BLKSELB, input [13:0] ADA, ADB, input CLKA, CEA, CLKB, CEB, OCE, RESETA, RESETB);
    localparam integer BYTE = 8;
    gowin_ram #(.BYTE(BYTE), .WIDTH_A(BIT_WIDTH_0), .WIDTH_B(BIT_WIDTH_1), .PLAIN(READ_MODE == 0 && BLK_SEL_0 == 0 && BLK_SEL_1 == 0),
                .CONTENTS(`GOWIN_CONTENTS)) ram (
        .clka(CLKA), .cea(CEA), .wea(1'b1), .reseta(RESETA), .selecta(BLKSELA), .ada(ADA), .da(DI), .qa(),
        .clkb(CLKB), .ceb(CEB), .web(1'b0), .resetb(RESETB), .selectb(BLKSELB), .adb(ADB), .db(32'd0), .qb(DO));
endmodule

module SDPX9B #(
    parameter READ_MODE = 0, BIT_WIDTH_0 = 36, BIT_WIDTH_1 = 36, BLK_SEL_0 = 0, BLK_SEL_1 = 0, RESET_MODE = "SYNC",
`GOWIN_INIT
) (output [35:0] DO, input [35:0] DI, input [2:0] BLKSELA, BLKSELB, input [13:0] ADA, ADB, input CLKA, CEA, CLKB, CEB, OCE, RESETA, RESETB);
    localparam integer BYTE = 9;
    gowin_ram #(.BYTE(BYTE), .WIDTH_A(BIT_WIDTH_0), .WIDTH_B(BIT_WIDTH_1), .PLAIN(READ_MODE == 0 && BLK_SEL_0 == 0 && BLK_SEL_1 == 0),
                .CONTENTS(`GOWIN_CONTENTS)) ram (
        .clka(CLKA), .cea(CEA), .wea(1'b1), .reseta(RESETA), .selecta(BLKSELA), .ada(ADA), .da(DI), .qa(),
        .clkb(CLKB), .ceb(CEB), .web(1'b0), .resetb(RESETB), .selectb(BLKSELB), .adb(ADB), .db(36'd0), .qb(DO));
endmodule

module DPB #(
    parameter READ_MODE0 = 0, READ_MODE1 = 0, WRITE_MODE0 = 0, WRITE_MODE1 = 0, BIT_WIDTH_0 = 16, BIT_WIDTH_1 = 16, BLK_SEL_0 = 0, BLK_SEL_1 = 0,
              RESET_MODE = "SYNC",
`GOWIN_INIT
) (output [15:0] DOA, DOB, input [15:0] DIA, DIB, input [2:0] BLKSELA, BLKSELB, input [13:0] ADA, ADB,
   input CLKA, CEA, WREA, OCEA, RESETA, CLKB, CEB, WREB, OCEB, RESETB);
    localparam integer BYTE = 8;
    wire [15:0] unused_a, unused_b;
    gowin_ram #(.BYTE(BYTE), .WIDTH_A(BIT_WIDTH_0), .WIDTH_B(BIT_WIDTH_1), .MODE_A(WRITE_MODE0), .MODE_B(WRITE_MODE1),
                .PLAIN(READ_MODE0 == 0 && READ_MODE1 == 0 && BLK_SEL_0 == 0 && BLK_SEL_1 == 0), .CONTENTS(`GOWIN_CONTENTS)) ram (
        .clka(CLKA), .cea(CEA), .wea(WREA), .reseta(RESETA), .selecta(BLKSELA), .ada(ADA), .da({16'd0, DIA}), .qa({unused_a, DOA}),
        .clkb(CLKB), .ceb(CEB), .web(WREB), .resetb(RESETB), .selectb(BLKSELB), .adb(ADB), .db({16'd0, DIB}), .qb({unused_b, DOB}));
endmodule

module DPX9B #(
    parameter READ_MODE0 = 0, READ_MODE1 = 0, WRITE_MODE0 = 0, WRITE_MODE1 = 0, BIT_WIDTH_0 = 18, BIT_WIDTH_1 = 18, BLK_SEL_0 = 0, BLK_SEL_1 = 0,
              RESET_MODE = "SYNC",
`GOWIN_INIT
) (output [17:0] DOA, DOB, input [17:0] DIA, DIB, input [2:0] BLKSELA, BLKSELB, input [13:0] ADA, ADB,
   input CLKA, CEA, WREA, OCEA, RESETA, CLKB, CEB, WREB, OCEB, RESETB);
    localparam integer BYTE = 9;
    wire [17:0] unused_a, unused_b;
    gowin_ram #(.BYTE(BYTE), .WIDTH_A(BIT_WIDTH_0), .WIDTH_B(BIT_WIDTH_1), .MODE_A(WRITE_MODE0), .MODE_B(WRITE_MODE1),
                .PLAIN(READ_MODE0 == 0 && READ_MODE1 == 0 && BLK_SEL_0 == 0 && BLK_SEL_1 == 0), .CONTENTS(`GOWIN_CONTENTS)) ram (
        .clka(CLKA), .cea(CEA), .wea(WREA), .reseta(RESETA), .selecta(BLKSELA), .ada(ADA), .da({18'd0, DIA}), .qa({unused_a, DOA}),
        .clkb(CLKB), .ceb(CEB), .web(WREB), .resetb(RESETB), .selectb(BLKSELB), .adb(ADB), .db({18'd0, DIB}), .qb({unused_b, DOB}));
endmodule

module MULT9X9 (input [8:0] A, B, input ASIGN, BSIGN, CE, CLK, RESET, input [8:0] SIA, SIB, input ASEL, BSEL, output [17:0] DOUT);
    wire signed [9:0] left = {ASIGN & A[8], A};
    wire signed [9:0] right = {BSIGN & B[8], B};
    wire signed [19:0] product = left * right;
    assign DOUT = product[17:0];
    always @* if (ASEL || BSEL) begin
        $display("MULT9X9 takes its neighbour's operand, which is not modelled: %m");
        $fatal;
    end
endmodule

module MULT18X18 (input [17:0] A, B, input ASIGN, BSIGN, CE, CLK, RESET, input [17:0] SIA, SIB, input ASEL, BSEL, output [35:0] DOUT);
    wire signed [18:0] left = {ASIGN & A[17], A};
    wire signed [18:0] right = {BSIGN & B[17], B};
    wire signed [37:0] product = left * right;
    assign DOUT = product[35:0];
    always @* if (ASEL || BSEL) begin
        $display("MULT18X18 takes its neighbour's operand, which is not modelled: %m");
        $fatal;
    end
endmodule

module MULT36X36 (input [35:0] A, B, input ASIGN, BSIGN, CE, CLK, RESET, output [71:0] DOUT);
    wire signed [36:0] left = {ASIGN & A[35], A};
    wire signed [36:0] right = {BSIGN & B[35], B};
    wire signed [73:0] product = left * right;
    assign DOUT = product[71:0];
endmodule

module IOBUF (output O, inout IO, input I, OEN);
    assign IO = OEN ? 1'bz : I;
    assign O = IO;
endmodule
