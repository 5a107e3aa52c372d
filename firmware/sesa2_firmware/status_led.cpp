#include "status_led.h"

#include <Arduino.h>

#include "config.h"
#include "imu_set.h"

namespace status_led {

void begin() { pinMode(config::STATUS_LED_PIN, OUTPUT); }

void poll() {
  const uint8_t mask = imu_set::mask();
  const bool blink_on = millis() & 256;
  const bool on = mask && (imu_set::running() == mask || blink_on);
  digitalWrite(config::STATUS_LED_PIN, on);
}

}  // namespace status_led
