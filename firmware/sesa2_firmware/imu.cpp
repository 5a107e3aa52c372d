#include "imu.h"

#include <Arduino.h>
#include <string.h>

#include "bno055.h"
#include "multiplexer.h"
#include "statistics.h"

namespace {

constexpr uint8_t SEARCH_MS = 10;       /* between two looks for an absent chip */
constexpr uint8_t SEARCH_STUCK_MS = 250; /* where looking hangs the bus: that costs the other IMUs time */
constexpr uint8_t RETRY_MS = 2;
constexpr uint8_t MAX_FAILURES = 2;       /* one after another, until a chip counts as unplugged */
constexpr uint8_t MAX_OFFSET_ATTEMPTS = 3;
constexpr uint8_t MAX_ERRORS = 15;        /* what four bits hold */

bool is_due(uint16_t due_ms) { return int16_t(uint16_t(millis()) - due_ms) >= 0; }

}  // namespace

uint8_t Imu::offsets_read[OFFSETS_SIZE];

imu_state_t Imu::state() const {
  switch (stage_) {
    case SEARCHING:
      return STATE_ABSENT;
    case START_FUSION:
    case ENTER_FUSION:
      return STATE_TO_NDOF;
    case RUNNING:
      return STATE_RUN;
    default:
      return STATE_TO_CONFIG;
  }
}

void Imu::go(Stage stage, uint8_t wait_ms) {
  stage_ = stage;
  due_ms_ = uint16_t(millis()) + wait_ms + (wait_ms != 0); /* the first millisecond may already be nearly over */
}

void Imu::configure(uint8_t channel, uint8_t mode) {
  channel_ = channel;
  const bool changed = mode != mode_;
  mode_ = mode;
  if (stage_ == SEARCHING)
    go(SEARCHING);
  else if (stage_ != RUNNING)
    go(LEAVE_FUSION, bno055::TO_CONFIG_MS); /* not before the change of mode that is going on has ended */
  else if (changed)
    go(LEAVE_FUSION);
}

bool Imu::step() {
  if (stage_ == RUNNING || !is_due(due_ms_))
    return false;
  i2c::Result result = multiplexer::select(channel_);
  if (result == i2c::OK)
    result = advance();
  if (result == i2c::OK)
    failures_ = 0;
  else if (stage_ == SEARCHING)
    search_again(result);
  else
    failed(result);
  return true;
}

/* One stage. A stage whose transfer fails is tried again. */
i2c::Result Imu::advance() {
  i2c::Result result = i2c::OK;
  uint8_t mode;
  switch (stage_) {
    case SEARCHING:
      result = bno055::identify();
      if (result == i2c::OK)
        go(LEAVE_FUSION);
      break;

    case LEAVE_FUSION: /* also for a chip that has just booted: nobody knows what it was told before */
      result = bno055::select_page_0();
      if (result == i2c::OK)
        result = bno055::set_mode(bno055::CONFIG);
      if (result == i2c::OK)
        go(ENTER_CONFIG, bno055::TO_CONFIG_MS);
      break;

    case ENTER_CONFIG:
      result = bno055::read_mode(mode);
      if (result == i2c::OK && mode != bno055::CONFIG)
        return i2c::NACK;
      if (result == i2c::OK)
        result = bno055::write_axes();
      attempts_ = 0;
      if (result == i2c::OK)
        go(job_ == READ_JOB ? READ_OFFSETS : has_offsets_ ? WRITE_OFFSETS : START_FUSION);
      break;

    case WRITE_OFFSETS:
      result = bno055::write_offsets(offsets_);
      if (result == i2c::OK)
        go(VERIFY_OFFSETS);
      break;

    case VERIFY_OFFSETS:
      result = verify_offsets();
      break;

    case READ_OFFSETS:
      result = bno055::read_offsets(offsets_read);
      if (result == i2c::OK) {
        finish_job(RESULT_OK);
        go(START_FUSION);
      }
      break;

    case START_FUSION:
      result = bno055::set_mode(mode_);
      if (result == i2c::OK)
        go(ENTER_FUSION, bno055::FROM_CONFIG_MS);
      break;

    case ENTER_FUSION:
      result = bno055::read_mode(mode);
      if (result == i2c::OK && mode != mode_) {
        go(LEAVE_FUSION);
        return i2c::NACK;
      }
      if (result != i2c::OK)
        break;
      if (was_lost_)
        saturating_increment(statistics.comebacks[channel_]);
      was_lost_ = false;
      errors_ = 0;
      go(RUNNING);
      break;

    case RUNNING:
      break;
  }
  return result;
}

/* A chip that keeps refusing its offsets still runs: they are an improvement, its orientation is what it is for. */
i2c::Result Imu::verify_offsets() {
  uint8_t found[OFFSETS_SIZE];
  const i2c::Result result = bno055::read_offsets(found);
  if (result != i2c::OK)
    return result;
  const bool same = memcmp(found, offsets_, OFFSETS_SIZE) == 0;
  if (!same)
    count_error();
  if (!same && ++attempts_ < MAX_OFFSET_ATTEMPTS) {
    go(WRITE_OFFSETS);
    return i2c::OK;
  }
  finish_job(same ? RESULT_OK : RESULT_I2C_ERROR);
  go(START_FUSION);
  return i2c::OK;
}

