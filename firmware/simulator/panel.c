#include "panel.h"

#include <avr_ioport.h>
#include <sim_io.h>
#include <sim_time.h>
#include <string.h>

enum {
  COMMAND_US = 37,
  CLEAR_US = 1520,
  ROW_ADDRESS = 0x40,

  /* Arduino's pins 5, 4, 3 and 2 are PE3, PG5, PE5 and PE4; 12 is PB6, 11 is PB5, 6 is PH3. */
  ENABLE = 5,
  REGISTER_SELECT = 6,
  BUTTON = 3
};

static const struct {
  char port;
  unsigned bit;
} DATA_PINS[4] = {{'E', 3}, {'G', 5}, {'E', 5}, {'E', 4}};

static bool pin(panel_t *panel, char port, unsigned bit) {
  avr_ioport_state_t state;
  avr_ioctl(panel->avr, AVR_IOCTL_IOPORT_GETSTATE(port), &state);
  return state.port >> bit & 1;
}

static void execute(panel_t *panel, bool is_character, uint8_t byte) {
  uint32_t takes_us = COMMAND_US;
  if (panel->avr->cycle < panel->busy_until)
    panel->violations++;
  if (is_character) {
    panel->memory[panel->address] = (char)byte;
    panel->address = (panel->address + 1) % PANEL_MEMORY;
  } else if (byte & 0x80) {
    panel->address = byte & 0x7F;
  } else if (byte == 0x01) {
    memset(panel->memory, ' ', sizeof panel->memory);
    panel->address = 0;
    takes_us = CLEAR_US;
  }
  panel->busy_until = panel->avr->cycle + avr_usec_to_cycles(panel->avr, takes_us);
}

/* It takes what is on its pins when "enable" falls. */
static void enable_changed(struct avr_irq_t *irq, uint32_t value, void *param) {
  (void)irq;
  panel_t *panel = param;
  const bool fell = panel->enable && !value;
  panel->enable = value;
  if (!fell)
    return;
  uint8_t nibble = 0;
  for (unsigned i = 0; i < 4; i++)
    nibble |= pin(panel, DATA_PINS[i].port, DATA_PINS[i].bit) << i;
  if (!panel->four_bits) {
    panel->four_bits = nibble == 0x2; /* "function set" of the initialisation; the low lines are not connected */
  } else if (!panel->second_nibble) {
    panel->first_nibble = nibble;
    panel->second_nibble = true;
  } else {
    panel->second_nibble = false;
    execute(panel, pin(panel, 'B', REGISTER_SELECT), panel->first_nibble << 4 | nibble);
  }
}

void panel_install(panel_t *panel, avr_t *avr) {
  memset(panel, 0, sizeof *panel);
  panel->avr = avr;
  memset(panel->memory, ' ', sizeof panel->memory);
  avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('B'), ENABLE), enable_changed, panel);
}

void panel_read(const panel_t *panel, unsigned row, char text[PANEL_COLUMNS + 1]) {
  memcpy(text, panel->memory + row * ROW_ADDRESS, PANEL_COLUMNS);
  text[PANEL_COLUMNS] = 0;
}

void panel_press(panel_t *panel, bool pressed) {
  avr_raise_irq(avr_io_getirq(panel->avr, AVR_IOCTL_IOPORT_GETIRQ('H'), BUTTON), !pressed);
}
