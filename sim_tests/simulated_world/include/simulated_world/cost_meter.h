// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstddef>

namespace simulated_world {

/// What computing took: on the wall, and of the processors by all threads of the process together.
struct Cost {
  double wall_s{0.0};
  double processor_s{0.0};

  Cost& operator+=(const Cost& other) {
    wall_s += other.wall_s;
    processor_s += other.processor_s;
    return *this;
  }
  Cost operator-(const Cost& other) const { return {wall_s - other.wall_s, processor_s - other.processor_s}; }
};

/// Parts of the simulation, for the question where its time goes.
enum class SimulationPart { kPhysics, kCamera, kScanner, kJudge };
constexpr std::size_t kNumSimulationParts = 4;

/// Time since some fixed moment; differences count.
Cost costNow();

/// Sums of what the parts cost. It only looks at clocks: nothing simulated depends on it.
class CostMeter {
 public:
  /// Adds the time of its life to a part.
  class Scope {
   public:
    Scope(CostMeter& meter, SimulationPart part) : cost_(meter.costs_[static_cast<std::size_t>(part)]) {}
    ~Scope() { cost_ += costNow() - start_; }
    Scope(const Scope&) = delete;
    Scope& operator=(const Scope&) = delete;

   private:
    Cost& cost_;
    Cost start_{costNow()};
  };

  const Cost& of(SimulationPart part) const { return costs_[static_cast<std::size_t>(part)]; }

 private:
  std::array<Cost, kNumSimulationParts> costs_{};
};

}  // namespace simulated_world
