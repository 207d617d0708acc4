// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/options.h"

#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

namespace devo {
namespace {

struct Validator {
  template <typename Number>
  void operator()(const char* key, Number value, Number min, Number max, const char* /*meaning*/) const {
    // Negated, so that NaN fails too.
    if (!(value >= min && value <= max)) {
      std::ostringstream message;
      message << key << " is " << value << ", expected a number from " << min << " to " << max;
      throw std::invalid_argument(message.str());
    }
  }

  void operator()(const char* /*key*/, bool /*value*/, const char* /*meaning*/) const {}  // both are valid

  void operator()(const char* key, const std::string& value, const char* choices, const char* /*meaning*/) const {
    std::string expected;
    for (const std::string& name : SplitChoices(choices)) {
      if (name == value) return;
      expected += (expected.empty() ? "" : " or ") + name;
    }
    throw std::invalid_argument(std::string(key) + " is \"" + value + "\", expected " + expected);
  }
};

void ExpectNotAbove(const char* low_key, double low, const char* high_key, double high) {
  if (low <= high) return;
  std::ostringstream message;
  message << low_key << " is " << low << ", expected at most " << high_key << " which is " << high;
  throw std::invalid_argument(message.str());
}

}  // namespace

std::vector<std::string> SplitChoices(const std::string& choices) {
  std::vector<std::string> names;
  std::istringstream stream(choices);
  for (std::string name; std::getline(stream, name, '|');) names.push_back(name);
  return names;
}

void Validate(const OdometryOptions& options) {
  VisitOptions(options, Validator{});
  ExpectNotAbove("mapping.min_depth_m", options.mapping.min_depth_m, "mapping.max_depth_m",
                 options.mapping.max_depth_m);
}

}  // namespace devo
