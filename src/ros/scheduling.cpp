// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/scheduling.h"

#ifdef __linux__
#include <linux/sched/types.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#endif

namespace devo {

#ifdef __linux__
namespace {
constexpr unsigned kTurn_ns = 200'000;
constexpr int kBackgroundNice = 5;

int ThreadId() { return static_cast<int>(syscall(SYS_gettid)); }
}  // namespace

void PreferShortWaits() {
  sched_attr attributes{};
  // The scheduler's policy and the thread's nice value stay as whoever started the process wants them.
  if (syscall(SYS_sched_getattr, 0, &attributes, sizeof(attributes), 0) != 0 || attributes.sched_policy != 0) return;
  attributes.size = sizeof(attributes);
  attributes.sched_runtime = kTurn_ns;
  syscall(SYS_sched_setattr, 0, &attributes, 0);
}

void LetOthersGoFirst() {
  // On Linux a nice value is a thread's own.
  errno = 0;
  const int nice = getpriority(PRIO_PROCESS, ThreadId());
  if (errno == 0) setpriority(PRIO_PROCESS, ThreadId(), nice + kBackgroundNice);
}
#else
void PreferShortWaits() {}
void LetOthersGoFirst() {}
#endif

}  // namespace devo
