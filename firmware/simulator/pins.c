#include "pins.h"

#include <avr_ioport.h>

#include "peripheral.h"

enum { SCL = 1 << 0, SDA = 1 << 1, MULTIPLEXER_RESET = 1 << 5, PIND = 0x29, DDRD = 0x2A, PORTD = 0x2B };

static uint8_t read_port_d(avr_t *avr, avr_io_addr_t address, void *param) {
  pins_t *pins = param;
  uint8_t value = pins->read_port_d(avr, address, pins->read_port_d_param) | SCL | SDA;
  const uint8_t driven_low = avr->data[DDRD] & ~avr->data[PORTD];
  if (bus_scl_held(pins->bus) || (driven_low & SCL))
    value &= ~SCL;
  if (bus_sda_held(pins->bus) || (driven_low & SDA))
    value &= ~SDA;
  return value;
}

static void direction_d_changed(struct avr_irq_t *irq, uint32_t outputs, void *param) {
  (void)irq;
  pins_t *pins = param;
  const bool was_low = pins->scl_low;
  pins->scl_low = outputs & ~pins->avr->data[PORTD] & SCL;
  if (was_low && !pins->scl_low && !bus_scl_held(pins->bus))
    bus_clock_pulse(pins->bus);
}

static void direction_h_changed(struct avr_irq_t *irq, uint32_t outputs, void *param) {
  (void)irq;
  pins_t *pins = param;
  if (outputs & MULTIPLEXER_RESET)
    bus_reset_multiplexer(pins->bus);
}

void pins_install(pins_t *pins, avr_t *avr, bus_t *bus) {
  const unsigned port = AVR_DATA_TO_IO(PIND);
  *pins = (pins_t){
      .avr = avr, .bus = bus, .read_port_d = avr->io[port].r.c, .read_port_d_param = avr->io[port].r.param};
  peripheral_on_read(avr, PIND, read_port_d, pins);
  avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('D'), IOPORT_IRQ_DIRECTION_ALL),
                          direction_d_changed, pins);
  avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('H'), IOPORT_IRQ_DIRECTION_ALL),
                          direction_h_changed, pins);
}
