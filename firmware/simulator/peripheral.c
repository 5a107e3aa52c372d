#include "peripheral.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

avr_io_t *peripheral_find(avr_t *avr, const char *kind) {
  avr_io_t *found = NULL;
  for (avr_io_t *io = avr->io_port; io; io = io->next)
    if (strcmp(io->kind, kind) == 0)
      found = io; /* simavr puts each new module before the others: the first is the last */
  if (!found) {
    fprintf(stderr, "simavr has no %s for this controller\n", kind);
    exit(1);
  }
  return found;
}

void peripheral_on_write(avr_t *avr, avr_io_addr_t address, avr_io_write_t handler, void *param) {
  avr->io[AVR_DATA_TO_IO(address)].w.c = handler;
  avr->io[AVR_DATA_TO_IO(address)].w.param = param;
}

void peripheral_on_read(avr_t *avr, avr_io_addr_t address, avr_io_read_t handler, void *param) {
  avr->io[AVR_DATA_TO_IO(address)].r.c = handler;
  avr->io[AVR_DATA_TO_IO(address)].r.param = param;
}
