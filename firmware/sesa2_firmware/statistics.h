/* The counters that STATS reports. */
#ifndef SESA2_STATISTICS_H
#define SESA2_STATISTICS_H

#include "packets.h"

extern statistics_t statistics;

template <typename T>
inline void saturating_increment(T &counter) {
  if (T(counter + 1) != 0)
    counter++;
}

#endif
