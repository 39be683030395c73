// How the pins of a design with a converter and those of the converter's model are wired, by the macro CONVERTER_<name>.
// SLEEPS: the design puts the converter to sleep. PORT_BUSY is high while the converter's port moves; it rests after a frame's last channel.
`ifdef CONVERTER_ddc232
`define PIN_WIRES wire ddc_clk, reset_n, conv, din_cfg, clk_cfg, dclk, dvalid_n, dout;
`define DESIGN_PINS .pins__clk(ddc_clk), .pins__reset_n(reset_n), .pins__conv(conv), .pins__din_cfg(din_cfg), .pins__clk_cfg(clk_cfg), \
    .pins__dclk(dclk), .pins__dvalid_n(dvalid_n), .pins__dout(dout)
`define MODEL_PINS .clk(ddc_clk), .reset_n(reset_n), .conv(conv), .din_cfg(din_cfg), .clk_cfg(clk_cfg), .dclk(dclk), .dvalid_n(dvalid_n), \
    .dout(dout)
`define PORT_BUSY dclk
`elsif CONVERTER_mpr121
`define PIN_WIRES wire scl_low, sda_low, sda;
`define DESIGN_PINS .pins__scl_low(scl_low), .pins__sda_low(sda_low), .pins__sda(sda)
`define MODEL_PINS .scl_low(scl_low), .sda_low(sda_low), .sda(sda)
`define PORT_BUSY (scl_low | sda_low)
`elsif CONVERTER_matrix
`ifdef SLEEPS
`define PIN_WIRES wire [31:0] row, column; wire off, cs_n, sclk, miso;
`define OFF_PIN , .pins__off(off)
`else
`define PIN_WIRES wire [31:0] row, column; wire off = 1'b0; wire cs_n, sclk, miso;
`define OFF_PIN
`endif
`define DESIGN_PINS .pins__row(row), .pins__column(column), .pins__cs_n(cs_n), .pins__sclk(sclk), .pins__miso(miso) `OFF_PIN
`define MODEL_PINS .row(row), .column(column), .off(off), .cs_n(cs_n), .sclk(sclk), .miso(miso)
`define PORT_BUSY (!cs_n)
`else
`define PIN_WIRES wire [`SELECTS-1:0] cs_n; wire [`LINES-1:0] miso; wire sclk, mosi;
`define DESIGN_PINS .pins__cs_n(cs_n), .pins__sclk(sclk), .pins__mosi(mosi), .pins__miso(miso)
`define MODEL_PINS .cs_n(cs_n), .sclk(sclk), .mosi(mosi), .miso(miso)
`define PORT_BUSY (!(&cs_n))
`endif
