// An ATmega328P at 16 MHz, cycle by cycle: events come at given cycles, and what the program does is printed.
//
//   core PROGRAM.elf CYCLES [TRIGGER ECHO WIDTH] < events
//   events     CYCLE byte 0 VALUE    a byte begins to arrive at the UART, which runs at 9600 baud
//              CYCLE pin NUMBER LEVEL
//   output     CYCLE byte 0 VALUE    the UART begins to send a byte
//              CYCLE pin NUMBER LEVEL
//              CYCLE pwm NUMBER DUTY
//
// TRIGGER and ECHO are the pins of an HC-SR04 whose echo begins 450 us after the trigger, and lasts WIDTH cycles.
#include <simavr/avr_ioport.h>
#include <simavr/avr_timer.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>
#include <simavr/sim_io.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

// At 9600 baud a bit has 208 steps of 8 cycles.
enum { PINS = 20, MOST_EVENTS = 4096, ECHO_DELAY = 450 * 16, BYTE_CYCLES = 10 * 208 * 8 };

struct event {
  unsigned long long cycle;
  char kind[8];
  int number, value;
};

static avr_t* avr;
static struct event events[MOST_EVENTS];
static int event_count, next_event, trigger = -1, echo = -1, trigger_level;
static unsigned long width;
static avr_irq_t* pins[PINS];

static void show(const char* kind, int number, unsigned value) {
  printf("%llu %s %d %u\n", (unsigned long long)avr->cycle, kind, number, value);
}

static avr_cycle_count_t echo_falls(avr_t* core, avr_cycle_count_t when, void* unused) {
  (void)core, (void)when, (void)unused;
  avr_raise_irq(pins[echo], 0);
  return 0;
}
static avr_cycle_count_t echo_rises(avr_t* core, avr_cycle_count_t when, void* unused) {
  (void)when, (void)unused;
  avr_raise_irq(pins[echo], 1);
  avr_cycle_timer_register(core, width, echo_falls, NULL);
  return 0;
}

static void pin_changed(avr_irq_t* irq, uint32_t value, void* number) {
  (void)irq;
  const int pin = (int)(intptr_t)number;
  show("pin", pin, value & 1);
  if (pin != trigger) return;
  if (trigger_level && !value) avr_cycle_timer_register(avr, ECHO_DELAY, echo_rises, NULL);
  trigger_level = value & 1;
}
static void duty_changed(avr_irq_t* irq, uint32_t value, void* number) {
  (void)irq;
  show("pwm", (int)(intptr_t)number, value);
}
static void byte_sent(avr_irq_t* irq, uint32_t value, void* unused) {
  (void)irq, (void)unused;
  show("byte", 0, value & 0xFF);
}

// Applies an event, and comes again at the next one's cycle.
static avr_cycle_count_t apply(avr_t* core, avr_cycle_count_t when, void* uart) {
  (void)core, (void)when;
  const struct event* each = &events[next_event++];
  if (!strcmp(each->kind, "byte"))
    avr_raise_irq(uart, (uint32_t)each->value);
  else
    avr_raise_irq(pins[each->number], (uint32_t)each->value);
  return next_event < event_count ? events[next_event].cycle : 0;
}

int main(int count, char** arguments) {
  if (count < 3) return 2;
  elf_firmware_t firmware;
  memset(&firmware, 0, sizeof firmware);
  if (elf_read_firmware(arguments[1], &firmware)) return 2;
  avr = avr_make_mcu_by_name("atmega328p");
  if (!avr) return 2;
  avr_init(avr);
  firmware.frequency = 16000000;
  avr_load_firmware(avr, &firmware);
  if (count >= 6) {
    trigger = atoi(arguments[3]);
    echo = atoi(arguments[4]);
    width = strtoul(arguments[5], NULL, 10);
  }
  // The pins' numbers are the Uno's: 0 to 7 are port D, 8 to 13 port B, 14 to 19 (A0 to A5) port C.
  for (int pin = 0; pin < PINS; ++pin) {
    const char port = pin < 8 ? 'D' : pin < 14 ? 'B' : 'C';
    pins[pin] = avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ(port), pin < 8 ? pin : pin < 14 ? pin - 8 : pin - 14);
    avr_irq_register_notify(pins[pin], pin_changed, (void*)(intptr_t)pin);
  }
  static const struct { char timer; int comparator, pin; } outputs[] = {
      {'0', 0, 6}, {'0', 1, 5}, {'1', 0, 9}, {'1', 1, 10}, {'2', 0, 11}, {'2', 1, 3}};
  for (size_t each = 0; each < sizeof outputs / sizeof *outputs; ++each)
    avr_irq_register_notify(
        avr_io_getirq(avr, AVR_IOCTL_TIMER_GETIRQ(outputs[each].timer), TIMER_IRQ_OUT_PWM0 + outputs[each].comparator),
        duty_changed, (void*)(intptr_t)outputs[each].pin);
  uint32_t flags = 0;  // nothing is printed for the sketch, and polling it does not sleep
  avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
  avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), byte_sent, NULL);

  struct event* read = events;
  while (event_count < MOST_EVENTS && scanf("%llu %7s %d %d", &read->cycle, read->kind, &read->number, &read->value) == 4) {
    ++event_count;
    ++read;
  }
  if (event_count)
    avr_cycle_timer_register(avr, events[0].cycle, apply, avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT));
  const unsigned long long end = strtoull(arguments[2], NULL, 10);
  avr_uart_t* uart = NULL;
  for (avr_io_t* each = avr->io_port; each; each = each->next)
    if (!strcmp(each->kind, "uart")) uart = (avr_uart_t*)each;
  if (!uart) return 2;
  while (avr->cycle < end) {
    uart->cycles_per_byte = BYTE_CYCLES;  // simavr counts eleven bits; a byte has ten
    const int state = avr_run(avr);
    if (state == cpu_Done || state == cpu_Crashed) return 1;
  }
  return 0;
}
