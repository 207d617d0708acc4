// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace devo {

/// One brightness change reported by an event camera (paper section III-B).
struct Event {
  std::int64_t t_ns = 0;      ///< sensor time, nanoseconds
  std::uint16_t x = 0;        ///< raw (distorted) column, pixel centres at integers
  std::uint16_t y = 0;        ///< raw (distorted) row
  std::uint8_t polarity = 0;  ///< 1: brighter (ON), 0: darker (OFF)
};
static_assert(sizeof(Event) == 16, "events are streamed by the million; keep them small");

inline bool IsEarlier(const Event& a, const Event& b) { return a.t_ns < b.t_ns; }

/// Read-only view of consecutive events, ordered in time. Does not own them.
struct EventSpan {
  const Event* data = nullptr;
  std::size_t size = 0;

  EventSpan() = default;
  EventSpan(const Event* data_in, std::size_t size_in) : data(data_in), size(size_in) {}
  EventSpan(const std::vector<Event>& events)  // NOLINT(google-explicit-constructor): a view
      : data(events.data()), size(events.size()) {}

  const Event* begin() const { return data; }
  const Event* end() const { return data + size; }
  bool empty() const { return size == 0; }
};

}  // namespace devo
