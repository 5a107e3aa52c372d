/* The I2C bus: register reads and writes that always return, and recovery of a stuck bus. */
#ifndef SESA2_I2C_BUS_H
#define SESA2_I2C_BUS_H

#include <stdint.h>

namespace i2c {

enum Result : uint8_t {
  OK,
  NACK,  /* nobody answered, or the addressed chip refused; took well under a millisecond */
  STUCK, /* the bus hung: a line held low, or a transfer that outlasted BUS_TIMEOUT_US */
};

void begin();
void set_slow(bool slow); /* 100 kHz, else 400 kHz */

Result send(uint8_t address, uint8_t byte);
Result write(uint8_t address, uint8_t reg, const uint8_t *bytes, uint8_t count);
Result read(uint8_t address, uint8_t reg, uint8_t *bytes, uint8_t count);

}  // namespace i2c

#endif
