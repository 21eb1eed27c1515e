// SPDX-License-Identifier: BSD-3-Clause
#include "nbv_selection/utility.h"

#include <cmath>
#include <sstream>
#include <stdexcept>

#include <interactive_mapping_common/config/range_check.h>

namespace nbv_selection {
namespace {

constexpr std::array<Factor, kNumFactors> kFactors{Factor::kManipulability, Factor::kPickOrder, Factor::kTravel,
                                                   Factor::kUncertainty, Factor::kFrontier};
constexpr const char* kFailurePenalty = "failure_penalty";
constexpr const char* kNone = "none";
/// YAML has weights with a few decimals: thirds written with seven of them are accepted, slips are not.
constexpr double kSumTolerance = 1e-6;

std::string problem(const std::string& key, double value, const std::string& must) {
  std::ostringstream text;
  text.precision(9);  // more than kSumTolerance shows
  text << key << " = " << value << ", must be " << must;
  return text.str();
}

}  // namespace

const char* toString(Factor factor) {
  switch (factor) {
    case Factor::kManipulability:
      return "manipulability";
    case Factor::kPickOrder:
      return "pick_order";
    case Factor::kTravel:
      return "travel";
    case Factor::kUncertainty:
      return "uncertainty";
    case Factor::kFrontier:
      return "frontier";
  }
  return "unknown";
}

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

Logistic Logistic::spanning(double low, double high) {
  if (!std::isfinite(low) || !std::isfinite(high) || !(low < high)) {
    std::ostringstream text;
    text << "low = " << low << ", high = " << high << ", must be finite and low < high";
    throw std::invalid_argument(text.str());
  }
  // L(low) = 0.1 and L(high) = 0.9: -a low + b = ln 9 and -a high + b = -ln 9. Halves first: the sum of two large
  // numbers may overflow, their halves' does not.
  const double half_width = 0.5 * high - 0.5 * low;
  const double middle = 0.5 * high + 0.5 * low;
  const Logistic result{1.0, std::log(9.0) / half_width, std::log(9.0) / half_width * middle};
  if (!std::isfinite(result.a) || !std::isfinite(result.b)) {
    std::ostringstream text;
    text << "low = " << low << ", high = " << high << ", must be farther apart";
    throw std::invalid_argument(text.str());
  }
  return result;
}

std::vector<std::string> UtilityConfig::validate() const {
  std::vector<std::string> problems;
  double sum = 0.0;
  for (const Factor factor : kFactors) {
    const double weight = of(factor).weight;
    sum += weight;
    if (!std::isfinite(weight) || weight < 0.0) {
      problems.push_back(problem(std::string("weights/") + toString(factor), weight, "finite and >= 0"));
    }
  }
  if (problems.empty() && !(std::abs(sum - 1.0) <= kSumTolerance)) {
    problems.push_back(problem("weights: their sum", sum, "1 within 1e-06"));
  }
  for (const Factor factor : kFactors) {
    const std::string prefix = std::string("logistic/") + toString(factor) + "/";
    const Logistic& logistic = of(factor).logistic;
    if (!(logistic.l > 0.0 && logistic.l <= 10.0)) {
      problems.push_back(problem(prefix + "l", logistic.l, "in (0, 10]"));
    }
    // A factor does not punish its own growth.
    if (!std::isfinite(logistic.a) || logistic.a < 0.0) {
      problems.push_back(problem(prefix + "a", logistic.a, "finite and >= 0"));
    }
    if (!std::isfinite(logistic.b)) problems.push_back(problem(prefix + "b", logistic.b, "finite"));
  }
  if (!(gamma_per_s > 0.0 && gamma_per_s < 1.0)) {
    problems.push_back(problem("gamma_per_s", gamma_per_s, "in (0, 1)"));
  }
  interactive_mapping::RangeCheck check;
  check("min_utility", min_utility, 0.0, 1.0, "");
  problems.insert(problems.end(), check.problems().begin(), check.problems().end());
  return problems;
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
