#include "uart.h"

#include <sim_interrupts.h>
#include <sim_regbit.h>

#include "peripheral.h"

enum {
  MPCM = 1 << 0,
  U2X = 1 << 1,
  DOR = 1 << 3,
  UDRE = 1 << 5,
  TXC = 1 << 6,
  RXC = 1 << 7,
  TXEN = 1 << 3,
  RXEN = 1 << 4,
  UDRIE = 1 << 5,
  RXCIE = 1 << 7,
  BITS_PER_BYTE = 10 /* 8N1 */
};

static uint8_t *status(uart_t *uart) { return &uart->avr->data[uart->registers->r_ucsra]; }

static uint8_t control(uart_t *uart) { return uart->avr->data[uart->registers->r_ucsrb]; }

static avr_cycle_count_t byte_cycles(uart_t *uart) {
  const unsigned low = uart->avr->data[uart->registers->ubrrl.reg];
  const unsigned high = uart->avr->data[uart->registers->ubrrh.reg] & 0x0F;
  return BITS_PER_BYTE * (avr_cycle_count_t)((high << 8 | low) + 1) * (*status(uart) & U2X ? 8 : 16);
}

/* ---- board to cable ---- */
static avr_cycle_count_t byte_sent(avr_t *avr, avr_cycle_count_t when, void *param) {
  uart_t *uart = param;
  uart->sent++;
  uart->sink(uart->sink_param, uart->tx_shift);
  if (!uart->buffered) {
    uart->shifting = false;
    *status(uart) |= TXC;
    return 0;
  }
  uart->tx_shift = uart->tx_buffer;
  uart->buffered = false;
  avr_raise_interrupt(avr, &uart->registers->udrc);
  return when + byte_cycles(uart);
}

static void write_data(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
  (void)address;
  uart_t *uart = param;
  if (!(control(uart) & TXEN))
    return;
  avr_clear_interrupt(avr, &uart->registers->udrc);
  if (uart->shifting) {
    uart->tx_buffer = value;
    uart->buffered = true;
    *status(uart) &= ~UDRE;
    return;
  }
  uart->tx_shift = value;
  uart->shifting = true;
  *status(uart) &= ~TXC;
  avr_cycle_timer_register(avr, byte_cycles(uart), byte_sent, uart);
  avr_raise_interrupt(avr, &uart->registers->udrc); /* the buffer is empty at once */
}

/* ---- cable to board ---- */
static avr_cycle_count_t byte_received(avr_t *avr, avr_cycle_count_t when, void *param) {
  uart_t *uart = param;
  const uint8_t byte = uart->rx_queue[uart->rx_tail++ % UART_RX_QUEUE];
  if (control(uart) & RXEN) {
    if (uart->rx_count < UART_RX_FIFO) {
      uart->rx_fifo[uart->rx_count++] = byte;
      avr_raise_interrupt(avr, &uart->registers->rxc);
    } else {
      uart->overruns++;
      *status(uart) |= DOR;
    }
  }
  uart->receiving = uart->rx_tail != uart->rx_head;
  return uart->receiving ? when + byte_cycles(uart) : 0;
}

static uint8_t read_data(avr_t *avr, avr_io_addr_t address, void *param) {
  uart_t *uart = param;
  if (uart->rx_count) {
    avr->data[address] = uart->rx_fifo[0];
    uart->rx_count--;
    for (unsigned i = 0; i < uart->rx_count; i++)
      uart->rx_fifo[i] = uart->rx_fifo[i + 1];
    uart->received++;
  }
  avr_clear_interrupt(avr, &uart->registers->rxc);
  *status(uart) &= ~(RXC | DOR);
  if (uart->rx_count)
    avr_raise_interrupt(avr, &uart->registers->rxc);
  return avr->data[address];
}

size_t uart_room(const uart_t *uart) { return UART_RX_QUEUE - (uart->rx_head - uart->rx_tail); }

size_t uart_feed(uart_t *uart, const uint8_t *bytes, size_t count) {
  if (count > uart_room(uart))
    count = uart_room(uart);
  for (size_t i = 0; i < count; i++)
    uart->rx_queue[uart->rx_head++ % UART_RX_QUEUE] = bytes[i];
  if (count && !uart->receiving) {
    uart->receiving = true;
    avr_cycle_timer_register(uart->avr, byte_cycles(uart), byte_received, uart);
  }
  return count;
}

/* ---- registers ---- */
static void write_status(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
  (void)param;
  const uint8_t cleared = value & TXC; /* by writing a one */
  avr->data[address] = (value & (U2X | MPCM)) | (avr->data[address] & ~(U2X | MPCM) & ~cleared);
}

static void write_control(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
  uart_t *uart = param;
  avr->data[address] = value;
  /* Both interrupts last as long as their flags. */
  if ((value & UDRIE) && (*status(uart) & UDRE))
    avr_raise_interrupt(avr, &uart->registers->udrc);
  if ((value & RXCIE) && (*status(uart) & RXC))
    avr_raise_interrupt(avr, &uart->registers->rxc);
}

static uart_t *installed; /* simavr's reset hook knows only its own module */

static void reset(avr_io_t *io) {
  (void)io;
  uart_t *uart = installed;
  avr_cycle_timer_cancel(uart->avr, byte_sent, uart);
  avr_cycle_timer_cancel(uart->avr, byte_received, uart);
  uart->shifting = uart->buffered = uart->receiving = false;
  uart->rx_count = 0;
  uart->rx_tail = uart->rx_head; /* what was on the cable meets a board that does not listen yet */
  *status(uart) = UDRE;
}

void uart_install(uart_t *uart, avr_t *avr, uart_sink_t sink, void *sink_param) {
  avr_io_t *io = peripheral_find(avr, "uart");
  *uart = (uart_t){.avr = avr, .registers = (avr_uart_t *)io, .sink = sink, .sink_param = sink_param};
  installed = uart;
  io->reset = reset;
  peripheral_on_write(avr, uart->registers->r_udr, write_data, uart);
  peripheral_on_read(avr, uart->registers->r_udr, read_data, uart);
  peripheral_on_write(avr, uart->registers->r_ucsra, write_status, uart);
  peripheral_on_read(avr, uart->registers->r_ucsra, NULL, NULL);
  peripheral_on_write(avr, uart->registers->r_ucsrb, write_control, uart);
  peripheral_on_write(avr, uart->registers->ubrrl.reg, NULL, NULL);
  peripheral_on_write(avr, uart->registers->ubrrh.reg, NULL, NULL);
  reset(io);
}
