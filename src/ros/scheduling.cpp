// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/scheduling.h"

#ifdef __linux__
#include <cerrno>

#include <linux/sched/types.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>
#endif

namespace devo {

#ifdef __linux__
namespace {
constexpr unsigned kTurn_ns = 200'000;
constexpr int kNicer = 5;
}  // namespace

void PreferShortWaits() {
  sched_attr attributes{};
  // The scheduler's policy and the thread's nice value stay as whoever started the process wants them.
  if (syscall(SYS_sched_getattr, 0, &attributes, sizeof(attributes), 0) != 0 || attributes.sched_policy != 0) return;
  attributes.size = sizeof(attributes);
  attributes.sched_runtime = kTurn_ns;
  syscall(SYS_sched_setattr, 0, &attributes, 0);
}

void LetOthersFirst() {
  // In Linux nice values are each thread's own.
  const auto thread = static_cast<id_t>(syscall(SYS_gettid));
  errno = 0;
  const int nice = getpriority(PRIO_PROCESS, thread);
  if (errno == 0) setpriority(PRIO_PROCESS, thread, nice + kNicer);
}
#else
void PreferShortWaits() {}
void LetOthersFirst() {}
#endif

}  // namespace devo
