#include "i2c_bus.h"

#include <Arduino.h>
#include <Wire.h>

#include "config.h"
#include "statistics.h"

namespace i2c {
namespace {

constexpr uint8_t HALF_CLOCK_US = 5; /* of the recovery pulses: 100 kHz */

bool slow_clock;

#ifndef __AVR_ATmega2560__
#error "SDA and SCL are looked at where the Arduino Mega 2560 has them: PD1 and PD0"
#endif
constexpr uint8_t LINES = _BV(PD1) | _BV(PD0);

/* Both lines are high when nobody talks. Looked at for 50 us, since a weak pull-up takes a while. */
bool lines_free() {
  for (uint8_t i = 0; i < 10; i++) {
    if ((PIND & LINES) == LINES)
      return true;
    delayMicroseconds(5);
  }
  return false;
}

void start_hardware() {
  Wire.begin();
  Wire.setClock(slow_clock ? 100000 : 400000);
  Wire.setWireTimeout(config::BUS_TIMEOUT_US, true);
}

/* Open drain: a line is pulled low or left to its pull-up, never driven high. */
void pull_low(uint8_t pin) {
  pinMode(pin, OUTPUT);
  delayMicroseconds(HALF_CLOCK_US);
}

void let_go(uint8_t pin) {
  pinMode(pin, INPUT);
  delayMicroseconds(HALF_CLOCK_US);
}

/* A chip that lost count in the middle of a byte holds SDA low until it has seen the rest of its clock. */
void pulse_clock() {
  for (uint8_t i = 0; i < 9 && !digitalRead(SDA); i++) {
    pull_low(SCL);
    let_go(SCL);
  }
  pull_low(SDA); /* a STOP, in case somebody still thinks that the transfer goes on */
  let_go(SDA);
}

/* Takes a chip that cannot be freed off the bus, by closing all channels. */
void reset_multiplexer() {
  pull_low(config::MULTIPLEXER_RESET_PIN);
  let_go(config::MULTIPLEXER_RESET_PIN);
}

/* Whether clock pulses were enough. If not, the transfer at hand is to be given up: no channel is selected any more. */
bool recover() {
  saturating_increment(statistics.bus_recoveries);
  Wire.end();
  digitalWrite(SDA, LOW); /* from here on OUTPUT means low */
  digitalWrite(SCL, LOW);
  let_go(SDA);
  let_go(SCL);
  pulse_clock();
  const bool freed = lines_free();
  if (!freed)
    reset_multiplexer();
  start_hardware();
  return freed;
}

/* Asked before each transfer: it costs a microsecond, and a stuck bus would cost the whole timeout. */
bool ready() { return lines_free() || recover(); }

Result end_transmission(bool stop) {
  Wire.clearWireTimeoutFlag();
  const uint8_t error = Wire.endTransmission(stop);
  if (error == 2 || error == 3)
    return NACK;
  if (error == 0 && !Wire.getWireTimeoutFlag()) /* Wire reports a STOP that hung by its flag alone */
    return OK;
  recover();
  return STUCK;
}

}  // namespace

void begin() {
  pinMode(config::MULTIPLEXER_RESET_PIN, INPUT);
  start_hardware();
}

void set_slow(bool slow) {
  slow_clock = slow;
  Wire.setClock(slow ? 100000 : 400000);
}

Result send(uint8_t address, uint8_t byte) {
  if (!ready())
    return STUCK;
  Wire.beginTransmission(address);
  Wire.write(byte);
  return end_transmission(true);
}

Result write(uint8_t address, uint8_t reg, const uint8_t *bytes, uint8_t count) {
  if (!ready())
    return STUCK;
  Wire.beginTransmission(address);
  Wire.write(reg);
  Wire.write(bytes, count);
  return end_transmission(true);
}

Result read(uint8_t address, uint8_t reg, uint8_t *bytes, uint8_t count) {
  if (!ready())
    return STUCK;
  Wire.beginTransmission(address);
  Wire.write(reg);
  const Result result = end_transmission(false);
  if (result != OK)
    return result;
  Wire.clearWireTimeoutFlag();
  if (Wire.requestFrom(address, count, uint8_t(true)) != count) {
    if (!Wire.getWireTimeoutFlag())
      return NACK;
    recover();
    return STUCK;
  }
  while (count--)
    *bytes++ = uint8_t(Wire.read());
  return OK;
}

}  // namespace i2c
