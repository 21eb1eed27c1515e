// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cmath>
#include <string>

#include <interactive_mapping_common/config/schema.h>

namespace nbv_selection {

/// The factors of eq 9, in its order.
enum class Factor { kManipulability, kPickOrder, kTravel, kUncertainty, kFrontier };
inline constexpr interactive_mapping::Names<Factor> kFactorNames = {{"manipulability", Factor::kManipulability},
                                                                    {"pick_order", Factor::kPickOrder},
                                                                    {"travel", Factor::kTravel},
                                                                    {"uncertainty", Factor::kUncertainty},
                                                                    {"frontier", Factor::kFrontier}};
constexpr std::size_t kNumFactors = kFactorNames.size();
constexpr const char* toString(Factor factor) {
  return interactive_mapping::nameOf(factor, kFactorNames);
}

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

  static void fields(Logistic& c, interactive_mapping::Fields& f) {
    f.live()("l", c.l, 1e-6, 10.0, "", "largest value of l / (1 + exp(-a x + b)), x in the unit of the factor");
    // A factor does not punish its own growth.
    f.live()("a", c.a, 0.0, 1e12, "", "steepness; 0: a constant");
    f.live()("b", c.b, -1e9, 1e9, "", "half of l is reached at x = b / a");
  }
};

struct FactorConfig {
  double weight{0.2};  // beta
  Logistic logistic;
};

/// All of eqs 8 and 9 but the attributes. The logistic functions span what the attributes are in missions (the README says
/// how): 0.1 at the 10th percentile, 0.9 at the 90th.
struct UtilityConfig {
  std::array<FactorConfig, kNumFactors> factors{{
      {0.20, {1.0, 417.0, 4.06}},     // manipulability: 0.0045 to 0.0150
      {0.10, {1.0, 44.0, 10.2}},      // pick order: 0.18 m to 0.28 m
      {0.40, {1.0, 1.56, -3.6}},      // travel: 3.7 m to 0.90 m
      {0.10, {1.0, 46700.0, 3.11}},   // uncertainty: 2.0e-5 m^2 to 1.1e-4 m^2
      {0.20, {1.0, 732000.0, 3.25}},  // frontier: 1.4e-6 m^2 to 7.4e-6 m^2
  }};
  double gamma_per_s{0.99};
  double min_utility{0.02};  // U_min
  bool use_failures{true};   // false: p = 0

  const FactorConfig& of(Factor factor) const { return factors[static_cast<std::size_t>(factor)]; }
  FactorConfig& of(Factor factor) { return factors[static_cast<std::size_t>(factor)]; }

  struct Weights {
    std::array<FactorConfig, kNumFactors>& factors;

    static void fields(Weights& c, interactive_mapping::Fields& f) {
      constexpr const char* kTexts[kNumFactors] = {
          "weight of the surface that the arm can pick from; the five weights sum to 1",
          "weight of the height of the pile [m]", "weight of minus the driving distance [m]",
          "weight of the uncertainty of the map [m^2, or bit in an OctoMap]",
          "weight of the squared slope of the uncertainty, per m^2"};
      for (std::size_t i = 0; i < kNumFactors; ++i) {
        const char* factor = toString(static_cast<Factor>(i));
        f.liveTogether(std::string("weight_") + factor)(factor, c.factors[i].weight, 0.0, 1.0, "", kTexts[i]);
      }
    }
  };

  struct Logistics {
    std::array<FactorConfig, kNumFactors>& factors;

    static void fields(Logistics& c, interactive_mapping::Fields& f) {
      for (std::size_t i = 0; i < kNumFactors; ++i) {
        f.section(toString(static_cast<Factor>(i)), c.factors[i].logistic);
      }
    }
  };

  static void fields(UtilityConfig& c, interactive_mapping::Fields& f) {
    f("gamma_per_s", c.gamma_per_s, 1e-6, 0.999999, "",
      "a failure t seconds ago counts gamma_per_s^t: half after 69 s with 0.99");
    f("min_utility", c.min_utility, 0.0, 1.0, "", "a best segment below it is not worth going to");
    Weights weights{c.factors};
    f.section("weights", weights);
    Logistics logistics{c.factors};
    f.section("logistic", logistics);
    // Weights that are impossible themselves are reported alone. The tolerance takes thirds written with seven decimals.
    double sum = 0.0;
    bool are_possible = true;
    for (const FactorConfig& factor : c.factors) {
      sum += factor.weight;
      are_possible = are_possible && factor.weight >= 0.0 && factor.weight <= 1.0;
    }
    f.require(!are_possible || std::abs(sum - 1.0) <= 1e-6,
              "weights: their sum = " + std::to_string(sum) + ", must be 1 within 1e-06");
  }

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
