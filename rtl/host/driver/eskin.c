#include "eskin.h"

#define FIELD(word, name) (((word) & ESKIN_##name##_MASK) >> ESKIN_##name##_SHIFT)

#ifdef ESKIN_BASE
static uint32_t get(const eskin_hw *hw, uint32_t offset) {
    (void)hw;
    return *(volatile uint32_t *)(uintptr_t)(ESKIN_BASE + offset);
}

static void put(const eskin_hw *hw, uint32_t offset, uint32_t word) {
    (void)hw;
    *(volatile uint32_t *)(uintptr_t)(ESKIN_BASE + offset) = word;
}
#else
static uint32_t get(const eskin_hw *hw, uint32_t offset) {
    return hw->read ? hw->read(hw->context, offset) : hw->base[offset / 4];
}

static void put(const eskin_hw *hw, uint32_t offset, uint32_t word) {
    if (hw->write) {
        hw->write(hw->context, offset, word);
    } else {
        hw->base[offset / 4] = word;
    }
}
#endif

int eskin_hw_present(const eskin_hw *hw) {
    return get(hw, ESKIN_ID_OFFSET) == ESKIN_ID_VALUE && get(hw, ESKIN_VERSION_OFFSET) == ESKIN_VERSION_VALUE;
}

int eskin_hw_load(eskin_hw *hw, const uint32_t *writes, size_t count) {
    if (get(hw, ESKIN_STATUS_OFFSET) & ESKIN_STATUS_TOUCH) {
        eskin_hw_arm(hw); /* a memory takes no write while a touch is open; otherwise ARM would start a converter */
    }
    eskin_hw_clear_faults(hw);
    for (size_t k = 0; k < count; k++) {
        put(hw, writes[k] >> 16 << 2, writes[k] & 0xFFFFu);
    }
    return (eskin_hw_faults(hw) & ESKIN_FAULT_WRITE_REFUSED) == 0;
}

static void arm(eskin_hw *hw, uint32_t option) {
    put(hw, ESKIN_CONTROL_OFFSET, ESKIN_CONTROL_ARM | ESKIN_CONTROL_CLEAR_FAULTS | option);
    hw->next = 0;
}

void eskin_hw_arm(eskin_hw *hw) { arm(hw, 0); }

void eskin_hw_arm_every(eskin_hw *hw) { arm(hw, ESKIN_CONTROL_EVERY); }

#ifdef ESKIN_SAMPLE
static int frame_is_in(eskin_hw *hw) {
    uint32_t next = get(hw, ESKIN_NEXT_TAXEL_OFFSET);
    hw->next = FIELD(next, NEXT_TAXEL_TAXEL);
    return next == 0;
}

int eskin_hw_frame(eskin_hw *hw, const uint16_t *codes) {
    for (uint32_t k = hw->next; k < ESKIN_FRAME_TAXELS; k += 2) {
        uint32_t second = k + 1 < ESKIN_FRAME_TAXELS ? codes[k + 1] : 0;
        put(hw, ESKIN_SAMPLE_PAIR_OFFSET, codes[k] | second << 16);
    }
    return frame_is_in(hw);
}

int eskin_hw_frame_pairs(eskin_hw *hw, const uint32_t *pairs) {
    if (hw->next == 0) { /* so often that the compiler should know the count */
        for (uint32_t k = 0; k < ESKIN_FRAME_TAXELS; k += 2) {
            put(hw, ESKIN_SAMPLE_PAIR_OFFSET, pairs[k / 2]);
        }
    } else {
        uint32_t k = hw->next;
        if (k & 1) { /* the first of its pair is in */
            put(hw, ESKIN_SAMPLE_OFFSET, pairs[k / 2] >> 16);
            k++;
        }
        for (; k < ESKIN_FRAME_TAXELS; k += 2) {
            put(hw, ESKIN_SAMPLE_PAIR_OFFSET, pairs[k / 2]);
        }
    }
    return frame_is_in(hw);
}
#endif

void eskin_hw_finish(const eskin_hw *hw) { put(hw, ESKIN_CONTROL_OFFSET, ESKIN_CONTROL_FINISH); }

int eskin_hw_busy(const eskin_hw *hw) { return (get(hw, ESKIN_STATUS_OFFSET) & ESKIN_STATUS_BUSY) != 0; }

int eskin_hw_decision(const eskin_hw *hw, eskin_hw_decision_t *decision) {
    uint32_t word = get(hw, ESKIN_DECISION_OFFSET);
    if (word == ESKIN_DECISION_RESET) {
        return 0;
    }
    decision->cls = (uint8_t)FIELD(word, DECISION_CLASS);
    decision->step = (uint8_t)FIELD(word, DECISION_STEP);
    decision->margin = (uint16_t)FIELD(word, DECISION_MARGIN);
    decision->global = (uint8_t)FIELD(word, DECISION_GLOBAL);
    decision->partial = (uint8_t)FIELD(word, DECISION_PARTIAL);
    decision->unsure = (uint8_t)FIELD(word, DECISION_UNSURE);
    return 1;
}

void eskin_hw_enable(const eskin_hw *hw, uint32_t events, int global_only) {
    put(hw, ESKIN_ENABLE_OFFSET, events | (global_only ? ESKIN_ENABLE_GLOBAL_ONLY_MASK : 0));
}

uint32_t eskin_hw_events(const eskin_hw *hw) { return get(hw, ESKIN_EVENTS_OFFSET); }

void eskin_hw_mask(const eskin_hw *hw, const uint16_t *words) {
    for (uint32_t k = 0; k < ESKIN_MASK_WORDS; k++) {
        put(hw, ESKIN_MASK_OFFSET + 4 * k, words[k]);
    }
}

uint32_t eskin_hw_faults(const eskin_hw *hw) { return get(hw, ESKIN_FAULTS_OFFSET); }

void eskin_hw_clear_faults(const eskin_hw *hw) { put(hw, ESKIN_CONTROL_OFFSET, ESKIN_CONTROL_CLEAR_FAULTS); }

#ifdef ESKIN_TEACH
void eskin_hw_teach(const eskin_hw *hw, uint8_t cls, int next) {
    put(hw, ESKIN_TEACH_OFFSET, cls | (next ? ESKIN_TEACH_NEXT_MASK : 0));
}

void eskin_hw_forget(const eskin_hw *hw, uint8_t cls, int all) {
    put(hw, ESKIN_FORGET_OFFSET, cls | (all ? ESKIN_FORGET_ALL_MASK : 0));
}

uint32_t eskin_hw_taught(const eskin_hw *hw) { return FIELD(get(hw, ESKIN_TAUGHT_OFFSET), TAUGHT_IN_USE); }

int eskin_hw_teaching_refused(const eskin_hw *hw) {
    return (int)FIELD(get(hw, ESKIN_TAUGHT_OFFSET), TAUGHT_REFUSED);
}
#endif
