// Steps a chip's netlist, given as tables (cosim/gates.py), a clock cycle at a time. Only cells whose inputs changed are looked at.
//
// Without delays: all nets settle; flip-flops, macros and clock gates take what they see; latches behind gates that let the edge
// through are open until everything has settled again. With delays (`timed`) the same happens in order of time: a cell's output follows
// after its delay, pulses shorter than that are swallowed (inertial delay, as of a Verilog assign #d), and every change is counted, those
// of a net that ends where it began (glitches) too.

#include <cstdint>
#include <cstring>
#include <vector>

typedef uint8_t u8;
typedef int32_t i32;
typedef int64_t i64;
typedef uint64_t u64;

static const int ROUNDS = 1000;         // times as many evaluations as cells: a netlist that needs more never rests
static const int HORIZON = 1 << 16;     // ticks of a delay, at most

struct Tables {  // as gates.py makes them; cells: outputs of logic in the order of their inputs, behind them the latches
  i64 nets, cells, latches, gates, flops, memories;
  const i32 *output, *inverse, *first, *inputs, *delay;  // of each cell: net, net of the opposite (latches) or -1, inputs
  const i32 *gate_enable, *gate_clock;                   // the gate before it, or -1
  const i32 *memory;  // of each: gate, enable, write, read, words, address bits, data bits, delay, then nets of address, input, mask, output
  const i32 *flop_data, *flop_q, *flop_inverse, *flop_delay;
  const i32 *flop_first, *latch_first;  // numbers of the first behind each gate; before those, behind none
  const u64 *table;                     // what a cell's inputs, read as a number, give
};

struct Event {
  i32 what, stamp;  // a cell, or a net + cells
  u8 value;
};

struct Chip {
  Tables t;
  std::vector<u8> n, was, listed, open, passed, sampled;
  std::vector<u64> dirty;
  std::vector<i32> reader_first, readers, changed;
  std::vector<std::vector<uint32_t>> words;
  std::vector<uint32_t> shown;
  // with delays
  bool timed;
  std::vector<std::vector<Event>> wheel;
  std::vector<i32> stamp;
  std::vector<u8> pending, pending_value;
  long long waiting, now;
  // what changes cost
  double *joule;
  const double *cost, *gate_cost, *access_cost;  // of each memory: a read, a write
  const u8 *kind, *gate_kind, *access_kind;
  int kinds;
};

static inline void mark(Chip &c, i32 cell) { c.dirty[cell >> 6] |= 1ull << (cell & 63); }

static inline void set(Chip &c, i32 net, u8 value) {
  if (net < 0 || c.n[net] == value) return;
  if (!c.listed[net]) {
    c.listed[net] = 1;
    c.was[net] = c.n[net];
    c.changed.push_back(net);
  }
  c.n[net] = value;
  if (c.timed && c.joule) c.joule[c.kinds + c.kind[net]] += c.cost[net];
  for (i32 k = c.reader_first[net]; k < c.reader_first[net + 1]; k++) mark(c, c.readers[k]);
}

static inline u8 value_of(const Chip &c, i32 cell) {
  unsigned at = 0;
  for (i32 k = c.t.first[cell], place = 0; k < c.t.first[cell + 1]; k++, place++) at |= unsigned(c.n[c.t.inputs[k]]) << place;
  return c.t.table[cell] >> at & 1;
}

static inline bool follows(const Chip &c, i32 cell) { return cell < c.t.cells || c.open[cell - c.t.cells]; }

static inline void give(Chip &c, i32 cell, u8 value) {
  set(c, c.t.output[cell], value);
  if (c.t.inverse[cell] >= 0) set(c, c.t.inverse[cell], !value);
}

static void at(Chip &c, i32 delay, Event event) {
  c.wheel[(c.now + delay) & (HORIZON - 1)].push_back(event);
  c.waiting++;
}

// A net behind the edge: at once without delays.
static void later(Chip &c, i32 net, u8 value, i32 delay) {
  if (net < 0) return;
  if (c.timed) at(c, delay, {c.t.cells + c.t.latches + net, 0, value});
  else set(c, net, value);
}

static u8 now_of(const Chip &c, i32 cell) {
  return c.t.output[cell] >= 0 ? c.n[c.t.output[cell]] : !c.n[c.t.inverse[cell]];
}

