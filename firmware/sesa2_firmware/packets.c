#include "packets.h"

#include <string.h>

static uint8_t *put_u16(uint8_t *at, uint16_t value) {
  *at++ = (uint8_t)value;
  *at++ = (uint8_t)(value >> 8);
  return at;
}

static uint8_t *put_u32(uint8_t *at, uint32_t value) {
  return put_u16(put_u16(at, (uint16_t)value), (uint16_t)(value >> 16));
}

static uint8_t *put_vector(uint8_t *at, const int16_t xyz[3]) {
  for (uint8_t i = 0; i < 3; i++)
    at = put_u16(at, (uint16_t)xyz[i]);
  return at;
}

static uint8_t *put_sweep_header(uint8_t *at, packet_type_t type, const sweep_t *sweep) {
  *at++ = type;
  *at++ = PROTOCOL_VERSION;
  at = put_u16(at, sweep->sequence);
  at = put_u32(at, sweep->start_us);
  at = put_u16(at, sweep->duration_us);
  *at++ = sweep->mask;
  return at;
}

uint8_t packets_data(uint8_t *body, const sweep_t *sweep) {
  uint8_t *at = put_sweep_header(body, PACKET_DATA, sweep);
  for (uint8_t channel = 0; channel < CHANNELS; channel++) {
    if (!(sweep->mask >> channel & 1))
      continue;
    const imu_sample_t *sample = &sweep->samples[channel];
    *at++ = sample->health;
    *at++ = sample->calibration;
    for (uint8_t i = 0; i < 4; i++)
      at = put_u16(at, (uint16_t)sample->quaternion[i]);
  }
  return at - body;
}

uint8_t packets_acceleration(uint8_t *body, const sweep_t *sweep) {
  uint8_t *at = put_sweep_header(body, PACKET_ACCELERATION, sweep);
  for (uint8_t channel = 0; channel < CHANNELS; channel++)
    if (sweep->mask >> channel & 1)
      at = put_vector(at, sweep->samples[channel].acceleration);
  return at - body;
}

uint8_t packets_raw(uint8_t *body, const sweep_t *sweep) {
  uint8_t *at = put_sweep_header(body, PACKET_RAW, sweep);
  for (uint8_t channel = 0; channel < CHANNELS; channel++) {
    if (!(sweep->mask >> channel & 1))
      continue;
    const imu_sample_t *sample = &sweep->samples[channel];
    *at++ = sample->health;
    at = put_vector(at, sample->angular_velocity);
    at = put_vector(at, sample->acceleration);
  }
  return at - body;
}

uint8_t packets_magnetometer(uint8_t *body, const sweep_t *sweep) {
  uint8_t *at = put_sweep_header(body, PACKET_MAGNETOMETER, sweep);
  for (uint8_t channel = 0; channel < CHANNELS; channel++)
    if (sweep->mask >> channel & 1)
      at = put_vector(at, sweep->samples[channel].magnetic_field);
  return at - body;
}

uint8_t packets_reply(uint8_t *body, uint8_t code, uint8_t token, result_t result) {
  body[0] = 0x80 | code;
  body[1] = PROTOCOL_VERSION;
  body[2] = token;
  body[3] = result;
  return 4;
}

uint8_t packets_hello_reply(uint8_t *body, uint8_t token, uint8_t major, uint8_t minor, uint8_t channels,
                            uint32_t uptime_ms) {
  uint8_t *at = body + packets_reply(body, COMMAND_HELLO, token, RESULT_OK);
  *at++ = major;
  *at++ = minor;
  *at++ = channels;
  return put_u32(at, uptime_ms) - body;
}

uint8_t packets_offsets_reply(uint8_t *body, uint8_t token, const uint8_t offsets[OFFSETS_SIZE]) {
  uint8_t *at = body + packets_reply(body, COMMAND_READ_OFFSETS, token, RESULT_OK);
  memcpy(at, offsets, OFFSETS_SIZE);
  return at + OFFSETS_SIZE - body;
}

uint8_t packets_statistics_reply(uint8_t *body, uint8_t token, const statistics_t *statistics) {
  uint8_t *at = body + packets_reply(body, COMMAND_STATS, token, RESULT_OK);
  at = put_u32(at, statistics->sweeps);
  at = put_u32(at, statistics->late);
  at = put_u16(at, statistics->max_scan_us);
  at = put_u16(at, statistics->bus_recoveries);
  at = put_u16(at, statistics->rx_bad);
  at = put_u16(at, statistics->rx_overflow);
  at = put_u16(at, statistics->tx_dropped);
  *at++ = statistics->reset_cause;
  for (uint8_t channel = 0; channel < CHANNELS; channel++)
    *at++ = statistics->comebacks[channel];
  for (uint8_t channel = 0; channel < CHANNELS; channel++)
    at = put_u16(at, statistics->errors[channel]);
  return at - body;
}

static bool length_fits(uint8_t code, uint8_t length) {
  switch (code) {
    case COMMAND_HELLO:
    case COMMAND_STATS:
      return length == 0;
    case COMMAND_CONFIGURE:
      return length == 4;
    case COMMAND_STREAM:
    case COMMAND_READ_OFFSETS:
    case COMMAND_RESET_IMU:
      return length == 1;
    case COMMAND_WRITE_OFFSETS:
      return length == 1 + OFFSETS_SIZE;
    default:
      return true;
  }
}

bool packets_command(command_t *command, const uint8_t *body, uint8_t length) {
  if (length < 3)
    return false;
  command->code = body[0];
  command->version = body[1];
  command->token = body[2];
  command->arguments = body + 3;
  command->length = length - 3;
  return command->version != PROTOCOL_VERSION || length_fits(command->code, command->length);
}
