// SPDX-License-Identifier: BSD-3-Clause
//
// The few options that may change while the odometry runs, through dynamic_reconfigure. Keys, ranges, defaults and
// meanings are those of VisitOptions (core/options.h), so that there is no .cfg file to keep in step with it.
#pragma once

#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include <dynamic_reconfigure/Config.h>
#include <ros/node_handle.h>

#include "devo/core/options.h"

namespace devo {

enum class Module { kSurface, kMapping, kTracking };

/// Names of a module's options that may change, without the section's prefix: "crest_quantile". Private parameters of
/// these names override the configuration.
std::vector<std::string> TunableNames(Module module);

/// These and `others`: all parameters that a nodelet knows.
std::vector<std::string> WithTunables(Module module, std::vector<std::string> others);

/// `options` with the private parameters of tunable names taken over. Throws std::invalid_argument naming parameter or
/// option when one has another type or is out of range.
OdometryOptions ReadTunables(const ros::NodeHandle& private_nh, Module module, OdometryOptions options);

/// One module's dynamic_reconfigure server. A change that leaves all options valid is handed on; any other is refused
/// as a whole, with the key named in the log, and the answer of the service holds the values that stay. What other
/// modules change reaches this one through the topic `tuned_options`, for an option may concern more than one.
class Tunables {
 public:
  using OnChange = std::function<void(const OdometryOptions&)>;

  /// `options`: as ReadTunables returned them. `on_change` is called from callbacks' threads, never concurrently.
  Tunables(ros::NodeHandle nh, const ros::NodeHandle& private_nh, Module module, const OdometryOptions& options,
           OnChange on_change);
  ~Tunables();

 private:
  struct Server;

  bool Accept(const OdometryOptions& options);
  void Announce();
  void OnAnnounced(const dynamic_reconfigure::Config& config);

  std::string name_;
  Module module_;
  std::recursive_mutex mutex_;
  OdometryOptions options_;
  OnChange on_change_;
  ros::Publisher publisher_;
  ros::Subscriber subscriber_;
  std::unique_ptr<Server> server_;  // last: its callbacks use all of the above
};

}  // namespace devo