// Cells that are marked begin to follow their inputs, at most so many.
static void look(Chip &c, long long most) {
  for (size_t word = 0; word < c.dirty.size(); word++)
    while (c.dirty[word]) {
      i32 cell = i32(word << 6) + __builtin_ctzll(c.dirty[word]);
      c.dirty[word] &= c.dirty[word] - 1;
      if (!follows(c, cell)) continue;
      u8 value = value_of(c, cell);
      if (!c.timed) {
        give(c, cell, value);
        if (!most--) return;
        continue;
      }
      if (c.pending[cell] ? value == c.pending_value[cell] : value == now_of(c, cell)) continue;
      c.stamp[cell]++;
      c.pending[cell] = !c.pending[cell];
      c.pending_value[cell] = value;
      if (c.pending[cell]) at(c, c.t.delay[cell], {cell, c.stamp[cell], value});
    }
}

// 0, or 1 where it never rests.
static int rest(Chip &c) {
  int all = c.t.cells + c.t.latches;
  if (!c.timed) {
    for (int round = 0; round < ROUNDS; round++) {
      look(c, all);
      bool any = false;
      for (u64 word : c.dirty) any |= word != 0;
      if (!any) return 0;
    }
    return 1;
  }
  look(c, 0);
  for (long long idle = 0; c.waiting && idle < 64ll * HORIZON; idle++) {
    c.now++;
    std::vector<Event> &bucket = c.wheel[c.now & (HORIZON - 1)];
    if (bucket.empty()) continue;
    for (const Event &event : bucket) {
      c.waiting--;
      if (event.what >= all) set(c, event.what - all, event.value);
      else if (c.pending[event.what] && c.stamp[event.what] == event.stamp) {
        c.pending[event.what] = 0;
        give(c, event.what, event.value);
      }
    }
    bucket.clear();
    look(c, 0);
  }
  return c.waiting != 0;
}

