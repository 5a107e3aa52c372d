/* A BNO055 as seen through its registers: boot, modes and the time they take to change, what is readable in which.
   Facts: Bosch BST-BNO055-DS000. Stricter than the chip: what the datasheet forbids is counted. */
#ifndef SIMULATOR_BNO055_H
#define SIMULATOR_BNO055_H

#include <stdbool.h>
#include <stdint.h>

enum { BNO055_ADDRESS = 0x28, BNO055_REGISTERS = 128 };

typedef struct {
  /* what the world does to it */
  int16_t quaternion[4];     /* w x y z, raw */
  int16_t acceleration[3];   /* 100 is 1 m/s2 */
  int16_t magnetic_field[3]; /* 16 is 1 uT */
  int16_t angular_velocity[3]; /* 16 is 1 degree a second */
  uint8_t calibration;
  bool pattern;              /* quaternions follow bno055_pattern() instead, and in the mode AMG all of bno055_raw_pattern() */
  uint32_t stretch_us;       /* clock stretching before each read */
  unsigned glitches;         /* so many of the next addressings go unacknowledged */
  bool refuses_offsets;      /* what is written there does not stick */

  /* its state */
  bool powered;
  uint64_t booted_us;
  uint8_t registers[BNO055_REGISTERS];
  uint8_t page, pointer;
  bool pointer_follows;      /* the next written byte is the register pointer */
  uint8_t mode, next_mode;
  uint64_t mode_settles_us;
  unsigned phase_us;         /* of its 100 Hz output */

  unsigned boots;
  unsigned violations;       /* writes that the datasheet forbids at that time, reads of what is not readable */
} bno055_t;

void bno055_init(bno055_t *chip, unsigned index);
void bno055_power(bno055_t *chip, bool on, uint64_t now_us);

/* The test pattern: a rotation about x, y or z that advances by 2 pi / 997 with every tick of 10 ms. */
void bno055_pattern(int16_t wxyz[4], unsigned index, uint64_t tick);

/* What the three sensors measure in that motion, in register order: acceleration, magnetic field, angular velocity. z of
   the earth frame is up and y north. */
void bno055_raw_pattern(int16_t nine[9], unsigned index, uint64_t tick);

/* As an I2C target. */
bool bno055_address(bno055_t *chip, bool read, uint64_t now_us); /* whether it acknowledges */
void bno055_write(bno055_t *chip, uint8_t byte, uint64_t now_us);
uint8_t bno055_read(bno055_t *chip);

#endif
