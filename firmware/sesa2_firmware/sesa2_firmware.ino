/* Reads up to eight BNO055 through a TCA9548A and streams them to a PC. Arduino Mega 2560. See ../README.md. */
#include "commands.h"
#include "i2c_bus.h"
#include "panel.h"
#include "statistics.h"
#include "status_led.h"
#include "sweep.h"
#include "uart.h"

statistics_t statistics;

void setup() {
  statistics.reset_cause = MCUSR;
  MCUSR = 0; /* else the next reset would show this one's cause too */
  uart::begin();
  i2c::begin();
  status_led::begin();
  panel::begin();
}

void loop() {
  commands::poll();
  sweep::poll();
  status_led::poll();
  panel::poll();
}
