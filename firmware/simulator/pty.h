/* The USB serial port as a PC sees it: a pseudo-terminal behind a symbolic link, which can be pulled out. */
#ifndef SIMULATOR_PTY_H
#define SIMULATOR_PTY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { PTY_BUFFER = 1 << 20 };

typedef struct {
  const char *link;
  int controller; /* -1: pulled out */
  int terminal;   /* kept open, so that a PC that closes it does not hang it up */
  uint8_t pending[PTY_BUFFER];
  size_t pending_count;
  uint64_t read_total, dropped;
} pty_t;

void pty_init(pty_t *pty, const char *link);
void pty_plug(pty_t *pty);
void pty_unplug(pty_t *pty);

void pty_send(pty_t *pty, uint8_t byte);
void pty_flush(pty_t *pty); /* as much as the terminal takes now */
size_t pty_receive(pty_t *pty, uint8_t *bytes, size_t room);

#endif
