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

/* Reads the calibration scores of one IMU that runs, in turn: of all in each sweep would cost a fifth of it. */
void refresh_one_calibration();

}  // namespace imu_set

#endif
