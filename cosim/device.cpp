// The cycles of a device (cosim/device.py): bus accesses, frames, waiting, every stage taken down.
#include <cmath>
#include <cstdint>
#include <cstring>
#include <map>
#include <string>
#include <vector>

typedef int64_t i64;

// A port that a device lacks is driven in vain and says 0.

#include "Vtop.h"
#include "verilated.h"
typedef uint64_t u64;
struct Port {
  void* at;
  size_t bytes;
};
struct Model {
  VerilatedContext context;
  Vtop top{&context, "TOP"};
  std::map<std::string, Port> ports{
#include "ports.h"
  };
  ~Model() { top.final(); }
  const Port* port(const char* name) {
    auto found = ports.find(name);
    return found == ports.end() ? nullptr : &found->second;
  }
  void put(const Port* p, u64 value) {
    if (p) memcpy(p->at, &value, p->bytes);
  }
  u64 get(const Port* p) {
    if (!p) return 0;
    if (p->bytes == 1) return *(const uint8_t*)p->at;
    if (p->bytes == 4) return *(const uint32_t*)p->at;
    u64 value = 0;
    memcpy(&value, p->at, p->bytes);
    return value;
  }
  void settle() {
    top.clk = 0;
    top.eval();
  }
  void edge() {
    top.clk = 1;
    top.eval();
  }
};

enum { FRAME_END = -1, HUNG = -2 };
struct Seen {
  int32_t stage;
  uint32_t value, also;
  i64 cycle;
};
struct State {  // as in device.py, as Seen is
  i64 cycle, decisions, stalls, refused, overruns, frame_cycles_max, frame, taxel;
  i64 stop_at;       // from this cycle on nothing waits any more
  i64 poke_at;       // the cycle in which the pokes are put, which are 0 in all others
  i64 watch;         // a register that is read in every cycle without another access, or -1
};
struct Stage {
  const Port *valid, *value;
};
struct Poke {
  const Port* port;
  u64 value;
};
enum { ADDR, W_DATA, W_STB, R_STB, R_DATA, PAYLOAD, VALID, READY, O_VALID, BUSY, HANG, ROLES };
const char* NAMES[] = {"bus__addr", "bus__w_data", "bus__w_stb", "bus__r_stb", "bus__r_data",
    "i__payload", "i__valid", "i__ready", "o__valid", "busy", "hung"};

struct Device {
  State s{};
  Model model;
  const Port* role[ROLES];
  std::vector<Stage> stages;
  std::vector<Poke> pokes;
  std::vector<Seen> events;
  bool taken = false, decided = false;

  void put(int which, u64 value) { model.put(role[which], value); }
  u64 get(int which) { return model.get(role[which]); }
  bool leaves() { return s.cycle >= s.stop_at; }

  void tick() {
    for (const Poke& poke : pokes) model.put(poke.port, s.cycle == s.poke_at ? poke.value : 0);
    bool watching = s.watch >= 0 && !get(W_STB) && !get(R_STB);
    if (watching) put(ADDR, s.watch), put(R_STB, 1);
    model.settle();
    taken = get(VALID) && get(READY);
    decided = get(O_VALID);
    for (size_t k = 0; k < stages.size(); k++)
      if (model.get(stages[k].valid))
        events.push_back({int32_t(k), uint32_t(model.get(stages[k].value)), uint32_t(get(R_DATA)), s.cycle});
    s.decisions += decided;
    if (get(HANG)) events.push_back({HUNG, uint32_t(s.frame), uint32_t(s.taxel + taken), s.cycle});
    model.edge();
    s.cycle++;
    if (watching) put(R_STB, 0);
  }
};

