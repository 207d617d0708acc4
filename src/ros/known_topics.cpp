// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/known_topics.h"

#include <mutex>
#include <utility>

#include <ros/this_node.h>
#include <ros/time.h>

namespace devo {
namespace {

bool IsOneOf(const std::string& types, const std::string& datatype) {
  const std::string separator = " or ";
  return (separator + types + separator).find(separator + datatype.substr(datatype.find('/') + 1) + separator) !=
         std::string::npos;
}

/// ros::master::getTopics, but for one thing: where the master cannot be reached, that asks again for ever, and with it
/// stands the callback queue that asked.
KnownTopics AskOnce() {
  XmlRpc::XmlRpcValue request, response, topics;
  request[0] = ros::this_node::getName();
  request[1] = "";  // below no name in particular
  KnownTopics known;
  constexpr bool kWaitForMaster = false;
  if (!ros::master::execute("getPublishedTopics", request, response, topics, kWaitForMaster)) return known;
  const int size = topics.size();  // its iterators are those of a struct
  for (int i = 0; i < size; ++i) known.emplace_back(std::string(topics[i][0]), std::string(topics[i][1]));
  return known;
}

}  // namespace

std::shared_ptr<const KnownTopics> AskForTopics() {
  constexpr double kMoment_s = 0.4;
  static std::mutex mutex;
  static std::shared_ptr<const KnownTopics> last;
  static ros::WallTime asked;
  const std::lock_guard<std::mutex> lock(mutex);
  const double age_s = (ros::WallTime::now() - asked).toSec();
  if (last && age_s >= 0 && age_s < kMoment_s) return last;
  last = std::make_shared<const KnownTopics>(AskOnce());
  asked = ros::WallTime::now();
  return last;
}

std::string DescribeTopic(const KnownTopics& known, const std::string& topic, const std::string& type) {
  std::string same_type;
  for (const ros::master::TopicInfo& info : known) {
    if (info.name == topic) {
      if (IsOneOf(type, info.datatype)) return "it is advertised but nothing comes";
      return "it is published as " + info.datatype;
    }
    if (IsOneOf(type, info.datatype)) same_type += (same_type.empty() ? "" : ", ") + info.name;
  }
  if (same_type.empty()) return "nobody publishes it, nor any other " + type;
  return "nobody publishes it; " + type + " topics that exist: " + same_type;
}

}  // namespace devo
