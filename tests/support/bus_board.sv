// A design (module accelerator) between a converter's model and a CPU's bus; tests/support/bus_bench.py plays it.
`timescale 1ns / 1ps
/* verilator public_flat_rw_on */
module bus_board #(parameter integer BEATS = 16, CLASSES = 3) (
    input wire clk, rst,
    input wire wb_cyc, wb_stb, wb_we, input wire [8:0] wb_adr, input wire [3:0] wb_sel, input wire [31:0] wb_dat_w,
    output wire [31:0] wb_dat_r, output wire wb_ack,
    input wire [8:0] s_axi_awaddr, s_axi_araddr, input wire [2:0] s_axi_awprot, s_axi_arprot, input wire [31:0] s_axi_wdata,
    input wire [3:0] s_axi_wstrb, input wire s_axi_awvalid, s_axi_wvalid, s_axi_bready, s_axi_arvalid, s_axi_rready,
    output wire s_axi_awready, s_axi_wready, s_axi_bvalid, s_axi_arready, s_axi_rvalid,
    output wire [1:0] s_axi_bresp, s_axi_rresp, output wire [31:0] s_axi_rdata,
    output wire irq, moving, input wire [32*BEATS-1:0] analog, output wire [31:0] violations
);
    /* verilator public_off */
    wire led, decision_valid;
    wire [CLASSES-1:0] decision;
    `PIN_WIRES
    assign moving = `PORT_BUSY;
    converter #(`MODEL_PARAMETERS) model (`MODEL_PINS, .analog(analog), .fault(3'd0), .violations(violations));
    accelerator dut (.*, `DESIGN_PINS);
endmodule
