/* Replacing one of simavr's peripherals by a model of our own. */
#ifndef SIMULATOR_PERIPHERAL_H
#define SIMULATOR_PERIPHERAL_H

#include <sim_avr.h>
#include <sim_io.h>

/* simavr's module of that kind (and, with several, the first), or exits. */
avr_io_t *peripheral_find(avr_t *avr, const char *kind);

/* Unlike avr_register_io_*, these replace the handler that is there. */
void peripheral_on_write(avr_t *avr, avr_io_addr_t address, avr_io_write_t handler, void *param);
void peripheral_on_read(avr_t *avr, avr_io_addr_t address, avr_io_read_t handler, void *param);

#endif
