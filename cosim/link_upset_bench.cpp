// Plays one line waveform into the serial link once for every upset of a list, each time from power-on, and writes the other line down.
//
// In:  line.bin       a byte a cycle: bit 0 the receiving line, bit 1 a decision is offered from here on until it is taken
//      upsets.txt     an upset a line: register bit cycle (numbers of rtl/fpga/upsets.py)
// Out: results.txt    an upset a line: the sending line, a character (0, 1) a cycle
// (Verilator writes two underscores in a row as ___05F.)
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "Vtop.h"
#include "verilated.h"

static const unsigned PAYLOAD = 0x12345678, REGISTER = 0x2BCD;

int main() {
    FILE* file = fopen("line.bin", "rb");
    FILE* list = fopen("upsets.txt", "r");
    FILE* out = fopen("results.txt", "w");
    if (!file || !list || !out) return 2;
    std::vector<unsigned char> line;
    for (int c; (c = fgetc(file)) != EOF;) line.push_back(c);
    unsigned reg, bit;
    long cycle;
    while (fscanf(list, "%u %u %ld", &reg, &bit, &cycle) == 3) {
        VerilatedContext context;
        auto dut = std::make_unique<Vtop>(&context, "TOP");
        std::string sent;
        bool offers = false;
        for (long now = -4; now < (long)line.size(); now++) {
            dut->rst = now < 0;
            dut->rx = now < 0 || (line[now] & 1);
            offers = offers || (now >= 0 && line[now] & 2);
            dut->decision___05Fvalid = offers;
            dut->decision___05Fpayload = PAYLOAD;
            dut->frame___05Fready = 1;
            dut->bus___05Fr_data = REGISTER;
            dut->upset_register = now == cycle ? reg : 0;
            dut->upset_bit = bit;
            dut->clk = 0;
            dut->eval();
            if (now >= 0) sent += dut->tx ? '1' : '0';
            if (offers && dut->decision___05Fready) offers = false;
            dut->clk = 1;
            dut->eval();
        }
        fprintf(out, "%s\n", sent.c_str());
        dut->final();
    }
    fclose(out);
    return 0;
}
