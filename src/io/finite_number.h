// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <optional>
#include <stdexcept>
#include <string>

namespace devo {

/// All of `text` as a finite number; empty where it is none.
inline std::optional<double> FiniteNumber(const std::string& text) {
  std::size_t read = 0;
  double value = 0;
  try {
    value = std::stod(text, &read);
  } catch (const std::logic_error&) {
    return std::nullopt;
  }
  if (read != text.size() || !std::isfinite(value)) return std::nullopt;
  return value;
}

}  // namespace devo
