// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <string>
#include <vector>

namespace nbv_selection {

/// The factors of eq 9, in its order.
enum class Factor { kManipulability, kPickOrder, kTravel, kUncertainty, kFrontier };
constexpr std::size_t kNumFactors = 5;
const char* toString(Factor factor);  // "manipulability", "pick_order", "travel", "uncertainty", "frontier"

/// What eq 9 weighs.
struct Attributes {
  double manipulability{0.0};  // m, in [0, 1]
  double height_m{0.0};        // h
  double distance_m{0.0};      // d
  double uncertainty{0.0};     // sigma^2, in the units of SceneModel::uncertainty()
  double frontier{0.0};        // f, the square of that per m^2

  bool isFinite() const;
  double of(Factor factor) const;  // with its sign in eq 9: -d for travel
};

/// L(x) = l / (1 + exp(-a x + b)).
struct Logistic {
  double l{1.0};
  double a{1.0};
  double b{0.0};

  double operator()(double x) const;
  /// The one with l = 1 whose value is 0.1 at `low` and 0.9 at `high`. Throws std::invalid_argument unless low < high,
  /// both finite.
  static Logistic spanning(double low, double high);
};

struct FactorConfig {
  double weight{0.2};  // beta
  Logistic logistic;
};

/// All of eqs 8 and 9 but the attributes. The logistic functions span what the attributes are on maps of gpis_mapping (the
/// README says how): 0.1 at the 10th percentile, 0.9 at the 90th.
struct UtilityConfig {
  std::array<FactorConfig, kNumFactors> factors{{
      {0.25, {1.0, 263.0, 3.42}},     // manipulability: 0.0046 to 0.0213
      {0.15, {1.0, 28.2, 5.46}},      // pick order: 0.12 m to 0.27 m
      {0.25, {1.0, 1.56, -3.6}},      // travel: 3.7 m to 0.90 m
      {0.10, {1.0, 28700.0, 2.85}},   // uncertainty: 2.3e-5 m^2 to 1.8e-4 m^2
      {0.25, {1.0, 401000.0, 2.78}},  // frontier: 1.4e-6 m^2 to 1.2e-5 m^2
  }};
  double gamma_per_s{0.99};  // p = gamma^(t - t_f): after 69 s a failure counts half
  double min_utility{0.05};  // U_min: a best segment below it is not worth going to
  bool use_failures{true};   // false: p = 0

  const FactorConfig& of(Factor factor) const { return factors[static_cast<std::size_t>(factor)]; }
  FactorConfig& of(Factor factor) { return factors[static_cast<std::size_t>(factor)]; }

  /// Every problem as "key = value, must be ...": weights that are negative or do not sum to 1 within 1e-6 among them.
  std::vector<std::string> validate() const;

  /// Without a factor: its weight 0, the others scaled so that they sum to 1 (the ablation of Table I). `name` is one of
  /// toString(Factor), or "failure_penalty", or "none". Throws std::invalid_argument for another name, listing these, and
  /// for a factor that has all the weight.
  UtilityConfig without(const std::string& name) const;
};

/// What became of the attributes of one segment.
struct Utility {
  std::array<double, kNumFactors> factor_values{};  // L_k, before weights
  double information{0.0};                          // I, eq 9
  double failure_penalty{0.0};                      // p in [0, 1]
  double utility{0.0};                              // U, eq 8
};

/// Eq 9 and eq 8. `since_failure_s`: t - t_f, infinite without a failure; negative (the clock ran back) counts as 0.
Utility computeUtility(const Attributes& attributes, double since_failure_s, const UtilityConfig& config);

}  // namespace nbv_selection
