// SPDX-License-Identifier: BSD-3-Clause
//
// The three nodelets as one standalone node, for a debugger or a robot without a nodelet manager.
#include <malloc.h>

#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <exception>
#include <iostream>
#include <iterator>
#include <string>
#include <vector>

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

/// A module's parameter falls back to the node's own, so that `_config:=rig.yaml` is enough. What an earlier run on
/// this master inherited is no choice of the user's, and gives way to what this one is given.
void InheritParameters(const std::vector<std::string>& modules) {
  const ros::NodeHandle private_nh("~");
  for (const char* key : {"config", "set"}) {
    std::string value;
    private_nh.getParam(key, value);
    for (const std::string& module : modules) {
      const std::string name = module + "/" + key, inherited = "inherited/" + name;
      std::string now, before;
      if (private_nh.getParam(name, now) && !(private_nh.getParam(inherited, before) && now == before)) continue;
      private_nh.setParam(name, value);
      private_nh.setParam(inherited, value);
    }
  }
}

/// The parameters of this node that were not there at first: what the modules leave on the master of their tunables
/// would have precedence over the yaml of the next run.
class OwnParameters {
 public:
  OwnParameters() : before_(Names()) {}
  void Delete() const {
    for (const std::string& name : Names()) {
      if (!std::binary_search(before_.begin(), before_.end(), name)) ros::param::del(name);
    }
  }

 private:
  static std::vector<std::string> Names() {
    std::vector<std::string> all, own;
    ros::param::getParamNames(all);
    const std::string prefix = ros::this_node::getName() + "/";
    std::copy_if(all.begin(), all.end(), std::back_inserter(own),
                 [&](const std::string& name) { return name.compare(0, prefix.size(), prefix) == 0; });
    std::sort(own.begin(), own.end());
    return own;
  }

  std::vector<std::string> before_;
};

volatile std::sig_atomic_t stop = 0;

/// Until SIGINT, SIGTERM or the master ends the node. roscpp's own handler would leave no time to ask the master.
void WaitForEnd() {
  while (ros::ok() && stop == 0) ros::WallDuration(0.05).sleep();
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
  ros::init(argc, argv, "devo", ros::init_options::NoSigintHandler);
  for (const int signal : {SIGINT, SIGTERM}) std::signal(signal, [](int) { stop = 1; });
  const ros::NodeHandle keep_running;
  try {
    const OwnParameters own;
    InheritParameters({"tracking", "mapping", "time_surface"});
    const Module<devo::TrackingNode> tracking("tracking");
    const Module<devo::MappingNode> mapping("mapping");
    const Module<devo::TimeSurfaceNode> time_surface("time_surface");
    WaitForEnd();
    if (ros::ok()) own.Delete();
  } catch (const std::exception& error) {
    std::cerr << "devo_node: " << error.what() << std::endl;
    return 2;
  }
  return 0;
}
