#include "commands.h"

#include <Arduino.h>

#include "bno055.h"
#include "config.h"
#include "i2c_bus.h"
#include "imu_set.h"
#include "multiplexer.h"
#include "packets.h"
#include "statistics.h"
#include "sweep.h"
#include "uart.h"

namespace commands {
namespace {

/* A command about offsets is answered when the chip has been through CONFIG mode. */
struct {
  bool active;
  uint8_t code, token, channel;
} pending;

framing_decoder_t decoder;
uint8_t body[FRAMING_MAX_BODY];

void send(uint8_t length) {
  uint8_t frame[FRAMING_MAX_FRAME];
  if (!uart::send(frame, framing_encode(body, length, frame)))
    saturating_increment(statistics.tx_dropped);
}

void reply(const command_t &command, result_t result) { send(packets_reply(body, command.code, command.token, result)); }

void hello(const command_t &command) {
  const uint8_t channels = multiplexer::scan(imu_set::running());
  send(packets_hello_reply(body, command.token, FIRMWARE_MAJOR, FIRMWARE_MINOR, channels, millis()));
}

result_t configure(const uint8_t *arguments) {
  const uint8_t mask = arguments[0], rate_hz = arguments[1], mode = arguments[2], slow = arguments[3];
  const bool mode_known =
      mode == bno055::RAW || mode == bno055::IMU || mode == bno055::NDOF_FMC_OFF || mode == bno055::NDOF;
  if (rate_hz < 1 || rate_hz > 100 || !mode_known || slow > 1)
    return RESULT_BAD_ARGUMENT;
  i2c::set_slow(slow);
  sweep::set_rate(rate_hz);
  imu_set::configure(mask, mode);
  return RESULT_OK;
}

result_t stream(const uint8_t *arguments) {
  if (arguments[0] & ~(STREAM_QUATERNIONS | STREAM_ACCELERATION | STREAM_RAW | STREAM_MAGNETOMETER))
    return RESULT_BAD_ARGUMENT;
  sweep::set_stream(arguments[0]);
  return RESULT_OK;
}

void statistics_reply(const command_t &command) {
  statistics.rx_overflow = uart::overflow();
  send(packets_statistics_reply(body, command.token, &statistics));
}

/* The commands about one IMU, whose first argument is its channel. */
void about_imu(const command_t &command) {
  const uint8_t channel = command.arguments[0];
  if (channel >= CHANNELS)
    return reply(command, RESULT_BAD_ARGUMENT);
  if (pending.active)
    return reply(command, RESULT_BUSY);

  Imu &imu = imu_set::at(channel);
  const bool in_use = imu_set::mask() >> channel & 1;
  const uint8_t *offsets = command.arguments + 1;
  if (!in_use) {
    if (command.code == COMMAND_WRITE_OFFSETS)
      imu.keep_offsets(offsets);
    return reply(command, RESULT_ABSENT);
  }
  if (command.code == COMMAND_RESET_IMU)
    return reply(command, imu.reset());

  const result_t begun = command.code == COMMAND_WRITE_OFFSETS ? imu.write_offsets(offsets) : imu.read_offsets();
  if (begun != RESULT_OK)
    return reply(command, begun);
  pending.active = true;
  pending.code = command.code;
  pending.token = command.token;
  pending.channel = channel;
}

void answer_pending() {
  result_t result;
  if (!pending.active || !imu_set::at(pending.channel).job_done(result))
    return;
  pending.active = false;
  if (pending.code == COMMAND_READ_OFFSETS && result == RESULT_OK)
    send(packets_offsets_reply(body, pending.token, Imu::offsets_read));
  else
    send(packets_reply(body, pending.code, pending.token, result));
}

void execute(const command_t &command) {
  if (command.code == COMMAND_HELLO) /* whatever its version: the PC learns from the answer which versions met */
    return hello(command);
  if (command.version != PROTOCOL_VERSION)
    return reply(command, RESULT_BAD_ARGUMENT);
  switch (command.code) {
    case COMMAND_CONFIGURE:
      return reply(command, configure(command.arguments));
    case COMMAND_STREAM:
      return reply(command, stream(command.arguments));
    case COMMAND_WRITE_OFFSETS:
    case COMMAND_READ_OFFSETS:
    case COMMAND_RESET_IMU:
      return about_imu(command);
    case COMMAND_STATS:
      return statistics_reply(command);
    default:
      return reply(command, RESULT_BAD_ARGUMENT);
  }
}

}  // namespace

void poll() {
  answer_pending();
  for (int16_t byte = uart::receive(); byte >= 0; byte = uart::receive()) {
    const uint8_t *received;
    uint8_t length;
    const framing_event_t event = framing_feed(&decoder, uint8_t(byte), &received, &length);
    command_t command;
    if (event == FRAMING_BODY && packets_command(&command, received, length))
      execute(command);
    else if (event != FRAMING_INCOMPLETE)
      saturating_increment(statistics.rx_bad);
  }
}

}  // namespace commands
