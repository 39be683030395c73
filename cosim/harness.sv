// Plays recordings into `accelerator` by itself and writes down every stage: no host call per cycle.
//
// The subset of SystemVerilog that Icarus 11 (-g2012) and Verilator 5 both take. The cocotb bench owns reset, start, directed bus accesses
// and the wall-clock limit; this module owns stimulus, back-pressure and capture. All files lie in the folder the simulator runs in.
//
// In:  boot.bin         32-bit words {16'h address, 16'h data}: bus writes before the first recording
//      recordings.bin   two 32-bit words a recording: number, frames
//      samples.bin      16-bit words, big-endian as $fread takes them, frame after frame, taxel 0 first
//      plus-args        recordings, boot, declared (0/1), rate, clock (integers of one common unit), stalls (0/1), gap_seed, watchdog (cycles),
//                       hold_recording, hold_frame (pause before that frame until `resume`), waves_from, waves_to (cycles since arm)
// With CONVERTER defined the accelerator sits behind a converter's pins (module sensing) and a model of the converter (module converter of
// cosim/converters/, wired as pins.svh there says): samples.bin holds PIN_CODES codes a frame as 32-bit words, frames come at the design's own sample clock, and the plus-args
// fault_frame, fault_frames, fault_kind make the model misbehave in so many frames of each recording.
// Out: sum|fault|feature|state|logit|step.txt   one value a line:  recording hex-value cycle
//      decision.txt     recording hex-payload cycle-first-offered cycle-taken
//      frames.bin       32-bit cycle stamp (low word) of the edge that took the last taxel of each frame
//      status.txt       recording STATUS FAULTS TOUCHES, hex, read over the bus when the recording is over, cycle of its arm command,
//                       and FLAG_WORDS words of TAXEL_FAULTS
//      summary.txt      name value
// With IMAGES defined the accelerator is one for images: map.txt in place of state.txt, and nothing in sum, fault and feature.
//      scans.bin        with CONVERTER, two 32-bit stamps a frame: its scan begins; the converter's port rests after its last channel
// A cycle stamp is the number of the rising edge since start, counted from 0.
`timescale 1ns / 1ps

module harness #(
    parameter integer TAXELS = 16,
    parameter integer SAMPLE_BITS = 16,
    parameter integer CONTROL = 2,   // bus addresses and commands come from registers.json
    parameter integer STATUS = 3,
    parameter integer FAULTS = 4,
    parameter integer TOUCHES = 5,
    parameter integer TAXEL_FAULTS = 32,
    parameter integer FLAG_WORDS = 0,
    parameter integer ARM = 1,
    parameter integer FINISH = 2,
    parameter integer LINES = 1, parameter integer SELECTS = 1, parameter integer CYCLE_PS = 83333,  // of the converter's model
    parameter integer FRAME_BITS = 16, parameter integer CHANNELS = 8, parameter integer CHANNEL_BIT = 0, parameter integer DELAY = 0,
    parameter integer CODE_BIT = 0, parameter integer CODE_BITS = 12, parameter integer TAG_BIT = 0, parameter integer TAG_BITS = 0,
    parameter integer ZEROS = 0, parameter integer PIN_CODES = TAXELS, parameter integer ROWS = 1, parameter integer COLUMNS = 1,
    parameter integer FIRST = 1, parameter integer ASCENDING = 0, parameter integer SETTLE_PS = 0, parameter integer CLOCK_PS = 0,
    parameter integer CHIPS = 1
) (
`ifdef VERILATOR  // cosim/main.cpp makes the clock
    input wire clk /* verilator public_flat_rd */,
`endif
    output wire alone  // the bench has nothing to do
);
`ifndef VERILATOR
    reg clk = 1'b0;
    always #5 clk = ~clk;
