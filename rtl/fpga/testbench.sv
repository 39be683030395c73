// Self-checking testbench of one recording: loads the weights over the bus, plays the frames, compares every stage with the golden model.
// Needs no Python. From this folder, either of
//     $ iverilog -g2012 -s testbench -o testbench.vvp testbench.sv accelerator.sv && vvp -n testbench.vvp
//     $ verilator --binary --timing -Wno-fatal -Wno-lint --top-module testbench testbench.sv accelerator.sv && obj_dir/Vtestbench
// ends with the line PASSED and status 0, or with the first differences, FAILED and another status.
`timescale 1ns / 1ps
@DEFINE@
module testbench;
    localparam TAXELS = @TAXELS@, SAMPLE_BITS = @SAMPLE_BITS@, FRAMES = @FRAMES@, WRITES = @WRITES@;
    localparam SUMS = @SUMS@, FAULTS = @FAULTS@, FEATURES = @FEATURES@, STATES = @STATES@, LOGITS = @LOGITS@, DECISIONS = @DECISIONS@;

    reg clk = 1'b0, rst = 1'b1;
    always #5 clk = ~clk;

    reg i_valid = 1'b0;
    reg [SAMPLE_BITS+1:0] i_payload = 0;
    reg [7:0] addr = 8'd0;
    reg [15:0] w_data = 16'd0;
    reg w_stb = 1'b0;
    wire i_ready, o_valid, busy, sum_valid, fault_valid, feature_valid, state_valid, logit_valid, step_valid;
    wire [31:0] o_payload;
    wire [15:0] r_data;
    wire [31:0] sum, fault, feature, state, logit, step_cycles;

    accelerator dut (
        .clk(clk), .rst(rst), .i__payload(i_payload), .i__valid(i_valid), .i__ready(i_ready),
        .o__payload(o_payload), .o__valid(o_valid), .o__ready(1'b1),
        .bus__addr(addr), .bus__w_data(w_data), .bus__w_stb(w_stb), .bus__r_stb(1'b0), .bus__r_data(r_data), .busy(busy),
`ifdef IMAGES  // values of maps in place of the recurrent states, and nothing in front of them
        .probe__map__valid(state_valid), .probe__map__value(state),
`else
        .probe__sum__valid(sum_valid), .probe__sum__value(sum), .probe__fault__valid(fault_valid), .probe__fault__value(fault),
        .probe__feature__valid(feature_valid), .probe__feature__value(feature), .probe__state__valid(state_valid), .probe__state__value(state),
`endif
        .probe__logit__valid(logit_valid), .probe__logit__value(logit), .probe__step__valid(step_valid), .probe__step__value(step_cycles)
    );
