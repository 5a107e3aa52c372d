/* The board's pins that the bus hangs on, while the firmware drives them by hand: PD0 is SCL, PD1 is SDA, PH5 resets the
   multiplexer. Open drain: an output is low, an input is left to its pull-up. */
#ifndef SIMULATOR_PINS_H
#define SIMULATOR_PINS_H

#include <sim_avr.h>

#include "bus.h"

typedef struct {
  avr_t *avr;
  bus_t *bus;
  avr_io_read_t read_port_d; /* simavr's own */
  void *read_port_d_param;
  bool scl_low;
} pins_t;

void pins_install(pins_t *pins, avr_t *avr, bus_t *bus);

#endif
