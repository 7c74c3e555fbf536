/* Stand-in for libusb-1.0: its calls, as far as Aravis makes them, on one device behind a Unix socket.

   The socket lies beside this library and is called bus.sock; if nobody listens there, the bus is empty. All
   logic of the device is behind the socket (usb_device.py): each transfer is a request, whose answer ends it.

   Not modelled: several devices, isochronous and interrupt transfers, time-outs of asynchronous transfers. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#include "usb_library.h"

#define SOCKET "bus.sock"
#define USBFS_BYTES (16 << 20) /* the kernel's default limit of submitted transfers, usbfs_memory_mb */

enum { OPEN = 1, CLAIM, RELEASE, CLEAR_HALT, SET_HALT, STRING, OUT, IN, CANCEL };
/* --- the device: control, events and stream of USB3 Vision --- */

#define ENDPOINT(number) {7, 5, number, 2, 1024, 0, 0, 0, NULL, 0}
static const struct endpoint_descriptor control_endpoints[] = {ENDPOINT(0x81), ENDPOINT(0x01)};
static const struct endpoint_descriptor event_endpoint = ENDPOINT(0x82), stream_endpoint = ENDPOINT(0x83);
static const unsigned char information[20] = {20, 0x24, 1, 0, 0, 1, 0, 1, 0, 1, 0, 4, 1, 2, 2, 5, 5, 3, 0, 8};
static const struct interface_descriptor descriptors[] = {
    {9, 4, 0, 0, 2, 0xef, 5, 0, 0, control_endpoints, information, sizeof information},
    {9, 4, 1, 0, 1, 0xef, 5, 1, 0, &event_endpoint, NULL, 0},
    {9, 4, 2, 0, 1, 0xef, 5, 2, 0, &stream_endpoint, NULL, 0},
};
static const struct interface interfaces[] = {{&descriptors[0], 1}, {&descriptors[1], 1}, {&descriptors[2], 1}};
static const unsigned char association[8] = {8, 11, 0, 3, 0xef, 5, 0, 0};
static const struct config_descriptor configuration = {
    9, 2, 92, 3, 1, 0, 0x80, 112, interfaces, association, sizeof association};
static const struct device_descriptor description = {
    18, 1, 0x0300, 0xef, 2, 1, 9, 0x1209, 0x0001, 0x0100, 1, 2, 3, 1};

/* --- requests --- */

struct request { uint32_t operation, id, argument, length; };
struct answer { uint32_t id; int32_t status; uint32_t length; };

struct pending {
  uint32_t id, capacity, actual;
  int status, done;
  unsigned char *buffer;
  struct transfer *transfer; /* NULL: somebody waits for the end */
  struct pending *next;
};

struct context {
  struct pending *ended; /* asynchronous transfers whose callbacks are due, the first first */
  struct device *left;   /* device that was unplugged and not reported yet */
  int (*on_left)(struct context *, struct device *, int, void *);
  void *on_left_data;
};

struct device { struct context *context; int references; };

struct handle {
  struct device *device;
  int socket, gone;
  uint32_t last_id;
  pthread_t reader;
  struct pending *pending;
};

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER, sending = PTHREAD_MUTEX_INITIALIZER;
static pthread_cond_t changed = PTHREAD_COND_INITIALIZER;
static int64_t submitted_bytes;

static struct timespec after_us(int64_t us) {
  struct timespec end;
  clock_gettime(CLOCK_MONOTONIC, &end);
  int64_t ns = end.tv_nsec + us % 1000000 * 1000;
  return (struct timespec){end.tv_sec + us / 1000000 + ns / 1000000000, ns % 1000000000};
}

static int connected_socket(void) {
  struct sockaddr_un address = {.sun_family = AF_UNIX};
  Dl_info library;
  if (dladdr(connected_socket, &library) == 0) return -1;
  size_t folder = strrchr(library.dli_fname, '/') + 1 - library.dli_fname;
  if (folder + sizeof SOCKET > sizeof address.sun_path) return -1;
  memcpy(address.sun_path, library.dli_fname, folder);
  strcpy(address.sun_path + folder, SOCKET);
  int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (fd >= 0 && connect(fd, (struct sockaddr *)&address, sizeof address) != 0) {
    close(fd);
    return -1;
  }
  return fd;
}

