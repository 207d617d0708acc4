// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "devo/io/rig_config.h"

namespace devo {

struct BagValidation {
  std::string text;  ///< for a person: what was found, problems with what to change, warnings, a yaml to begin with
  std::size_t problems = 0;  ///< what keeps the odometry from using the recording
};

/// Explains the bags of one recording. Without `config` the topic of each role is found by its type (the one with the
/// most messages, depth by its encoding) and a yaml is proposed. Throws std::runtime_error naming a file that is no
/// bag.
BagValidation ValidateBags(const std::vector<std::string>& paths, const std::optional<RigConfig>& config);

}  // namespace devo
