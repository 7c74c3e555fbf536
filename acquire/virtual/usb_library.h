/* Structures and numbers of libusb 1.0, after its binary interface (libusb.h of version 1.0.26). */

#include <stddef.h>
#include <stdint.h>

enum { SUCCESS = 0, ERROR_IO = -1, ERROR_NO_DEVICE = -4, ERROR_NOT_FOUND = -5, ERROR_TIMEOUT = -7, ERROR_OVERFLOW = -8,
       ERROR_PIPE = -9, ERROR_NO_MEM = -11 };
enum { COMPLETED, FAILED, TIMED_OUT, CANCELLED, STALL, NO_DEVICE, OVERFLOW }; /* ends of a transfer */
enum { SPEED_SUPER = 4, DEVICE_LEFT = 2, TO_HOST = 0x80 };

struct device_descriptor {
  uint8_t length, type;
  uint16_t usb;
  uint8_t class, subclass, protocol, max_packet;
  uint16_t vendor, product, version;
  uint8_t manufacturer_index, product_index, serial_index, configurations;
};

struct endpoint_descriptor {
  uint8_t length, type, address, attributes;
  uint16_t max_packet;
  uint8_t interval, refresh, synch;
  const unsigned char *extra;
  int extra_length;
};

struct interface_descriptor {
  uint8_t length, type, number, alternate, endpoints, class, subclass, protocol, index;
  const struct endpoint_descriptor *endpoint;
  const unsigned char *extra;
  int extra_length;
};

struct interface {
  const struct interface_descriptor *alternatives;
  int count;
};

struct config_descriptor {
  uint8_t length, type;
  uint16_t total;
  uint8_t interfaces, value, index, attributes, power;
  const struct interface *interface;
  const unsigned char *extra;
  int extra_length;
};

struct transfer {
  struct handle *handle;
  uint8_t flags;
  unsigned char endpoint, type;
  unsigned int timeout;
  int status, length, actual;
  void (*callback)(struct transfer *);
  void *user_data;
  unsigned char *buffer;
  int packets;
};