static int read_all(int fd, void *target, size_t length) {
  for (char *at = target; length > 0;) {
    ssize_t got = recv(fd, at, length, 0);
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) return -1;
    at += got, length -= got;
  }
  return 0;
}

static void send_request(struct handle *handle, struct request request, const void *data) {
  struct { const void *at; size_t length; } parts[] = {
      {&request, sizeof request}, {data, request.operation == OUT ? request.length : 0}};
  pthread_mutex_lock(&sending);
  for (int i = 0; i < 2; i++)
    while (parts[i].length > 0) {
      ssize_t sent = send(handle->socket, parts[i].at, parts[i].length, MSG_NOSIGNAL);
      if (sent < 0 && errno == EINTR) continue;
      if (sent < 0) break; /* the reader finds the end of the connection */
      parts[i].at = (const char *)parts[i].at + sent, parts[i].length -= sent;
    }
  pthread_mutex_unlock(&sending);
}

/* The caller holds the lock, here and in `finish`. */
static struct pending *enlist(struct handle *handle, struct pending *each) {
  each->id = ++handle->last_id;
  each->next = handle->pending;
  return handle->pending = each;
}

static void finish(struct handle *handle, struct pending *each, int status, uint32_t actual) {
  struct pending **at = &handle->pending;
  while (*at != each) at = &(*at)->next;
  *at = each->next;
  each->status = status, each->actual = actual, each->done = 1, each->next = NULL;
  if (each->transfer != NULL) {
    for (at = &handle->device->context->ended; *at != NULL;) at = &(*at)->next;
    *at = each;
  }
  pthread_cond_broadcast(&changed);
}

static void *read_answers(void *argument) {
  struct handle *handle = argument;
  struct answer answer;
  while (read_all(handle->socket, &answer, sizeof answer) == 0) {
    pthread_mutex_lock(&lock);
    struct pending *each = handle->pending;
    while (each != NULL && each->id != answer.id) each = each->next;
    pthread_mutex_unlock(&lock);
    if (each == NULL || answer.length > each->capacity) break;
    if (read_all(handle->socket, each->buffer, answer.length) != 0) break;
    pthread_mutex_lock(&lock);
    finish(handle, each, answer.status, answer.length);
    pthread_mutex_unlock(&lock);
  }
  pthread_mutex_lock(&lock);
  handle->gone = 1;
  while (handle->pending != NULL)
    finish(handle, handle->pending, handle->pending->transfer == NULL ? ERROR_NO_DEVICE : NO_DEVICE, 0);
  handle->device->context->left = handle->device;
  pthread_cond_broadcast(&changed);
  pthread_mutex_unlock(&lock);
  return NULL;
}

/* Send a request and wait for its end; status of the answer, or ERROR_TIMEOUT. */
static int call(struct handle *handle, struct request request, void *data, uint32_t capacity, int *actual,
                unsigned timeout_ms) {
  struct pending each = {.buffer = data, .capacity = capacity};
  struct timespec end = after_us((int64_t)timeout_ms * 1000);
  int cancelled = 0;
  pthread_mutex_lock(&lock);
  if (handle->gone) {
    pthread_mutex_unlock(&lock);
    return ERROR_NO_DEVICE;
  }
  request.id = enlist(handle, &each)->id;
  pthread_mutex_unlock(&lock);
  send_request(handle, request, data);
  pthread_mutex_lock(&lock);
  while (!each.done)
    if (timeout_ms == 0 || cancelled) {
      pthread_cond_wait(&changed, &lock);
    } else if (pthread_cond_clockwait(&changed, &lock, CLOCK_MONOTONIC, &end) == ETIMEDOUT && !each.done) {
      cancelled = 1;
      pthread_mutex_unlock(&lock);
      send_request(handle, (struct request){CANCEL, each.id, 0, 0}, NULL);
      pthread_mutex_lock(&lock);
    }
  pthread_mutex_unlock(&lock);
  if (actual != NULL) *actual = each.actual;
  return each.status;
}

/* --- libusb's calls --- */

int libusb_init(struct context **context) { return (*context = calloc(1, sizeof **context)) ? SUCCESS : ERROR_NO_MEM; }
void libusb_exit(struct context *context) { free(context); }

