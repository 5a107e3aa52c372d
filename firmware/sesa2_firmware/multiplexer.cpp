#include "multiplexer.h"

#include "bno055.h"
#include "config.h"
#include "packets.h"

namespace multiplexer {

i2c::Result select(uint8_t channel) { return i2c::send(config::MULTIPLEXER_ADDRESS, uint8_t(1 << channel)); }

uint8_t scan(uint8_t known) {
  uint8_t found = known;
  for (uint8_t channel = 0; channel < CHANNELS; channel++) {
    if (found >> channel & 1)
      continue;
    if (select(channel) == i2c::OK && bno055::identify() == i2c::OK)
      found |= uint8_t(1 << channel);
  }
  return found;
}

}  // namespace multiplexer
