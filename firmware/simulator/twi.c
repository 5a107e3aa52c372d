#include "twi.h"

#include <sim_interrupts.h>
#include <sim_regbit.h>
#include <sim_time.h>

#include "peripheral.h"

enum {
  TWIE = 1 << 0,
  TWEN = 1 << 2,
  TWWC = 1 << 3,
  TWSTO = 1 << 4,
  TWSTA = 1 << 5,
  TWEA = 1 << 6,
  TWINT = 1 << 7,

  STATUS_START = 0x08,
  STATUS_REPEATED_START = 0x10,
  STATUS_WRITE_ADDRESS_ACK = 0x18,
  STATUS_WRITE_ADDRESS_NACK = 0x20,
  STATUS_WRITE_DATA_ACK = 0x28,
  STATUS_WRITE_DATA_NACK = 0x30,
  STATUS_READ_ADDRESS_ACK = 0x40,
  STATUS_READ_ADDRESS_NACK = 0x48,
  STATUS_READ_DATA_ACK = 0x50,
  STATUS_READ_DATA_NACK = 0x58,
  STATUS_IDLE = 0xF8,

  HELD_LINE_POLL_US = 20
};

static uint8_t *control(twi_t *twi) { return &twi->avr->data[twi->registers->r_twcr]; }

static uint8_t data(twi_t *twi) { return twi->avr->data[twi->registers->r_twdr]; }

static uint64_t now_us(twi_t *twi) { return twi->avr->cycle * 1000000ULL / twi->avr->frequency; }

static void set_status(twi_t *twi, uint8_t status) {
  uint8_t *twsr = &twi->avr->data[twi->registers->r_twsr];
  *twsr = (*twsr & 3) | status;
}

static avr_cycle_count_t clock_period(twi_t *twi) {
  const uint8_t twbr = twi->avr->data[twi->registers->r_twbr];
  const uint8_t prescaler = twi->avr->data[twi->registers->r_twsr] & 3;
  return 16 + (2 * (avr_cycle_count_t)twbr << (2 * prescaler));
}

static uint8_t finish_byte(twi_t *twi) {
  bool acknowledged;
  switch (twi->phase) {
    case TWI_STARTED: {
      const bool read = data(twi) & 1;
      acknowledged = bus_address(twi->bus, data(twi), now_us(twi));
      twi->phase = read ? TWI_READING : TWI_WRITING;
      if (read)
        return acknowledged ? STATUS_READ_ADDRESS_ACK : STATUS_READ_ADDRESS_NACK;
      return acknowledged ? STATUS_WRITE_ADDRESS_ACK : STATUS_WRITE_ADDRESS_NACK;
    }
    case TWI_WRITING:
      acknowledged = bus_write(twi->bus, data(twi), now_us(twi));
      return acknowledged ? STATUS_WRITE_DATA_ACK : STATUS_WRITE_DATA_NACK;
    default:
      twi->avr->data[twi->registers->r_twdr] = bus_read(twi->bus);
      return *control(twi) & TWEA ? STATUS_READ_DATA_ACK : STATUS_READ_DATA_NACK;
  }
}

static avr_cycle_count_t finish(avr_t *avr, avr_cycle_count_t when, void *param) {
  twi_t *twi = param;
  if (bus_sda_held(twi->bus) || bus_scl_held(twi->bus))
    return when + avr_usec_to_cycles(avr, HELD_LINE_POLL_US); /* nothing ends while a line is held */
  const twi_action_t action = twi->action;
  twi->action = TWI_NOTHING;
  switch (action) {
    case TWI_STOP:
      bus_stop(twi->bus);
      twi->phase = TWI_IDLE;
      *control(twi) &= ~TWSTO;
      set_status(twi, STATUS_IDLE);
      return 0; /* a STOP raises no interrupt */
    case TWI_START:
      set_status(twi, twi->phase == TWI_IDLE ? STATUS_START : STATUS_REPEATED_START);
      twi->phase = TWI_STARTED;
      break;
    default:
      set_status(twi, finish_byte(twi));
  }
  avr_raise_interrupt(avr, &twi->registers->twi);
  return 0;
}

static void begin(twi_t *twi, twi_action_t action, avr_cycle_count_t cycles) {
  twi->action = action;
  avr_cycle_timer_cancel(twi->avr, finish, twi);
  avr_cycle_timer_register(twi->avr, cycles, finish, twi);
}

static void begin_byte(twi_t *twi) {
  const uint32_t stretch_us = twi->phase == TWI_STARTED ? bus_stretch_us(twi->bus, data(twi)) : 0;
  begin(twi, TWI_BYTE, 9 * clock_period(twi) + avr_usec_to_cycles(twi->avr, stretch_us));
}

static void switch_off(twi_t *twi) {
  avr_cycle_timer_cancel(twi->avr, finish, twi);
  twi->phase = TWI_IDLE;
  twi->action = TWI_NOTHING;
}

static void write_control(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
  (void)address;
  twi_t *twi = param;
  const uint8_t old = *control(twi);
  const bool go_on = value & TWINT; /* writing a one clears the flag, and that starts what is asked for */
  if (go_on)
    avr_clear_interrupt(avr, &twi->registers->twi);
  /* A STOP that is still being sent stays asked for. */
  const uint8_t stopping = twi->action == TWI_STOP ? old & TWSTO : 0;
  *control(twi) = (value & (TWIE | TWEN | TWSTO | TWSTA | TWEA)) | stopping | (old & TWWC) | (go_on ? 0 : old & TWINT);

  if (!(value & TWEN)) {
    switch_off(twi);
    *control(twi) &= ~TWSTO;
  } else if (go_on && (value & TWSTO)) {
    begin(twi, TWI_STOP, clock_period(twi) * 3 / 2);
  } else if (go_on && (value & TWSTA)) {
    begin(twi, TWI_START, clock_period(twi) * 3 / 2);
  } else if (go_on && twi->phase != TWI_IDLE) {
    begin_byte(twi);
  } else if (*control(twi) & TWINT) {
    avr_raise_interrupt(avr, &twi->registers->twi); /* if TWIE has just been set */
  }
}

static void write_data(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
  twi_t *twi = param;
  if (*control(twi) & TWINT) {
    avr->data[address] = value;
    *control(twi) &= ~TWWC;
  } else {
    *control(twi) |= TWWC;
  }
}

static void write_status(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
  (void)param;
  avr->data[address] = (avr->data[address] & ~3) | (value & 3); /* only the prescaler can be written */
}

static twi_t *installed; /* simavr's reset hook knows only its own module */

static void reset(avr_io_t *io) {
  (void)io;
  switch_off(installed);
  set_status(installed, STATUS_IDLE);
}

void twi_install(twi_t *twi, avr_t *avr, bus_t *bus) {
  avr_io_t *io = peripheral_find(avr, "twi");
  *twi = (twi_t){.avr = avr, .registers = (avr_twi_t *)io, .bus = bus};
  installed = twi;
  io->reset = reset;
  peripheral_on_write(avr, twi->registers->r_twcr, write_control, twi);
  peripheral_on_write(avr, twi->registers->r_twdr, write_data, twi);
  peripheral_on_write(avr, twi->registers->r_twsr, write_status, twi);
  reset(io);
}
