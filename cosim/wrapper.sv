// The accelerator under cosim/bench.py: a clock, a block of frames on its way out, and what every stage said since Python was last woken.
//
// Python decides what is offered, when, and what is accepted; nothing of a recording is kept here. It writes `block` (FRAMES frames, taxel 0 of
// the first one lowest), for each of its `frames` a word of `dues` (the first cycle it may be offered in; bit 47: say when it was taken), then
// toggles `sent`. Bits of `offers` and `accepts`, one a cycle, let a beat be offered and a decision be taken.
// `woken` toggles when `count` rows of `events`, {8'kind, 56'cycle, 32'word}, are there to be read. Icarus 11 and Verilator 5 both take this file.
`timescale 1ns / 1ps

module wrapper #(
    parameter integer TAXELS = 16, SAMPLE_BITS = 16, FRAMES = 1, PATIENCE = 1000000,
    parameter integer PIN_CODES = TAXELS, CYCLE_PS = 83333, LINES = 1, SELECTS = 1, FRAME_BITS = 16, CHANNELS = 8, CHANNEL_BIT = 0, DELAY = 0,
    parameter integer CODE_BIT = 0, CODE_BITS = 12, TAG_BIT = 0, TAG_BITS = 0, ZEROS = 0, ROWS = 1, COLUMNS = 1, FIRST = 1, ASCENDING = 0,
    parameter integer SETTLE_PS = 0, CLOCK_PS = 0, CHIPS = 1  // from PIN_CODES on: of the converter's model
) ();
`ifdef CONVERTER
    localparam integer BEATS = PIN_CODES, BITS = 32;
`else
    localparam integer BEATS = TAXELS, BITS = 16;
`endif
    localparam integer LOG = 128, ROW = 96, SLICE = 16 * ROW, QUIET = 5;
    localparam FRAME = 7, WAITED = 8, SENT = 9, SCAN = 10, RESTED = 11, LOST = 12, UNSTABLE = 13, UNKNOWN = 14, STUCK = 15;

    reg clk /* verilator public_flat_rd */ = 1'b0;
    always #5 clk = ~clk;
    // ---------------------------------------------------------------- what the bench writes
    reg rst /* verilator public_flat_rw */ = 1'b1, sent /* verilator public_flat_rw */ = 1'b0, measured /* verilator public_flat_rw */ = 1'b0;
    reg [FRAMES*BEATS*BITS-1:0] block /* verilator public_flat_rw */ = 0;
    reg [FRAMES*48-1:0] dues /* verilator public_flat_rw */ = 0;
    reg [15:0] frames /* verilator public_flat_rw */ = 0, bus_w_data /* verilator public_flat_rw */ = 0;
    reg [1023:0] offers /* verilator public_flat_rw */ = {1024{1'b1}}, accepts /* verilator public_flat_rw */ = {1024{1'b1}};
    reg [7:0] bus_addr /* verilator public_flat_rw */ = 0;
    reg bus_w_stb /* verilator public_flat_rw */ = 0, bus_r_stb /* verilator public_flat_rw */ = 0, dump /* verilator public_flat_rw */ = 0;
    reg [2:0] misbehaves /* verilator public_flat_rw */ = 0;
    // ---------------------------------------------------------------- what it reads
    wire [15:0] bus_r_data /* verilator public_flat_rd */;
    reg woken /* verilator public_flat_rd */ = 1'b0, through /* verilator public_flat_rd */ = 1'b0, idle /* verilator public_flat_rd */ = 1'b0;
    reg [7:0] count /* verilator public_flat_rd */ = 0;
    reg [SLICE-1:0] events [0:LOG/16-1] /* verilator public_flat_rd */;
    reg [55:0] cycle /* verilator public_flat_rd */ = 0, measured_cycles /* verilator public_flat_rd */ = 0;
    reg [55:0] clocked_cycles /* verilator public_flat_rd */ = 0, longest /* verilator public_flat_rd */ = 0;
    wire [31:0] violations /* verilator public_flat_rd */;

    // ---------------------------------------------------------------- the accelerator; its ports are named here and nowhere else
    reg o_ready = 1'b0, loaded = 1'b0;
    wire i_ready, o_valid, busy;
    wire [31:0] o_payload, sum, fault, feature, state, logit, step;
    wire [5:0] valid;  // of sum (lowest) to step
