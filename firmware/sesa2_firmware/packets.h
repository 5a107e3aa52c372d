/* The bodies of PROTOCOL.md, byte for byte. Compiles for the board and for the host. */
#ifndef SESA2_PACKETS_H
#define SESA2_PACKETS_H

#include <stdbool.h>
#include <stdint.h>

#include "framing.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { PROTOCOL_VERSION = 2, CHANNELS = 8, OFFSETS_SIZE = 22 };

typedef enum { PACKET_DATA = 1, PACKET_ACCELERATION = 2, PACKET_RAW = 3, PACKET_MAGNETOMETER = 4 } packet_type_t;

typedef enum {
  COMMAND_HELLO = 10,
  COMMAND_CONFIGURE,
  COMMAND_STREAM,
  COMMAND_WRITE_OFFSETS,
  COMMAND_READ_OFFSETS,
  COMMAND_RESET_IMU,
  COMMAND_STATS
} command_code_t;

typedef enum { RESULT_OK, RESULT_BAD_ARGUMENT, RESULT_ABSENT, RESULT_BUSY, RESULT_I2C_ERROR } result_t;

typedef enum { STATE_ABSENT, STATE_TO_CONFIG, STATE_TO_NDOF, STATE_RUN } imu_state_t;

enum { STREAM_QUATERNIONS = 1, STREAM_ACCELERATION = 2, STREAM_RAW = 4, STREAM_MAGNETOMETER = 8 };

/* What "not measured" looks like. */
enum { NO_QUATERNION = 0, NO_VECTOR = -32768 };

typedef struct {
  uint8_t health;         /* errors << 4 | state */
  uint8_t calibration;    /* register 0x35 */
  int16_t quaternion[4];  /* w x y z, 2^14 is one */
  int16_t acceleration[3];
  int16_t magnetic_field[3];
  int16_t angular_velocity[3];
} imu_sample_t;

typedef struct {
  uint16_t sequence;
  uint32_t start_us;
  uint16_t duration_us;
  uint8_t mask;
  imu_sample_t samples[CHANNELS]; /* by channel; those outside the mask are not sent */
} sweep_t;

typedef struct {
  uint32_t sweeps;
  uint32_t late;
  uint16_t max_scan_us;
  uint16_t bus_recoveries;
  uint16_t rx_bad;
  uint16_t rx_overflow;
  uint16_t tx_dropped;
  uint8_t reset_cause;
  uint8_t comebacks[CHANNELS];
  uint16_t errors[CHANNELS];
} statistics_t;

typedef struct {
  uint8_t code;
  uint8_t version;
  uint8_t token;
  const uint8_t *arguments;
  uint8_t length; /* of the arguments */
} command_t;

/* Each writes a body and returns its length. */
uint8_t packets_data(uint8_t *body, const sweep_t *sweep);
uint8_t packets_acceleration(uint8_t *body, const sweep_t *sweep);
uint8_t packets_raw(uint8_t *body, const sweep_t *sweep);
uint8_t packets_magnetometer(uint8_t *body, const sweep_t *sweep);
uint8_t packets_reply(uint8_t *body, uint8_t code, uint8_t token, result_t result);
uint8_t packets_hello_reply(uint8_t *body, uint8_t token, uint8_t major, uint8_t minor, uint8_t channels,
                            uint32_t uptime_ms);
uint8_t packets_offsets_reply(uint8_t *body, uint8_t token, const uint8_t offsets[OFFSETS_SIZE]);
uint8_t packets_statistics_reply(uint8_t *body, uint8_t token, const statistics_t *statistics);

/* Whether a body is a command. Its arguments point into the body. A command of this version must have the length of
   its code; one of another version is let through, for the board must answer it, and so is an unknown code. */
bool packets_command(command_t *command, const uint8_t *body, uint8_t length);

#ifdef __cplusplus
}
#endif
#endif
