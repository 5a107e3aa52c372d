#include "uart.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "config.h"

#define BAUD SESA2_BAUD
#define BAUD_TOL 3 /* 115200 is 2.1 % off on 16 MHz; Arduino's own rate for it is the same */
#include <util/setbaud.h>

namespace {

/* 256 bytes each, so that the indices wrap by themselves. A RAW and a MAGNETOMETER packet together take 182. */
volatile uint8_t tx_ring[256], tx_head, tx_tail;
volatile uint8_t rx_ring[256], rx_head, rx_tail;
volatile uint16_t lost;

}  // namespace

ISR(USART0_RX_vect) {
  if ((UCSR0A & _BV(DOR0)) && lost < UINT16_MAX)
    lost++; /* at least one byte: the hardware's two-byte buffer was full */
  const uint8_t byte = UDR0;
  if (uint8_t(rx_head + 1) == rx_tail) {
    if (lost < UINT16_MAX)
      lost++;
    return;
  }
  rx_ring[rx_head] = byte;
  rx_head++;
}

ISR(USART0_UDRE_vect) {
  if (tx_tail == tx_head) {
    UCSR0B &= ~_BV(UDRIE0);
    return;
  }
  UDR0 = tx_ring[tx_tail];
  tx_tail++;
}

namespace uart {

void begin() {
  UBRR0 = UBRR_VALUE;
#if USE_2X
  UCSR0A = _BV(U2X0);
#else
  UCSR0A = 0;
#endif
  UCSR0C = _BV(UCSZ01) | _BV(UCSZ00); /* 8N1 */
  UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);
}

bool send(const uint8_t *bytes, uint8_t count, uint8_t keep_free) {
  const uint8_t room = uint8_t(tx_tail - tx_head - 1);
  if (uint16_t(count) + keep_free > room)
    return false;
  uint8_t head = tx_head;
  while (count--)
    tx_ring[head++] = *bytes++;
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    tx_head = head;
    UCSR0B |= _BV(UDRIE0);
  }
  return true;
}

int16_t receive() {
  if (rx_tail == rx_head)
    return -1;
  const uint8_t byte = rx_ring[rx_tail];
  rx_tail++;
  return byte;
}

uint16_t overflow() {
  uint16_t count;
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { count = lost; }
  return count;
}

}  // namespace uart
