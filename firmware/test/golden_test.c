/* Checks the board's framing and packets against golden_packets.txt: what the board sends is encoded from its fields and
   compared with the frame, what it receives is decoded from the frame and compared with the fields. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "framing.h"
#include "packets.h"

enum { MAX_FIELDS = 24, MAX_VALUE = 800, MAX_BYTES = 256 };

typedef struct {
  char name[64];
  unsigned count;
  struct {
    char key[32], value[MAX_VALUE];
  } fields[MAX_FIELDS];
} packet_t;

static unsigned checked, failed;

static void check(const packet_t *packet, bool passed, const char *what) {
  checked++;
  if (passed)
    return;
  failed++;
  printf("%s: %s\n", packet->name, what);
}

static const char *field(const packet_t *packet, const char *key) {
  for (unsigned i = 0; i < packet->count; i++)
    if (strcmp(packet->fields[i].key, key) == 0)
      return packet->fields[i].value;
  return NULL;
}

/* The numbers of a field that must be there. */
static unsigned numbers(const packet_t *packet, const char *key, long *values, unsigned most) {
  const char *text = field(packet, key);
  if (!text) {
    printf("%s: has no field %s\n", packet->name, key);
    exit(1);
  }
  unsigned count = 0;
  for (char *end; count < most; text = end) {
    const long value = strtol(text, &end, 0);
    if (end == text)
      break;
    values[count++] = value;
  }
  return count;
}

static long number(const packet_t *packet, const char *key) {
  long value = 0;
  numbers(packet, key, &value, 1);
  return value;
}

static unsigned hexadecimal(const packet_t *packet, const char *key, uint8_t *bytes) {
  const char *text = field(packet, key);
  unsigned count = 0;
  for (char *end; text && count < MAX_BYTES; text = end) {
    const unsigned long value = strtoul(text, &end, 16);
    if (end == text)
      break;
    bytes[count++] = (uint8_t)value;
  }
  return count;
}

/* ---- what the board sends ---- */
static const struct {
  const char *kind;
  unsigned numbers; /* of an IMU */
  uint8_t (*encode)(uint8_t *body, const sweep_t *sweep);
} SWEEPS[] = {
    {"DATA", 6, packets_data},
    {"ACCELERATION", 3, packets_acceleration},
    {"RAW", 7, packets_raw},
    {"MAGNETOMETER", 3, packets_magnetometer},
};
enum { DATA, ACCELERATION, RAW, MAGNETOMETER, SWEEP_KINDS };

static unsigned sweep_kind(const char *kind) {
  unsigned which = 0;
  while (which < SWEEP_KINDS && strcmp(kind, SWEEPS[which].kind) != 0)
    which++;
  return which;
}

static void take_words(int16_t *words, const long *values, unsigned count) {
  for (unsigned i = 0; i < count; i++)
    words[i] = values[i];
}

static void read_sweep(const packet_t *packet, sweep_t *sweep, unsigned kind) {
  memset(sweep, 0, sizeof *sweep);
  sweep->sequence = number(packet, "seq");
  sweep->start_us = number(packet, "t_us");
  sweep->duration_us = number(packet, "scan_us");
  sweep->mask = number(packet, "mask");
  for (unsigned channel = 0; channel < CHANNELS; channel++) {
    char key[] = "imu0";
    long values[8];
    key[3] += channel;
    if (!(sweep->mask >> channel & 1))
      continue;
    imu_sample_t *sample = &sweep->samples[channel];
    check(packet, numbers(packet, key, values, 8) == SWEEPS[kind].numbers, "an IMU with too few or too many numbers");
    if (kind == DATA || kind == RAW)
      sample->health = values[0];
    if (kind == DATA) {
      sample->calibration = values[1];
      take_words(sample->quaternion, values + 2, 4);
    } else if (kind == ACCELERATION) {
      take_words(sample->acceleration, values, 3);
    } else if (kind == RAW) {
      take_words(sample->angular_velocity, values + 1, 3);
      take_words(sample->acceleration, values + 4, 3);
    } else {
      take_words(sample->magnetic_field, values, 3);
    }
  }
}

static uint8_t encode_stats(const packet_t *packet, uint8_t *body, uint8_t token) {
  long comebacks[CHANNELS], errors[CHANNELS];
  statistics_t statistics = {
      .sweeps = number(packet, "sweeps"),
      .late = number(packet, "late"),
      .max_scan_us = number(packet, "max_scan_us"),
      .bus_recoveries = number(packet, "bus_recoveries"),
      .rx_bad = number(packet, "rx_bad"),
      .rx_overflow = number(packet, "rx_overflow"),
      .tx_dropped = number(packet, "tx_dropped"),
      .reset_cause = number(packet, "reset_cause"),
  };
  numbers(packet, "comebacks", comebacks, CHANNELS);
  numbers(packet, "errors", errors, CHANNELS);
  for (unsigned k = 0; k < CHANNELS; k++) {
    statistics.comebacks[k] = comebacks[k];
    statistics.errors[k] = errors[k];
  }
  return packets_statistics_reply(body, token, &statistics);
}

