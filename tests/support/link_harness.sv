// A board on a desk: `board_top` with a serial port at its pins. Bytes cross to the bench in bulk, not one simulator call a bit.
//
// Towards the board: the bench sets push_data, push_broken (bit k: byte k's stop bit is low), push_count and flips push; the bytes queue up
// and go out at CLOCKS_PER_BIT; where the bench drives rx itself, nothing is pushed. busy: bytes are still to go.
// From the board:    bytes are collected; arrived: a flag has come since the last take. The bench flips take; a cycle later take_data and
// take_count hold up to 256 of them.
`timescale 1ns / 1ps

module link_harness #(
    parameter integer CLASSES = 3,
    parameter integer CLOCKS_PER_BIT = 4
) (
    input wire clk /* verilator public_flat_rd */,  // cosim/main.cpp makes it
    output wire alone  // the bench has nothing to do
);
    assign alone = 1'b0;
    reg rst /* verilator public_flat_rw */ = 1'b0;

    reg [2047:0] push_data /* verilator public_flat_rw */ = 0;
    reg [255:0] push_broken /* verilator public_flat_rw */ = 0;
    reg [8:0] push_count /* verilator public_flat_rw */ = 0;
    reg push /* verilator public_flat_rw */ = 1'b0;
    reg busy /* verilator public_flat_rd */ = 1'b0;
    reg take /* verilator public_flat_rw */ = 1'b0;
    reg [2047:0] take_data /* verilator public_flat_rd */ = 0;
    reg [8:0] take_count /* verilator public_flat_rd */ = 0;
    reg arrived /* verilator public_flat_rd */ = 1'b0;
    reg [63:0] cycle /* verilator public_flat_rd */ = 0;

    reg line = 1'b1;
    reg rx /* verilator public_flat_rw */ = 1'b1;
    wire tx /* verilator public_flat_rd */;
    wire [CLASSES-1:0] decision /* verilator public_flat_rd */;
    wire decision_valid /* verilator public_flat_rd */;
    wire led;
    board_top dut (
        .clk(clk), .rst(rst), .rx(rx & line), .tx(tx), .decision(decision), .decision_valid(decision_valid), .led(led)
    );

    // ---------------------------------------------------------------- towards the board
    localparam QUEUE = 65536;
    reg [8:0] queue [0:QUEUE-1];
    integer head = 0, tail = 0, k = 0;
    integer out_timer = 0, out_bit = 10;
    reg push_seen = 1'b0;
    reg [8:0] out = 9'h1FF;

    // ---------------------------------------------------------------- from the board
    reg [7:0] heard [0:QUEUE-1];
    integer heard_head = 0, heard_tail = 0, in_timer = 0, in_bit = 10;
    reg take_seen = 1'b0;
    reg [7:0] in = 8'd0;

    always @(posedge clk) begin
        cycle <= cycle + 1;
        if (push != push_seen) begin
            push_seen <= push;
            for (k = 0; k < push_count; k = k + 1) begin
                queue[tail] = {push_broken[k], push_data[8*k +: 8]};
                tail = (tail + 1) % QUEUE;
            end
        end
        if (out_timer > 0) out_timer = out_timer - 1;
        else if (out_bit < 10) begin
            line <= out_bit == 0 ? 1'b0 : out_bit == 9 ? ~out[8] : out[out_bit-1];
            out_bit = out_bit + 1;
            out_timer = CLOCKS_PER_BIT - 1;
        end else if (head != tail) begin
            out = queue[head];
            head = (head + 1) % QUEUE;
            line <= 1'b0;
            out_bit = 1;
            out_timer = CLOCKS_PER_BIT - 1;
        end else line <= 1'b1;
        busy <= out_bit < 10 || out_timer > 0 || head != tail || push != push_seen;

        if (in_timer > 0) in_timer = in_timer - 1;
        else if (in_bit < 8) begin
            in[in_bit] = tx;
            in_bit = in_bit + 1;
            in_timer = CLOCKS_PER_BIT - 1;
        end else if (in_bit == 8) begin
            in_bit = 10;
            heard[heard_tail] = in;
            heard_tail = (heard_tail + 1) % QUEUE;
            if (in == 8'h7E) arrived <= 1'b1;
        end else if (tx === 1'b0) begin
            in_bit = 0;
            in_timer = (3 * CLOCKS_PER_BIT) / 2 - 1;
        end
        if (take != take_seen) begin
            take_seen <= take;
            take_count = 0;
            while (heard_head != heard_tail && take_count < 256) begin
                take_data[8*take_count +: 8] = heard[heard_head];
                take_count = take_count + 1;
                heard_head = (heard_head + 1) % QUEUE;
            end
            if (heard_head == heard_tail) arrived <= 1'b0;
        end
    end
endmodule
