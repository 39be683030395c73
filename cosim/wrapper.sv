// The accelerator under cosim/bench.py. Python decides what is offered, when, and what is accepted; nothing of a recording is kept here. It writes
// `block` (FRAMES frames, taxel 0 of the first one lowest) and `dues` (of each of its frames the first cycle it may be offered in), then sets
// `frames`. Bits of `offers` and `accepts`, one a cycle, let a beat be offered and a decision be taken. `woken` toggles when `count` rows of
// `events`, {8'kind, 56'cycle, 32'word} (of a word with an X: UNKNOWN and its kind), are there to be read before the next clock. Icarus 11 and Verilator 5 both take this file.
`timescale 1ns / 1ps
module wrapper #(parameter integer FRAMES = 1, BEATS = 16, BITS = 16, SAMPLE_BITS = 16, PATIENCE = 1000000) ();
    localparam [7:0] DECISION = 7, FRAME = 8, WAITED = 9, SENT = 10, SCAN = 11, LOST = 12, UNSTABLE = 13, UNKNOWN = 14, STUCK = 15;
    localparam LOG = 128, SLICE = 16, ROW = 96, QUIET = 5;
    /* verilator public_flat_rw_on */  // what the bench writes
    reg rst = 1'b1, measured = 1'b0, bus__w_stb = 1'b0, bus__r_stb = 1'b0, dump = 1'b0;
    reg [FRAMES*BEATS*BITS-1:0] block = 0;
    reg [FRAMES*64-1:0] dues = 0;
    reg [15:0] frames = 0, bus__w_data = 0;
    reg [7:0] bus__addr = 0, misbehaves = 0;  // the converter
    reg [1023:0] offers = {1024{1'b1}}, accepts = {1024{1'b1}};
    /* verilator public_flat_rd_on */  // and what it reads
    reg clk = 1'b0, woken = 1'b0, through = 1'b0, idle = 1'b0;
    reg [7:0] count = 0, faults = 0;
    reg [SLICE*ROW-1:0] events [0:LOG/SLICE-1];
    reg [55:0] cycle = 0;
    integer frame = 0;
    wire [15:0] bus__r_data;
    wire [31:0] violations;
    /* verilator public_off */
    // ports of the accelerator by their own names; probes may be missing
    wire i__ready, o__valid, busy, probe__sum__valid, probe__fault__valid, probe__feature__valid, probe__state__valid, probe__map__valid;
    wire probe__logit__valid, probe__step__valid;
    wire [31:0] o__payload, probe__sum__value, probe__fault__value, probe__feature__value, probe__state__value, probe__map__value;
    wire [31:0] probe__logit__value, probe__step__value;
    wire [6:0] valid = {probe__step__valid, probe__logit__valid, probe__map__valid, probe__state__valid, probe__feature__valid,
                        probe__fault__valid, probe__sum__valid};
    wire [7*32-1:0] values = {probe__step__value, probe__logit__value, probe__map__value, probe__state__value, probe__feature__value,
                              probe__fault__value, probe__sum__value};
    reg o__ready = 1'b0, offered = 1'b0, hurry = 1'b0;
`ifdef CONVERTER
    wire i__valid, sampling, broken;
    wire [SAMPLE_BITS+1:0] i__payload;
    wire [4:0] fault_bits;
    reg [BEATS*BITS-1:0] analog = 0;
    reg run = 1'b0;
    `PIN_WIRES
    converter #(`MODEL_PARAMETERS) model (`MODEL_PINS, .analog(analog), .fault(misbehaves[2:0]), .violations(violations));
    sensing dut (.*, .fault(fault_bits), .frame({i__payload, i__ready, i__valid}), .o__payload(o__payload), `DESIGN_PINS);
