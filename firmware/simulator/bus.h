/* The I2C bus: a TCA9548A on it, a BNO055 on each of its channels, and what can hold the lines. */
#ifndef SIMULATOR_BUS_H
#define SIMULATOR_BUS_H

#include "bno055.h"

enum { BUS_CHANNELS = 8, BUS_TRUNK = BUS_CHANNELS };

/* Somebody holds a line low: for ever, or SDA until the clock has been pulsed. */
typedef struct {
  bool sda, scl;
  unsigned clocks_left; /* 0: no number of pulses helps */
} bus_hold_t;

typedef struct {
  bool multiplexer_powered;
  uint8_t selected;                     /* the channels that the multiplexer connects */
  uint8_t selection;                    /* what it was told to connect at the next STOP */
  bno055_t chips[BUS_CHANNELS];
  bus_hold_t holds[BUS_CHANNELS + 1];   /* by channel, and on the trunk */

  /* the transfer going on */
  bool multiplexer_addressed;
  uint8_t chips_addressed;              /* mask */

  unsigned transfers, bytes, clock_pulses, multiplexer_resets;
} bus_t;

void bus_init(bus_t *bus);
void bus_power_multiplexer(bus_t *bus, bool on);
void bus_hold(bus_t *bus, unsigned where, bool sda, bool scl, unsigned clocks);
void bus_release(bus_t *bus, unsigned where);

/* As the controller sees it. */
bool bus_sda_held(const bus_t *bus);
bool bus_scl_held(const bus_t *bus);
bool bus_address(bus_t *bus, uint8_t address_and_read, uint64_t now_us); /* whether somebody acknowledges */
bool bus_write(bus_t *bus, uint8_t byte, uint64_t now_us);
uint8_t bus_read(bus_t *bus);
uint32_t bus_stretch_us(const bus_t *bus, uint8_t address_and_read);
void bus_stop(bus_t *bus);

/* As the board's pins drive it. */
void bus_clock_pulse(bus_t *bus);
void bus_reset_multiplexer(bus_t *bus);

#endif
