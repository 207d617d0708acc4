// SPDX-License-Identifier: BSD-3-Clause
#include <pluginlib/class_list_macros.hpp>

#include "devo/ros/mapping_node.h"
#include "nodelet_of.h"

namespace devo {
class MappingNodelet : public NodeletOf<MappingNode> {};
}  // namespace devo

PLUGINLIB_EXPORT_CLASS(devo::MappingNodelet, nodelet::Nodelet)
