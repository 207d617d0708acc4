// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/scheduling.h"

#ifdef __linux__
#include <linux/sched/types.h>
#include <sys/syscall.h>
#include <unistd.h>
#endif

namespace devo {

#ifdef __linux__
namespace {
constexpr unsigned kTurn_ns = 200'000;
}  // namespace

void PreferShortWaits() {
  sched_attr attributes{};
  // The scheduler's policy and the thread's nice value stay as whoever started the process wants them.
  if (syscall(SYS_sched_getattr, 0, &attributes, sizeof(attributes), 0) != 0 || attributes.sched_policy != 0) return;
  attributes.size = sizeof(attributes);
  attributes.sched_runtime = kTurn_ns;
  syscall(SYS_sched_setattr, 0, &attributes, 0);
}
#else
void PreferShortWaits() {}
#endif

}  // namespace devo
