// SPDX-License-Identifier: BSD-3-Clause
#include <pluginlib/class_list_macros.hpp>

#include "devo/ros/simulated_sensor_node.h"
#include "nodelet_of.h"

namespace devo {
class SimulatedSensorNodelet : public NodeletOf<SimulatedSensorNode> {};
}  // namespace devo

PLUGINLIB_EXPORT_CLASS(devo::SimulatedSensorNodelet, nodelet::Nodelet)
