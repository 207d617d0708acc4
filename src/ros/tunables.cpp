// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/tunables.h"

#include <algorithm>
#include <map>
#include <stdexcept>
#include <type_traits>
#include <utility>
#include <variant>

#include <dynamic_reconfigure/ConfigDescription.h>
#include <dynamic_reconfigure/server.h>
#include <boost/make_shared.hpp>

#include "devo/ros/topics.h"

namespace devo {
namespace {

// What changes from one surface, depth image or pose to the next. Everything else shapes memory or the rig.
const std::vector<std::string> kTunable[] = {
    {"surface.max_window_s", "surface.crest_quantile", "surface.noise_neighbours", "surface.still_activity_hz"},
    {"mapping.min_depth_m", "mapping.max_depth_m", "mapping.min_coverage", "mapping.max_points"},
    {"tracking.max_iterations", "tracking.huber_share", "tracking.acceleration_m_s2",
     "tracking.angular_acceleration_rad_s2"}};

const std::vector<std::string>& KeysOf(Module module) { return kTunable[static_cast<int>(module)]; }

std::string NameOf(const std::string& key) { return key.substr(key.find('.') + 1); }

using Number = std::variant<int, double>;

struct Description {
  Number min, max;
  std::string meaning;
};

/// Calls visit(key, number&, description) for the numeric options among `keys`; `Options` may be const.
template <typename Options, typename Visit>
void VisitNumbers(Options& options, const std::vector<std::string>& keys, const Visit& visit) {
  VisitOptions(options, [&]([[maybe_unused]] const char* key, auto& value, auto&&... rest) {
    using T = std::remove_const_t<std::remove_reference_t<decltype(value)>>;
    if constexpr (std::is_same_v<T, int> || std::is_same_v<T, double>) {
      if (std::find(keys.begin(), keys.end(), key) == keys.end()) return;
      const auto describe = [](T min, T max, const char* meaning) { return Description{min, max, meaning}; };
      visit(std::string(key), value, describe(rest...));
    }
  });
}

/// Values by key, as dynamic_reconfigure's messages and parameters carry them.
class Values {
 public:
  Values() = default;
  Values(const OdometryOptions& options, const std::vector<std::string>& keys) {
    VisitNumbers(options, keys,
                 [this](const std::string& key, auto value, const Description&) { by_key_[key] = value; });
  }
  const std::map<std::string, Number>& by_key() const { return by_key_; }
  std::map<std::string, Number>& by_key() { return by_key_; }

  OdometryOptions AppliedTo(OdometryOptions options) const {
    std::vector<std::string> keys;
    for (const auto& [key, number] : by_key_) keys.push_back(key);
    VisitNumbers(options, keys, [this](const std::string& key, auto& value, const Description&) {
      value = std::get<std::remove_reference_t<decltype(value)>>(by_key_.at(key));
    });
    return options;
  }

  /// With `names_of(key)` as the parameters' names.
  template <typename Name>
  void Write(dynamic_reconfigure::Config* message, const Name& name_of) const {
    *message = dynamic_reconfigure::Config();
    for (const auto& [key, number] : by_key_) {
      if (const int* whole = std::get_if<int>(&number)) {
        message->ints.emplace_back();
        message->ints.back().name = name_of(key);
        message->ints.back().value = *whole;
      } else {
        message->doubles.emplace_back();
        message->doubles.back().name = name_of(key);
        message->doubles.back().value = std::get<double>(number);
      }
    }
    message->groups.resize(1);  // clients expect the group that holds everything
    message->groups.front().name = "Default";
    message->groups.front().state = 1;
  }

  /// Takes those values of the message that are here already, in their own type.
  template <typename Name>
  void Read(const dynamic_reconfigure::Config& message, const Name& name_of) {
    for (auto& [key, number] : by_key_) {
      for (const auto& p : message.ints) {
        if (p.name != name_of(key)) continue;
        number = std::holds_alternative<int>(number) ? Number(p.value) : Number(static_cast<double>(p.value));
      }
      for (const auto& p : message.doubles) {
        if (p.name == name_of(key) && std::holds_alternative<double>(number)) number = p.value;
      }
    }
  }

 private:
  std::map<std::string, Number> by_key_;
};

const auto kWholeKey = [](const std::string& key) { return key; };

/// What dynamic_reconfigure::Server asks of a configuration; the .cfg generator writes the same from a list of its own.
/// Values are not clamped: what is out of range is refused.
template <Module module>
struct TunableConfig {
  Values values;

  static const Values& Limits(bool upper) {
    static const auto make = [](bool of_upper) {
      Values limits(OdometryOptions(), KeysOf(module));
      const OdometryOptions defaults;
      VisitNumbers(defaults, KeysOf(module), [&](const std::string& key, auto, const Description& description) {
        limits.by_key()[key] = of_upper ? description.max : description.min;
      });
      return limits;
    };
    static const Values lower_limits = make(false), upper_limits = make(true);
    return upper ? upper_limits : lower_limits;
  }
  // NOLINTBEGIN(bugprone-reserved-identifier): the server's names
  static TunableConfig __getMin__() { return {Limits(false)}; }
  static TunableConfig __getMax__() { return {Limits(true)}; }
  static TunableConfig __getDefault__() { return {Values(OdometryOptions(), KeysOf(module))}; }
  static int __getParamDescriptions__() { return 0; }
  static int __getGroupDescriptions__() { return 0; }

