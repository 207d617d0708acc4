// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/bag_runs.h"

#include <algorithm>
#include <cstdio>
#include <exception>
#include <iterator>
#include <optional>

#include <ros/message_traits.h>
#include <std_msgs/Header.h>

#include "devo/core/time.h"
#include "devo/ros/conversions.h"
#include "devo/ros/deserialise.h"
#include "devo/ros/message_conversion.h"

namespace devo {
namespace {

// A recorder closes one bag and opens the next between messages that may change places there.
constexpr std::int64_t kChangesPlaces_ns = 50'000'000;
// A first array of events may carry stamps of 0: the second one tells when the bag begins.
constexpr std::size_t kBegin = 1;

/// Empty where it cannot be read or holds no event.
std::optional<std::int64_t> DataTime(const BagMessage& message) {
  const ByteSpan bytes = message.bag->Read(message.entry);
  if (bytes.data == nullptr) return std::nullopt;
  try {
    if (message.topic().md5 != ros::message_traits::MD5Sum<EventArray>::value()) {
      return FromRosTime(Deserialise<std_msgs::Header>(bytes).stamp);
    }
    std::vector<Event> events;
    AppendSerializedEvents(bytes.data, bytes.size, &events);
    if (!events.empty()) return events.front().t_ns;
  } catch (const std::exception&) {  // who reads it in its turn says so
  }
  return std::nullopt;
}

template <typename Iterator>
std::int64_t FirstTime(Iterator begin, Iterator end) {
  for (; begin != end; ++begin) {
    if (const auto t_ns = DataTime(*begin)) return *t_ns;
  }
  return 0;
}

BagRun RunOf(BagFile* bag, const std::string& topic) {
  BagRun run;
  for (const BagEntry& entry : bag->entries()) {
    if (bag->topics()[entry.topic].name == topic) run.messages.push_back({bag, entry});
  }
  const auto skipped = static_cast<std::ptrdiff_t>(run.messages.size() > kBegin ? kBegin : 0);
  run.begin_ns = FirstTime(run.messages.begin() + skipped, run.messages.end());
  run.end_ns = std::max(run.begin_ns, FirstTime(run.messages.rbegin(), run.messages.rend()));
  run.bags = "'" + bag->path() + "'";
  return run;
}

std::string Span(const BagRun& run) {
  char text[64];
  std::snprintf(text, sizeof(text), " (%.3f to %.3f s)", SecondsFromNs(run.begin_ns), SecondsFromNs(run.end_ns));
  return run.bags + text;
}

}  // namespace

std::vector<BagRun> RunsOf(const std::vector<std::unique_ptr<BagFile>>& bags, const std::string& topic) {
  std::vector<BagRun> of_bags;
  for (const auto& bag : bags) {
    BagRun run = RunOf(bag.get(), topic);
    if (!run.messages.empty()) of_bags.push_back(std::move(run));
  }
  std::stable_sort(of_bags.begin(), of_bags.end(),
                   [](const BagRun& a, const BagRun& b) { return a.begin_ns < b.begin_ns; });
  std::vector<BagRun> runs;
  for (BagRun& next : of_bags) {
    if (runs.empty() || next.begin_ns < runs.back().end_ns - kChangesPlaces_ns) {
      runs.push_back(std::move(next));
      continue;
    }
    BagRun& last = runs.back();
    last.messages.insert(last.messages.end(), next.messages.begin(), next.messages.end());
    last.end_ns = std::max(last.end_ns, next.end_ns);
    last.bags += ", " + next.bags;
  }
  return runs;
}

std::string ComplaintOfOverlap(const std::string& topic, const BagRun& first, const BagRun& second) {
  return "topic '" + topic + "' is in " + Span(first) + " and again in " + Span(second) +
         ", expected bags that follow each other in time (is one a copy of the other?)";
}

}  // namespace devo
