/* Sends frames from an application to an eyebox display (docs/live-input.md).
 *
 * It needs Linux on a little-endian system of 64 bits, and C99 or C++ with GCC or Clang.
 *
 *     eyebox_live live;
 *     if (eyebox_live_connect(&live, "demo")) return fprintf(stderr, "%s\n", live.error), 1;
 *     while (eyebox_live_wait(&live, 1000) >= 0) { ... eyebox_live_begin, write, eyebox_live_publish ... }
 *     eyebox_live_close(&live);
 *
 * Only one thread at a time may call the functions. `error` has the reason of a refusal in one line.
 * This file implements the format itself and is no binding of the Rust crate. A program therefore needs only this file
 * and a C compiler. */
#ifndef EYEBOX_LIVE_H
#define EYEBOX_LIVE_H

#include <asm/socket.h>
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/times.h>
#include <sys/un.h>
#include <unistd.h>

#if __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__ || !defined(__linux__) || !defined(__LP64__)
#error "eyebox_live.h is for Linux, little-endian, 64 bits"
#endif

enum { EYEBOX_LIVE_VIEWS = 1, EYEBOX_LIVE_COLOR_AND_DEPTH = 2, EYEBOX_LIVE_LAYERS = 4 };
enum { EYEBOX_LIVE_U8 = 1, EYEBOX_LIVE_U16 = 2, EYEBOX_LIVE_F16 = 3, EYEBOX_LIVE_F32 = 4 };
enum { EYEBOX_LIVE_LINEAR = 1, EYEBOX_LIVE_SRGB = 2 };

/* A request of the display, in the layout of the shared memory. Times are in ns of CLOCK_MONOTONIC. */
typedef struct {
    uint64_t number;
    int64_t lit_ns;
    uint64_t period_ns;
    double pupil_x_mm, pupil_y_mm, pupil_diameter_mm, focus_dioptres, velocity_x_mm_s, velocity_y_mm_s;
    uint32_t kind, tracked;
    uint32_t view_rows, view_columns;
    double pitch_mm, center_x_mm, center_y_mm;
} eyebox_live_request_t;

/* The description of a frame. `dioptres` has the distances of the layers, with the farthest first. */
typedef struct {
    uint32_t kind, sample, transfer;
    uint32_t view_rows, view_columns, layers;
    uint64_t request;
    int64_t content_time_ns;
    double pitch_mm, center_x_mm, center_y_mm;
    float dioptres[64];
    /* If 1, the samples are in the display's device memory, at slot * slot_stride (see eyebox_live_share). Layers are
     * never there. */
    uint32_t on_device;
} eyebox_live_frame;

/* Memory of the display's device, in the layout of the region. It has VkPhysicalDeviceIDProperties of the device,
 * allocationSize, VkBufferCreateInfo's size, bytes from slot to slot, memoryTypeIndex and VkBufferUsageFlags. */
typedef struct {
    uint8_t device_uuid[16], driver_uuid[16];
    uint64_t memory_bytes, buffer_bytes, slot_stride;
    uint32_t memory_type, usage;
} eyebox_live_memory;

typedef struct {
    /* The offer of the display. */
    uint32_t rows, columns, most_view_rows, most_view_columns, most_layers, kinds, colors, channels;
    double pixel_angle, eyebox_width_mm, eyebox_height_mm;
    char error[160];
    /* Private members. */
    int socket;
    uint8_t *region;
    uint64_t length, first, stride, room, frames, seen;
    uint32_t slots;
    int newest, writing, shares;
} eyebox_live;

static inline int eyebox_live_failed(eyebox_live *live, const char *what, const char *why) {
    snprintf(live->error, sizeof live->error, "%s%s%s", what, *why ? ": " : "", why);
    return -1;
}

static inline uint32_t eyebox_live_u32(const uint8_t *at) { uint32_t v; memcpy(&v, at, 4); return v; }
static inline uint64_t eyebox_live_u64(const uint8_t *at) { uint64_t v; memcpy(&v, at, 8); return v; }
static inline double eyebox_live_f64(const uint8_t *at) { double v; memcpy(&v, at, 8); return v; }
static inline uint64_t *eyebox_live_word(const eyebox_live *live, uint64_t at) { return (uint64_t *)(void *)(live->region + at); }

