// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <sstream>
#include <string>

#include <CLI/CLI.hpp>

namespace devo {

/// Refuses what is no number from `min` to `max`. CLI11's own ranges let NaN through, which no comparison refuses, and
/// have no end, so that a time overflows as nanoseconds.
inline CLI::Validator NumberIn(double min, double max) {
  std::ostringstream range;
  range << "from " << min << " to " << max;
  return CLI::Validator(
      [min, max, range = range.str()](std::string& text) -> std::string {
        double value = 0;
        if (CLI::detail::lexical_cast(text, value) && value >= min && value <= max) return "";
        return "is " + text + ", expected a number " + range;
      },
      range.str());
}

}  // namespace devo
