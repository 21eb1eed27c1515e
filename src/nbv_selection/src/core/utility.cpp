// SPDX-License-Identifier: BSD-3-Clause
#include "nbv_selection/utility.h"

#include <cmath>
#include <stdexcept>

namespace nbv_selection {
namespace {

constexpr std::array<Factor, kNumFactors> kFactors{Factor::kManipulability, Factor::kPickOrder, Factor::kTravel,
                                                   Factor::kUncertainty, Factor::kFrontier};
constexpr const char* kFailurePenalty = "failure_penalty";
constexpr const char* kNone = "none";
}  // namespace

bool Attributes::isFinite() const {
  return std::isfinite(manipulability) && std::isfinite(height_m) && std::isfinite(distance_m) &&
         std::isfinite(uncertainty) && std::isfinite(frontier);
}

double Attributes::of(Factor factor) const {
  switch (factor) {
    case Factor::kManipulability:
      return manipulability;
    case Factor::kPickOrder:
      return height_m;
    case Factor::kTravel:
      return -distance_m;
    case Factor::kUncertainty:
      return uncertainty;
    case Factor::kFrontier:
      return frontier;
  }
  throw std::invalid_argument("factor = " + std::to_string(static_cast<int>(factor)) + ", must be in [0, " +
                              std::to_string(kNumFactors - 1) + "]");
}

double Logistic::operator()(double x) const {
  // a = 0 is a constant, of an infinite distance, too.
  const double exponent = a == 0.0 ? b : -a * x + b;
  // Of the two equal forms the one whose exponential cannot overflow.
  if (exponent <= 0.0) return l / (1.0 + std::exp(exponent));
  const double decay = std::exp(-exponent);
  return l * decay / (1.0 + decay);
}

UtilityConfig UtilityConfig::without(const std::string& name) const {
  UtilityConfig result = *this;
  if (name == kNone) return result;
  if (name == kFailurePenalty) {
    result.use_failures = false;
    return result;
  }
  for (const Factor removed : kFactors) {
    if (name != toString(removed)) continue;
    double rest = 0.0;
    for (const Factor factor : kFactors) {
      if (factor != removed) rest += of(factor).weight;
    }
    if (!(rest > 0.0)) {
      throw std::invalid_argument("factor " + name + " has all the weight: nothing is left without it");
    }
    for (const Factor factor : kFactors) result.of(factor).weight = factor == removed ? 0.0 : of(factor).weight / rest;
    return result;
  }
  std::string names;
  for (const Factor factor : kFactors) names += std::string(toString(factor)) + ", ";
  throw std::invalid_argument("removed factor = \"" + name + "\", must be one of " + names + kFailurePenalty + ", " +
                              kNone);
}

Utility computeUtility(const Attributes& attributes, double since_failure_s, const UtilityConfig& config) {
  Utility result;
  for (const Factor factor : kFactors) {
    const double value = config.of(factor).logistic(attributes.of(factor));
    result.factor_values[static_cast<std::size_t>(factor)] = value;
    // A factor that is switched off has no say, not even with a NaN.
    if (config.of(factor).weight > 0.0) result.information += config.of(factor).weight * value;  // eq 9
  }
  if (config.use_failures) {
    result.failure_penalty = std::pow(config.gamma_per_s, since_failure_s < 0.0 ? 0.0 : since_failure_s);
  }
  result.utility = (1.0 - result.failure_penalty) * result.information;  // eq 8
  return result;
}

}  // namespace nbv_selection
