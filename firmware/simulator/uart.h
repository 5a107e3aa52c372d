/* UART0 of the ATmega2560, in place of simavr 1.6's: that one counts 11 bits for 8N1, has no transmit buffer beside the
   shift register and paces the reader. Facts: ATmega2560 datasheet, chapter 22. */
#ifndef SIMULATOR_UART_H
#define SIMULATOR_UART_H

#include <avr_uart.h>
#include <sim_avr.h>
#include <stdbool.h>
#include <stddef.h>

enum { UART_RX_FIFO = 3 /* two bytes and the shift register */, UART_RX_QUEUE = 1 << 16 };

typedef void (*uart_sink_t)(void *param, uint8_t byte);

typedef struct {
  avr_t *avr;
  avr_uart_t *registers;
  uart_sink_t sink; /* gets what the board sends, as each byte ends */
  void *sink_param;

  bool shifting, buffered;
  uint8_t tx_shift, tx_buffer;

  uint8_t rx_fifo[UART_RX_FIFO];
  unsigned rx_count;
  bool receiving;
  uint8_t rx_queue[UART_RX_QUEUE]; /* on the cable */
  unsigned rx_head, rx_tail;

  uint64_t sent, received;
  unsigned overruns; /* bytes that came while the FIFO was full */
} uart_t;

void uart_install(uart_t *uart, avr_t *avr, uart_sink_t sink, void *sink_param);

/* Puts bytes on the cable to the board; returns how many there was room for. */
size_t uart_feed(uart_t *uart, const uint8_t *bytes, size_t count);
size_t uart_room(const uart_t *uart);

#endif
