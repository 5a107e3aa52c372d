/* A 16x2 HD44780 display in 4-bit mode that is written one character per call, so that sweeps never wait for it. */
#ifndef SESA2_HD44780_H
#define SESA2_HD44780_H

#include <stdint.h>

namespace hd44780 {

constexpr uint8_t COLUMNS = 16, ROWS = 2;

void begin(); /* takes 60 ms */

/* What is to be shown; poll() brings it onto the display. */
void put(uint8_t row, uint8_t column, char character);
void print(uint8_t row, uint8_t column, const char *text);

void poll();

}  // namespace hd44780

#endif
