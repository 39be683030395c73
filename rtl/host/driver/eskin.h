/* Driver of the eskin accelerator behind a bus: C99, no memory allocation, no state beside the handle.
 *
 *   eskin_hw hw = {.base = (volatile uint32_t *)0x30000000};
 *   if (!eskin_hw_present(&hw)) ...
 *   eskin_hw_load(&hw, eskin_load, ESKIN_LOAD_WORDS);       (load.h)
 *   eskin_hw_arm(&hw);
 *   for each frame:  while (!eskin_hw_frame(&hw, codes)) take(&hw);
 *   eskin_hw_finish(&hw);
 *   while (eskin_hw_busy(&hw)) take(&hw);
 *   take(&hw);
 *
 * where take() calls eskin_hw_decision() until it returns 0; an interrupt routine may do that instead. */
#ifndef ESKIN_H
#define ESKIN_H

#include <stddef.h>
#include <stdint.h>

#include "registers.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Where the registers are: at base, or behind read and write, which get context and a byte offset. Compiled with
 * -DESKIN_BASE=0x30000000u they are there, and none of the three is looked at: fewer instructions. */
typedef struct {
    volatile uint32_t *base;
    uint32_t (*read)(void *context, uint32_t offset);
    void (*write)(void *context, uint32_t offset, uint32_t word);
    void *context;
    uint32_t next; /* taxel of the frame under way; 0 to begin with */
} eskin_hw;

/* margin: votes (global decisions of a design that votes), else in units of 4 LSB of a logit. */
typedef struct {
    uint8_t cls, step;
    uint16_t margin;
    uint8_t global, partial, unsure;
} eskin_hw_decision_t;

/* 1 where a device with this register map answers. */
int eskin_hw_present(const eskin_hw *hw);

/* Ends an open touch and carries out writes, each address << 16 | word: the model of load.h. 1: it is in. 0: a
 * converter feeds since an earlier eskin_hw_arm(), and a touch opened meanwhile; then call it again. No decision means
 * anything before the next eskin_hw_arm(). */
int eskin_hw_load(eskin_hw *hw, const uint32_t *writes, size_t count);

/* Begins a recording; faults and decisions of the one before are gone. */
void eskin_hw_arm(eskin_hw *hw);

/* The same where every frame of the source comes: the hardware takes one in ESKIN_SCAN_EVERY. After eskin_hw_arm() it takes
 * all that come. */
void eskin_hw_arm_every(eskin_hw *hw);

#ifdef ESKIN_SAMPLE
/* Feeds a frame of ESKIN_FRAME_TAXELS codes (two's complement). 1: it is in. 0: decisions have to be taken first;
 * then call it again with the same frame, which goes on where it stopped. */
int eskin_hw_frame(eskin_hw *hw, const uint16_t *codes);

/* The same of a frame that lies as the register takes it, two codes a word, the first in the low half: faster. */
int eskin_hw_frame_pairs(eskin_hw *hw, const uint32_t *pairs);
#endif

/* The recording has ended: an open touch is decided as partial. It is over when eskin_hw_busy() is 0. */
void eskin_hw_finish(const eskin_hw *hw);
int eskin_hw_busy(const eskin_hw *hw);

/* Takes the oldest decision: 1, or 0 where none waits. */
int eskin_hw_decision(const eskin_hw *hw, eskin_hw_decision_t *decision);

/* Interrupt while any of these events (ESKIN_EVENT_...) is there; global_only: local decisions are dropped. */
void eskin_hw_enable(const eskin_hw *hw, uint32_t events, int global_only);
uint32_t eskin_hw_events(const eskin_hw *hw);

/* Taxels out of use from the next frame on, 16 a word, ESKIN_MASK_WORDS words. */
void eskin_hw_mask(const eskin_hw *hw, const uint16_t *words);

/* ESKIN_FAULT_... since they were cleared. */
uint32_t eskin_hw_faults(const eskin_hw *hw);
void eskin_hw_clear_faults(const eskin_hw *hw);

#ifdef ESKIN_TEACH
/* The touch that ended last, or (next) the next one, is of class cls. Its trajectory is written while eskin_hw_busy() is 1. */
void eskin_hw_teach(const eskin_hw *hw, uint8_t cls, int next);
/* Forgets what class cls, or (all) every class was taught. */
void eskin_hw_forget(const eskin_hw *hw, uint8_t cls, int all);
/* Places in use. */
uint32_t eskin_hw_taught(const eskin_hw *hw);
/* 1: since eskin_hw_clear_faults() one of these was refused: a touch is open, was not whole, or is being written. */
int eskin_hw_teaching_refused(const eskin_hw *hw);
#endif

#ifdef __cplusplus
}
#endif
#endif
