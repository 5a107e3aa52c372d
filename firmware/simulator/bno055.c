#include "bno055.h"

#include <math.h>
#include <string.h>

enum {
  BOOT_US = 650000,
  TO_CONFIG_US = 19000,
  FROM_CONFIG_US = 7000,
  OUTPUT_PERIOD_US = 10000,
  PATTERN_STEPS = 997,

  PAGE_ID = 0x07,
  ACCELERATION = 0x08,
  MAGNETIC_FIELD = 0x0E,
  ANGULAR_VELOCITY = 0x14,
  QUATERNION = 0x20,
  CALIBRATION = 0x35,
  OPERATION_MODE = 0x3D,
  SYSTEM_TRIGGER = 0x3F,
  AXIS_MAP = 0x41,
  AXIS_SIGN = 0x42,
  OFFSETS = 0x55,
  OFFSETS_END = 0x6B,

  MODE_CONFIG = 0x00,
  MODE_AMG = 0x07, /* the last that does not fuse */
  RESET_SYSTEM = 0x20
};

/* In the earth frame: 9.81 m/s2 up; 20 uT north and 45 uT down, as in middle latitudes. */
static const int16_t GRAVITY[3] = {0, 0, 981}, FIELD[3] = {0, 320, -720};

void bno055_init(bno055_t *chip, unsigned index) {
  memset(chip, 0, sizeof *chip);
  chip->quaternion[0] = 1 << 14;
  memcpy(chip->acceleration, GRAVITY, sizeof GRAVITY);
  memcpy(chip->magnetic_field, FIELD, sizeof FIELD);
  chip->phase_us = index * OUTPUT_PERIOD_US / 8;
}

static void boot(bno055_t *chip, uint64_t now_us) {
  static const uint8_t identity[] = {0xA0, 0xFB, 0x32, 0x0F, 0x11, 0x03, 0x15};
  memset(chip->registers, 0, sizeof chip->registers);
  memcpy(chip->registers, identity, sizeof identity);
  chip->registers[AXIS_MAP] = 0x24;
  chip->page = chip->pointer = 0;
  chip->mode = chip->next_mode = MODE_CONFIG;
  chip->mode_settles_us = 0;
  chip->booted_us = now_us + BOOT_US;
  chip->boots++;
}

void bno055_power(bno055_t *chip, bool on, uint64_t now_us) {
  if (on && !chip->powered)
    boot(chip, now_us);
  chip->powered = on;
}

static double pattern_half_angle(unsigned index, uint64_t tick) {
  return M_PI * (double)(tick % PATTERN_STEPS) / PATTERN_STEPS + 0.1 * index;
}

void bno055_pattern(int16_t wxyz[4], unsigned index, uint64_t tick) {
  const double half_angle = pattern_half_angle(index, tick);
  memset(wxyz, 0, 4 * sizeof *wxyz);
  wxyz[0] = (int16_t)lround(16384 * cos(half_angle));
  wxyz[1 + index % 3] = (int16_t)lround(16384 * sin(half_angle));
}

/* A vector of the earth frame in the axes of a sensor that has turned about one of them. */
static void into_sensor(int16_t xyz[3], const int16_t earth[3], unsigned axis, double angle) {
  const unsigned u = (axis + 1) % 3, v = (axis + 2) % 3;
  xyz[axis] = earth[axis];
  xyz[u] = (int16_t)lround(earth[u] * cos(angle) + earth[v] * sin(angle));
  xyz[v] = (int16_t)lround(earth[v] * cos(angle) - earth[u] * sin(angle));
}

void bno055_raw_pattern(int16_t nine[9], unsigned index, uint64_t tick) {
  const double angle = 2 * pattern_half_angle(index, tick);
  memset(nine, 0, 9 * sizeof *nine);
  into_sensor(nine, GRAVITY, index % 3, angle);
  into_sensor(nine + 3, FIELD, index % 3, angle);
  nine[6 + index % 3] = (int16_t)lround(16 * 360.0 / PATTERN_STEPS / (OUTPUT_PERIOD_US * 1e-6));
}

static void settle_mode(bno055_t *chip, uint64_t now_us) {
  if (chip->mode != chip->next_mode && now_us >= chip->mode_settles_us)
    chip->mode = chip->next_mode;
}

