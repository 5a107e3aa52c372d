/* One IMU: finds its chip, brings it from any state to its mode with its axes and offsets, reads it, notices when it is gone.

   Every call makes a few short transfers and returns; what takes time is waited for by coming back later, so that no
   IMU holds up another. */
#ifndef SESA2_IMU_H
#define SESA2_IMU_H

#include "i2c_bus.h"
#include "packets.h"

class Imu {
 public:
  /* Makes `mode` the one to run in; a chip that runs in another one goes through CONFIG. */
  void configure(uint8_t channel, uint8_t mode);

  /* Takes the next step towards RUN, if its time has come. Returns whether the bus was used. */
  bool step();

  /* One turn of a sweep. Leaves "not measured" in the sample unless the chip runs and answers. */
  struct Turn {
    bool acceleration, calibration; /* to be read beside the quaternion; in the mode RAW all three sensors are read */
  };
  void sample(imu_sample_t &sample, Turn turn);

  /* Commands. Each returns RESULT_BUSY, RESULT_ABSENT and so on at once, or RESULT_OK; the two about offsets have
     then only begun, and job_done() tells when they have ended, and how. */
  result_t write_offsets(const uint8_t *offsets);
  result_t read_offsets();
  result_t reset();
  bool job_done(result_t &result) const;
  void abandon_job();

  imu_state_t state() const;
  uint8_t health() const { return uint8_t(errors_ << 4 | state()); }
  uint8_t calibration() const { return calibration_; }

  /* Kept for a chip that is not there, or not in use. */
  void keep_offsets(const uint8_t *offsets);

  /* Where READ_OFFSETS leaves what it read; one command is in flight at a time. */
  static uint8_t offsets_read[OFFSETS_SIZE];

 private:
  enum Stage : uint8_t {
    SEARCHING,
    LEAVE_FUSION,
    ENTER_CONFIG,
    WRITE_OFFSETS,
    VERIFY_OFFSETS,
    READ_OFFSETS,
    START_FUSION,
    ENTER_FUSION,
    RUNNING,
  };
  enum Job : uint8_t { NO_JOB, WRITE_JOB, READ_JOB };

  i2c::Result advance();
  i2c::Result verify_offsets();
  i2c::Result read_chip(imu_sample_t &sample, Turn turn);
  i2c::Result read_fused(imu_sample_t &sample, Turn turn);
  i2c::Result read_raw(imu_sample_t &sample);
  i2c::Result check_mode();
  void go(Stage stage, uint8_t wait_ms = 0);
  void search_again(i2c::Result why);
  void count_error();
  void failed(i2c::Result why);
  void lost(uint8_t wait_ms = 0);
  void finish_job(result_t result);

  Stage stage_;
  Job job_;
  result_t job_result_;
  uint8_t channel_;
  uint8_t mode_;
  uint8_t calibration_;
  uint8_t errors_;   /* as sent: saturating at 15, cleared at RUN */
  uint8_t failures_; /* one after another */
  uint8_t attempts_; /* at writing the offsets */
  bool was_lost_;
  bool has_offsets_;
  uint8_t offsets_[OFFSETS_SIZE];
  uint16_t due_ms_;
};

#endif
