// SPDX-License-Identifier: BSD-3-Clause
//
// What the master knows of topics: in which type an input is published, and what to say where nothing comes.
#pragma once

#include <memory>
#include <string>

#include <ros/master.h>

namespace devo {

/// Topics and types that the master knows.
using KnownTopics = ros::master::V_TopicInfo;

/// Asked once in a moment for all nodelets of the process: reading the answer, which names all topics of a robot, is
/// most of what they cost while they wait. Empty, at once, while there is no master.
std::shared_ptr<const KnownTopics> AskForTopics();

/// What the master says about a topic, as the end of a sentence: "nobody publishes it; EventArray topics that exist:
/// /dvs/events" or "it is advertised but nothing comes". `type`: name without package, such as "EventArray", or several
/// that will do: "EventArray or EventPacket".
std::string DescribeTopic(const KnownTopics& known, const std::string& topic, const std::string& type);

}  // namespace devo