static void put_words(uint8_t *at, const int16_t *words, unsigned count) {
  for (unsigned i = 0; i < count; i++) {
    at[2 * i] = (uint8_t)words[i];
    at[2 * i + 1] = (uint8_t)((uint16_t)words[i] >> 8);
  }
}

/* What a burst reads is that of one moment. */
static void latch_output(bno055_t *chip, uint64_t now_us) {
  static const int16_t zero[4];
  const bool measures = chip->mode != MODE_CONFIG && chip->next_mode == chip->mode;
  const bool fusion = measures && chip->mode > MODE_AMG;
  int16_t pattern[4], raw[9];
  const unsigned index = chip->phase_us * 8 / OUTPUT_PERIOD_US;
  const uint64_t tick = (now_us + chip->phase_us) / OUTPUT_PERIOD_US;
  if (chip->pattern)
    bno055_pattern(pattern, index, tick);
  put_words(chip->registers + QUATERNION, !fusion ? zero : chip->pattern ? pattern : chip->quaternion, 4);
  put_words(chip->registers + ACCELERATION, measures ? chip->acceleration : zero, 3);
  put_words(chip->registers + MAGNETIC_FIELD, measures ? chip->magnetic_field : zero, 3);
  put_words(chip->registers + ANGULAR_VELOCITY, measures ? chip->angular_velocity : zero, 3);
  if (measures && !fusion && chip->pattern) {
    bno055_raw_pattern(raw, index, tick);
    put_words(chip->registers + ACCELERATION, raw, 9);
  }
  chip->registers[CALIBRATION] = fusion ? chip->calibration : 0;
  chip->registers[OPERATION_MODE] = chip->mode;
}

bool bno055_address(bno055_t *chip, bool read, uint64_t now_us) {
  if (!chip->powered || now_us < chip->booted_us)
    return false;
  if (chip->glitches) {
    chip->glitches--;
    return false;
  }
  settle_mode(chip, now_us);
  if (read)
    latch_output(chip, now_us);
  else
    chip->pointer_follows = true;
  return true;
}

static bool config_only(uint8_t reg) {
  return reg == AXIS_MAP || reg == AXIS_SIGN || (reg >= OFFSETS && reg < OFFSETS_END);
}

static bool in_config(const bno055_t *chip) { return chip->mode == MODE_CONFIG && chip->next_mode == MODE_CONFIG; }

static void set_mode(bno055_t *chip, uint8_t mode, uint64_t now_us) {
  const bool through_config = mode != MODE_CONFIG && !in_config(chip) && mode != chip->mode;
  if (through_config || chip->mode != chip->next_mode)
    chip->violations++; /* fusion modes are entered from CONFIG, and one change ends before the next */
  chip->next_mode = mode & 0x0F;
  chip->mode_settles_us = now_us + (chip->next_mode == MODE_CONFIG ? TO_CONFIG_US : FROM_CONFIG_US);
}

void bno055_write(bno055_t *chip, uint8_t byte, uint64_t now_us) {
  if (chip->pointer_follows) {
    chip->pointer_follows = false;
    chip->pointer = byte % BNO055_REGISTERS;
    return;
  }
  const uint8_t reg = chip->pointer;
  chip->pointer = (uint8_t)(reg + 1) % BNO055_REGISTERS;
  if (reg == PAGE_ID) {
    chip->page = byte;
    chip->registers[PAGE_ID] = byte;
  } else if (chip->page != 0) {
    chip->violations++; /* nothing on page 1 is for this firmware */
  } else if (reg == OPERATION_MODE) {
    set_mode(chip, byte, now_us);
  } else if (reg == SYSTEM_TRIGGER) {
    if (byte & RESET_SYSTEM)
      boot(chip, now_us);
  } else if (!config_only(reg) || !in_config(chip)) {
    chip->violations++;
  } else if (reg < OFFSETS || !chip->refuses_offsets) {
    chip->registers[reg] = byte;
  }
}

uint8_t bno055_read(bno055_t *chip) {
  const uint8_t reg = chip->pointer;
  chip->pointer = (uint8_t)(reg + 1) % BNO055_REGISTERS;
  if (chip->page != 0 && reg != PAGE_ID)
    return 0xFF;
  if (reg >= OFFSETS && reg < OFFSETS_END && !in_config(chip)) {
    chip->violations++;
    return 0;
  }
  return chip->registers[reg];
}
