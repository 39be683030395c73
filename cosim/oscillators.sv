// The own oscillators of an iCE40UP5K in place of the vendor's black boxes. Periods and the fast one's start-up are the board's
// (cosim/standalone.sv), in picoseconds of the simulation. Output before the fast one is stable is a violation, and far too fast.
`timescale 1ps/1ps
module SB_LFOSC (input wire CLKLFPU, input wire CLKLFEN, output wire CLKLF);
    reg level = 1'b0;
    always #(standalone.slow_half) level = !level;
    assign CLKLF = level && CLKLFPU && CLKLFEN;
endmodule

module SB_HFOSC #(parameter TRIM_EN = "0b0", CLKHF_DIV = "0b00") (
    input wire TRIM0, TRIM1, TRIM2, TRIM3, TRIM4, TRIM5, TRIM6, TRIM7, TRIM8, TRIM9,
    input wire CLKHFPU, input wire CLKHFEN, output wire CLKHF
);
    reg level = 1'b0, unstable = 1'b0;
    time powered = 0;
    integer violations = 0;
    wire on = CLKHFPU && CLKHFEN;
    always @(posedge CLKHFPU) powered = $time;
    always @(posedge CLKHFEN) begin
        unstable = !CLKHFPU || $time - powered < standalone.start_up;
        if (unstable) violations = violations + 1;
    end
    always if (on) begin
        level = 1'b1;
        #(unstable ? standalone.fast_half / 8 : standalone.fast_half);
        level = 1'b0;
        #(unstable ? standalone.fast_half / 8 : standalone.fast_half);
    end else @(on);
    assign CLKHF = level && on;
endmodule
