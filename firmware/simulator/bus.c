#include "bus.h"

#include <string.h>

enum { MULTIPLEXER_ADDRESS = 0x70 };

void bus_init(bus_t *bus) {
  memset(bus, 0, sizeof *bus);
  bus->multiplexer_powered = true;
  for (unsigned k = 0; k < BUS_CHANNELS; k++) {
    bno055_init(&bus->chips[k], k);
    bno055_power(&bus->chips[k], true, 0);
  }
}

void bus_power_multiplexer(bus_t *bus, bool on) {
  bus->multiplexer_powered = on;
  bus->selected = bus->selection = 0; /* its power-on state */
}

void bus_hold(bus_t *bus, unsigned where, bool sda, bool scl, unsigned clocks) {
  bus->holds[where] = (bus_hold_t){.sda = sda, .scl = scl, .clocks_left = clocks};
}

void bus_release(bus_t *bus, unsigned where) { bus->holds[where] = (bus_hold_t){0}; }

static bool reaches_trunk(const bus_t *bus, unsigned where) {
  return where == BUS_TRUNK || (bus->multiplexer_powered && (bus->selected >> where & 1));
}

bool bus_sda_held(const bus_t *bus) {
  for (unsigned k = 0; k <= BUS_TRUNK; k++)
    if (bus->holds[k].sda && reaches_trunk(bus, k))
      return true;
  return false;
}

bool bus_scl_held(const bus_t *bus) {
  for (unsigned k = 0; k <= BUS_TRUNK; k++)
    if (bus->holds[k].scl && reaches_trunk(bus, k))
      return true;
  return false;
}

bool bus_address(bus_t *bus, uint8_t address_and_read, uint64_t now_us) {
  const uint8_t address = address_and_read >> 1;
  const bool read = address_and_read & 1;
  bus->transfers++;
  bus->bytes++;
  bus->multiplexer_addressed = bus->multiplexer_powered && address == MULTIPLEXER_ADDRESS;
  bus->chips_addressed = 0;
  if (bus->multiplexer_powered && address == BNO055_ADDRESS)
    for (unsigned k = 0; k < BUS_CHANNELS; k++)
      if ((bus->selected >> k & 1) && bno055_address(&bus->chips[k], read, now_us))
        bus->chips_addressed |= 1 << k;
  return bus->multiplexer_addressed || bus->chips_addressed;
}

bool bus_write(bus_t *bus, uint8_t byte, uint64_t now_us) {
  bus->bytes++;
  if (bus->multiplexer_addressed && bus->multiplexer_powered) {
    bus->selection = byte;
    return true;
  }
  bool acknowledged = false;
  for (unsigned k = 0; k < BUS_CHANNELS; k++) {
    if (!(bus->chips_addressed >> k & 1) || !(bus->selected >> k & 1) || !bus->chips[k].powered)
      continue;
    bno055_write(&bus->chips[k], byte, now_us);
    acknowledged = true;
  }
  return acknowledged;
}

uint8_t bus_read(bus_t *bus) {
  bus->bytes++;
  uint8_t byte = 0xFF; /* what a line that nobody pulls reads as */
  if (bus->multiplexer_addressed && bus->multiplexer_powered)
    byte &= bus->selected;
  for (unsigned k = 0; k < BUS_CHANNELS; k++)
    if ((bus->chips_addressed >> k & 1) && (bus->selected >> k & 1) && bus->chips[k].powered)
      byte &= bno055_read(&bus->chips[k]);
  return byte;
}

uint32_t bus_stretch_us(const bus_t *bus, uint8_t address_and_read) {
  uint32_t longest = 0;
  if (address_and_read != (BNO055_ADDRESS << 1 | 1) || !bus->multiplexer_powered)
    return 0;
  for (unsigned k = 0; k < BUS_CHANNELS; k++)
    if ((bus->selected >> k & 1) && bus->chips[k].powered && bus->chips[k].stretch_us > longest)
      longest = bus->chips[k].stretch_us;
  return longest;
}

void bus_stop(bus_t *bus) {
  bus->selected = bus->selection;
  bus->multiplexer_addressed = false;
  bus->chips_addressed = 0;
}

void bus_clock_pulse(bus_t *bus) {
  bus->clock_pulses++;
  for (unsigned k = 0; k <= BUS_TRUNK; k++)
    if (bus->holds[k].sda && bus->holds[k].clocks_left && reaches_trunk(bus, k) && --bus->holds[k].clocks_left == 0)
      bus_release(bus, k);
}

void bus_reset_multiplexer(bus_t *bus) {
  bus->multiplexer_resets++;
  bus->selected = bus->selection = 0;
}
