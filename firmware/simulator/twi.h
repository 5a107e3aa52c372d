/* The ATmega2560's TWI as a bus controller, in place of simavr 1.6's: that one ignores TWBR, reports SLA+W with the
   status of a data byte and has no write collision. Facts: ATmega2560 datasheet, chapter 24. */
#ifndef SIMULATOR_TWI_H
#define SIMULATOR_TWI_H

#include <avr_twi.h>
#include <sim_avr.h>

#include "bus.h"

typedef enum { TWI_IDLE, TWI_STARTED, TWI_WRITING, TWI_READING } twi_phase_t;
typedef enum { TWI_NOTHING, TWI_START, TWI_STOP, TWI_BYTE } twi_action_t;

typedef struct {
  avr_t *avr;
  avr_twi_t *registers; /* simavr's description of the peripheral: addresses, bits and vector */
  bus_t *bus;
  twi_phase_t phase;
  twi_action_t action;  /* going on */
} twi_t;

void twi_install(twi_t *twi, avr_t *avr, bus_t *bus);

#endif
