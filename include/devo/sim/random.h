// SPDX-License-Identifier: BSD-3-Clause
//
// Random numbers that depend on what they are for (seed, purpose, index), not on the order in which threads ask.
#pragma once

#include <cmath>
#include <cstdint>

namespace devo::sim {

/// Finaliser of splitmix64 (Steele, Lea, Flood 2014): a bijection whose output bits look independent.
inline std::uint64_t Mix(std::uint64_t z) {
  z += 0x9e3779b97f4a7c15ULL;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
  return z ^ (z >> 31);
}

/// A small generator; as cheap to make as to use.
class Rng {
 public:
  explicit Rng(std::uint64_t seed, std::uint64_t purpose = 0, std::uint64_t index = 0)
      : state_(Mix(Mix(Mix(seed) ^ purpose) ^ index)) {}

  std::uint64_t Next() { return Mix(state_ += 0x9e3779b97f4a7c15ULL); }
  /// Uniform in (0, 1), never 0 nor 1.
  double Uniform() { return (static_cast<double>(Next() >> 12) + 0.5) * 0x1p-52; }
  double Uniform(double lo, double hi) { return lo + (hi - lo) * Uniform(); }
  /// Standard normal (Box and Muller 1958).
  double Gaussian() {
    const double r = std::sqrt(-2 * std::log(Uniform()));
    return r * std::cos(6.283185307179586 * Uniform());
  }

 private:
  std::uint64_t state_;
};

}  // namespace devo::sim
