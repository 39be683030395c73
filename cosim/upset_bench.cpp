// Plays the same recordings into `accelerator` once for every upset of a list, each time from power-on, and writes down what came out.
//
// In:  stimulus.bin   32-bit words: taxels, sample bits, register addresses (CONTROL, FAULTS, STATUS, TOUCHES), commands (ARM, FINISH),
//                     limit (cycles), stop (1: an upset's run ends with the first global decision after it), boot writes, {address, data} each, recordings, then of each: frames, samples
//      upsets.txt     an upset a line: register memory word bit recording cycle (cycles since that recording's arm; numbers of rtl/fpga/upsets.py).
//                     In place of a register: 65535 a reset, 65534 a new arm, in that cycle; the next recording follows. 65533: it follows
//                     without arm.
// Out: results.txt    an upset a line, JSON: recordings [{decisions [[payload, FAULTS when it was offered, cycle]], faults, status, touches,
//                     hang, cycles, cleared [[frames taken, taxels taken of the next one, cycle]: where the watchdog acted]}]
// hang: 1 an input beat waited for more than `limit` cycles, 2 busy for more than `limit` cycles without a decision after FINISH.
// (Verilator writes two underscores in a row as ___05F.)
#include <cstdint>
#include <cstdio>
#include <memory>
#include <vector>

#include "Vtop.h"
#include "verilated.h"

struct Upset {
    unsigned reg, memory, word, bit, recording;
    long cycle;
};

struct Stimulus {
    std::vector<uint32_t> words;
    size_t at = 0;
    uint32_t next() { return words.at(at++); }
};

struct Recording {
    uint32_t frames;
    std::vector<uint16_t> samples;
};

static const unsigned RESET = 65535, ARM_AGAIN = 65534, NO_ARM = 65533;
static unsigned taxels, sample_bits, control_at, faults_at, status_at, touches_at, arm, finish, limit, stop;
static std::vector<uint32_t> boot;
static std::vector<Recording> recordings;

class Run {
  public:
    explicit Run(const Upset& upset) : upset_(upset) {}

    void play(FILE* out) {
        for (int k = 0; k < 4; k++) tick();
        in_reset_ = false;
        for (uint32_t word : boot) write(word >> 16, word & 0xFFFF);
        fprintf(out, "{\"recordings\": [");
        for (current_ = 0; current_ < recordings.size() && !stopped_; current_++) {
            if (current_) fprintf(out, ", ");
            recording(recordings[current_], out);
        }
        fprintf(out, "]}\n");
        dut_.final();
    }

  private:
    VerilatedContext context_;
    Vtop dut_{&context_, "TOP"};
    Upset upset_;
    size_t current_ = 0;
    long since_arm_ = -1;
    unsigned frame_ = 0, taxel_ = 0;
    bool offered_ = false, taken_ = false, beat_taken_ = false, stopped_ = false, abandoned_ = false, in_reset_ = true;
    struct Event {
        unsigned first, second;
        long cycle;
    };
    std::vector<Event> decisions_, cleared_;

    // One clock cycle with the inputs as they are; FAULTS is read in every cycle that writes nothing.
    void tick() {
        bool hit = since_arm_ == upset_.cycle && current_ == upset_.recording;
        bool leaves = hit && upset_.reg >= NO_ARM;
        abandoned_ = abandoned_ || leaves;
        dut_.rst = in_reset_ || (leaves && upset_.reg == RESET);
        dut_.upset_register = hit && !leaves ? upset_.reg : 0;
        dut_.upset_memory = hit ? upset_.memory : 0;
        dut_.upset_word = upset_.word;
        dut_.upset_bit = upset_.bit;
        dut_.o___05Fready = 1;
        if (!dut_.bus___05Fw_stb && !dut_.bus___05Fr_stb) {
            dut_.bus___05Faddr = faults_at;
            dut_.bus___05Fr_stb = 1;
        }
        dut_.clk = 0;
        dut_.eval();
        taken_ = dut_.o___05Fvalid;
        stopped_ = stopped_ || (stop && dut_.o___05Fvalid && dut_.o___05Fpayload >> 29 & 1 && current_ == upset_.recording &&
                                upset_.cycle >= 0 && since_arm_ > upset_.cycle);
        if (dut_.o___05Fvalid) decisions_.push_back({dut_.o___05Fpayload, dut_.bus___05Fr_data, since_arm_});
        beat_taken_ = dut_.i___05Fvalid && dut_.i___05Fready;
        if (dut_.hung && since_arm_ >= 0) cleared_.push_back({frame_, taxel_ + beat_taken_, since_arm_});
        dut_.clk = 1;
        dut_.eval();
        dut_.bus___05Fw_stb = 0;
        dut_.bus___05Fr_stb = 0;
        if (since_arm_ >= 0) since_arm_++;
    }

