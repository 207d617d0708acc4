// SPDX-License-Identifier: BSD-3-Clause
#include <pluginlib/class_list_macros.hpp>

#include "devo/ros/time_surface_node.h"
#include "nodelet_of.h"

namespace devo {
class TimeSurfaceNodelet : public NodeletOf<TimeSurfaceNode> {};
}  // namespace devo

PLUGINLIB_EXPORT_CLASS(devo::TimeSurfaceNodelet, nodelet::Nodelet)
