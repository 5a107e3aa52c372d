#include "sweep.h"

#include <Arduino.h>

#include "imu_set.h"
#include "packets.h"
#include "statistics.h"
#include "uart.h"

namespace sweep {
namespace {

constexpr uint32_t LATE_US = 1000;
constexpr int32_t STEP_US = 1500; /* what one step of an IMU may take at 400 kHz, with some to spare */

constexpr uint8_t KEPT_FOR_REPLIES = 64; /* on a line too slow for the stream the board can still be told to stop it */

uint32_t period_us, next_us;
uint8_t stream;
sweep_t current;

void send(const uint8_t *body, uint8_t length) {
  uint8_t frame[FRAMING_MAX_FRAME];
  if (!uart::send(frame, framing_encode(body, length, frame), KEPT_FOR_REPLIES))
    saturating_increment(statistics.tx_dropped);
}

void run() {
  current.mask = imu_set::mask();
  current.start_us = micros();
  /* The scores of one IMU a sweep, in turn: those of all in each would lengthen it by a quarter. */
  const uint8_t scored = imu_set::next_running();
  for (uint8_t channel = 0; channel < CHANNELS; channel++)
    if (current.mask >> channel & 1)
      imu_set::at(channel).sample(current.samples[channel], {bool(stream & STREAM_ACCELERATION), channel == scored});
  const uint32_t duration_us = micros() - current.start_us;
  current.duration_us = duration_us < UINT16_MAX ? uint16_t(duration_us) : UINT16_MAX;

  if (current.duration_us > statistics.max_scan_us)
    statistics.max_scan_us = current.duration_us;
  statistics.sweeps++;

  uint8_t body[FRAMING_MAX_BODY];
  if (stream & STREAM_QUATERNIONS)
    send(body, packets_data(body, &current));
  if (stream & STREAM_ACCELERATION)
    send(body, packets_acceleration(body, &current));
  if (stream & STREAM_RAW)
    send(body, packets_raw(body, &current));
  if (stream & STREAM_MAGNETOMETER)
    send(body, packets_magnetometer(body, &current));
  current.sequence++;
}

}  // namespace

void set_rate(uint8_t rate_hz) {
  const uint32_t period = 1000000UL / rate_hz;
  if (period != period_us)
    next_us = micros();
  period_us = period;
}

void set_stream(uint8_t flags) { stream = flags; }

void poll() {
  if (!imu_set::mask()) {
    next_us = micros(); /* left alone for half of micros()'s range it would lie in the future */
    return;
  }
  const int32_t left_us = int32_t(next_us - micros());
  if (left_us > 0) {
    if (left_us > STEP_US)
      imu_set::step_one();
    return;
  }
  const uint32_t behind_us = uint32_t(-left_us);
  if (behind_us > LATE_US)
    statistics.late++;
  /* After a pause longer than a period the missed sweeps are left out, not caught up with. */
  next_us += behind_us < period_us ? period_us : behind_us + period_us;
  run();
  imu_set::step_one(); /* even where sweeps fill all the time */
}

}  // namespace sweep
