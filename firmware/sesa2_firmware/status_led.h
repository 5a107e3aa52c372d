/* The LED on the board: off while nobody has configured it, blinking while an IMU in use does not run, else on. */
#ifndef SESA2_STATUS_LED_H
#define SESA2_STATUS_LED_H

namespace status_led {

void begin();
void poll();

}  // namespace status_led

#endif