`else
    reg i__valid = 1'b0;
    reg [SAMPLE_BITS+1:0] i__payload = 0;
    accelerator dut (.*, .o__payload(o__payload));
`endif
    wire i_last = i__payload[SAMPLE_BITS+1], i_first = i__payload[SAMPLE_BITS];
    reg [31:0] held = 0;
    reg [55:0] begun = 0, offered_at = 0;
    reg [FRAMES*BEATS*BITS-1:0] playing = 0;
    reg [FRAMES*64-1:0] due = 0;
    integer filled = 0, quiet = 0, waited = 0, left = 0, beat = 0, under_way = 0, k = 0, j = 0;
    task say(input [7:0] kind, input [31:0] word, input [55:0] at, input urgent);
        events[filled / SLICE][ROW*(filled % SLICE) +: ROW] = ^word === 1'bx ? {UNKNOWN, at, 24'd0, kind} : {kind, at, word};
        {filled, hurry} = {filled + 32'd1, hurry | urgent | (^word === 1'bx)};
    endtask
    always #5 clk = ~clk;
    always @(posedge clk) begin
        cycle <= cycle + 1;
        for (k = 0; k < 7; k = k + 1) if (!rst && valid[k] !== 1'b0 && valid[k] !== 1'bz) say(k, valid[k] ? values[32*k +: 32] : 32'bx, cycle, 0);
        if (offered && !rst && (!o__valid || o__payload !== held)) say(UNSTABLE, o__payload, cycle, 1);
        if (o__valid && !offered) offered_at = cycle;
        if (!rst && o__valid && o__ready) say(DECISION, o__payload, offered_at, 0);
        offered = o__valid && !o__ready;
        held = o__payload;
        if (!rst && (^{i__ready, o__valid, busy}) === 1'bx) say(UNKNOWN, 255, cycle, 1);
        if (i__valid && i__ready) begin
            if (i_first) begun = cycle - waited;
            if (waited != 0) say(WAITED, {i_first, waited[30:0]}, cycle, 0);
            if (i_last) say(FRAME, cycle - begun + 1, cycle, 0);
            waited = 0;
        end else if (i__valid) begin
            waited = waited + 1;
            if (waited == PATIENCE) say(STUCK, 0, cycle, 1);
        end
        if (left == 0 && frames != 0) begin
            {playing, due, left, frame, frames} = {block, dues, 16'd0, frames, 32'd0, 16'd0};
            say(SENT, 0, cycle, 1);
        end
`ifdef CONVERTER
        if (broken && under_way != 0) say(LOST, 0, cycle, 0);  // while a chip is set up no frame is lost
        if ((i__valid && i__ready && i_last) || (broken && under_way != 0)) under_way = under_way - 1;
        if (sampling) begin  // the taxels hold still while they are scanned
            analog <= playing[BEATS*BITS*frame +: BEATS*BITS];
            {frame, left, under_way} = {frame + 32'd1, left - 32'd1, under_way + 32'd1};
            say(SCAN, 0, cycle, 1);
        end
        {run, faults} <= {left != 0 || frames != 0, faults | fault_bits};  // the sample clock goes on from block to block
`else
        if (i__valid && i__ready && i_last) under_way = 0;
        if (!i__valid || i__ready) begin
            i__valid <= 1'b0;
            if (left != 0 && (beat != 0 || cycle >= due[64*frame +: 56]) && offers[cycle[9:0]]) begin
                i__valid <= 1'b1;
                i__payload <= {beat == BEATS - 1, beat == 0, playing[BITS*(BEATS*frame + beat) +: SAMPLE_BITS]};
                {beat, under_way} = {beat + 32'd1, 32'd1};
                if (beat == BEATS) {beat, frame, left} = {32'd0, frame + 32'd1, left - 32'd1};
            end
        end
`endif
        {through, o__ready} <= {left == 0 && frames == 0 && under_way == 0, accepts[cycle[9:0]]};
        quiet = busy !== 1'b0 || o__valid !== 1'b0 || i__valid || left != 0 || bus__w_stb || rst ? 0 : quiet + 1;
        idle <= quiet > QUIET;
        if (filled > LOG - 16 || hurry || (filled != 0 && quiet == QUIET)) begin
            count <= filled;
            woken <= ~woken;  // behind count, which is read when this changes
            {filled, hurry} = 33'd0;
        end
    end
    initial $dumpfile("waves.vcd");
    initial for (j = 0; j < LOG / SLICE; j = j + 1) events[j] = 0;
    always @(dump) if (dump) $dumpvars(0, wrapper); else $dumpoff;
endmodule
