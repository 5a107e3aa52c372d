/* The thesis's panel: display, calibration button and its LED. Compiled in with SESA2_LCD, else empty.

   The display shows which IMUs run; the button switches it to their calibration scores and back, without touching the
   stream. */
#ifndef SESA2_PANEL_H
#define SESA2_PANEL_H

#include "config.h"

namespace panel {

#ifdef SESA2_LCD
void begin();
void poll();
#else
inline void begin() {}
inline void poll() {}
#endif

}  // namespace panel

#endif
