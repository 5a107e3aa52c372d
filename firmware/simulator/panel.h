/* What hangs on the pins of the panel: a 16x2 HD44780 in 4-bit mode, and the button. */
#ifndef SIMULATOR_PANEL_H
#define SIMULATOR_PANEL_H

#include <sim_avr.h>
#include <stdbool.h>
#include <stdint.h>

enum { PANEL_COLUMNS = 16, PANEL_ROWS = 2, PANEL_MEMORY = 128 };

typedef struct {
  avr_t *avr;
  bool enable, four_bits, second_nibble;
  uint8_t first_nibble;
  uint8_t address;
  char memory[PANEL_MEMORY];
  avr_cycle_count_t busy_until;
  unsigned violations; /* writes while the display is busy */
} panel_t;

void panel_install(panel_t *panel, avr_t *avr);
void panel_read(const panel_t *panel, unsigned row, char text[PANEL_COLUMNS + 1]);
void panel_press(panel_t *panel, bool pressed);

#endif
