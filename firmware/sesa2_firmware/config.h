/* What belongs to this build and this wiring. Everything that belongs to an experiment comes over the link. */
#ifndef SESA2_CONFIG_H
#define SESA2_CONFIG_H

#include <stdint.h>

#define FIRMWARE_MAJOR 1
#define FIRMWARE_MINOR 1

/* Also set by `make BAUD=...`. 500000 divides 16 MHz exactly; 115200 carries eight IMUs at 100 Hz at 82 % of the line. */
#ifndef SESA2_BAUD
#define SESA2_BAUD 500000
#endif

/* The thesis's 16x2 display and calibration button; also set by `make LCD=1`. */
/* #define SESA2_LCD */

namespace config {

constexpr uint8_t MULTIPLEXER_ADDRESS = 0x70;
constexpr uint8_t BNO055_ADDRESS = 0x28; /* ADR low */

/* P1 of the datasheet, the chip's default: an IMU's mounting belongs to the PC's configuration. */
constexpr uint8_t AXIS_MAP = 0x24;
constexpr uint8_t AXIS_SIGN = 0x00;

/* A transfer that takes longer has hung. One that a chip stretches for longer is given up. */
constexpr uint32_t BUS_TIMEOUT_US = 5000;

constexpr uint8_t MULTIPLEXER_RESET_PIN = 8; /* to RST of the TCA9548A; may be left open */
constexpr uint8_t STATUS_LED_PIN = 13;       /* the one on the board */

constexpr uint8_t BUTTON_PIN = 6; /* to ground */
constexpr uint8_t CALIBRATION_LED_PIN = 7;
constexpr uint8_t LCD_RS_PIN = 12;
constexpr uint8_t LCD_ENABLE_PIN = 11;
constexpr uint8_t LCD_DATA_PINS[4] = {5, 4, 3, 2}; /* D4 to D7 */

}  // namespace config

#endif