    void write(unsigned address, unsigned data) {
        dut_.bus___05Faddr = address;
        dut_.bus___05Fw_data = data;
        dut_.bus___05Fw_stb = 1;
        tick();
    }

    unsigned read(unsigned address) {
        dut_.bus___05Faddr = address;
        dut_.bus___05Fr_stb = 1;
        tick();
        return dut_.bus___05Fr_data;
    }

    static void list(const std::vector<Event>& events, FILE* out) {
        fprintf(out, "[");
        for (size_t k = 0; k < events.size() && k < 512; k++)
            fprintf(out, "%s[%u, %u, %ld]", k ? ", " : "", events[k].first, events[k].second, events[k].cycle);
        fprintf(out, "]");
    }

    void recording(const Recording& what, FILE* out) {
        decisions_.clear();
        cleared_.clear();
        int hang = 0;
        frame_ = taxel_ = 0;
        since_arm_ = -1;
        bool armed = !(current_ && upset_.reg == NO_ARM);
        if (armed) write(control_at, arm);
        tick();  // the command clears the chain at the end of the cycle after it was written;
        if (armed) decisions_.clear();  // what is offered up to then belongs to the recording before (docs/specification.md, section 7)
        since_arm_ = 0;
        abandoned_ = false;
        for (frame_ = 0; frame_ < what.frames && !hang && !stopped_ && !abandoned_; frame_++) {
            for (taxel_ = 0; taxel_ < taxels && !hang && !abandoned_; taxel_++) {
                uint32_t sample = what.samples[frame_ * taxels + taxel_];
                dut_.i___05Fpayload = sample | (uint32_t)(taxel_ == 0) << sample_bits | (uint32_t)(taxel_ == taxels - 1) << (sample_bits + 1);
                dut_.i___05Fvalid = 1;
                unsigned waited = 0;
                do {
                    tick();
                    if (!beat_taken_ && ++waited > limit) hang = 1;
                } while (!beat_taken_ && !hang && !abandoned_);
            }
        }
        dut_.i___05Fvalid = 0;
        if (!abandoned_) write(control_at, finish);
        for (int k = 0; k < 4 && !abandoned_; k++) tick();
        unsigned waited = 0, decisions = 0;
        while (dut_.busy && !hang && !abandoned_) {
            tick();
            waited = taken_ ? 0 : waited + 1;
            decisions += taken_;
            if (waited > limit || decisions > 4096) hang = 2;
        }
        unsigned faults = read(faults_at), status = read(status_at), touches = read(touches_at);
        fprintf(out, "{\"hang\": %d, \"cycles\": %ld, \"faults\": %u, \"status\": %u, \"touches\": %u, \"decisions\": ", hang, since_arm_,
                faults, status, touches);
        list(decisions_, out);
        fprintf(out, ", \"cleared\": ");
        list(cleared_, out);
        fprintf(out, "}");
    }
};

int main() {
    Stimulus in;
    FILE* file = fopen("stimulus.bin", "rb");
    if (!file) return 2;
    uint32_t word;
    while (fread(&word, 4, 1, file) == 1) in.words.push_back(word);
    fclose(file);
    taxels = in.next(), sample_bits = in.next(), control_at = in.next(), faults_at = in.next(), status_at = in.next();
    touches_at = in.next(), arm = in.next(), finish = in.next(), limit = in.next(), stop = in.next();
    boot.resize(in.next());
    for (auto& entry : boot) entry = in.next();
    recordings.resize(in.next());
    for (auto& entry : recordings) {
        entry.frames = in.next();
        entry.samples.resize(size_t(entry.frames) * taxels);
        for (auto& sample : entry.samples) sample = in.next();
    }
    FILE* list = fopen("upsets.txt", "r");
    FILE* out = fopen("results.txt", "w");
    if (!list || !out) return 2;
    Upset upset;
    while (fscanf(list, "%u %u %u %u %u %ld", &upset.reg, &upset.memory, &upset.word, &upset.bit, &upset.recording, &upset.cycle) == 6) {
        std::make_unique<Run>(upset)->play(out);
        fflush(out);
    }
    fclose(out);
    fclose(list);
    return 0;
}
