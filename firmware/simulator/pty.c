#define _GNU_SOURCE
#include "pty.h"

#include <fcntl.h>
#include <pty.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <unistd.h>

void pty_init(pty_t *pty, const char *link) {
  memset(pty, 0, sizeof *pty);
  pty->link = link;
  pty->controller = pty->terminal = -1;
}

void pty_plug(pty_t *pty) {
  char name[128];
  struct termios raw;
  memset(&raw, 0, sizeof raw);
  cfmakeraw(&raw);
  raw.c_cflag |= CREAD | CLOCAL;
  if (pty->controller >= 0)
    return;
  if (openpty(&pty->controller, &pty->terminal, name, &raw, NULL) < 0) {
    perror("openpty");
    exit(1);
  }
  fcntl(pty->controller, F_SETFL, O_NONBLOCK);
  unlink(pty->link);
  if (symlink(name, pty->link) < 0) {
    perror(pty->link);
    exit(1);
  }
}

void pty_unplug(pty_t *pty) {
  if (pty->controller < 0)
    return;
  unlink(pty->link);
  close(pty->terminal);
  close(pty->controller);
  pty->controller = pty->terminal = -1;
  pty->pending_count = 0;
}

void pty_send(pty_t *pty, uint8_t byte) {
  if (pty->controller < 0)
    return; /* USB is unpowered: nobody is there to miss it */
  if (pty->pending_count == PTY_BUFFER)
    pty->dropped++;
  else
    pty->pending[pty->pending_count++] = byte;
}

void pty_flush(pty_t *pty) {
  if (pty->controller < 0 || pty->pending_count == 0)
    return;
  const ssize_t written = write(pty->controller, pty->pending, pty->pending_count);
  if (written <= 0)
    return;
  pty->pending_count -= written;
  memmove(pty->pending, pty->pending + written, pty->pending_count);
}

size_t pty_receive(pty_t *pty, uint8_t *bytes, size_t room) {
  if (pty->controller < 0 || room == 0)
    return 0;
  const ssize_t count = read(pty->controller, bytes, room);
  if (count <= 0)
    return 0;
  pty->read_total += count;
  return count;
}
