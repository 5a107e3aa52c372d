/* Reads all IMUs in use, one after another, at a fixed rate, and streams what they measured. */
#ifndef SESA2_SWEEP_H
#define SESA2_SWEEP_H

#include <stdint.h>

namespace sweep {

void set_rate(uint8_t rate_hz);
void set_stream(uint8_t flags);
void poll();

}  // namespace sweep

#endif
