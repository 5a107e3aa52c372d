#include "config.h"
#ifdef SESA2_LCD

#include <Arduino.h>
#include <string.h>

#include "hd44780.h"

namespace hd44780 {
namespace {

constexpr uint8_t WRITE_US = 50; /* datasheet: 37 us at 270 kHz, whose tolerance is wide */
constexpr uint8_t ROW_ADDRESS = 0x40;
constexpr uint8_t CELLS = ROWS * COLUMNS;

char wanted[CELLS], shown[CELLS];
uint8_t cursor; /* the cell that the next character goes to */
uint32_t last_write_us;

void write_nibble(uint8_t nibble) {
  for (uint8_t i = 0; i < 4; i++)
    digitalWrite(config::LCD_DATA_PINS[i], nibble >> i & 1);
  digitalWrite(config::LCD_ENABLE_PIN, HIGH);
  delayMicroseconds(1);
  digitalWrite(config::LCD_ENABLE_PIN, LOW);
}

void write(uint8_t byte, bool is_character) {
  digitalWrite(config::LCD_RS_PIN, is_character);
  write_nibble(byte >> 4);
  write_nibble(byte & 0x0F);
  last_write_us = micros();
}

}  // namespace

void begin() {
  memset(wanted, ' ', CELLS);
  memset(shown, ' ', CELLS);
  pinMode(config::LCD_RS_PIN, OUTPUT);
  pinMode(config::LCD_ENABLE_PIN, OUTPUT);
  for (const uint8_t pin : config::LCD_DATA_PINS)
    pinMode(pin, OUTPUT);
  /* The datasheet's "initializing by instruction" (figure 24): it may have come up in either width. */
  delay(50);
  for (uint8_t i = 0; i < 3; i++) {
    write_nibble(0x3);
    delay(5);
  }
  write_nibble(0x2);
  delay(1);
  constexpr uint8_t commands[] = {0x28, 0x0C, 0x06, 0x01}; /* 4 bits, 2 rows; on; to the right; clear */
  for (const uint8_t command : commands) {
    write(command, false);
    delay(2);
  }
}

void put(uint8_t row, uint8_t column, char character) { wanted[row * COLUMNS + column] = character; }

void print(uint8_t row, uint8_t column, const char *text) {
  while (*text && column < COLUMNS)
    put(row, column++, *text++);
}

void poll() {
  if (micros() - last_write_us < WRITE_US)
    return;
  for (uint8_t cell = 0; cell < CELLS; cell++) {
    if (wanted[cell] == shown[cell])
      continue;
    if (cell != cursor) {
      write(0x80 | (cell / COLUMNS * ROW_ADDRESS + cell % COLUMNS), false);
      cursor = cell;
    } else {
      write(wanted[cell], true);
      shown[cell] = wanted[cell];
      /* At the end of a row the display's own address leaves the visible columns. */
      cursor = (cell + 1) % COLUMNS ? cell + 1 : CELLS;
    }
    return;
  }
}

}  // namespace hd44780

#endif
