/* Frames on the serial line: body, CRC-16/CCITT-FALSE, COBS, 0x00 (PROTOCOL.md). Compiles for the board and for the host. */
#ifndef SESA2_FRAMING_H
#define SESA2_FRAMING_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
  FRAMING_MAX_BODY = 115,                                    /* a RAW packet of eight IMUs */
  FRAMING_MAX_FRAME = 1 + FRAMING_MAX_BODY + 2 + 1,          /* COBS code, body, CRC, delimiter */
  FRAMING_MAX_RECEIVED = 48                                  /* WRITE_OFFSETS, the longest command, takes 28 bytes */
};

uint16_t framing_crc(const uint8_t *bytes, uint8_t length);

/* Encodes a body of at most FRAMING_MAX_BODY bytes; returns the length of the frame, delimiter included. */
uint8_t framing_encode(const uint8_t *body, uint8_t length, uint8_t frame[FRAMING_MAX_FRAME]);

/* Collects one received frame. All zero is its initial state. */
typedef struct {
  uint8_t bytes[FRAMING_MAX_RECEIVED];
  uint8_t length;
  bool overlong;
} framing_decoder_t;

typedef enum { FRAMING_INCOMPLETE, FRAMING_BODY, FRAMING_BAD } framing_event_t;

/* Takes one received byte. On FRAMING_BODY, *body and *length are the checked body, valid until the next call. */
framing_event_t framing_feed(framing_decoder_t *decoder, uint8_t byte, const uint8_t **body, uint8_t *length);

#ifdef __cplusplus
}
#endif
#endif