`endif
    // ---------------------------------------------------------------- what the bench drives and reads
    reg rst /* verilator public_flat_rw */ = 1'b0;
    reg start /* verilator public_flat_rw */ = 1'b0;
    reg resume /* verilator public_flat_rw */ = 1'b0;
    reg [7:0] host_addr /* verilator public_flat_rw */ = 8'd0;
    reg [15:0] host_w_data /* verilator public_flat_rw */ = 16'd0;
    reg host_w_stb /* verilator public_flat_rw */ = 1'b0;
    reg host_r_stb /* verilator public_flat_rw */ = 1'b0;
    wire [15:0] bus_r_data /* verilator public_flat_rd */;
    reg done /* verilator public_flat_rd */ = 1'b0;
    reg held /* verilator public_flat_rd */ = 1'b0;

    // ---------------------------------------------------------------- the accelerator
    reg o_ready = 1'b0;
`ifdef CONVERTER
    wire i_valid, i_first, i_last;
    wire [SAMPLE_BITS-1:0] i_sample;
    reg run = 1'b0;
    wire sampling, broken;
    wire [4:0] conversion_fault;
    `PIN_WIRES
    wire [31:0] violations;
    reg [32*PIN_CODES-1:0] analog = 0;
    reg [2:0] misbehaves = 3'd0;
`else
    reg i_valid = 1'b0, i_first = 1'b0, i_last = 1'b0;
    reg [SAMPLE_BITS-1:0] i_sample = 0;
