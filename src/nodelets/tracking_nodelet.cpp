// SPDX-License-Identifier: BSD-3-Clause
#include <pluginlib/class_list_macros.hpp>

#include "devo/ros/tracking_node.h"
#include "nodelet_of.h"

namespace devo {
class TrackingNodelet : public NodeletOf<TrackingNode> {};
}  // namespace devo

PLUGINLIB_EXPORT_CLASS(devo::TrackingNodelet, nodelet::Nodelet)