extern "C" {  // whole numbers are i64, as device.py gives and takes them
Device* open_device(i64 seed) {
  Device* d = new Device{};
  d->model.context.randSeed(int(seed));
  for (int k = 0; k < ROLES; k++) d->role[k] = d->model.port(NAMES[k]);
  return d;
}
void close_device(Device* d) { delete d; }
State* state_of(Device* d) { return &d->s; }
void put_port(Device* d, const char* name, u64 value) { d->model.put(d->model.port(name), value); }
u64 get_port(Device* d, const char* name) { return d->model.get(d->model.port(name)); }
i64 add_stage(Device* d, const char* valid, const char* value) {  // whether there is one
  Stage stage{d->model.port(valid), d->model.port(value)};
  if (stage.valid) d->stages.push_back(stage);
  return stage.valid != nullptr;
}
void poke(Device* d, const char* name, u64 value) { d->pokes.push_back({d->model.port(name), value}); }
void forget(Device* d) { d->events.clear(); }
void unpoke(Device* d) { d->pokes.clear(); }
i64 event_count(Device* d) { return d->events.size(); }
const Seen* events_of(Device* d) { return d->events.data(); }

void cycles(Device* d, i64 count) {
  while (count-- > 0 && !d->leaves()) d->tick();
}

void write_word(Device* d, i64 address, i64 word) {
  d->put(ADDR, address), d->put(W_DATA, word), d->put(W_STB, 1);
  d->tick();
  d->put(W_STB, 0);
}

i64 read_word(Device* d, i64 address) {
  d->put(ADDR, address), d->put(R_STB, 1);
  d->tick();
  d->put(R_STB, 0);
  d->model.settle();
  return d->get(R_DATA);
}

// Until nothing is under way; a command needs a few (`quiet`) cycles before busy shows it. Whether it ever is: more
// than `limit` cycles without a decision, or decisions without end, are a standstill.
i64 settle_device(Device* d, i64 quiet, i64 limit) {
  cycles(d, quiet);
  i64 waited = 0, decisions = d->s.decisions;
  while ((d->get(BUSY) || d->get(O_VALID)) && !d->leaves()) {
    d->tick();
    waited = d->decided ? 0 : waited + 1;
    if (waited > limit || d->s.decisions - decisions > 4096) return 0;
  }
  return 1;
}

// Whether all were taken. period: cycles from frame to frame; 0: as fast as they are taken.
i64 play_frames(Device* d, const int32_t* samples, i64 frames, i64 taxels, i64 bits, double period, i64 limit) {
  State& s = d->s;
  i64 begun = s.cycle;
  bool hangs = false;
  for (s.frame = 0; s.frame < frames && !hangs && !d->leaves(); s.frame++) {
    i64 offered = s.cycle;
    for (s.taxel = 0; s.taxel < taxels && !hangs && !d->leaves(); s.taxel++) {
      u64 sample = uint32_t(*samples++) & ((1u << bits) - 1);
      d->put(PAYLOAD, sample | u64(s.taxel == 0) << bits | u64(s.taxel == taxels - 1) << (bits + 1));
      d->put(VALID, 1);
      for (i64 waited = 0; !hangs; waited++) {
        d->tick();
        if (d->taken || d->leaves()) break;
        s.stalls++;
        s.refused += s.taxel == 0 && waited == 0;
        hangs = waited >= limit;
      }
    }
    if (hangs || d->leaves()) break;
    d->events.push_back({FRAME_END, 0, 0, s.cycle - 1});
    if (s.cycle - offered > s.frame_cycles_max) s.frame_cycles_max = s.cycle - offered;
    if (period == 0) continue;
    i64 due = begun + llrint((s.frame + 1) * period);
    s.overruns += s.cycle > due;
    d->put(VALID, 0);
    while (s.cycle < due && !d->leaves()) d->tick();
  }
  d->put(VALID, 0);
  d->model.settle();
  return !hangs;
}

// A serial line: `count` cycles of levels on rx, what tx says in each.
void play_line(Device* d, const uint8_t* driven, i64 count, uint8_t* said) {
  const Port *rx = d->model.port("rx"), *tx = d->model.port("tx");
  for (i64 k = 0; k < count; k++) {
    d->model.put(rx, driven[k]);
    d->model.settle();
    said[k] = d->model.get(tx);
    d->model.edge();
    d->s.cycle++;
  }
}
}