`ifdef CONVERTER
    wire i_valid, i_first, i_last, sampling, broken;
    wire [SAMPLE_BITS-1:0] i_sample;
    wire [4:0] fault_bits;
    reg [4:0] faults /* verilator public_flat_rd */ = 0;
    reg [32*PIN_CODES-1:0] analog = 0;
    reg run = 1'b0, port_was = 1'b0;
    `PIN_WIRES
    converter #(`MODEL_PARAMETERS) model (`MODEL_PINS, .analog(analog), .fault(misbehaves), .violations(violations));
    sensing dut (
        .run(run), .sampling(sampling), .broken(broken), .fault(fault_bits), .frame({i_last, i_first, i_sample, i_ready, i_valid}), `DESIGN_PINS,
`else
    reg i_valid = 1'b0, i_first = 1'b0, i_last = 1'b0;
    reg [SAMPLE_BITS-1:0] i_sample = 0;
    assign violations = 0;
    accelerator dut (
        .i__payload({i_last, i_first, i_sample}), .i__valid(i_valid), .i__ready(i_ready),
`endif
`ifdef NO_PROBES
`elsif IMAGES
        .probe__map__valid(valid[3]), .probe__map__value(state), .probe__logit__valid(valid[4]), .probe__logit__value(logit),
        .probe__step__valid(valid[5]), .probe__step__value(step),
`else
        .probe__sum__valid(valid[0]), .probe__sum__value(sum), .probe__fault__valid(valid[1]), .probe__fault__value(fault),
        .probe__feature__valid(valid[2]), .probe__feature__value(feature), .probe__state__valid(valid[3]), .probe__state__value(state),
        .probe__logit__valid(valid[4]), .probe__logit__value(logit), .probe__step__valid(valid[5]), .probe__step__value(step),
`endif
        .clk(clk), .rst(rst), .busy(busy), .o__payload(o_payload), .o__valid(o_valid), .o__ready(o_ready),
        .bus__addr(bus_addr), .bus__w_data(bus_w_data), .bus__w_stb(bus_w_stb), .bus__r_stb(bus_r_stb), .bus__r_data(bus_r_data)
    );
`ifdef NO_PROBES
    assign valid = 0;
`elsif IMAGES
    assign valid[2:0] = 0;
`endif

    // ---------------------------------------------------------------- events
    reg [LOG*ROW-1:0] log = 0;
    integer filled = 0, quiet = 0, waited = 0, left = 0, beat = 0, under_way = 0, k = 0;
    integer frame /* verilator public_flat_rd */ = 0;
    reg offered = 1'b0, stalled = 1'b0, x_seen = 1'b0, hurry = 1'b0;
    reg [31:0] held = 0;
    reg [55:0] begun = 0, offered_at = 0;
    reg [FRAMES*BEATS*BITS-1:0] playing = 0;
    reg [FRAMES*48-1:0] due = 0;
    reg marked = 1'b0;
    task say(input [7:0] kind, input [31:0] word, input [55:0] when_);
        begin
            log[ROW*filled +: ROW] = {kind, when_, word};
            filled = filled + 1;
        end
    endtask
    always @(posedge clk) begin
        cycle <= cycle + 1;
        hurry = 1'b0;
        if (valid[0]) say(0, sum, cycle);
        if (valid[1]) say(1, fault, cycle);
        if (valid[2]) say(2, feature, cycle);
        if (valid[3]) say(3, state, cycle);
        if (valid[4]) say(4, logit, cycle);
        if (valid[5]) say(5, step, cycle);
        if (stalled && (!o_valid || o_payload !== held)) begin
            hurry = 1'b1;
            say(UNSTABLE, o_payload, cycle);
        end
        if (o_valid && !offered) offered_at = cycle;
        if (o_valid && o_ready) say(6, o_payload, offered_at);
        offered = o_valid && !o_ready;
        stalled = offered && !rst;
        held = o_payload;
        if (!x_seen && !rst && (^{i_ready, o_valid, busy, valid}) === 1'bx) begin
            {x_seen, hurry} = 2'b11;
            say(UNKNOWN, 0, cycle);
        end
        // ------------------------------------------------------------ frames
        if (i_valid && i_ready) begin
            if (i_first) begun = cycle - waited;
            if (waited != 0) say(WAITED, {i_first, waited[30:0]}, cycle);
            if (i_last && cycle - begun + 1 > longest) longest = cycle - begun + 1;
            waited = 0;
        end else if (i_valid) begin
            waited = waited + 1;
            if (waited == PATIENCE) say(STUCK, 0, cycle);
            if (waited == PATIENCE) hurry = 1'b1;
        end
        if (left == 0 && sent != loaded) begin
            {playing, due, left, frame, loaded, hurry} = {block, dues, {16'd0, frames}, 32'd0, sent, 1'b1};
            say(SENT, 0, cycle);
        end
`ifdef CONVERTER
        if ((i_valid && i_ready && i_last) || (broken && under_way != 0)) begin  // while a chip is set up no frame is lost
            say(broken ? LOST : FRAME, 0, cycle);
            under_way = under_way - 1;
        end
        if (sampling) begin  // the taxels hold still while they are scanned
            analog <= playing[BEATS*BITS*frame +: BEATS*BITS];
            frame = frame + 1;
            left = left - 1;
            under_way = under_way + 1;
            hurry = 1'b1;
            say(SCAN, 0, cycle);
        end
        run <= left != 0 || sent != loaded;  // the sample clock goes on from block to block
        if (port_was && !(`PORT_BUSY)) say(RESTED, 0, cycle);
        port_was = `PORT_BUSY;
        faults <= faults | fault_bits;
`else
        if (i_valid && i_ready && i_last && marked) say(FRAME, 0, cycle);
        if (i_valid && i_ready && i_last) under_way = 0;
        if (!i_valid || i_ready) begin
            i_valid <= 1'b0;
            if (left != 0 && (beat != 0 || cycle >= due[48*frame +: 47]) && offers[cycle[9:0]]) begin
                i_valid <= 1'b1;
                i_sample <= playing[BITS*(BEATS*frame + beat) +: SAMPLE_BITS];
                {i_first, i_last} <= {beat == 0, beat == BEATS - 1};
                if (beat == 0) {marked, under_way} = {due[48*frame + 47], 32'd1};
                beat = beat + 1;
                if (beat == BEATS) {beat, frame, left} = {32'd0, frame + 32'd1, left - 32'd1};
            end
        end
`endif
        through <= left == 0 && sent == loaded && under_way == 0;
        o_ready <= accepts[cycle[9:0]];
        if (measured) measured_cycles <= measured_cycles + 1;
`ifdef CLOCKED
        if (measured && dut.chain.needed) clocked_cycles <= clocked_cycles + 1;
`endif
        quiet = busy !== 1'b0 || o_valid !== 1'b0 || i_valid || left != 0 || bus_w_stb || rst ? 0 : quiet + 1;
        idle <= quiet > QUIET;
        if (filled != 0 && (filled > LOG - 16 || hurry || quiet == QUIET)) begin
            for (k = 0; k < LOG / 16; k = k + 1) events[k] <= log[SLICE*k +: SLICE];
            count <= filled;
            filled = 0;
            woken <= ~woken;
        end
    end
    initial $dumpfile("waves.vcd");
    always @(posedge dump) $dumpvars(0, wrapper);
    always @(negedge dump) $dumpoff;
endmodule
