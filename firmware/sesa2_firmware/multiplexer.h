/* The TCA9548A: connects one channel at a time. */
#ifndef SESA2_MULTIPLEXER_H
#define SESA2_MULTIPLEXER_H

#include "i2c_bus.h"

namespace multiplexer {

i2c::Result select(uint8_t channel);

/* The channels on which a BNO055 answers now, as a mask. Those in `known` are taken as answering, unasked. */
uint8_t scan(uint8_t known);

}  // namespace multiplexer

#endif
