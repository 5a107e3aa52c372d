/* UART0, the USB serial port, driven by interrupts.

   Arduino's Serial loses bytes silently when its 64-byte buffer is full, and waits when that for sending is; here
   what is lost is counted and nothing waits. */
#ifndef SESA2_UART_H
#define SESA2_UART_H

#include <stdint.h>

namespace uart {

void begin();

/* Queues all the bytes, or none if fewer than `keep_free` bytes of the buffer were left. */
bool send(const uint8_t *bytes, uint8_t count, uint8_t keep_free = 0);

/* The next received byte, or -1. */
int16_t receive();

/* Received bytes lost so far, saturating. */
uint16_t overflow();

}  // namespace uart

#endif
