#include "bno055.h"

#include "config.h"
#include "packets.h"

namespace bno055 {
namespace {

enum Register : uint8_t {
  CHIP_ID = 0x00,
  PAGE_ID = 0x07,
  ACCELERATION = 0x08, /* the magnetic field follows at 0x0E, the angular velocity at 0x14 */
  QUATERNION = 0x20,
  CALIBRATION = 0x35,
  OPERATION_MODE = 0x3D,
  SYSTEM_TRIGGER = 0x3F,
  AXIS_MAP = 0x41, /* its sign follows at 0x42 */
  OFFSETS = 0x55,
};

constexpr uint8_t CHIP_ID_VALUE = 0xA0;
constexpr uint8_t RESET_SYSTEM = 0x20;

i2c::Result write(uint8_t reg, uint8_t value) { return i2c::write(config::BNO055_ADDRESS, reg, &value, 1); }

i2c::Result read(uint8_t reg, uint8_t *bytes, uint8_t count) { return i2c::read(config::BNO055_ADDRESS, reg, bytes, count); }

/* The chip and the AVR are both little endian. */
i2c::Result read_words(uint8_t reg, int16_t *words, uint8_t count) {
  return read(reg, reinterpret_cast<uint8_t *>(words), uint8_t(2 * count));
}

}  // namespace

i2c::Result identify() {
  uint8_t id;
  const i2c::Result result = read(CHIP_ID, &id, 1);
  return result == i2c::OK && id != CHIP_ID_VALUE ? i2c::NACK : result;
}

i2c::Result select_page_0() { return write(PAGE_ID, 0); }

i2c::Result reset() { return write(SYSTEM_TRIGGER, RESET_SYSTEM); }

i2c::Result set_mode(uint8_t mode) { return write(OPERATION_MODE, mode); }

i2c::Result read_mode(uint8_t &mode) {
  const i2c::Result result = read(OPERATION_MODE, &mode, 1);
  mode &= 0x0F;
  return result;
}

i2c::Result write_axes() {
  const uint8_t axes[] = {config::AXIS_MAP, config::AXIS_SIGN};
  return i2c::write(config::BNO055_ADDRESS, AXIS_MAP, axes, sizeof axes);
}

i2c::Result write_offsets(const uint8_t *offsets) {
  return i2c::write(config::BNO055_ADDRESS, OFFSETS, offsets, OFFSETS_SIZE);
}

i2c::Result read_offsets(uint8_t *offsets) { return read(OFFSETS, offsets, OFFSETS_SIZE); }

i2c::Result read_quaternion(int16_t *wxyz) { return read_words(QUATERNION, wxyz, 4); }

i2c::Result read_acceleration(int16_t *xyz) { return read_words(ACCELERATION, xyz, 3); }

i2c::Result read_raw(int16_t *nine) { return read_words(ACCELERATION, nine, 9); }

i2c::Result read_calibration(uint8_t &scores) { return read(CALIBRATION, &scores, 1); }

}  // namespace bno055
