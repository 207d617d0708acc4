// SPDX-License-Identifier: BSD-3-Clause
//
// Private parameters of the nodelets. Everything about rig and method stands in the yaml that `config` names; these
// are the settings that exist in ROS only.
#pragma once

#include <string>
#include <vector>

#include <ros/node_handle.h>

#include "devo/core/rigid3.h"
#include "devo/io/rig_config.h"

namespace devo {

/// Reads a private parameter or returns `fallback`. Throws std::invalid_argument naming the full parameter and its
/// type when it is of another type; the numeric forms also when it is outside [min, max].
std::string ReadString(const ros::NodeHandle& private_nh, const std::string& key, const std::string& fallback);
bool ReadBool(const ros::NodeHandle& private_nh, const std::string& key, bool fallback);
double ReadDouble(const ros::NodeHandle& private_nh, const std::string& key, double fallback, double min, double max);
int ReadInt(const ros::NodeHandle& private_nh, const std::string& key, int fallback, int min, int max);

/// A file to write: as it is when absolute, else below $ROS_HOME (or ~/.ros), as ROS's own logs are.
std::string ReadPath(const ros::NodeHandle& private_nh, const std::string& key, const std::string& fallback);

/// `x y z qx qy qz qw` as a string or a list of seven numbers; the quaternion must be of unit length to 1 %.
Rigid3 ReadPose(const ros::NodeHandle& private_nh, const std::string& key, const Rigid3& fallback);

/// Throws std::invalid_argument naming the first private parameter that is none of `known` (a typo would otherwise
/// leave the default in force without a word). See WithTunables.
void RefuseUnknown(const ros::NodeHandle& private_nh, const std::vector<std::string>& known);

/// Throws std::invalid_argument naming two keys of different messages that name the same topic: roscpp's own complaint
/// about such a topic names neither it nor them.
void RefuseSharedTopics(const Topics& topics);

/// The rig and options that parameter `config` (one path, or several separated by commas; later ones override
/// earlier ones) and `set` (`key=value` separated by spaces) give.
RigConfig ReadRigConfig(const ros::NodeHandle& private_nh);

/// The topic to subscribe: `name` when it is remapped (`events:=/my/events`), else the configuration's topic, to
/// which remappings apply too. Empty when neither is there.
std::string InputTopic(const ros::NodeHandle& nh, const std::string& name, const std::string& configured);

}  // namespace devo
