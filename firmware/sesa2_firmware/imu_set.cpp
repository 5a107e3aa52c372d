#include "imu_set.h"

namespace imu_set {
namespace {

Imu imus[CHANNELS];
uint8_t in_use;
uint8_t step_turn, running_turn;

uint8_t next(uint8_t channel) { return (channel + 1) % CHANNELS; }

}  // namespace

void configure(uint8_t mask, uint8_t mode) {
  for (uint8_t channel = 0; channel < CHANNELS; channel++)
    if (mask >> channel & 1)
      imus[channel].configure(channel, mode);
    else
      imus[channel].abandon_job();
  in_use = mask;
}

uint8_t mask() { return in_use; }

Imu &at(uint8_t channel) { return imus[channel]; }

uint8_t running() {
  uint8_t channels = 0;
  for (uint8_t channel = 0; channel < CHANNELS; channel++)
    if ((in_use >> channel & 1) && imus[channel].state() == STATE_RUN)
      channels |= uint8_t(1 << channel);
  return channels;
}

void step_one() {
  for (uint8_t tried = 0; tried < CHANNELS; tried++) {
    step_turn = next(step_turn);
    if ((in_use >> step_turn & 1) && imus[step_turn].step())
      return;
  }
}

uint8_t next_running() {
  const uint8_t channels = running();
  for (uint8_t tried = 0; tried < CHANNELS; tried++) {
    running_turn = next(running_turn);
    if (channels >> running_turn & 1)
      return running_turn;
  }
  return CHANNELS;
}

}  // namespace imu_set
