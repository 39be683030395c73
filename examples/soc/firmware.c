/* Loads the model, then prints every decision. With a converter in front the CPU sleeps until the interrupt; without
 * one it wakes with each frame and feeds it. */
#include "eskin.h"
#include "load.h"

typedef struct {
    volatile uint32_t uart; /* a write sends a byte, and waits for the one before */
    volatile uint32_t time; /* microseconds */
    volatile uint32_t wait; /* a read is answered when an interrupt or a frame is there */
} soc_system;

#define SOC ((soc_system *)0x80000000u)
#define EVENTS (ESKIN_EVENT_DECISION | ESKIN_EVENT_FAULT)
#define FRAME ((const uint32_t *)0xC0000000u)

__asm__(".section .start,\"ax\"\n.globl _start\n_start:\n  la sp, stack\n  j main\n");

/* Text on its way out: in its pattern a digit k stands for the digit of weight 10^k, and a value ends with 0. */
typedef struct {
    const char *next;
    uint32_t value[7], at, digit;
} text;

static const char DECISION[] = "class 10 margin 43210 step 210 global 0 partial 0 unsure 0 time 9876543210 us\n";
static const char FAULT[] = "faults 43210\n";
static const uint32_t POWER[] = {1, 10, 100, 1000, 10000, 100000, 1000000, 10000000, 100000000, 1000000000};

/* Sends a character, or with slow makes one step towards a digit: a division would take as long as a frame. 0: there
 * is nothing left. */
static inline int say(text *line, int slow) {
    char c = *line->next;
    if (c == 0) {
        return 0;
    }
    if (c >= '0' && c <= '9') {
        uint32_t power = POWER[c - '0'], value = line->value[line->at], digit = line->digit;
        while (value >= power) {
            value -= power;
            digit++;
            if (slow) {
                line->value[line->at] = value;
                line->digit = digit;
                return 1;
            }
        }
        line->value[line->at] = value;
        line->digit = 0;
        line->at += c == '0';
        c = (char)('0' + digit);
    }
    line->next++;
    SOC->uart = (uint8_t)c;
    return 1;
}

/* The next thing to tell, when the line before is out; 0: there is none. */
static inline int tell(const eskin_hw *hw, text *line) {
    eskin_hw_decision_t decision;
    line->at = line->digit = 0;
    if (eskin_hw_decision(hw, &decision)) {
        line->next = DECISION;
        line->value[0] = decision.cls;
        line->value[1] = decision.margin;
        line->value[2] = decision.step;
        line->value[3] = decision.global;
        line->value[4] = decision.partial;
        line->value[5] = decision.unsure;
        line->value[6] = SOC->time;
        return 1;
    }
    line->value[0] = eskin_hw_faults(hw);
    if (line->value[0]) {
        line->next = FAULT;
        eskin_hw_clear_faults(hw);
        return 1;
    }
    return 0;
}

int main(void) {
    static eskin_hw hw; /* at ESKIN_BASE */
    text line;
    line.next = "no device of this register map\n";
    if (eskin_hw_present(&hw)) {
        line.next = eskin_hw_load(&hw, eskin_load, ESKIN_LOAD_WORDS) ? "ready\n" : "the model was not taken\n";
    }
    while (say(&line, 0)) {
    }
    eskin_hw_arm(&hw);
#ifdef ESKIN_SAMPLE
    for (;;) {
        (void)SOC->wait;
        __asm__ volatile("" ::: "memory"); /* FRAME holds another one now */
        while (!eskin_hw_frame_pairs(&hw, FRAME)) {
            while (say(&line, 0) || tell(&hw, &line)) {
            }
        }
        if (!say(&line, 1) && (eskin_hw_events(&hw) & EVENTS)) { /* a step a frame: none waits for a line */
            tell(&hw, &line);
        }
    }
#else
    eskin_hw_enable(&hw, EVENTS, 0);
    for (;;) {
        (void)SOC->wait;
        while (tell(&hw, &line)) {
            while (say(&line, 0)) {
            }
        }
    }
#endif
}
