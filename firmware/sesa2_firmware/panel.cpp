#include "panel.h"
#ifdef SESA2_LCD

#include <Arduino.h>

#include "hd44780.h"
#include "imu_set.h"
#include "multiplexer.h"

namespace panel {
namespace {

constexpr uint8_t DEBOUNCE_MS = 30;
constexpr uint16_t REFRESH_MS = 200;
constexpr uint8_t FIRST_COLUMN = hd44780::COLUMNS - CHANNELS; /* where the eight IMUs begin */

/* Register 0x35 holds four scores; they take turns on the second row. */
constexpr struct {
  const char *name;
  uint8_t shift;
} SCORES[] = {{"system  ", 6}, {"gyro    ", 4}, {"accel   ", 2}, {"mag     ", 0}};
constexpr uint8_t SCORE_REFRESHES = 6; /* 1.2 s each */

bool show_calibration;
bool was_pressed;
uint32_t pressed_ms, refreshed_ms;
uint8_t refreshes;

void poll_button() {
  const bool pressed = digitalRead(config::BUTTON_PIN) == LOW;
  if (pressed == was_pressed || millis() - pressed_ms < DEBOUNCE_MS)
    return;
  was_pressed = pressed;
  pressed_ms = millis();
  if (!pressed)
    return;
  show_calibration = !show_calibration;
  digitalWrite(config::CALIBRATION_LED_PIN, show_calibration);
  refreshed_ms = millis() - REFRESH_MS;
}

void put_imus(uint8_t row, char (*character)(uint8_t channel)) {
  for (uint8_t channel = 0; channel < CHANNELS; channel++)
    hd44780::put(row, FIRST_COLUMN + channel, character(channel));
}

bool in_use(uint8_t channel) { return imu_set::mask() >> channel & 1; }

char id(uint8_t channel) { return char('1' + channel); }

char state(uint8_t channel) {
  if (!in_use(channel))
    return ' ';
  switch (imu_set::at(channel).state()) {
    case STATE_ABSENT:
      return '-';
    case STATE_RUN:
      return 'R';
    default:
      return '.';
  }
}

uint8_t score_shift;

char score(uint8_t channel) {
  const bool runs = in_use(channel) && imu_set::at(channel).state() == STATE_RUN;
  return runs ? char('0' + (imu_set::at(channel).calibration() >> score_shift & 3)) : state(channel);
}

uint8_t found;

char found_id(uint8_t channel) { return found >> channel & 1 ? id(channel) : '-'; }

void refresh() {
  refreshes++;
  if (!imu_set::mask()) { /* nobody has configured the board: show what is plugged in */
    found = multiplexer::scan(0);
    hd44780::print(0, 0, "sesa2 is waiting");
    hd44780::print(1, 0, "found   ");
    put_imus(1, found_id);
    return;
  }
  hd44780::print(0, 0, "IMU     ");
  put_imus(0, id);
  if (show_calibration) {
    const auto &shown = SCORES[refreshes / SCORE_REFRESHES % 4];
    score_shift = shown.shift;
    hd44780::print(1, 0, shown.name);
    put_imus(1, score);
  } else {
    hd44780::print(1, 0, imu_set::running() == imu_set::mask() ? "all run " : "missing ");
    put_imus(1, state);
  }
}

}  // namespace

void begin() {
  pinMode(config::BUTTON_PIN, INPUT_PULLUP);
  pinMode(config::CALIBRATION_LED_PIN, OUTPUT);
  hd44780::begin();
}

void poll() {
  poll_button();
  if (millis() - refreshed_ms >= REFRESH_MS) {
    refreshed_ms = millis();
    refresh();
  }
  hd44780::poll();
}

}  // namespace panel

#endif
