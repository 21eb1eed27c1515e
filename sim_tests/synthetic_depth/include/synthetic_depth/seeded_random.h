// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <cstdint>

namespace synthetic_depth {

/// Small random generator whose output is fixed by its seed alone. The distributions of the standard library may differ
/// between library versions, so recorded sequences could not be compared across machines with them.
/// Engine: SplitMix64 (Steele, Lea, Flood, "Fast splittable pseudorandom number generators", OOPSLA 2014).
class SeededRandom {
 public:
  explicit SeededRandom(std::uint64_t seed) : state_(seed) {}

  /// Independent stream for (seed, a, b), e.g. (scene seed, frame, pixel): the value does not depend on what was drawn
  /// before, so frame k is the same whichever frames were made earlier.
  SeededRandom(std::uint64_t seed, std::uint64_t a, std::uint64_t b)
      : state_(mix(mix(mix(seed + kGamma) ^ (a + kGamma)) ^ (b + kGamma))) {}

  std::uint64_t next() {
    state_ += kGamma;
    return mix(state_);
  }

  /// Uniform in [0, 1).
  double uniform() { return static_cast<double>(next() >> 11U) * 0x1.0p-53; }

  /// Uniform in [low, high).
  double uniform(double low, double high) { return low + (high - low) * uniform(); }

  /// Two independent standard normal values; always takes two draws (Box-Muller).
  void normalPair(double& first, double& second) {
    const double radius = std::sqrt(-2.0 * std::log(1.0 - uniform()));
    const double angle = 2.0 * 3.14159265358979323846 * uniform();
    first = radius * std::cos(angle);
    second = radius * std::sin(angle);
  }

  double normal() {
    double first = 0.0;
    double second = 0.0;
    normalPair(first, second);
    return first;
  }

 private:
  friend class SeededStreams;
  static constexpr std::uint64_t kGamma = 0x9E3779B97F4A7C15ULL;

  static std::uint64_t mix(std::uint64_t z) {
    z = (z ^ (z >> 30U)) * 0xBF58476D1CE4E5B9ULL;
    z = (z ^ (z >> 27U)) * 0x94D049BB133111EBULL;
    return z ^ (z >> 31U);
  }

  std::uint64_t state_;
};

/// The streams SeededRandom(seed, a, b) of one seed and one a, made faster.
class SeededStreams {
 public:
  SeededStreams(std::uint64_t seed, std::uint64_t a)
      : key_(SeededRandom::mix(SeededRandom::mix(seed + SeededRandom::kGamma) ^ (a + SeededRandom::kGamma))) {}

  SeededRandom stream(std::uint64_t b) const {
    return SeededRandom(SeededRandom::mix(key_ ^ (b + SeededRandom::kGamma)));
  }

 private:
  std::uint64_t key_;
};

}  // namespace synthetic_depth
