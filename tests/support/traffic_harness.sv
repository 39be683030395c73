// Does to `accelerator` what a script says, cycle by cycle if need be: any bus traffic, frames of any shape, resets in the middle of
// anything. Writes down every word of every stage, and every X on an output. For Icarus (four states); no cocotb.
//
// script.txt, three decimal numbers a line: operation, a, b
//      0 a b   one bus write of word b to address a            5 a -   mark: writes "mark a"; ends skipping
//      1 a -   one bus read of address a: "read value"         6 a -   stalls of the sink with seed a from here on, 0: none
//      2 a -   one beat with payload a, held until taken       7 a b   reset for b cycles, a cycles from now; it withdraws what is offered
//      3 a -   a cycles of nothing                                     and skips to the next mark
//      4 - -   wait until idle (busy and o_valid low) for 8 cycles
// A wait of more than LIMIT cycles writes "stuck" and skips to the next mark.
`timescale 1ns / 1ps

module traffic_harness #(
    parameter integer SAMPLE_BITS = 16,
    parameter integer LIMIT = 20000
) ();
    reg clk = 1'b0, rst = 1'b1, i_valid = 1'b0, o_ready = 1'b1, w_stb = 1'b0, r_stb = 1'b0;
    always #5 clk = ~clk;
    reg [SAMPLE_BITS+1:0] i_payload = 0;
    reg [7:0] addr = 8'd0;
    reg [15:0] w_data = 16'd0;
    wire i_ready, o_valid, busy, sum_valid, feature_valid, state_valid, logit_valid, step_valid;
    wire [30:0] o_payload;
    wire [15:0] r_data;
    wire [31:0] sum, feature, state, logit, step_cycles;

    accelerator dut (
        .clk(clk), .rst(rst), .i__payload(i_payload), .i__valid(i_valid), .i__ready(i_ready),
        .o__payload(o_payload), .o__valid(o_valid), .o__ready(o_ready),
        .bus__addr(addr), .bus__w_data(w_data), .bus__w_stb(w_stb), .bus__r_stb(r_stb), .bus__r_data(r_data), .busy(busy),
        .probe__sum__valid(sum_valid), .probe__sum__value(sum), .probe__feature__valid(feature_valid), .probe__feature__value(feature),
        .probe__state__valid(state_valid), .probe__state__value(state), .probe__logit__valid(logit_valid), .probe__logit__value(logit),
        .probe__step__valid(step_valid), .probe__step__value(step_cycles)
    );

    integer script, said, got, op, a, b, waited, idle, alarm, reset_left, sink, unknown;
    reg skipping, stalled;
    reg [30:0] held;

    // what is taken or seen at a rising edge
    always @(posedge clk) if (!rst) begin
        if (sum_valid) $fwrite(said, "sum %h\n", sum);
        if (feature_valid) $fwrite(said, "feature %h\n", feature);
        if (state_valid) $fwrite(said, "state %h\n", state);
        if (logit_valid) $fwrite(said, "logit %h\n", logit);
        if (o_valid && o_ready) $fwrite(said, "decision %h\n", o_payload);
        // a decision may be withdrawn by a command (arm) alone
        if (stalled && !w_stb && (!o_valid || o_payload !== held)) $fwrite(said, "unstable %h\n", o_payload);
        stalled = o_valid && !o_ready && !(w_stb && addr == 8'd2);
        held = o_payload;
        if ((^{i_ready, o_valid, busy, sum_valid, feature_valid, state_valid, logit_valid, step_valid}) === 1'bx) begin
            if (unknown < 20) $fwrite(said, "unknown %b\n", {i_ready, o_valid, busy, sum_valid, feature_valid, state_valid, logit_valid, step_valid});
            unknown = unknown + 1;
        end
    end else stalled = 1'b0;

    task tick;  // to the next falling edge, where everything is driven
        begin
            if (alarm > 0) begin
                alarm = alarm - 1;
                if (alarm == 0) begin
                    rst = 1'b1;
                    i_valid = 1'b0;
                    w_stb = 1'b0;
                    r_stb = 1'b0;
                    skipping = 1'b1;
                end
            end else if (rst && reset_left > 0) begin
                reset_left = reset_left - 1;
                if (reset_left == 0) rst = 1'b0;
            end
            @(negedge clk);
            if (sink == 0) o_ready = 1'b1;
            else begin
                sink = sink ^ (sink << 13);
                sink = sink ^ (sink >>> 17);
                sink = sink ^ (sink << 5);
                if (sink == 0) sink = 1;
                o_ready = sink[1:0] == 2'd0;
            end
        end
    endtask

    initial begin
        script = $fopen("script.txt", "r");
        said = $fopen("said.txt", "w");
        alarm = 0;
        reset_left = 0;
        sink = 0;
        unknown = 0;
        skipping = 1'b0;
        stalled = 1'b0;
        repeat (4) @(negedge clk);
        rst = 1'b0;
        got = $fscanf(script, "%d %d %d", op, a, b);
        while (got == 3) begin
            if (op == 5) begin
                while (rst) tick;
                alarm = 0;
                skipping = 1'b0;
                $fwrite(said, "mark %0d\n", a);
            end else if (!skipping) begin
                waited = 0;
                case (op)
                    0: begin
                        addr = a;
                        w_data = b;
                        w_stb = 1'b1;
                        tick;
                        w_stb = 1'b0;
                    end
                    1: begin
                        addr = a;
                        r_stb = 1'b1;
                        tick;
                        r_stb = 1'b0;
                        if (!skipping) $fwrite(said, "read %h\n", r_data);
                    end
                    2: begin
                        i_payload = a;
                        i_valid = 1'b1;
                        #1;
                        while (i_ready !== 1'b1 && waited < LIMIT && !skipping) begin
                            tick;
                            #1;
                            waited = waited + 1;
                        end
                        if (!skipping) tick;
                        i_valid = 1'b0;
                    end
                    3: while (waited < a && !skipping) begin
                        tick;
                        waited = waited + 1;
                    end
                    4: begin
                        idle = 0;
                        while (idle < 8 && waited < LIMIT && !skipping) begin
                            tick;
                            idle = (busy === 1'b0 && o_valid === 1'b0) ? idle + 1 : 0;
                            waited = waited + 1;
                        end
                    end
                    6: sink = a;
                    7: begin
                        alarm = a;
                        reset_left = b;
                    end
                    default: ;
                endcase
                if (waited >= LIMIT) begin
                    $fwrite(said, "stuck %0d\n", op);
                    i_valid = 1'b0;
                    skipping = 1'b1;
                end
            end
            got = $fscanf(script, "%d %d %d", op, a, b);
        end
        $fwrite(said, "unknown_cycles %0d\n", unknown);
        $fclose(said);
        $finish;
    end
endmodule
