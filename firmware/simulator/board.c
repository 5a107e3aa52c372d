#include "board.h"

#include <sim_elf.h>
#include <sim_io.h>
#include <sim_regbit.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { SLICE_US = 1000 };

/* simavr writes to stdout what it loads; only its errors matter here. */
static void log_error(avr_t *avr, const int level, const char *format, va_list arguments) {
  (void)avr;
  if (level <= LOG_ERROR)
    vfprintf(stderr, format, arguments);
}

static void send_to_pty(void *param, uint8_t byte) { pty_send(param, byte); }

void board_init(board_t *board, const char *elf, const char *port_link) {
  static elf_firmware_t firmware;
  avr_global_logger_set(log_error);
  if (elf_read_firmware(elf, &firmware) < 0) {
    fprintf(stderr, "%s: not an AVR firmware\n", elf);
    exit(1);
  }
  board->avr = avr_make_mcu_by_name("atmega2560");
  if (!board->avr || avr_init(board->avr) < 0) {
    fprintf(stderr, "this simavr knows no atmega2560\n");
    exit(1);
  }
  board->avr->frequency = 16000000;
  avr_load_firmware(board->avr, &firmware);
  board->avr->frequency = 16000000;
  bus_init(&board->bus);
  twi_install(&board->twi, board->avr, &board->bus);
  pty_init(&board->pty, port_link);
  uart_install(&board->uart, board->avr, send_to_pty, &board->pty);
  pins_install(&board->pins, board->avr, &board->bus);
  panel_install(&board->panel, board->avr);
  pty_plug(&board->pty);
}

uint64_t board_now_us(const board_t *board) { return board->avr->cycle / 16; }

void board_exchange(board_t *board) {
  uint8_t bytes[4096];
  const size_t room = uart_room(&board->uart);
  const size_t count = pty_receive(&board->pty, bytes, room < sizeof bytes ? room : sizeof bytes);
  uart_feed(&board->uart, bytes, count);
  pty_flush(&board->pty);
}

bool board_run_until(board_t *board, uint64_t time_us) {
  while (board_now_us(board) < time_us) {
    uint64_t slice_end_us = board_now_us(board) + SLICE_US;
    if (slice_end_us > time_us)
      slice_end_us = time_us;
    board_exchange(board);
    while (board->avr->cycle < slice_end_us * 16) {
      const int state = avr_run(board->avr);
      if (state == cpu_Done || state == cpu_Crashed)
        return false;
    }
  }
  board_exchange(board);
  return true;
}

static void restart(board_t *board, avr_regbit_t cause) {
  board->panel.second_nibble = false; /* the initialisation sets its width anew */
  board->panel.four_bits = false;
  avr_reset(board->avr);
  avr_regbit_set(board->avr, cause);
}

void board_reset(board_t *board) { restart(board, board->avr->reset_flags.extrf); }

void board_power_cycle(board_t *board) {
  for (unsigned k = 0; k < BUS_CHANNELS; k++) {
    const bool plugged = board->bus.chips[k].powered;
    bno055_power(&board->bus.chips[k], false, board_now_us(board));
    bno055_power(&board->bus.chips[k], plugged, board_now_us(board));
  }
  bus_power_multiplexer(&board->bus, board->bus.multiplexer_powered);
  restart(board, board->avr->reset_flags.porf);
}
