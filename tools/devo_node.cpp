// SPDX-License-Identifier: BSD-3-Clause
//
// The three nodelets as one standalone node, for a debugger or a robot without a nodelet manager.
#include <malloc.h>

#include <cstdlib>
#include <exception>
#include <iostream>

#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <ros/spinner.h>

#include "devo/ros/mapping_node.h"
#include "devo/ros/time_surface_node.h"
#include "devo/ros/tracking_node.h"

namespace {

/// A module with a callback queue and a thread of its own, as in a nodelet manager. Parameters: ~config and so on in
/// the module's own namespace, such as ~tracking/config.
template <typename Node>
class Module {
 public:
  explicit Module(const std::string& name) : nh_(), private_nh_("~" + name), spinner_(1, &queue_) {
    nh_.setCallbackQueue(&queue_);
    private_nh_.setCallbackQueue(&queue_);
    node_ = std::make_unique<Node>(nh_, private_nh_);
    spinner_.start();
  }
  ~Module() { spinner_.stop(); }

 private:
  ros::CallbackQueue queue_;
  ros::NodeHandle nh_, private_nh_;
  std::unique_ptr<Node> node_;
  ros::AsyncSpinner spinner_;
};

/// A module's parameter falls back to the node's own, so that `_config:=rig.yaml` is enough.
void InheritParameters(const std::vector<std::string>& modules) {
  const ros::NodeHandle private_nh("~");
  for (const char* key : {"config", "set"}) {
    std::string value;
    if (!private_nh.getParam(key, value)) continue;
    for (const std::string& module : modules) {
      if (!private_nh.hasParam(module + "/" + key)) private_nh.setParam(module + "/" + key, value);
    }
  }
}

/// Messages of half a megabyte come and go in every thread: with an arena of the allocator's for each, most of the
/// memory would be what these keep for the next one. The environment's choice has precedence.
void ShareOneArena() {
#ifdef __GLIBC__
  if (std::getenv("MALLOC_ARENA_MAX") == nullptr) mallopt(M_ARENA_MAX, 1);
#endif
}

}  // namespace

int main(int argc, char** argv) {
  ShareOneArena();
  ros::init(argc, argv, "devo");
  const ros::NodeHandle keep_running;
  try {
    InheritParameters({"tracking", "mapping", "time_surface"});
    const Module<devo::TrackingNode> tracking("tracking");
    const Module<devo::MappingNode> mapping("mapping");
    const Module<devo::TimeSurfaceNode> time_surface("time_surface");
    ros::waitForShutdown();
  } catch (const std::exception& error) {
    std::cerr << "devo_node: " << error.what() << std::endl;
    return 2;
  }
  return 0;
}
