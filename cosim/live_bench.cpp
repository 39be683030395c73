// Plays what comes on standard input into `accelerator` and says on standard output what came out of it: lock step with another program.
//
// In:  32-bit words, low byte first. First taxels, sample bits, limit (cycles). Then commands:
//      1 address data   a bus write
//      2 n samples      n frames, taxel 0 first; after each the chain runs until nothing is under way
//      3                runs until nothing is under way
//      4 address        a bus read
// Out: pairs of 32-bit words, tag and value: 1 sum, 2 fault, 3 feature, 4 state, 5 logit, 6 decision, 7 cycles of a step: as they come.
//      8 a frame is through (value: cycles it took), 9 a register's value, 10 the chain stands still (value: 1 a beat waits, 2 busy),
//      11 a value of a map: a design for images (IMAGES) has these in place of 1 to 4.
// A write answers nothing, command 3 tag 8. (Verilator writes two underscores in a row as ___05F.)
#include <cstdint>
#include <cstdio>
#include <vector>

#include "Vtop.h"
#include "verilated.h"

static VerilatedContext context;
static Vtop dut{&context, "TOP"};
static std::vector<uint32_t> out;
static bool beat_taken = false;

static void say(uint32_t tag, uint32_t value) {
    out.push_back(tag);
    out.push_back(value);
}

static void tick() {
    dut.o___05Fready = 1;
    dut.clk = 0;
    dut.eval();
    beat_taken = dut.i___05Fvalid && dut.i___05Fready;
#ifdef IMAGES
    if (dut.probe___05Fmap___05Fvalid) say(11, dut.probe___05Fmap___05Fvalue);
#else
    if (dut.probe___05Fsum___05Fvalid) say(1, dut.probe___05Fsum___05Fvalue);
    if (dut.probe___05Ffault___05Fvalid) say(2, dut.probe___05Ffault___05Fvalue);
    if (dut.probe___05Ffeature___05Fvalid) say(3, dut.probe___05Ffeature___05Fvalue);
    if (dut.probe___05Fstate___05Fvalid) say(4, dut.probe___05Fstate___05Fvalue);
#endif
    if (dut.probe___05Flogit___05Fvalid) say(5, dut.probe___05Flogit___05Fvalue);
    if (dut.o___05Fvalid) say(6, dut.o___05Fpayload);
    if (dut.probe___05Fstep___05Fvalid) say(7, dut.probe___05Fstep___05Fvalue);
    dut.clk = 1;
    dut.eval();
    dut.bus___05Fw_stb = 0;
    dut.bus___05Fr_stb = 0;
}

static bool next(uint32_t& word) { return fread(&word, 4, 1, stdin) == 1; }

static void flush() {
    fwrite(out.data(), 4, out.size(), stdout);
    fflush(stdout);
    out.clear();
}

// Until nothing is under way; a command needs a few cycles before busy shows it. The cycles it took.
static uint32_t settle(uint32_t limit) {
    uint32_t cycles = 0;
    for (; cycles < 4; cycles++) tick();
    for (; dut.busy && cycles < limit; cycles++) tick();
    if (dut.busy) say(10, 2);
    return cycles;
}

int main() {
    uint32_t taxels, bits, limit, command, address, data;
    if (!next(taxels) || !next(bits) || !next(limit)) return 2;
    dut.rst = 1;
    for (int k = 0; k < 4; k++) tick();
    dut.rst = 0;
    while (next(command)) {
        if (command == 1) {
            if (!next(address) || !next(data)) return 2;
            dut.bus___05Faddr = address;
            dut.bus___05Fw_data = data;
            dut.bus___05Fw_stb = 1;
            tick();
        } else if (command == 2) {
            uint32_t frames;
            if (!next(frames)) return 2;
            for (uint32_t frame = 0; frame < frames; frame++) {
                uint32_t cycles = 0;
                for (uint32_t taxel = 0; taxel < taxels; taxel++) {
                    if (!next(data)) return 2;
                    dut.i___05Fpayload = data | (uint32_t)(taxel == 0) << bits | (uint32_t)(taxel == taxels - 1) << (bits + 1);
                    dut.i___05Fvalid = 1;
                    uint32_t waited = 0;
                    do {
                        tick();
                        cycles++;
                    } while (!beat_taken && ++waited < limit);
                    if (!beat_taken) say(10, 1);
                }
                dut.i___05Fvalid = 0;
                say(8, cycles + settle(limit));
            }
            flush();
        } else if (command == 3) {
            say(8, settle(limit));
            flush();
        } else if (command == 4) {
            if (!next(address)) return 2;
            dut.bus___05Faddr = address;
            dut.bus___05Fr_stb = 1;
            tick();
            say(9, dut.bus___05Fr_data);
            flush();
        } else {
            return 2;
        }
    }
    dut.final();
    return 0;
}
