// Plays what was done to one accelerator (ops.txt, as tests/support/replayed.py writes it) to another one, and says what differs.
//
// Lines of ops.txt, hex: W address word (bus write); R address word (bus read, and what must come); S payload (a beat of a frame, until it is
// taken); I cycles (nothing); T 0 (until it is no longer busy). decisions.txt has the words
// that must be decided.
`timescale 1ns / 1ps

module replay;
    reg clk = 1'b0, rst = 1'b1, i_valid = 1'b0, w_stb = 1'b0, r_stb = 1'b0, o_ready = 1'b0;
    reg [17:0] i_payload = 18'd0;
    reg [7:0] addr = 8'd0;
    reg [15:0] w_data = 16'd0;
    wire [15:0] r_data;
    wire [`DECISION-1:0] o_payload;
    wire i_ready, o_valid, busy;
    always #5 clk = ~clk;
    accelerator dut (
        .clk(clk), .rst(rst), .i__payload(i_payload[`PAYLOAD-1:0]), .i__valid(i_valid), .i__ready(i_ready), .o__payload(o_payload),
        .o__valid(o_valid), .o__ready(o_ready), .bus__addr(addr), .bus__w_data(w_data), .bus__w_stb(w_stb), .bus__r_stb(r_stb),
        .bus__r_data(r_data), .busy(busy)
    );
    integer ops, words, wrong = 0, decisions = 0, reads = 0, waited;
    reg [7:0] op;
    reg [31:0] a, b, word;
    initial begin
        ops = $fopen("ops.txt", "r");
        words = $fopen("decisions.txt", "r");
        repeat (5) @(negedge clk);
        rst = 1'b0;
        op = "I";
        while (op != "E") begin
            if ($fscanf(ops, "%c %h %h\n", op, a, b) != 3) op = "E";
            case (op)
                "W": begin
                    addr = a; w_data = b; w_stb = 1'b1;
                    @(negedge clk) w_stb = 1'b0;
                end
                "R": begin
                    addr = a; r_stb = 1'b1;
                    @(negedge clk) r_stb = 1'b0;
                    reads = reads + 1;
                    if (r_data !== b[15:0]) begin
                        wrong = wrong + 1;
                        $display("read %h: %h, not %h", a, r_data, b);
                    end
                end
                "S": begin
                    while ($urandom % 8 == 0) @(negedge clk);
                    i_payload = a; i_valid = 1'b1; #1;
                    while (!i_ready) @(negedge clk);
                    @(negedge clk) i_valid = 1'b0;
                end
                "I": repeat (a) @(negedge clk);
                "T": begin
                    repeat (4) @(negedge clk);
                    while (busy || o_valid) @(negedge clk);
                end
            endcase
        end
        $display("decisions %0d reads %0d wrong %0d", decisions, reads, wrong);
        $finish;
    end
    always @(negedge clk) o_ready = $urandom % 4 == 0;  // both sides stall
    always @(posedge clk) if (!rst && o_valid && o_ready) begin
        decisions = decisions + 1;
        if ($fscanf(words, "%h\n", word) != 1 || word[`DECISION-1:0] !== o_payload) begin
            wrong = wrong + 1;
            $display("decision %h, not %h", o_payload, word);
        end
    end
endmodule
