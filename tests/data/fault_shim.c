/* Preloaded into a test process: kills it, or fails, at the n-th call that changes the disk.
   fault_arm(n, mode): 0 kill before the call, 1 kill after it, 2 the disk is full from that call on. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

static long at = -1, count = 0;
static int mode = 0;

void fault_arm(long n, int m) { at = n; mode = m; count = 0; }
long fault_count(void) { return count; }

static int before(void) {
  if (at < 0) return 0;
  ++count;
  if (mode == 2) return count >= at;
  if (count == at && mode == 0) kill(getpid(), SIGKILL);
  return 0;
}
static void after(void) { if (at >= 0 && count == at && mode == 1) kill(getpid(), SIGKILL); }

#define REAL(name) ((__typeof__(&name)) dlsym(RTLD_NEXT, #name))
#define CALL(type, name, params, args, grows) \
  type name params { \
    if (before() && grows) { errno = ENOSPC; return -1; } \
    type result = REAL(name) args; after(); return result; }

CALL(ssize_t, write, (int fd, const void *data, size_t size), (fd, data, size), fd > 2)
CALL(ssize_t, pwrite, (int fd, const void *data, size_t size, off_t place), (fd, data, size, place), 1)
CALL(ssize_t, pwrite64, (int fd, const void *data, size_t size, off64_t place), (fd, data, size, place), 1)
CALL(ssize_t, writev, (int fd, const struct iovec *parts, int n), (fd, parts, n), fd > 2)
CALL(int, ftruncate, (int fd, off_t size), (fd, size), 0)
CALL(int, ftruncate64, (int fd, off64_t size), (fd, size), 0)
CALL(int, fsync, (int fd), (fd), 0)
CALL(int, fdatasync, (int fd), (fd), 0)
CALL(int, rename, (const char *from, const char *to), (from, to), 0)
CALL(int, unlink, (const char *path), (path), 0)