/* Ends the connection. */
static inline void eyebox_live_close(eyebox_live *live) {
    if (live->region) munmap(live->region, live->length);
    if (live->socket >= 0) close(live->socket);
    live->region = NULL;
    live->socket = -1;
}

/* Receives the display's answer, and maps and checks the region. */
static inline int eyebox_live_greeted(eyebox_live *live) {
    uint8_t message[128];
    union { struct cmsghdr header; uint8_t space[CMSG_SPACE(sizeof(int))]; } control;
    struct iovec part = {message, sizeof message};
    struct msghdr all;
    struct pollfd waiting = {live->socket, POLLIN, 0};
    struct stat there;
    int fd = -1, seals;
    memset(&all, 0, sizeof all);
    memset(&control, 0, sizeof control);
    all.msg_iov = &part, all.msg_iovlen = 1, all.msg_control = &control, all.msg_controllen = sizeof control;
    if (poll(&waiting, 1, 10000) != 1) return eyebox_live_failed(live, "the display does not answer", "");
    ssize_t got = recvmsg(live->socket, &all, MSG_CMSG_CLOEXEC | MSG_DONTWAIT);
    struct cmsghdr *header = got < 0 ? NULL : CMSG_FIRSTHDR(&all);
    if (header && header->cmsg_type == SCM_RIGHTS && header->cmsg_len == CMSG_LEN(sizeof fd)) memcpy(&fd, CMSG_DATA(header), sizeof fd);
    if (got != sizeof message || memcmp(message, "EYELIVE1", 8) || eyebox_live_u32(message + 8) != 1) {
        if (fd >= 0) close(fd);
        return eyebox_live_failed(live, "no greeting of live input, version 1", "");
    }
    message[127] = 0;
    if (eyebox_live_u32(message + 12) || fd < 0) {
        if (fd >= 0) close(fd);
        return eyebox_live_failed(live, "the display refused", (char *)message + 24);
    }
    live->length = eyebox_live_u64(message + 16);
    seals = fcntl(fd, 1034 /* F_GET_SEALS */);
    if (seals < 0 || (seals & 6) != 6 /* F_SEAL_SHRINK | F_SEAL_GROW */ || fstat(fd, &there) || (uint64_t)there.st_size != live->length || live->length < 4096) {
        close(fd);
        return eyebox_live_failed(live, "the display's memory is not sealed, or has another length than announced", "");
    }
    void *map = mmap(NULL, live->length, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    close(fd);
    if (map == MAP_FAILED) return eyebox_live_failed(live, "mapping shared memory", strerror(errno));
    live->region = (uint8_t *)map;
    const uint8_t *r = live->region;
    live->slots = eyebox_live_u32(r + 12), live->first = eyebox_live_u64(r + 24), live->stride = eyebox_live_u64(r + 32), live->room = eyebox_live_u64(r + 40);
    live->rows = eyebox_live_u32(r + 48), live->columns = eyebox_live_u32(r + 52);
    live->most_view_rows = eyebox_live_u32(r + 56), live->most_view_columns = eyebox_live_u32(r + 60);
    live->most_layers = eyebox_live_u32(r + 64), live->colors = eyebox_live_u32(r + 68), live->kinds = eyebox_live_u32(r + 72);
    live->pixel_angle = eyebox_live_f64(r + 80), live->eyebox_width_mm = eyebox_live_f64(r + 88), live->eyebox_height_mm = eyebox_live_f64(r + 96);
    live->channels = (live->colors & 1) + (live->colors >> 1 & 1) + (live->colors >> 2 & 1);
    int fits = live->slots >= 3 && live->slots <= 8 && live->first == 4096 && live->stride % 4096 == 0 && live->stride <= live->length &&
               live->room >= 64 && live->room <= live->stride && live->room + 512 <= live->stride && live->first + live->slots * live->stride == live->length;
    if (memcmp(r, "EYELIVE1", 8) || eyebox_live_u32(r + 8) != 1 || !fits || !live->channels || live->rows - 1 >= 65536 || live->columns - 1 >= 65536)
        return eyebox_live_failed(live, "the display sent damaged data", "its numbers do not fit each other");
    return 0;
}

/* Connects to the display that takes frames as live:`name`. Returns 0, or -1 and sets `error`. */
static inline int eyebox_live_connect(eyebox_live *live, const char *name) {
    const char *runtime = getenv("XDG_RUNTIME_DIR");
    struct sockaddr_un to;
    struct { int pid; uint32_t uid, gid; } peer;
    socklen_t size = sizeof peer;
    int written;
    memset(live, 0, sizeof *live);
    memset(&to, 0, sizeof to);
    live->socket = live->newest = live->writing = -1;
    to.sun_family = AF_UNIX;
    if (!*name || *name == '.' || strlen(name) > 64 || strspn(name, "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-") != strlen(name))
        return eyebox_live_failed(live, "a name has 1 to 64 letters, digits, '.', '_' and '-', and does not begin with '.'", "");
    if (runtime && *runtime == '/') written = snprintf(to.sun_path, sizeof to.sun_path, "%s/eyebox/%s.sock", runtime, name);
    else written = snprintf(to.sun_path, sizeof to.sun_path, "/tmp/eyebox-%u/%s.sock", (unsigned)geteuid(), name);
    if (written < 0 || written >= (int)sizeof to.sun_path) return eyebox_live_failed(live, "the socket's path is too long", "");
    live->socket = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (live->socket < 0 || connect(live->socket, (struct sockaddr *)&to, sizeof to)) {
        eyebox_live_failed(live, "no display takes frames there", strerror(errno));
    } else if (getsockopt(live->socket, SOL_SOCKET, SO_PEERCRED, &peer, &size) || peer.uid != (uint32_t)geteuid()) {
        eyebox_live_failed(live, "the display belongs to another user", "");
    } else if (!eyebox_live_greeted(live)) {
        return 0;
    }
    eyebox_live_close(live);
    return -1;
}

/* Reads the current request of the display. Returns 1, or 0 before the first request. */
static inline int eyebox_live_request(const eyebox_live *live, eyebox_live_request_t *request) {
    uint64_t *sequence = eyebox_live_word(live, 192);
    for (int i = 0; i < 1000; i++) {
        uint64_t before = __atomic_load_n(sequence, __ATOMIC_ACQUIRE);
        memcpy(request, live->region + 200, sizeof *request);
        __atomic_thread_fence(__ATOMIC_ACQUIRE);
        if (before % 2 == 0 && before == __atomic_load_n(sequence, __ATOMIC_RELAXED)) return before != 0;
    }
    return 0;
}

/* Returns the milliseconds of a clock that is never set. C99 programs have times() for this. It counts in steps of
 * 10 ms. */
static inline int64_t eyebox_live_now_ms(void) {
    struct tms used;
    return (int64_t)times(&used) * 1000 / sysconf(_SC_CLK_TCK);
}

/* Returns the end of a wait of at least `timeout_ms` that begins now, or -1 for no end if it is below 0. */
static inline int64_t eyebox_live_until(int timeout_ms) {
    return timeout_ms < 0 ? -1 : eyebox_live_now_ms() + timeout_ms + (timeout_ms ? 10 : 0);
}

/* Returns the milliseconds until this end, or -1 for no end if it is below 0. */
static inline int eyebox_live_left(int64_t until_ms) {
    int64_t left = until_ms < 0 ? -1 : until_ms - eyebox_live_now_ms();
    return until_ms < 0 ? -1 : left < 0 ? 0 : left > 0x7fffffff ? 0x7fffffff : (int)left;
}

/* Waits for a request that no earlier wait returned, for at most `timeout_ms` (forever if below 0). Returns 1, 0 if
 * none arrived in time, or -1 if the display is gone. */
static inline int eyebox_live_wait(eyebox_live *live, int timeout_ms) {
    for (int64_t until_ms = eyebox_live_until(timeout_ms);;) {
        int left_ms = eyebox_live_left(until_ms);
        uint8_t bytes[256];
        eyebox_live_request_t request;
        struct pollfd waiting = {live->socket, POLLIN, 0};
        ssize_t got = recv(live->socket, bytes, sizeof bytes, MSG_DONTWAIT);
        if (got == 0 || (got < 0 && errno != EAGAIN && errno != EINTR)) return eyebox_live_failed(live, "the display is gone", "");
        if (eyebox_live_request(live, &request) && request.number != live->seen) return live->seen = request.number, 1;
        if (!left_ms) return 0;
        poll(&waiting, 1, left_ms);
    }
}

/* Returns 1 if the display has memory of a device to share. Then `device_uuid` and `driver_uuid` identify the device.
 * An application on another device, or with another driver, continues with the region. */
static inline int eyebox_live_device(const eyebox_live *live, eyebox_live_memory *memory) {
    if (__atomic_load_n(eyebox_live_word(live, 104), __ATOMIC_ACQUIRE) != 1) return 0;
    memcpy(memory, live->region + 1024, sizeof *memory);
    return 1;
}

/* Requests that memory. Returns its file descriptor, or -1 and sets `error`. Import it by VkImportMemoryFdInfoKHR
 * (opaque) with allocationSize `memory_bytes` and memoryTypeIndex `memory_type`. Bind it at 0 to a buffer of
 * `buffer_bytes` and `usage` that was made with VkExternalMemoryBufferCreateInfo. To send a frame with `on_device`,
 * call eyebox_live_begin, but do not write to the pointer that it returns. Write the samples to
 * eyebox_live_slot(live) * slot_stride on the device. Add a barrier that hands the buffer to VK_QUEUE_FAMILY_EXTERNAL,
 * call vkQueueSubmit, wait for its fence, and call eyebox_live_publish. */
static inline int eyebox_live_share(eyebox_live *live, eyebox_live_memory *memory, int timeout_ms) {
    __atomic_store_n(eyebox_live_word(live, 136), 1, __ATOMIC_RELEASE);
    send(live->socket, "", 1, MSG_DONTWAIT | MSG_NOSIGNAL);
    for (int64_t until_ms = eyebox_live_until(timeout_ms);;) {
        int left_ms = eyebox_live_left(until_ms);
        uint8_t bytes[256];
        union { struct cmsghdr header; uint8_t space[CMSG_SPACE(sizeof(int))]; } control;
        struct iovec part = {bytes, sizeof bytes};
        struct msghdr all;
        struct pollfd waiting = {live->socket, POLLIN, 0};
        memset(&all, 0, sizeof all);
        memset(&control, 0, sizeof control);
        all.msg_iov = &part, all.msg_iovlen = 1, all.msg_control = &control, all.msg_controllen = sizeof control;
        ssize_t got = recvmsg(live->socket, &all, MSG_CMSG_CLOEXEC | MSG_DONTWAIT);
        if (got == 0 || (got < 0 && errno != EAGAIN && errno != EINTR)) return eyebox_live_failed(live, "the display is gone", "");
        struct cmsghdr *header = got < 0 ? NULL : CMSG_FIRSTHDR(&all);
        int there = eyebox_live_device(live, memory), fd = -1;
        if (header && header->cmsg_type == SCM_RIGHTS && header->cmsg_len == CMSG_LEN(sizeof fd)) memcpy(&fd, CMSG_DATA(header), sizeof fd);
        if (fd >= 0 && there && memory->slot_stride >= live->room && memory->slot_stride <= memory->buffer_bytes / live->slots && memory->buffer_bytes <= memory->memory_bytes)
            return live->shares = 1, fd;
        if (fd >= 0) close(fd);
        if (fd >= 0 || !there) return eyebox_live_failed(live, "the display shares no memory of a device that holds its slots", "");
        if (!left_ms) return eyebox_live_failed(live, "the display does not answer", "");
        if (got < 0) poll(&waiting, 1, left_ms);
    }
}

/* Returns the slot of the frame that was begun. */
static inline int eyebox_live_slot(const eyebox_live *live) { return live->writing; }

/* Returns the bytes of a frame's samples. `*depth` (may be NULL) receives the offset of the dioptres of color and
 * depth. */
static inline uint64_t eyebox_live_bytes(const eyebox_live *live, const eyebox_live_frame *frame, uint64_t *depth) {
    static const uint64_t sizes[5] = {0, 1, 2, 2, 4};
    uint64_t pixels = (uint64_t)live->rows * live->columns, colors = pixels * live->channels;
    if (frame->kind == EYEBOX_LIVE_VIEWS) colors = colors * frame->view_rows * frame->view_columns;
    if (frame->kind == EYEBOX_LIVE_LAYERS) colors = pixels * (live->channels + 1) * frame->layers;
    colors *= sizes[frame->sample <= 4 ? frame->sample : 0];
    uint64_t from = (colors + 63) / 64 * 64;
    if (depth) *depth = from;
    return frame->kind == EYEBOX_LIVE_COLOR_AND_DEPTH ? from + pixels * 4 : colors;
}

/* Begins a frame. Returns the place for its samples, all of which must be written before eyebox_live_publish. Returns
 * NULL and sets `error` for a frame that the display would refuse by its size. */
static inline void *eyebox_live_begin(eyebox_live *live, const eyebox_live_frame *frame) {
    uint32_t views = frame->kind == EYEBOX_LIVE_VIEWS, layers = frame->kind == EYEBOX_LIVE_LAYERS ? frame->layers : 0;
    uint32_t shape[2] = {views ? frame->view_rows : 1, views ? frame->view_columns : 1};
    if ((frame->kind != 1 && frame->kind != 2 && frame->kind != 4) || !(frame->kind & live->kinds) || frame->sample - 1 > 3 || shape[0] - 1 > 63 || shape[1] - 1 > 63 || layers > 64 || frame->on_device > (uint32_t)(live->shares && frame->kind != EYEBOX_LIVE_LAYERS) || eyebox_live_bytes(live, frame, NULL) > live->room) {
        eyebox_live_failed(live, "the display takes no frame of this kind, sample and size", "");
        return NULL;
    }
    for (uint32_t i = 0;; i = (i + 1) % live->slots) {
        uint64_t *held = eyebox_live_word(live, 128), at = live->first + i * live->stride, *sequence = eyebox_live_word(live, at);
        if ((int)i == live->newest || __atomic_load_n(held, __ATOMIC_RELAXED) == i + 1) continue;
        uint64_t before = __atomic_load_n(sequence, __ATOMIC_RELAXED);
        __atomic_store_n(sequence, before | 1, __ATOMIC_RELAXED);
        __atomic_thread_fence(__ATOMIC_SEQ_CST);
        if (__atomic_load_n(held, __ATOMIC_SEQ_CST) == i + 1 && before % 2 == 0) {
            __atomic_store_n(sequence, before, __ATOMIC_RELEASE);
            continue;
        }
        uint8_t *header = live->region + at;
        uint64_t numbers[2] = {live->frames + 1, frame->request};
        uint32_t codes[8] = {frame->kind, frame->sample, frame->transfer, live->colors, live->rows, live->columns, shape[0], shape[1]};
        double places[3] = {views ? frame->pitch_mm : 0, frame->center_x_mm, frame->center_y_mm};
        uint64_t sizes[2] = {layers | (uint64_t)frame->on_device << 32, eyebox_live_bytes(live, frame, NULL)};
        memset(header + 8, 0, 504);
        memcpy(header + 8, numbers, sizeof numbers);
        memcpy(header + 24, &frame->content_time_ns, 8);
        memcpy(header + 32, codes, sizeof codes);
        memcpy(header + 64, places, sizeof places);
        memcpy(header + 88, sizes, sizeof sizes);
        memcpy(header + 128, frame->dioptres, layers * sizeof(float));
        live->writing = (int)i;
        return header + 512;
    }
}

/* Publishes the frame that was begun. Returns its number. */
static inline uint64_t eyebox_live_publish(eyebox_live *live) {
    if (live->writing < 0) return 0;
    uint64_t *sequence = eyebox_live_word(live, live->first + (uint64_t)live->writing * live->stride);
    __atomic_store_n(sequence, __atomic_load_n(sequence, __ATOMIC_RELAXED) + 1, __ATOMIC_RELEASE);
    live->newest = live->writing, live->writing = -1;
    send(live->socket, "", 1, MSG_DONTWAIT | MSG_NOSIGNAL);
    return ++live->frames;
}

#endif
