/* The decoder under fire: random bytes, and every frame with every one-bit and many two-bit damages. It must neither read
   past its buffers (the sanitizers watch) nor accept what was not sent. Deterministic. */
#include <stdio.h>
#include <string.h>

#include "framing.h"
#include "packets.h"

enum { RANDOM_BYTES = 20000000, BODIES = 2000 };

static uint32_t state = 2024;

static uint32_t next_random(void) { /* xorshift32 */
  state ^= state << 13;
  state ^= state >> 17;
  state ^= state << 5;
  return state;
}

static unsigned failed;

static void check(bool passed, const char *what) {
  if (!passed && failed++ < 10)
    printf("%s\n", what);
}

static framing_event_t feed(framing_decoder_t *decoder, const uint8_t *bytes, unsigned count, const uint8_t **body, uint8_t *length) {
  framing_event_t event = FRAMING_INCOMPLETE;
  for (unsigned i = 0; i < count; i++) {
    const framing_event_t now = framing_feed(decoder, bytes[i], body, length);
    if (now != FRAMING_INCOMPLETE)
      event = now;
  }
  return event;
}

/* Few delimiters, many delimiters, few values: each finds other corners. */
static void random_bytes(void) {
  framing_decoder_t decoder = {0};
  unsigned accepted = 0, frames = 0;
  for (unsigned i = 0; i < RANDOM_BYTES; i++) {
    const uint32_t random = next_random();
    const unsigned flavour = i >> 12 & 3;
    const uint8_t byte = flavour == 0 ? random : flavour == 1 ? random % 8 : flavour == 2 ? random % 32 * 8 : random | 1;
    const uint8_t *body;
    uint8_t length;
    command_t command;
    const framing_event_t event = framing_feed(&decoder, byte, &body, &length);
    frames += event != FRAMING_INCOMPLETE;
    accepted += event == FRAMING_BODY && packets_command(&command, body, length);
  }
  printf("random bytes: %d, frames among them %u, taken for commands %u\n", RANDOM_BYTES, frames, accepted);
  check(accepted <= frames / 20000, "random bytes are taken for commands more often than a CRC of 16 bits explains");
}

static void round_trips(void) {
  unsigned damaged = 0, accepted = 0;
  for (unsigned n = 0; n < BODIES; n++) {
    uint8_t body[FRAMING_MAX_RECEIVED], frame[FRAMING_MAX_FRAME];
    const uint8_t size = 1 + next_random() % 25;
    for (unsigned i = 0; i < size; i++)
      body[i] = n % 3 ? next_random() : next_random() % 2;
    const uint8_t frame_size = framing_encode(body, size, frame);
    framing_decoder_t decoder = {0};
    const uint8_t *received;
    uint8_t length;
    check(memchr(frame, 0, frame_size) == frame + frame_size - 1, "a frame with a delimiter inside");
    const bool intact = feed(&decoder, frame, frame_size, &received, &length) == FRAMING_BODY;
    check(intact && length == size && memcmp(received, body, size) == 0, "a round trip that changes the body");
    for (unsigned bit = 0; bit < 8u * (frame_size - 1); bit++) {
      frame[bit / 8] ^= 1 << bit % 8;
      damaged++;
      accepted += feed(&decoder, frame, frame_size, &received, &length) == FRAMING_BODY;
      frame[bit / 8] ^= 1 << bit % 8;
    }
    check(feed(&decoder, frame, frame_size, &received, &length) == FRAMING_BODY, "damage that outlives its frame");
  }
  printf("one-bit damages: %u, accepted %u\n", damaged, accepted);
  /* A damaged COBS code byte changes two bytes of the packet at once; the CRC lets 2^-16 of such through. */
  check(accepted <= damaged / 20000, "damaged frames are accepted more often than a CRC of 16 bits explains");
}

int main(void) {
  random_bytes();
  round_trips();
  if (failed)
    printf("framing: %u failed\n", failed);
  return failed != 0;
}
