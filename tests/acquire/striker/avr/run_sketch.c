/* Runs a striker board's program on a simulated ATmega328P in real time, with its serial line on stdin and stdout
 * (both the master of a pseudo-terminal). When the drive (PB1) is switched on, the contact sensor (PD2) pulls to
 * ground 80 ms later for 2 ms; PD4 is grounded (drawn back). Times of both are printed on stderr in cycles.
 * Usage: run_sketch PROGRAM.elf */
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

#include "avr_ioport.h"
#include "avr_uart.h"
#include "sim_avr.h"
#include "sim_elf.h"

static avr_t *avr;
static avr_cycle_count_t touch_at, release_at;
static int may_receive = 1;

static void sent(avr_irq_t *irq, uint32_t value, void *param) {
  (void)irq, (void)param;
  uint8_t byte = value;
  if (write(1, &byte, 1) != 1) exit(1);
}
static void xon(avr_irq_t *irq, uint32_t value, void *param) { (void)irq, (void)value, (void)param; may_receive = 1; }
static void xoff(avr_irq_t *irq, uint32_t value, void *param) { (void)irq, (void)value, (void)param; may_receive = 0; }
static void drive(avr_irq_t *irq, uint32_t value, void *param) {
  (void)irq, (void)param;
  fprintf(stderr, "drive %u %llu\n", value & 1, (unsigned long long)avr->cycle);
  if (value & 1) touch_at = avr->cycle + 16000 * 80, release_at = touch_at + 16000 * 2;
}
static void pin(char port, int number, int level) {
  avr_raise_irq(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ(port), number), level);
}

int main(int argc, char **argv) {
  elf_firmware_t program = {{0}};
  if (argc != 2 || elf_read_firmware(argv[1], &program)) return 2;
  avr = avr_make_mcu_by_name("atmega328p");
  avr_init(avr);
  avr->frequency = 16000000;
  avr_load_firmware(avr, &program);
  uint32_t flags = 0;
  avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
  avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), sent, 0);
  avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XON), xon, 0);
  avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XOFF), xoff, 0);
  avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('B'), 1), drive, 0);
  avr_ioport_external_t grounded = {.name = 'D', .mask = 1 << 4, .value = 0}; /* stronger than the pull-up */
  avr_ioctl(avr, AVR_IOCTL_IOPORT_SET_EXTERNAL('D'), &grounded);
  pin('D', 2, 1), pin('D', 4, 0);
  struct timespec start, now;
  clock_gettime(CLOCK_MONOTONIC, &start);
  for (;;) {
    clock_gettime(CLOCK_MONOTONIC, &now);
    avr_cycle_count_t due = (now.tv_sec - start.tv_sec) * 16000000ll + (now.tv_nsec - start.tv_nsec) * 16 / 1000;
    while (avr->cycle < due) {
      if (avr_run(avr) >= cpu_Done) return 1;
      if (touch_at && avr->cycle >= touch_at) touch_at = 0, pin('D', 2, 0), fprintf(stderr, "touch %llu\n", (unsigned long long)avr->cycle);
      if (release_at && avr->cycle >= release_at) release_at = 0, pin('D', 2, 1);
    }
    struct pollfd input = {0, POLLIN, 0};
    uint8_t byte;
    if (may_receive && poll(&input, 1, 0) > 0) {
      if (read(0, &byte, 1) != 1) return 0;
      avr_raise_irq(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT), byte);
    } else {
      usleep(50);
    }
  }
}
