/* The simulated board: the firmware's ELF on simavr, its bus and its serial port. */
#ifndef SIMULATOR_BOARD_H
#define SIMULATOR_BOARD_H

#include <sim_avr.h>

#include "bus.h"
#include "panel.h"
#include "pins.h"
#include "pty.h"
#include "twi.h"
#include "uart.h"

typedef struct {
  avr_t *avr;
  bus_t bus;
  twi_t twi;
  uart_t uart;
  pins_t pins;
  panel_t panel;
  pty_t pty;
} board_t;

void board_init(board_t *board, const char *elf, const char *port_link);
uint64_t board_now_us(const board_t *board);

/* Runs until that time, exchanging bytes with the pseudo-terminal every simulated millisecond. False: the CPU crashed. */
bool board_run_until(board_t *board, uint64_t time_us);

/* Moves bytes between the pseudo-terminal and the cable, without moving time. */
void board_exchange(board_t *board);

/* As the button does, or the PC by opening the port: the chips keep their power. */
void board_reset(board_t *board);

/* Takes the power off everything, and gives it back. */
void board_power_cycle(board_t *board);

#endif