void Imu::sample(imu_sample_t &sample, Turn turn) {
  memset(sample.quaternion, 0, sizeof sample.quaternion);
  for (uint8_t i = 0; i < 3; i++)
    sample.acceleration[i] = sample.magnetic_field[i] = sample.angular_velocity[i] = NO_VECTOR;

  if (stage_ == RUNNING) {
    i2c::Result result = read_chip(sample, turn);
    if (result == i2c::NACK) { /* a glitch on the line costs no sample */
      count_error();
      result = read_chip(sample, turn);
    }
    if (result == i2c::OK)
      failures_ = 0;
    else
      failed(result);
  }
  sample.health = health();
  sample.calibration = calibration_;
}

i2c::Result Imu::read_chip(imu_sample_t &sample, Turn turn) {
  const i2c::Result result = multiplexer::select(channel_);
  if (result != i2c::OK)
    return result;
  return mode_ == bno055::RAW ? read_raw(sample) : read_fused(sample, turn);
}

/* Zeros alone: the chip has not begun, or has lost its power for a moment and has booted unnoticed, into CONFIG. */
i2c::Result Imu::check_mode() {
  uint8_t mode;
  const i2c::Result result = bno055::read_mode(mode);
  if (result == i2c::OK && mode != mode_)
    lost();
  return result;
}

i2c::Result Imu::read_raw(imu_sample_t &sample) {
  int16_t nine[9];
  const i2c::Result result = bno055::read_raw(nine);
  if (result != i2c::OK)
    return result;
  if (!(nine[0] | nine[1] | nine[2]))
    return check_mode();
  memcpy(sample.acceleration, nine, sizeof sample.acceleration);
  memcpy(sample.magnetic_field, nine + 3, sizeof sample.magnetic_field);
  memcpy(sample.angular_velocity, nine + 6, sizeof sample.angular_velocity);
  return i2c::OK;
}

i2c::Result Imu::read_fused(imu_sample_t &sample, Turn turn) {
  int16_t quaternion[4];
  i2c::Result result = bno055::read_quaternion(quaternion);
  if (result != i2c::OK)
    return result;
  if (!(quaternion[0] | quaternion[1] | quaternion[2] | quaternion[3]))
    return check_mode();
  memcpy(sample.quaternion, quaternion, sizeof quaternion);
  if (turn.acceleration) {
    int16_t acceleration[3];
    result = bno055::read_acceleration(acceleration);
    if (result != i2c::OK)
      return result;
    memcpy(sample.acceleration, acceleration, sizeof acceleration);
  }
  return turn.calibration ? bno055::read_calibration(calibration_) : i2c::OK;
}

void Imu::count_error() {
  if (errors_ < MAX_ERRORS)
    errors_++;
  saturating_increment(statistics.errors[channel_]);
}

void Imu::search_again(i2c::Result why) {
  if (why == i2c::STUCK)
    count_error(); /* a chip that is not there is no error; a bus that hangs is */
  go(SEARCHING, why == i2c::STUCK ? SEARCH_STUCK_MS : SEARCH_MS);
}

void Imu::failed(i2c::Result why) {
  count_error();
  if (++failures_ >= MAX_FAILURES)
    lost(why == i2c::STUCK ? SEARCH_STUCK_MS : 0);
  else if (stage_ != RUNNING)
    go(stage_, RETRY_MS);
}

void Imu::lost(uint8_t wait_ms) {
  was_lost_ = true;
  calibration_ = 0;
  failures_ = 0;
  finish_job(RESULT_ABSENT);
  go(SEARCHING, wait_ms);
}

void Imu::finish_job(result_t result) {
  if (job_ != NO_JOB)
    job_result_ = result;
  job_ = NO_JOB;
}

void Imu::abandon_job() { finish_job(RESULT_ABSENT); }

bool Imu::job_done(result_t &result) const {
  result = job_result_;
  return job_ == NO_JOB;
}

void Imu::keep_offsets(const uint8_t *offsets) {
  memcpy(offsets_, offsets, OFFSETS_SIZE);
  has_offsets_ = true;
}

result_t Imu::write_offsets(const uint8_t *offsets) {
  if (stage_ != SEARCHING && stage_ != RUNNING)
    return RESULT_BUSY;
  keep_offsets(offsets);
  if (stage_ == SEARCHING)
    return RESULT_ABSENT;
  job_ = WRITE_JOB;
  go(LEAVE_FUSION);
  return RESULT_OK;
}

result_t Imu::read_offsets() {
  if (stage_ == SEARCHING)
    return RESULT_ABSENT;
  if (stage_ != RUNNING)
    return RESULT_BUSY;
  job_ = READ_JOB;
  go(LEAVE_FUSION);
  return RESULT_OK;
}

result_t Imu::reset() {
  if (stage_ == SEARCHING)
    return RESULT_ABSENT;
  if (stage_ != RUNNING)
    return RESULT_BUSY;
  if (multiplexer::select(channel_) != i2c::OK || bno055::reset() != i2c::OK) {
    count_error();
    return RESULT_I2C_ERROR;
  }
  lost(bno055::RESET_MS);
  return RESULT_OK;
}