  static dynamic_reconfigure::ConfigDescription __getDescriptionMessage__() {
    dynamic_reconfigure::ConfigDescription message;
    message.groups.resize(1);
    message.groups.front().name = "Default";
    const OdometryOptions defaults;
    VisitNumbers(defaults, KeysOf(module), [&](const std::string& key, auto value, const Description& description) {
      dynamic_reconfigure::ParamDescription parameter;
      parameter.name = NameOf(key);
      parameter.type = std::is_same_v<decltype(value), int> ? "int" : "double";
      parameter.description = description.meaning;
      message.groups.front().parameters.push_back(parameter);
    });
    __getMin__().__toMessage__(message.min);
    __getMax__().__toMessage__(message.max);
    __getDefault__().__toMessage__(message.dflt);
    return message;
  }

  void __toMessage__(dynamic_reconfigure::Config& message, int = 0, int = 0) const { values.Write(&message, NameOf); }
  bool __fromMessage__(dynamic_reconfigure::Config& message) {
    values.Read(message, NameOf);
    return true;
  }
  void __toServer__(const ros::NodeHandle& nh) const {
    for (const auto& [key, number] : values.by_key()) {
      std::visit([&nh, name = NameOf(key)](auto value) { nh.setParam(name, value); }, number);
    }
  }
  void __fromServer__(const ros::NodeHandle& nh) {
    for (auto& [key, number] : values.by_key()) {
      std::visit([&nh, name = NameOf(key)](auto& value) { nh.getParam(name, value); }, number);
    }
  }
  void __clamp__() {}
  std::uint32_t __level__(const TunableConfig&) const { return 0; }
  // NOLINTEND(bugprone-reserved-identifier)
};

}  // namespace

std::vector<std::string> TunableNames(Module module) {
  std::vector<std::string> names;
  for (const std::string& key : KeysOf(module)) names.push_back(NameOf(key));
  return names;
}

std::vector<std::string> WithTunables(Module module, std::vector<std::string> others) {
  const std::vector<std::string> names = TunableNames(module);
  others.insert(others.end(), names.begin(), names.end());
  return others;
}

OdometryOptions ReadTunables(const ros::NodeHandle& private_nh, Module module, OdometryOptions options) {
  VisitNumbers(options, KeysOf(module), [&](const std::string& key, auto& value, const Description&) {
    const std::string name = NameOf(key);
    if (private_nh.hasParam(name) && !private_nh.getParam(name, value)) {
      throw std::invalid_argument("parameter " + private_nh.resolveName(name) + " is not a number");
    }
  });
  try {
    Validate(options);
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument("parameters of " + private_nh.getNamespace() + ": " + error.what());
  }
  return options;
}

/// The server of any of the modules, whose types differ.
struct Tunables::Server {
  template <Module module>
  void Start(Tunables* owner, const ros::NodeHandle& private_nh) {
    using Config = TunableConfig<module>;
    // The server begins with what it finds among the parameters.
    Config{Values(owner->options_, KeysOf(module))}.__toServer__(private_nh);
    auto server = boost::make_shared<dynamic_reconfigure::Server<Config>>(mutex, private_nh);
    server->setCallback([owner](Config& config, std::uint32_t) {
      const std::lock_guard<std::recursive_mutex> lock(owner->mutex_);
      if (!owner->Accept(config.values.AppliedTo(owner->options_))) {
        config.values = Values(owner->options_, KeysOf(module));
      }
    });
    running = server;
  }

  boost::recursive_mutex mutex;
  boost::shared_ptr<void> running;
};

Tunables::Tunables(ros::NodeHandle nh, const ros::NodeHandle& private_nh, Module module, const OdometryOptions& options,
                   OnChange on_change)
    : name_(private_nh.getNamespace()), module_(module), options_(options), on_change_(std::move(on_change)),
      publisher_(nh.advertise<dynamic_reconfigure::Config>(topics::kTunedOptions, 4, true)),
      server_(std::make_unique<Server>()) {
  switch (module) {
    case Module::kSurface: server_->Start<Module::kSurface>(this, private_nh); break;
    case Module::kMapping: server_->Start<Module::kMapping>(this, private_nh); break;
    case Module::kTracking: server_->Start<Module::kTracking>(this, private_nh); break;
  }
  Announce();
  subscriber_ = nh.subscribe<dynamic_reconfigure::Config>(
      topics::kTunedOptions, 8, [this](const dynamic_reconfigure::ConfigConstPtr& message) { OnAnnounced(*message); });
}

Tunables::~Tunables() { subscriber_.shutdown(); }

bool Tunables::Accept(const OdometryOptions& options) {
  if (Values(options, KeysOf(module_)).by_key() == Values(options_, KeysOf(module_)).by_key()) return true;
  try {
    Validate(options);
  } catch (const std::invalid_argument& error) {
    ROS_ERROR_STREAM(name_ << ": refused: " << error.what());
    return false;
  }
  options_ = options;
  on_change_(options_);
  Announce();
  return true;
}

void Tunables::Announce() {
  dynamic_reconfigure::Config message;
  Values(options_, KeysOf(module_)).Write(&message, kWholeKey);
  publisher_.publish(message);
}

void Tunables::OnAnnounced(const dynamic_reconfigure::Config& message) {
  std::vector<std::string> of_others;
  for (const Module other : {Module::kSurface, Module::kMapping, Module::kTracking}) {
    if (other != module_) of_others.insert(of_others.end(), KeysOf(other).begin(), KeysOf(other).end());
  }
  const std::lock_guard<std::recursive_mutex> lock(mutex_);
  Values values(options_, of_others);
  const auto before = values.by_key();
  values.Read(message, kWholeKey);
  if (values.by_key() == before) return;
  options_ = values.AppliedTo(options_);
  on_change_(options_);
}

}  // namespace devo
