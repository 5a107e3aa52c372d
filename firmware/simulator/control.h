/* The test's hand on the simulated board: one line of text a command, one line an answer, on a UNIX socket.

   Answers begin with "ok" or "error". Channels are 0 to 7; times are microseconds of simulated time.

     run US [RX]                time moves on by US, once RX bytes in all have come from the PC -> ok NOW SENT
                                (SENT: bytes in all that the board has sent; not in real time)
     time                       -> ok NOW SENT
     quaternion K W X Y Z       raw, 16384 is one
     acceleration K X Y Z       raw, 100 is 1 m/s2
     magnetometer K X Y Z       raw, 16 is 1 uT
     gyroscope K X Y Z          raw, 16 is 1 degree a second
     calibration K SCORES       register 0x35
     pattern K 0|1              a rotation that goes on with each 10 ms (bno055_pattern, bno055_raw_pattern)
     stretch K US               clock stretching before each read
     glitch K N                 so many of its next addressings go unacknowledged
     refuse K 0|1               offsets that are written do not stick
     unplug K|multiplexer, plug K|multiplexer
     blip K                     the chip's power goes for a moment
     hold K|trunk sda|scl [N]   a line is held low; N: until the clock has been pulsed N times
     release K|trunk
     cable 0|1                  the USB cable; 0 closes the pseudo-terminal
     reset                      the board
     power                      off and on for everything
     register K ADDRESS [N]     N registers, in hexadecimal, as they stand in the chip
     poke K ADDRESS VALUE       a register, whatever the chip's mode
     mode K                     the mode that the chip is in
     display                    -> ok ROW0|ROW1, of the panel
     button 0|1                 of the panel; 1 is pressed
     stats                      -> ok key=value... */
#ifndef SIMULATOR_CONTROL_H
#define SIMULATOR_CONTROL_H

#include "board.h"

typedef struct {
  board_t *board;
  bool real_time;
  int listener, client; /* client: -1 if none */
  char line[256];
  size_t length;
  bool waiting;         /* a run that waits for bytes from the PC */
  uint64_t run_us, run_received;
} control_t;

void control_init(control_t *control, board_t *board, const char *path, bool real_time);
void control_accept(control_t *control);

/* Serves what has come. False when the client has gone. */
bool control_serve(control_t *control);

/* Goes on with a run that waits for bytes. */
void control_continue(control_t *control);

#endif
