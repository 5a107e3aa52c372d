/* The IMUs in use: which channels, in which mode, and whose turn it is. */
#ifndef SESA2_IMU_SET_H
#define SESA2_IMU_SET_H

#include "imu.h"

namespace imu_set {

void configure(uint8_t mask, uint8_t mode);
uint8_t mask();
Imu &at(uint8_t channel);

/* The channels of the mask whose chips run. */
uint8_t running();

/* Gives one IMU that does not run its next step, in turn. */
void step_one();

/* The channel of the next IMU that runs, in turn; CHANNELS if none does. */
uint8_t next_running();

}  // namespace imu_set

#endif