extern "C" {

Chip *make(const Tables *tables) {
  Chip *chip = new Chip{};
  Chip &c = *chip;
  c.t = *tables;
  const Tables &t = c.t;
  int all = t.cells + t.latches;
  c.n.assign(t.nets, 0), c.was.assign(t.nets, 0), c.listed.assign(t.nets, 0);
  c.n[1] = 1;
  c.open.assign(t.latches + 1, 0), c.passed.assign(t.gates + 1, 0), c.sampled.assign(t.flops + 1, 0);
  c.dirty.assign((all >> 6) + 1, 0);
  c.stamp.assign(all, 0), c.pending.assign(all, 0), c.pending_value.assign(all, 0);
  std::vector<i32> count(t.nets + 1, 0);
  for (i32 k = 0; k < t.first[all]; k++) count[t.inputs[k] + 1]++;
  for (i32 net = 0; net < t.nets; net++) count[net + 1] += count[net];
  c.reader_first = count;
  c.readers.resize(t.first[all]);
  for (i32 cell = 0; cell < all; cell++)
    for (i32 k = t.first[cell]; k < t.first[cell + 1]; k++) c.readers[count[t.inputs[k]]++] = cell;
  const i32 *row = t.memory;
  for (i32 k = 0; k < t.memories; k++, row += 8 + row[5] + 3 * row[6]) c.words.emplace_back(row[4]), c.shown.push_back(0);
  return chip;
}

void drop(Chip *chip) { delete chip; }

void with_delays(Chip *chip) {
  chip->timed = true;
  chip->wheel.resize(HORIZON);
}

// States and words begin as `random` says, a bit each, then 32 bits a word.
i64 begin(Chip *chip, const u8 *random, const uint32_t *contents) {
  Chip &c = *chip;
  const Tables &t = c.t;
  double *joule = c.joule;
  bool timed = c.timed;
  c.joule = nullptr;
  c.timed = false;
  auto state = [&](i32 q, i32 inverse) {
    u8 value = *random++;
    if (q >= 0) c.n[q] = value;
    if (inverse >= 0) c.n[inverse] = !value;
  };
  for (i32 k = 0; k < t.flops; k++) state(t.flop_q[k], t.flop_inverse[k]);
  for (i32 k = t.cells; k < t.cells + t.latches; k++) state(t.output[k], t.inverse[k]);
  for (auto &words : c.words)
    for (auto &word : words) word = *contents++;
  const i32 *row = t.memory;
  for (i32 k = 0; k < t.memories; k++, row += 8 + row[5] + 3 * row[6])
    for (i32 bit = 0; bit < row[6]; bit++)
      if (row[8 + row[5] + 2 * row[6] + bit] >= 0) c.n[row[8 + row[5] + 2 * row[6] + bit]] = *contents++ & 1;
  for (auto &word : c.dirty) word = ~0ull;
  if ((t.cells + t.latches) & 63) c.dirty.back() = (1ull << ((t.cells + t.latches) & 63)) - 1;
  else c.dirty.back() = 0;
  int wrong = rest(c);
  c.changed.clear();
  std::fill(c.listed.begin(), c.listed.end(), 0);
  std::fill(c.passed.begin(), c.passed.end(), 0);
  c.joule = joule;
  c.timed = timed;
  return wrong;
}

void put(Chip *chip, const i32 *nets, int count, u64 value) {
  for (int k = 0; k < count; k++) set(*chip, nets[k], value >> k & 1);
}

u64 get(Chip *chip, const i32 *nets, int count) {
  u64 value = 0;
  for (int k = 0; k < count; k++) value |= u64(chip->n[nets[k]]) << k;
  return value;
}

int settle(Chip *chip) { return rest(*chip); }

int edge(Chip *chip) {
  Chip &c = *chip;
  const Tables &t = c.t;
  auto passes = [&](i32 gate) { return gate < 0 || c.passed[gate]; };
  for (i32 k = 0; k < t.gates; k++) c.passed[k] = passes(t.gate_clock[k]) && c.n[t.gate_enable[k]];
  for (i32 gate = -1; gate < t.gates; gate++)
    if (passes(gate))
      for (i32 k = t.flop_first[gate + 1]; k < t.flop_first[gate + 2]; k++) c.sampled[k] = c.n[t.flop_data[k]];
  const i32 *row = t.memory;
  for (i32 k = 0; k < t.memories; k++, row += 8 + row[5] + 3 * row[6]) {
    if (!passes(row[0]) || !c.n[row[1]]) continue;
    const i32 *pin = row + 8;
    auto taken = [&](i32 bits) {
      uint32_t value = 0;
      for (i32 bit = 0; bit < bits; bit++) value |= uint32_t(c.n[*pin++]) << bit;
      return value;
    };
    uint32_t address = taken(row[5]) % row[4], given = taken(row[6]), mask = taken(row[6]), &word = c.words[k][address];
    bool writes = c.n[row[2]];
    if (writes) word = (given & mask) | (word & ~mask);
    else if (c.n[row[3]]) {
      c.shown[k] = word;
      for (i32 bit = 0; bit < row[6]; bit++) later(c, *pin++, word >> bit & 1, row[7]);
    } else continue;
    if (c.joule) c.joule[c.access_kind[k]] += c.access_cost[2 * k + writes];
  }
  for (i32 gate = -1; gate < t.gates; gate++) {
    if (!passes(gate)) continue;
    for (i32 k = t.flop_first[gate + 1]; k < t.flop_first[gate + 2]; k++) {
      later(c, t.flop_q[k], c.sampled[k], t.flop_delay[k]);
      later(c, t.flop_inverse[k], !c.sampled[k], t.flop_delay[k]);
    }
    for (i32 k = t.latch_first[gate + 1]; k < t.latch_first[gate + 2]; k++) c.open[k] = 1, mark(c, t.cells + k);
  }
  int wrong = rest(c);
  for (i32 gate = -1; gate < t.gates; gate++)
    if (passes(gate)) std::fill(c.open.begin() + t.latch_first[gate + 1], c.open.begin() + t.latch_first[gate + 2], 0);
  return wrong;
}

int gate_passed(Chip *chip, int gate) { return chip->passed[gate]; }

// Twice as many places in joule as kinds: what has changed from cycle to cycle, then the glitches beyond.
void costs(Chip *chip, double *joule, i64 kinds, const double *cost, const u8 *kind, const double *gate_cost, const u8 *gate_kind, const double *access_cost, const u8 *access_kind) {
  chip->joule = joule, chip->kinds = kinds;
  chip->cost = cost, chip->kind = kind, chip->gate_cost = gate_cost, chip->gate_kind = gate_kind;
  chip->access_cost = access_cost, chip->access_kind = access_kind;
}

void count(Chip *chip) {
  Chip &c = *chip;
  for (i32 net : c.changed) {
    c.listed[net] = 0;
    if (c.n[net] == c.was[net]) continue;
    c.joule[c.kind[net]] += c.cost[net];
    if (c.timed) c.joule[c.kinds + c.kind[net]] -= c.cost[net];
  }
  c.changed.clear();
  for (i32 k = 0; k < c.t.gates; k++)
    if (c.passed[k]) c.joule[c.gate_kind[k]] += c.gate_cost[k];
}
}