`endif
    reg [7:0] play_addr = 8'd0;
    reg [15:0] play_w_data = 16'd0;
    reg play_w_stb = 1'b0, play_r_stb = 1'b0;
    wire i_ready, o_valid, busy;
    wire [31:0] o_payload;
    wire sum_valid, fault_valid, feature_valid, state_valid, logit_valid, step_valid;
    wire [31:0] sum, fault, feature, state, logit, step_cycles;

    localparam IDLE = 0, BOOT = 1, NEXT = 2, ARMING = 3, PLAY = 4, FINISHING = 5, READ = 6, OVER = 7;
    integer mode = IDLE;
    wire host_turn = held | (mode == IDLE) | (mode == OVER);
    assign alone = !host_turn;

`ifdef CONVERTER
    converter #(`MODEL_PARAMETERS) model (`MODEL_PINS, .analog(analog), .fault(misbehaves), .violations(violations));
    sensing dut (
        .clk(clk), .rst(rst), .run(run), .sampling(sampling), .broken(broken), .fault(conversion_fault),
        .frame({i_last, i_first, i_sample, i_ready, i_valid}),
        `DESIGN_PINS,
`else
    accelerator dut (
        .clk(clk), .rst(rst),
        .i__payload({i_last, i_first, i_sample}), .i__valid(i_valid), .i__ready(i_ready),
`endif
        .o__payload(o_payload), .o__valid(o_valid), .o__ready(o_ready),
        .bus__addr(host_turn ? host_addr : play_addr), .bus__w_data(host_turn ? host_w_data : play_w_data),
        .bus__w_stb(host_turn ? host_w_stb : play_w_stb), .bus__r_stb(host_turn ? host_r_stb : play_r_stb), .bus__r_data(bus_r_data),
`ifndef NO_PROBES
`ifdef IMAGES
        .probe__map__valid(state_valid), .probe__map__value(state), .probe__logit__valid(logit_valid), .probe__logit__value(logit),
`else
        .probe__sum__valid(sum_valid), .probe__sum__value(sum), .probe__fault__valid(fault_valid), .probe__fault__value(fault),
        .probe__feature__valid(feature_valid), .probe__feature__value(feature),
        .probe__state__valid(state_valid), .probe__state__value(state), .probe__logit__valid(logit_valid), .probe__logit__value(logit),
`endif
        .probe__step__valid(step_valid), .probe__step__value(step_cycles),
`endif
        .busy(busy)
    );
`ifdef IMAGES
`ifndef NO_PROBES
    assign {sum_valid, fault_valid, feature_valid} = 3'd0;
    assign {sum, fault, feature} = 96'd0;
`endif
`endif
`ifdef NO_PROBES  // a netlist as it is placed: decisions and registers alone can be seen
    assign {sum_valid, fault_valid, feature_valid, state_valid, logit_valid, step_valid} = 6'd0;
    assign {sum, fault, feature, state, logit, step_cycles} = 192'd0;
`endif

    // ---------------------------------------------------------------- settings and files
    integer recordings, boot_words, declared, stalls, watchdog, hold_recording, hold_frame;
    reg [63:0] rate, clock, waves_from, waves_to;
    reg [31:0] seed;
    integer fault_frame, fault_frames, fault_kind, scan_file;
    integer boot_file, recording_file, sample_file, got;
    integer sum_file, fault_file, feature_file, state_file, logit_file, step_file, decision_file, frame_file, status_file, summary_file;

    initial begin
        if (!$value$plusargs("recordings=%d", recordings)) recordings = 0;
        if (!$value$plusargs("boot=%d", boot_words)) boot_words = 0;
        if (!$value$plusargs("declared=%d", declared)) declared = 0;
        if (!$value$plusargs("rate=%d", rate)) rate = 1;
        if (!$value$plusargs("clock=%d", clock)) clock = 1;
        if (!$value$plusargs("stalls=%d", stalls)) stalls = 0;
        if (!$value$plusargs("gap_seed=%d", seed)) seed = 1;
        if (!$value$plusargs("watchdog=%d", watchdog)) watchdog = 1000000;
        if (!$value$plusargs("hold_recording=%d", hold_recording)) hold_recording = -1;
        if (!$value$plusargs("hold_frame=%d", hold_frame)) hold_frame = 0;
        if (!$value$plusargs("waves_from=%d", waves_from)) waves_from = 0;
        if (!$value$plusargs("waves_to=%d", waves_to)) waves_to = 0;
        if (!$value$plusargs("fault_frame=%d", fault_frame)) fault_frame = 0;
        if (!$value$plusargs("fault_frames=%d", fault_frames)) fault_frames = 0;
        if (!$value$plusargs("fault_kind=%d", fault_kind)) fault_kind = 0;
        scan_file = $fopen("scans.bin", "wb");
        boot_file = $fopen("boot.bin", "rb");
        recording_file = $fopen("recordings.bin", "rb");
        sample_file = $fopen("samples.bin", "rb");
        sum_file = $fopen("sum.txt", "w");
        fault_file = $fopen("fault.txt", "w");
        feature_file = $fopen("feature.txt", "w");
`ifdef IMAGES
        state_file = $fopen("map.txt", "w");
`else
        state_file = $fopen("state.txt", "w");
`endif
        logit_file = $fopen("logit.txt", "w");
        step_file = $fopen("step.txt", "w");
        decision_file = $fopen("decision.txt", "w");
        frame_file = $fopen("frames.bin", "wb");
        status_file = $fopen("status.txt", "w");
        summary_file = $fopen("summary.txt", "w");
    end

    // ---------------------------------------------------------------- pseudo-random gaps: mostly short, now and then long
    function [31:0] next_random(input [31:0] x);
        reg [31:0] y;
        begin
            y = x ^ (x << 13);
            y = y ^ (y >> 17);
            next_random = y ^ (y << 5);
        end
    endfunction

    function [9:0] gap(input [15:0] r);
        gap = r[5:0] == 6'd0 ? {3'd0, r[12:6]} : r[5:4] == 2'd0 ? {7'd0, r[8:6]} : 10'd0;
    endfunction

    // ---------------------------------------------------------------- the player
    localparam SETTLE = 4;  // cycles a bus command may need before busy shows it
    reg [63:0] cycle = 0, armed_at = 0, phase = 0, frame_begin = 0, offered_at = 0, simulated = 0;
    reg [63:0] input_stalls = 0, overruns = 0, protocol_errors = 0, unknown = 0, frame_cycles_max = 0, frames_total = 0;
    reg [31:0] random = 1, word = 0, recording = 0, frames = 0;
`ifdef CONVERTER
    reg [31:0] frame [0:PIN_CODES-1];
`else
    reg [15:0] frame [0:TAXELS-1];
`endif
    reg [63:0] played_cycles = 0, clocked_cycles = 0;
    reg [63:0] scan_begin = 0, rested_at = 0, fault_until = 0;
    reg port_was = 1'b0;
    reg [31:0] conversion_faults = 0;
    integer lost = 0, taxel = 0;
    integer played = 0, loaded = 0, taken = 0, next_taxel = 0, due = 0, wait_cycles = 0, idle_cycles = 0, read_index = 0;
    integer source_gap = 0, sink_gap = 0, stuck = 0, dumping = 0;
    reg frame_open = 1'b0, offered = 1'b0, was_stalled = 1'b0;
    reg [31:0] stalled_payload = 0;
    reg [15:0] status_word = 0, fault_word = 0;

    always @(posedge clk) begin
        play_w_stb <= 1'b0;
        play_r_stb <= 1'b0;
`ifdef CLOCKED  // a design that stops its clock: cycles of play, and those with an edge
        if (mode == PLAY || mode == FINISHING) begin
            played_cycles = played_cycles + 1;
            if (dut.chain.needed) clocked_cycles = clocked_cycles + 1;
        end
`endif
        if (mode != IDLE && mode != OVER) begin
            cycle = cycle + 1;
            idle_cycles = idle_cycles + 1;
            random = next_random(random);
        end

        case (mode)
            IDLE: if (start) begin
                mode = boot_words > 0 ? BOOT : NEXT;
                wait_cycles = 0;
            end

            BOOT: begin
                got = $fread(word, boot_file);
                play_addr <= word[23:16];
                play_w_data <= word[15:0];
                play_w_stb <= 1'b1;
                idle_cycles = 0;
                boot_words = boot_words - 1;
                if (boot_words == 0) mode = NEXT;
            end

            NEXT: if (played == recordings || stuck != 0) begin
                simulated = cycle;
                mode = OVER;
            end else begin
                got = $fread(recording, recording_file);
                got = $fread(frames, recording_file);
                played = played + 1;
                loaded = 0;
                taken = 0;
                lost = 0;
                next_taxel = 0;
                source_gap = 0;
                sink_gap = 0;
                due = 1;
                phase = 0;
                random = (seed ^ (recording * 32'h9E3779B1)) | 32'd1;  // so that a recording played alone meets the same gaps
                play_addr <= CONTROL;
                play_w_data <= ARM;
                play_w_stb <= 1'b1;
                armed_at = cycle;
                wait_cycles = 0;
                mode = ARMING;
            end

            ARMING: begin
                wait_cycles = wait_cycles + 1;
                if (wait_cycles > SETTLE && !busy) begin
                    idle_cycles = 0;
                    mode = PLAY;
                end
            end

            PLAY: begin
`ifdef CONVERTER
                run <= loaded < frames;
                if (sampling) begin  // the taxels hold still while they are scanned
                    got = $fread(frame, sample_file);
                    for (taxel = 0; taxel < PIN_CODES; taxel = taxel + 1) analog[32*taxel +: 32] <= frame[taxel];
                    if (loaded == fault_frame && fault_frames > 0) begin
                        misbehaves <= fault_kind;
                        fault_until = cycle + fault_frames * clock / rate - 1;
                    end
                    loaded = loaded + 1;
                    run <= loaded < frames;
                    scan_begin = cycle;
                end
                if (`PORT_BUSY) port_was = 1'b1;
                else if (port_was) begin
                    port_was = 1'b0;
                    rested_at = cycle;
                end
                if (cycle == fault_until) misbehaves <= 0;
                conversion_faults = conversion_faults | conversion_fault;
                if (conversion_fault[2]) overruns = overruns + 1;
                if (i_valid && i_first && i_ready) frame_begin = cycle;
                if (broken && loaded > taken + lost) begin  // of a frame that was sampled; while a chip is set up there is none
                    lost = lost + 1;
                    idle_cycles = 0;
                    $fwrite(frame_file, "%u", cycle[31:0]);
                    $fwrite(scan_file, "%u%u", scan_begin[31:0], rested_at[31:0]);
                end
                if (!run || loaded < frames) idle_cycles = 0;
`else
                if (declared != 0) begin
                    phase = phase + rate;
                    if (phase >= clock) begin
                        phase = phase - clock;
                        due = due + 1;
                        if (frame_open || due > 1) overruns = overruns + 1;  // the frame before is not through
                    end
                end
                if (i_valid && !i_ready) input_stalls = input_stalls + 1;
                if (i_valid && !i_ready && i_first) overruns = overruns + 1;  // a frame is due and the chain is not ready for it
`endif
                if (i_valid && i_ready) begin
                    idle_cycles = 0;
`ifndef CONVERTER
                    i_valid <= 1'b0;
`endif
                    if (i_last) begin
                        taken = taken + 1;
                        frames_total = frames_total + 1;
                        if (cycle - frame_begin + 1 > frame_cycles_max) frame_cycles_max = cycle - frame_begin + 1;
                        $fwrite(frame_file, "%u", cycle[31:0]);
`ifdef CONVERTER
                        $fwrite(scan_file, "%u%u", scan_begin[31:0], rested_at[31:0]);
`endif
                    end
                end
`ifndef CONVERTER
                if (resume) held <= 1'b0;
                else if (recording == hold_recording && taken == hold_frame) held <= 1'b1;
                if (!resume && recording == hold_recording && loaded == hold_frame && !frame_open) begin  // nothing is offered but what is due
                    if (held) idle_cycles = 0;
                end else if (!i_valid || i_ready) begin
                    if (!frame_open && loaded < frames && (declared == 0 || due > 0)) begin
                        got = $fread(frame, sample_file);
                        loaded = loaded + 1;
                        due = due - 1;
                        frame_open = 1'b1;
                    end
                    if (source_gap > 0) source_gap = source_gap - 1;
                    else if (frame_open) begin
                        if (next_taxel == 0) frame_begin = cycle + 1;
                        i_valid <= 1'b1;
                        i_sample <= frame[next_taxel];
                        i_first <= next_taxel == 0;
                        i_last <= next_taxel == TAXELS - 1;
                        next_taxel = next_taxel + 1;
                        if (next_taxel == TAXELS) begin
                            next_taxel = 0;
                            frame_open = 1'b0;
                        end
                        if (stalls != 0) source_gap = gap(random[31:16]);
                    end
                end
                if (declared != 0 && !frame_open && due <= 0) idle_cycles = 0;
`endif
                if (taken + lost == frames) begin
                    play_addr <= CONTROL;
                    play_w_data <= FINISH;
                    play_w_stb <= 1'b1;
                    wait_cycles = 0;
                    mode = FINISHING;
                end
            end

            FINISHING: begin
                wait_cycles = wait_cycles + 1;
                if (wait_cycles > SETTLE && !busy && !o_valid) begin
                    read_index = 0;
                    mode = READ;
                end
            end

            READ: begin  // strobe, one cycle for the register, take
                if (read_index == 3) status_word = bus_r_data;
                if (read_index == 6) fault_word = bus_r_data;
                if (read_index == 9) $fwrite(status_file, "%0d %h %h %h %0d", recording, status_word, fault_word, bus_r_data, armed_at);
                if (read_index > 9 && read_index % 3 == 0) $fwrite(status_file, " %h", bus_r_data);
                if (read_index == 9 + 3 * FLAG_WORDS) begin
                    $fwrite(status_file, "\n");
                    idle_cycles = 0;
                    mode = NEXT;
                end
                play_addr <= read_index < 3 ? STATUS : read_index < 6 ? FAULTS : read_index < 9 ? TOUCHES : TAXEL_FAULTS + read_index / 3 - 3;
                play_r_stb <= read_index % 3 == 0 && read_index < 9 + 3 * FLAG_WORDS;
                read_index = read_index + 1;
            end

            default: ;
        endcase

        // ------------------------------------------------------------ output side
        if (mode != IDLE && mode != OVER) begin
            if (was_stalled && (!o_valid || o_payload !== stalled_payload)) protocol_errors = protocol_errors + 1;
            was_stalled = o_valid && !o_ready;
            stalled_payload = o_payload;
            if (o_valid && !offered) begin
                offered = 1'b1;
                offered_at = cycle;
            end
            if (o_valid && o_ready) begin
                $fwrite(decision_file, "%0d %h %0d %0d\n", recording, o_payload, offered_at, cycle);
                offered = 1'b0;
            end
            if (sum_valid) $fwrite(sum_file, "%0d %h %0d\n", recording, sum, cycle);
            if (fault_valid) $fwrite(fault_file, "%0d %h %0d\n", recording, fault, cycle);
            if (feature_valid) $fwrite(feature_file, "%0d %h %0d\n", recording, feature, cycle);
            if (state_valid) $fwrite(state_file, "%0d %h %0d\n", recording, state, cycle);
            if (logit_valid) $fwrite(logit_file, "%0d %h %0d\n", recording, logit, cycle);
            if (step_valid) $fwrite(step_file, "%0d %h %0d\n", recording, step_cycles, cycle);
            if ((^{i_ready, o_valid, busy, sum_valid, fault_valid, feature_valid, state_valid, logit_valid, step_valid}) === 1'bx) unknown = unknown + 1;
            if (stalls == 0) o_ready <= 1'b1;
            else if (sink_gap > 0) begin
                sink_gap = sink_gap - 1;
                o_ready <= sink_gap == 0;
            end else begin
                sink_gap = gap(random[15:0]);
                o_ready <= sink_gap == 0;
            end
            if (cycle % 16384 == 0) $fflush(frame_file);  // progress is read off its size
            if (idle_cycles > watchdog) begin
                stuck = 1;
                simulated = cycle;
                mode = OVER;
            end
        end

        // ------------------------------------------------------------ waves of a neighbourhood
        if (waves_to != 0 && mode > NEXT && mode != OVER) begin
            if (dumping == 0 && cycle - armed_at >= waves_from) begin
                dumping = 1;
                $dumpfile("waves.vcd");
                $dumpvars(0, harness);
            end
            if (dumping == 1 && cycle - armed_at >= waves_to) begin
                dumping = 2;
                $dumpoff;
                simulated = cycle;
                mode = OVER;
            end
        end

        if (mode == OVER && !done) begin
            $fwrite(summary_file, "cycles %0d\nframes %0d\nrecordings %0d\ninput_stalls %0d\noverruns %0d\nframe_cycles_max %0d\n",
                    simulated, frames_total, played, input_stalls, overruns, frame_cycles_max);
            $fwrite(summary_file, "protocol_errors %0d\nunknown %0d\nstuck %0d\nstuck_recording %0d\nstuck_frame %0d\narmed_at %0d\n",
                    protocol_errors, unknown, stuck, recording, taken + 1, armed_at);
`ifdef CONVERTER
            $fwrite(summary_file, "conversion_faults %0d\nviolations %0d\n", conversion_faults, violations);
`endif
`ifdef CLOCKED
            $fwrite(summary_file, "played_cycles %0d\nclocked_cycles %0d\n", played_cycles, clocked_cycles);
`endif
            $fclose(scan_file);
            $fclose(summary_file);
            $fclose(sum_file);
            $fclose(fault_file);
            $fclose(feature_file);
            $fclose(state_file);
            $fclose(logit_file);
            $fclose(step_file);
            $fclose(decision_file);
            $fclose(frame_file);
            $fclose(status_file);
            done <= 1'b1;
        end
    end
endmodule
