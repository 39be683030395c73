// The main program of a Verilated harness under cocotb. It makes the clock, a port of the harness, and calls the bench
// only when there is something for it to do: while the harness plays by itself (its port `alone`) half of all time
// would go into asking.
#include <algorithm>
#include <cstdint>

#include "Vtop.h"
#include "verilated.h"
#include "verilated_vpi.h"

extern "C" void vlog_startup_routines_bootstrap(void);

static const uint64_t HALF = 5000;  // of a clock cycle, in picoseconds

static void call_value_callbacks() {
    while (VerilatedVpi::callValueCbs()) {}
}

int main(int argc, char** argv) {
    VerilatedContext& context = *Verilated::defaultContextp();
    context.commandArgs(argc, argv);
    context.traceEverOn(VM_TRACE);
    context.fatalOnVpiError(false);
    Vtop top{&context, ""};
    vlog_startup_routines_bootstrap();
    Verilated::addExitCb([](void*) { VerilatedVpi::callCbs(cbEndOfSimulation); }, nullptr);
    VerilatedVpi::callCbs(cbStartOfSimulation);
    call_value_callbacks();
    uint64_t edge = HALF;
    while (true) {
        do {  // all that happens at this moment, the bench's answers to it included
            do {
                top.eval_step();
                VerilatedVpi::clearEvalNeeded();
                VerilatedVpi::doInertialPuts();
                call_value_callbacks();
            } while (VerilatedVpi::evalNeeded());
            VerilatedVpi::callCbs(cbReadWriteSynch);
            VerilatedVpi::doInertialPuts();
            call_value_callbacks();
        } while (VerilatedVpi::evalNeeded());
        top.eval_end_step();
        VerilatedVpi::callCbs(cbReadOnlySynch);
        for (; top.alone && !top.eventsPending() && !context.gotFinish(); edge += HALF) {
            context.time(edge);
            top.clk = !top.clk;
            top.eval_step();
            top.eval_end_step();
        }
        if (context.gotFinish()) break;
        uint64_t next = std::min(edge, VerilatedVpi::cbNextDeadline());
        if (top.eventsPending()) next = std::min(next, top.nextTimeSlot());
        context.time(next);
        VerilatedVpi::callCbs(cbNextSimTime);
        call_value_callbacks();
        VerilatedVpi::callTimedCbs();
        call_value_callbacks();
        if (next == edge) {
            top.clk = !top.clk;
            edge += HALF;
        }
    }
    top.final();
    VerilatedVpi::callCbs(cbEndOfSimulation);
    return context.errorCount() > 0;
}