const char *libusb_error_name(int code) {
  static const char *const names[] = {
      "LIBUSB_SUCCESS",       "LIBUSB_ERROR_IO",        "LIBUSB_ERROR_INVALID_PARAM", "LIBUSB_ERROR_ACCESS",
      "LIBUSB_ERROR_NO_DEVICE", "LIBUSB_ERROR_NOT_FOUND", "LIBUSB_ERROR_BUSY",        "LIBUSB_ERROR_TIMEOUT",
      "LIBUSB_ERROR_OVERFLOW",  "LIBUSB_ERROR_PIPE",      "LIBUSB_ERROR_INTERRUPTED", "LIBUSB_ERROR_NO_MEM"};
  return code <= 0 && code > -12 ? names[-code] : "LIBUSB_ERROR_OTHER";
}

ssize_t libusb_get_device_list(struct context *context, struct device ***list) {
  int fd = connected_socket();
  *list = calloc(2, sizeof **list);
  if (fd < 0) return 0;
  close(fd);
  **list = malloc(sizeof(struct device));
  ***list = (struct device){context, 1};
  return 1;
}

static void unreference(struct device *device) {
  if (--device->references == 0) free(device);
}

void libusb_free_device_list(struct device **list, int unreferenced) {
  if (*list != NULL && unreferenced) unreference(*list);
  free(list);
}

int libusb_get_device_descriptor(struct device *device, struct device_descriptor *target) {
  (void)device, *target = description;
  return SUCCESS;
}

int libusb_get_config_descriptor(struct device *device, uint8_t index, const struct config_descriptor **target) {
  (void)device, (void)index, *target = &configuration;
  return SUCCESS;
}

void libusb_free_config_descriptor(struct config_descriptor *config) { (void)config; }
uint8_t libusb_get_bus_number(struct device *device) { return (void)device, 2; }
uint8_t libusb_get_device_address(struct device *device) { return (void)device, 9; }
int libusb_get_device_speed(struct device *device) { return (void)device, SPEED_SUPER; }
struct device *libusb_get_device(struct handle *handle) { return handle->device; }

void libusb_close(struct handle *handle) {
  shutdown(handle->socket, SHUT_RDWR);
  pthread_join(handle->reader, NULL);
  close(handle->socket);
  pthread_mutex_lock(&lock);
  if (handle->device->context->left == handle->device) handle->device->context->left = NULL;
  unreference(handle->device);
  pthread_mutex_unlock(&lock);
  free(handle);
}

int libusb_open(struct device *device, struct handle **target) {
  struct handle *handle = calloc(1, sizeof *handle);
  handle->device = device;
  handle->socket = connected_socket();
  if (handle->socket < 0) {
    free(handle);
    return ERROR_NO_DEVICE;
  }
  device->references++;
  pthread_create(&handle->reader, NULL, read_answers, handle);
  int status = call(handle, (struct request){.operation = OPEN}, NULL, 0, NULL, 0);
  if (status == SUCCESS) *target = handle;
  else libusb_close(handle);
  return status;
}

int libusb_get_string_descriptor_ascii(struct handle *handle, uint8_t index, unsigned char *text, int length) {
  int actual = 0;
  struct request request = {.operation = STRING, .argument = index, .length = length - 1};
  int status = call(handle, request, text, length - 1, &actual, 1000);
  text[actual] = 0;
  return status == SUCCESS ? actual : status;
}

int libusb_set_auto_detach_kernel_driver(struct handle *handle, int on) { return (void)handle, (void)on, SUCCESS; }

int libusb_claim_interface(struct handle *handle, int number) {
  return call(handle, (struct request){.operation = CLAIM, .argument = number}, NULL, 0, NULL, 0);
}

int libusb_release_interface(struct handle *handle, int number) {
  return call(handle, (struct request){.operation = RELEASE, .argument = number}, NULL, 0, NULL, 0);
}

int libusb_clear_halt(struct handle *handle, unsigned char endpoint) {
  return call(handle, (struct request){.operation = CLEAR_HALT, .argument = endpoint}, NULL, 0, NULL, 0);
}

/* Aravis makes one kind of control transfer: it halts an endpoint (SET_FEATURE) to clear it afterwards. */
int libusb_control_transfer(struct handle *handle, uint8_t type, uint8_t kind, uint16_t value, uint16_t index,
                            unsigned char *data, uint16_t length, unsigned timeout_ms) {
  (void)type, (void)kind, (void)value, (void)data, (void)length, (void)timeout_ms;
  return call(handle, (struct request){.operation = SET_HALT, .argument = index}, NULL, 0, NULL, 0);
}