`ifdef IMAGES
    assign {sum_valid, fault_valid, feature_valid, sum, fault, feature} = 99'd0;
`endif

    // The files under vectors/ close with a word 0, so that a stage without values still fills a memory.
    reg [15:0] samples [0:FRAMES*TAXELS];
    reg [23:0] writes [0:WRITES-1];
    reg [31:0] sums [0:SUMS], faults [0:FAULTS], features [0:FEATURES], states [0:STATES], logits [0:LOGITS];
    reg [31:0] decisions [0:DECISIONS];
    integer n, taxel, errors, idle, sums_seen, faults_seen, features_seen, states_seen, logits_seen, decisions_seen;

    task differ(input [8*8-1:0] stage, input integer index, input [31:0] expected, input [31:0] got);
        begin
            errors = errors + 1;
            if (errors <= 20) $display("stage %0s, index %0d: expected %h, got %h", stage, index, expected, got);
        end
    endtask

    always @(posedge clk) if (!rst) begin
        if (sum_valid) begin
            if (sums_seen >= SUMS || sum !== sums[sums_seen]) differ("sum", sums_seen, sums[sums_seen < SUMS ? sums_seen : SUMS], sum);
            sums_seen = sums_seen + 1;
        end
        if (fault_valid) begin
            if (faults_seen >= FAULTS || fault !== faults[faults_seen])
                differ("fault", faults_seen, faults[faults_seen < FAULTS ? faults_seen : FAULTS], fault);
            faults_seen = faults_seen + 1;
        end
        if (feature_valid) begin
            if (features_seen >= FEATURES || feature !== features[features_seen])
                differ("feature", features_seen, features[features_seen < FEATURES ? features_seen : FEATURES], feature);
            features_seen = features_seen + 1;
        end
        if (state_valid) begin
            if (states_seen >= STATES || state !== states[states_seen])
                differ("state", states_seen, states[states_seen < STATES ? states_seen : STATES], state);
            states_seen = states_seen + 1;
        end
        if (logit_valid) begin
            if (logits_seen >= LOGITS || logit !== logits[logits_seen])
                differ("logit", logits_seen, logits[logits_seen < LOGITS ? logits_seen : LOGITS], logit);
            logits_seen = logits_seen + 1;
        end
        if (o_valid) begin
            if (decisions_seen >= DECISIONS || o_payload !== decisions[decisions_seen])
                differ("decision", decisions_seen, decisions[decisions_seen < DECISIONS ? decisions_seen : DECISIONS], o_payload);
            decisions_seen = decisions_seen + 1;
        end
    end

    task write(input [7:0] address, input [15:0] word);
        begin
            addr = address;
            w_data = word;
            w_stb = 1'b1;
            @(negedge clk);
            w_stb = 1'b0;
        end
    endtask

    task settle;  // wait until the accelerator is idle
        begin
            idle = 0;
            while (idle < 8) begin
                @(negedge clk);
                idle = (busy === 1'b0 && o_valid === 1'b0) ? idle + 1 : 0;
            end
        end
    endtask

    initial begin
        errors = 0;
        sums_seen = 0;
        faults_seen = 0;
        features_seen = 0;
        states_seen = 0;
        logits_seen = 0;
        decisions_seen = 0;
        $readmemh("vectors/samples.hex", samples);
        $readmemh("load.hex", writes);
        $readmemh("vectors/sum.hex", sums);
        $readmemh("vectors/fault.hex", faults);
        $readmemh("vectors/feature.hex", features);
        $readmemh("vectors/state.hex", states);
        $readmemh("vectors/logit.hex", logits);
        $readmemh("vectors/decision.hex", decisions);
        repeat (4) @(negedge clk);
        rst = 1'b0;
        for (n = 0; n < WRITES; n = n + 1) write(writes[n][23:16], writes[n][15:0]);
        write(8'd@CONTROL@, 16'd@ARM@);
        settle;
        for (n = 0; n < FRAMES; n = n + 1) begin
            for (taxel = 0; taxel < TAXELS; taxel = taxel + 1) begin
                i_payload = {taxel == TAXELS - 1, taxel == 0, samples[n * TAXELS + taxel][SAMPLE_BITS-1:0]};
                i_valid = 1'b1;
                #1;
                while (i_ready !== 1'b1) @(negedge clk) #1;
                @(negedge clk);
            end
        end
        i_valid = 1'b0;
        settle;
        write(8'd@CONTROL@, 16'd@FINISH@);
        settle;
        if (sums_seen != SUMS || faults_seen != FAULTS || features_seen != FEATURES || states_seen != STATES || logits_seen != LOGITS || decisions_seen != DECISIONS) begin
            errors = errors + 1;
            $display("values seen: sum %0d of %0d, fault %0d of %0d, feature %0d of %0d, state %0d of %0d, logit %0d of %0d, decision %0d of %0d",
                     sums_seen, SUMS, faults_seen, FAULTS, features_seen, FEATURES, states_seen, STATES, logits_seen, LOGITS, decisions_seen, DECISIONS);
        end
        if (errors == 0) begin
            $display("PASSED: %0d values in %0d frames", SUMS + FAULTS + FEATURES + STATES + LOGITS + DECISIONS, FRAMES);
            $finish;
        end else begin
            $display("FAILED: %0d differences", errors);
            $fatal(1);
        end
    end

    initial begin
        #@LIMIT_NS@;
        $display("FAILED: out of time after %0d decisions of %0d", decisions_seen, DECISIONS);
        $fatal(1);
    end
endmodule