static uint8_t encode_reply(const packet_t *packet, uint8_t *body) {
  const uint8_t code = number(packet, "cmd"), token = number(packet, "token"), result = number(packet, "result");
  uint8_t offsets[MAX_BYTES];
  if (result != RESULT_OK)
    return packets_reply(body, code, token, result);
  switch (code) {
    case COMMAND_HELLO:
      return packets_hello_reply(body, token, number(packet, "firmware_major"), number(packet, "firmware_minor"),
                                 number(packet, "channels"), number(packet, "uptime_ms"));
    case COMMAND_READ_OFFSETS:
      check(packet, hexadecimal(packet, "offsets", offsets) == OFFSETS_SIZE, "offsets of another size");
      return packets_offsets_reply(body, token, offsets);
    case COMMAND_STATS:
      return encode_stats(packet, body, token);
    default:
      return packets_reply(body, code, token, result);
  }
}

static void check_sent(const packet_t *packet, const char *kind, const uint8_t *expected, unsigned expected_length) {
  sweep_t sweep;
  uint8_t body[FRAMING_MAX_BODY], frame[FRAMING_MAX_FRAME], length;
  const unsigned which = sweep_kind(kind);
  if (which == SWEEP_KINDS) {
    length = encode_reply(packet, body);
  } else {
    read_sweep(packet, &sweep, which);
    length = SWEEPS[which].encode(body, &sweep);
  }
  const unsigned frame_length = framing_encode(body, length, frame);
  check(packet, frame_length == expected_length && memcmp(frame, expected, expected_length) == 0, "encodes to another frame");
}

/* ---- what the board receives ---- */
static framing_event_t feed(framing_decoder_t *decoder, const uint8_t *bytes, unsigned count, const uint8_t **body, uint8_t *length) {
  framing_event_t event = FRAMING_INCOMPLETE;
  for (unsigned i = 0; i < count && event == FRAMING_INCOMPLETE; i++)
    event = framing_feed(decoder, bytes[i], body, length);
  return event;
}

static void check_received(const packet_t *packet, const char *kind, const uint8_t *frame, unsigned frame_length) {
  static framing_decoder_t decoder; /* one for all, as on the board: damage must not outlive its frame */
  uint8_t arguments[MAX_BYTES];
  const uint8_t *body;
  uint8_t length;
  command_t command;
  const framing_event_t event = feed(&decoder, frame, frame_length, &body, &length);
  if (strcmp(kind, "BAD_FRAME") == 0)
    return check(packet, event == FRAMING_BAD, "is accepted");
  check(packet, event == FRAMING_BODY, "is not accepted");
  if (event != FRAMING_BODY)
    return;
  const bool is_command = packets_command(&command, body, length);
  if (strcmp(kind, "BAD_REQUEST") == 0)
    return check(packet, !is_command, "is taken for a command");
  const unsigned count = hexadecimal(packet, "arguments", arguments);
  check(packet, is_command, "is not taken for a command");
  check(packet, command.code == number(packet, "cmd"), "another command");
  check(packet, command.version == number(packet, "version"), "another version");
  check(packet, command.token == number(packet, "token"), "another token");
  check(packet, command.length == count && memcmp(command.arguments, arguments, count) == 0, "other arguments");
}

static void check_packet(const packet_t *packet) {
  uint8_t frame[MAX_BYTES];
  if (!packet->name[0])
    return;
  const char *kind = field(packet, "kind");
  const unsigned length = hexadecimal(packet, "frame", frame);
  check(packet, kind && length, "no kind or no frame");
  if (!kind || !length)
    return;
  if (sweep_kind(kind) < SWEEP_KINDS || strcmp(kind, "REPLY") == 0)
    check_sent(packet, kind, frame, length);
  else
    check_received(packet, kind, frame, length);
}

int main(int argc, char **argv) {
  static packet_t packet;
  char line[1024];
  FILE *file = argc == 2 ? fopen(argv[1], "r") : NULL;
  if (!file) {
    fprintf(stderr, "usage: %s golden_packets.txt\n", argv[0]);
    return 2;
  }
  while (fgets(line, sizeof line, file)) {
    line[strcspn(line, "\n")] = 0;
    char *equals = strstr(line, " = ");
    if (line[0] == '[') {
      check_packet(&packet);
      memset(&packet, 0, sizeof packet);
      sscanf(line, "[%63[^]]", packet.name);
    } else if (line[0] != '#' && equals && packet.count < MAX_FIELDS) {
      *equals = 0;
      snprintf(packet.fields[packet.count].key, sizeof packet.fields->key, "%.31s", line);
      snprintf(packet.fields[packet.count++].value, MAX_VALUE, "%.799s", equals + 3);
    }
  }
  check_packet(&packet);
  fclose(file);
  printf("golden packets: %u checks, %u failed\n", checked, failed);
  return failed || checked < 50;
}