int libusb_bulk_transfer(struct handle *handle, unsigned char endpoint, unsigned char *data, int length, int *actual,
                         unsigned timeout_ms) {
  int in = endpoint & TO_HOST;
  struct request request = {in ? IN : OUT, 0, endpoint, length};
  if (actual != NULL) *actual = 0;
  int status = call(handle, request, data, in ? length : 0, in ? actual : NULL, timeout_ms);
  if (!in && status == COMPLETED && actual != NULL) *actual = length;
  switch (status) {
    case COMPLETED: return SUCCESS;
    case TIMED_OUT: case CANCELLED: return ERROR_TIMEOUT;
    case STALL: return ERROR_PIPE;
    case NO_DEVICE: return ERROR_NO_DEVICE;
    case OVERFLOW: return ERROR_OVERFLOW;
    default: return status < 0 ? status : ERROR_IO;
  }
}

struct transfer *libusb_alloc_transfer(int packets) { return (void)packets, calloc(1, sizeof(struct transfer)); }
void libusb_free_transfer(struct transfer *transfer) { free(transfer); }
unsigned char *libusb_dev_mem_alloc(struct handle *handle, size_t length) { return (void)handle, (void)length, NULL; }
int libusb_dev_mem_free(struct handle *handle, unsigned char *data, size_t length) {
  return (void)handle, (void)data, (void)length, SUCCESS;
}

int libusb_submit_transfer(struct transfer *transfer) {
  struct handle *handle = transfer->handle;
  struct pending *each = calloc(1, sizeof *each);
  *each = (struct pending){.buffer = transfer->buffer, .capacity = transfer->length, .transfer = transfer};
  pthread_mutex_lock(&lock);
  int status = handle->gone ? ERROR_NO_DEVICE
               : submitted_bytes + transfer->length > USBFS_BYTES ? ERROR_IO : SUCCESS;
  if (status == SUCCESS) {
    submitted_bytes += transfer->length;
    enlist(handle, each);
  }
  struct request request = {transfer->endpoint & TO_HOST ? IN : OUT, each->id, transfer->endpoint, transfer->length};
  pthread_mutex_unlock(&lock);
  if (status == SUCCESS) send_request(handle, request, transfer->buffer);
  else free(each);
  return status;
}

int libusb_cancel_transfer(struct transfer *transfer) {
  pthread_mutex_lock(&lock);
  struct pending *each = transfer->handle->pending;
  while (each != NULL && each->transfer != transfer) each = each->next;
  uint32_t id = each == NULL ? 0 : each->id;
  pthread_mutex_unlock(&lock);
  if (id == 0) return ERROR_NOT_FOUND;
  send_request(transfer->handle, (struct request){CANCEL, id, 0, 0}, NULL);
  return SUCCESS;
}

int libusb_handle_events_timeout(struct context *context, struct timeval *limit) {
  struct timespec end = after_us((int64_t)limit->tv_sec * 1000000 + limit->tv_usec);
  pthread_mutex_lock(&lock);
  while (context->ended == NULL && context->left == NULL)
    if (pthread_cond_clockwait(&changed, &lock, CLOCK_MONOTONIC, &end) == ETIMEDOUT) break;
  while (context->ended != NULL) {
    struct pending *each = context->ended;
    context->ended = each->next;
    submitted_bytes -= each->transfer->length;
    pthread_mutex_unlock(&lock);
    each->transfer->status = each->status, each->transfer->actual = each->actual;
    each->transfer->callback(each->transfer);
    free(each);
    pthread_mutex_lock(&lock);
  }
  struct device *left = context->left;
  context->left = NULL;
  pthread_mutex_unlock(&lock);
  if (left != NULL && context->on_left != NULL) context->on_left(context, left, DEVICE_LEFT, context->on_left_data);
  return SUCCESS;
}

int libusb_hotplug_register_callback(struct context *context, int events, int flags, int vendor, int product, int class,
                                     int (*callback)(struct context *, struct device *, int, void *), void *data,
                                     int *number) {
  (void)events, (void)flags, (void)vendor, (void)product, (void)class;
  context->on_left = callback, context->on_left_data = data, *number = 1;
  return SUCCESS;
}

void libusb_hotplug_deregister_callback(struct context *context, int number) {
  (void)number, context->on_left = NULL;
}
