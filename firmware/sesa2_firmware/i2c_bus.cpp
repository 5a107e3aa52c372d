#include "i2c_bus.h"

#include <Arduino.h>
#include <util/twi.h>

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

/* SCL is F_CPU / (16 + 2 TWBR). */
constexpr uint8_t bit_rate(uint32_t clock_hz) { return uint8_t((F_CPU / clock_hz - 16) / 2); }

void set_clock() { TWBR = slow_clock ? bit_rate(100000) : bit_rate(400000); }

void start_hardware() {
  pinMode(SDA, INPUT_PULLUP);
  pinMode(SCL, INPUT_PULLUP);
  TWSR = 0;
  set_clock();
  TWCR = _BV(TWEN);
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
  TWCR = 0;
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

/* The hardware's steps are waited for here. Arduino's Wire does it by interrupts and copies each byte three times, which takes
   10 us a byte where the byte itself takes 23. */
uint32_t deadline_us;

bool in_time() { return int32_t(deadline_us - micros()) > 0; }

constexpr uint8_t TIMED_OUT = 0x01; /* none of the hardware's codes */

/* Asks for a step and returns the hardware's code at its end. */
uint8_t step(uint8_t request) {
  TWCR = request | _BV(TWINT) | _BV(TWEN);
  do {
    for (uint8_t i = 0; i < 200; i++) /* longer than a byte takes: the clock is looked at only where one is late */
      if (TWCR & _BV(TWINT))
        return TW_STATUS;
  } while (in_time());
  return TIMED_OUT;
}

Result expect(uint8_t code, uint8_t expected) {
  if (code == expected)
    return OK;
  const bool refused = code == TW_MT_SLA_NACK || code == TW_MT_DATA_NACK || code == TW_MR_SLA_NACK;
  return refused ? NACK : STUCK;
}

Result put(uint8_t byte, uint8_t expected) {
  TWDR = byte;
  return expect(step(0), expected);
}

Result address(uint8_t target, uint8_t direction) {
  const uint8_t code = step(_BV(TWSTA));
  if (code != TW_START && code != TW_REP_START)
    return STUCK;
  return put(uint8_t(target << 1 | direction), direction == TW_READ ? TW_MR_SLA_ACK : TW_MT_SLA_ACK);
}

Result begin_transfer(uint8_t target) {
  if (!ready())
    return STUCK;
  deadline_us = micros() + config::BUS_TIMEOUT_US;
  return address(target, TW_WRITE);
}

/* A STOP, also after a byte that was refused. */
Result end_transfer(Result result) {
  if (result != STUCK) {
    TWCR = _BV(TWINT) | _BV(TWEN) | _BV(TWSTO);
    while (TWCR & _BV(TWSTO))
      if (!in_time()) {
        result = STUCK;
        break;
      }
  }
  if (result == STUCK)
    recover();
  return result;
}

}  // namespace

void begin() {
  pinMode(config::MULTIPLEXER_RESET_PIN, INPUT);
  start_hardware();
}

void set_slow(bool slow) {
  slow_clock = slow;
  set_clock();
}

Result send(uint8_t target, uint8_t byte) { return write(target, byte, nullptr, 0); }

Result write(uint8_t target, uint8_t reg, const uint8_t *bytes, uint8_t count) {
  Result result = begin_transfer(target);
  if (result == OK)
    result = put(reg, TW_MT_DATA_ACK);
  while (result == OK && count--)
    result = put(*bytes++, TW_MT_DATA_ACK);
  return end_transfer(result);
}

Result read(uint8_t target, uint8_t reg, uint8_t *bytes, uint8_t count) {
  Result result = begin_transfer(target);
  if (result == OK)
    result = put(reg, TW_MT_DATA_ACK);
  if (result == OK)
    result = address(target, TW_READ);
  while (result == OK && count--) {
    /* All but the last are acknowledged, which asks for another. */
    result = count ? expect(step(_BV(TWEA)), TW_MR_DATA_ACK) : expect(step(0), TW_MR_DATA_NACK);
    *bytes++ = TWDR;
  }
  return end_transfer(result);
}

}  // namespace i2c
