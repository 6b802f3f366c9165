/* System calls that fail, and a clock that jumps: preloaded into the program by failing_system.py.

   FAIL_CALL   write, rename or fsync: which calls fail, in files under FAIL_UNDER only
   FAIL_AT     the first one to fail, counted from 1, in each process
   FAIL_ON     if set, all later ones fail too
   FAIL_ERRNO  what they report
   CLOCK_JUMP_S  how far the calendar clock jumps, forth, back and home, every few calls */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#define CALLS_PER_JUMP 40

static atomic_int struck, asked;

static int fails(const char *call, const char *path) {
    const char *named = getenv("FAIL_CALL"), *under = getenv("FAIL_UNDER");
    if (!named || !under || strcmp(named, call)) return 0;
    if (path[0] == '/' && strncmp(path, under, strlen(under))) return 0;
    int number = ++struck, at = atoi(getenv("FAIL_AT"));
    if (number < at || (number > at && !getenv("FAIL_ON"))) return 0;
    errno = atoi(getenv("FAIL_ERRNO"));
    return 1;
}

static int handle_fails(const char *call, int handle) {
    char link[64], path[4096];
    if (!getenv("FAIL_CALL")) return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", handle);
    ssize_t length = readlink(link, path, sizeof path - 1);
    if (length <= 0) return 0;
    path[length] = 0;
    return path[0] == '/' && fails(call, path);
}

ssize_t write(int handle, const void *data, size_t count) {
    return handle_fails("write", handle) ? -1 : syscall(SYS_write, handle, data, count);
}

ssize_t pwrite64(int handle, const void *data, size_t count, off64_t at) {
    return handle_fails("write", handle) ? -1 : syscall(SYS_pwrite64, handle, data, count, at);
}

ssize_t pwrite(int handle, const void *data, size_t count, off_t at) {
    return pwrite64(handle, data, count, at);
}

int fsync(int handle) { return handle_fails("fsync", handle) ? -1 : syscall(SYS_fsync, handle); }

int fdatasync(int handle) {
    return handle_fails("fsync", handle) ? -1 : syscall(SYS_fdatasync, handle);
}

int rename(const char *from, const char *to) {
    if (fails("rename", to)) return -1;
    return syscall(SYS_renameat, AT_FDCWD, from, AT_FDCWD, to);
}

static time_t jump_s(void) {
    const char *far = getenv("CLOCK_JUMP_S");
    int side = ++asked / CALLS_PER_JUMP % 3;
    return !far || !side ? 0 : side == 1 ? atol(far) : -atol(far);
}

int clock_gettime(clockid_t clock, struct timespec *now) {
    int code = syscall(SYS_clock_gettime, clock, now);
    if (!code && clock == CLOCK_REALTIME) now->tv_sec += jump_s();
    return code;
}

int gettimeofday(struct timeval *restrict now, void *restrict zone) {
    (void)zone;
    struct timespec precise;
    int code = clock_gettime(CLOCK_REALTIME, &precise);
    if (!code) *now = (struct timeval){precise.tv_sec, precise.tv_nsec / 1000};
    return code;
}

time_t time(time_t *told) {
    struct timespec precise;
    clock_gettime(CLOCK_REALTIME, &precise);
    if (told) *told = precise.tv_sec;
    return precise.tv_sec;
}
