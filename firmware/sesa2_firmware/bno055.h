/* The registers of the BNO055 on the selected channel (Bosch BST-BNO055-DS000, section 4). One transfer a call. */
#ifndef SESA2_BNO055_H
#define SESA2_BNO055_H

#include "i2c_bus.h"

namespace bno055 {

/* RAW is the datasheet's AMG: all nine axes as they are measured, uncompensated, and no fusion. The rest fuse. */
enum Mode : uint8_t { CONFIG = 0x00, RAW = 0x07, IMU = 0x08, NDOF_FMC_OFF = 0x0B, NDOF = 0x0C };

/* How long a change of mode takes (datasheet table 3-6: 19 and 7 ms), with a margin for the chip's own oscillator. */
constexpr uint8_t TO_CONFIG_MS = 22;
constexpr uint8_t FROM_CONFIG_MS = 9;
constexpr uint8_t RESET_MS = 30; /* until a chip that was told to reset no longer answers; it boots for 650 ms */

i2c::Result identify(); /* OK only if it is a BNO055 that has booted */
i2c::Result select_page_0();
i2c::Result reset();
i2c::Result set_mode(uint8_t mode);
i2c::Result read_mode(uint8_t &mode);
i2c::Result write_axes(); /* CONFIG only, as are the offsets */
i2c::Result write_offsets(const uint8_t *offsets);
i2c::Result read_offsets(uint8_t *offsets);
i2c::Result read_quaternion(int16_t *wxyz);
i2c::Result read_acceleration(int16_t *xyz);

/* Acceleration, magnetic field and angular velocity, x y z each: neighbours in the chip, so that one transfer reads them. */
i2c::Result read_raw(int16_t *nine);
i2c::Result read_calibration(uint8_t &scores);

}  // namespace bno055

#endif
