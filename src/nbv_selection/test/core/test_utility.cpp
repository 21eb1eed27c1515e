// SPDX-License-Identifier: BSD-3-Clause
#include "nbv_selection/utility.h"

#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <stdexcept>

#include <gmock/gmock.h>
#include <interactive_mapping_common/testing/temporary_folder.h>

namespace nbv_selection {
namespace {

using interactive_mapping::problemsOf;
using test_support::messageOf;
using ::testing::AllOf;
using ::testing::DoubleEq;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kHuge = std::numeric_limits<double>::max();
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr std::array<Factor, kNumFactors> kFactors{Factor::kManipulability, Factor::kPickOrder, Factor::kTravel,
                                                   Factor::kUncertainty, Factor::kFrontier};

double* attributeOf(Attributes* attributes, Factor factor) {
  switch (factor) {
    case Factor::kManipulability:
      return &attributes->manipulability;
    case Factor::kPickOrder:
      return &attributes->height_m;
    case Factor::kTravel:
      return &attributes->distance_m;
    case Factor::kUncertainty:
      return &attributes->uncertainty;
    case Factor::kFrontier:
      return &attributes->frontier;
  }
  return nullptr;
}

/// Factors of which each has another weight and another curve, with values that can be worked out by hand:
/// exponents -a x + b of ln 3, 0, ln 9, -ln 4 and 0.
UtilityConfig handConfig() {
  UtilityConfig config;
  config.of(Factor::kManipulability) = {0.1, {1.0, 4.0, 2.0 + std::log(3.0)}};
  config.of(Factor::kPickOrder) = {0.2, {2.0, 10.0, 3.0}};
  config.of(Factor::kTravel) = {0.3, {1.0, 0.5, -2.0 + std::log(9.0)}};
  config.of(Factor::kUncertainty) = {0.25, {1.0, 100.0, 2.0 - std::log(4.0)}};
  config.of(Factor::kFrontier) = {0.15, {0.6, 0.0, 0.0}};
  config.gamma_per_s = 0.5;
  return config;
}

Attributes handAttributes() {
  return {0.5, 0.3, 4.0, 0.02, 7.0};
}

TEST(Logistic, IsItsFormula) {
  std::mt19937 rng(1);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  for (int i = 0; i < 1000; ++i) {
    const Logistic logistic{5.0 + 5.0 * uniform(rng), 5.0 + 5.0 * uniform(rng), 20.0 * uniform(rng)};
    const double x = 3.0 * uniform(rng);
    // Exponents up to 50: long double neither overflows nor cancels.
    const long double exponent = -static_cast<long double>(logistic.a) * x + logistic.b;
    const auto expected = static_cast<double>(logistic.l / (1.0L + std::exp(exponent)));
    // The exponent, up to 50, rounds by 50 x 1e-16, the value by as much of itself.
    EXPECT_NEAR(logistic(x), expected, 1e-12 * expected) << logistic.a << " " << logistic.b << " " << x;
  }
}

TEST(Logistic, EndsExactlyAtZeroAndLHoweverFar) {
  const Logistic logistic{2.5, 3.0, -7.0};
  for (const double x : {1e3, 1e17, kHuge, kInfinity}) {
    EXPECT_EQ(logistic(x), 2.5) << x;
    EXPECT_EQ(logistic(-x), 0.0) << -x;
  }
  EXPECT_EQ((Logistic{1.0, kHuge, kHuge})(-kHuge), 0.0);
  EXPECT_EQ((Logistic{1.0, kHuge, -kHuge})(kHuge), 1.0);
  // Just where exp() ends: 709.78.
  EXPECT_GT((Logistic{1.0, 1.0, 0.0})(-709.0), 0.0);
  EXPECT_GT((Logistic{1.0, 1.0, 0.0})(-740.0), 0.0);
}

TEST(Logistic, WithoutSlopeIsAConstantAlsoAtInfinity) {
  const Logistic logistic{1.0, 0.0, std::log(3.0)};
  for (const double x : {0.0, 5.0, kInfinity, -kInfinity}) EXPECT_NEAR(logistic(x), 0.25, 1e-15) << x;
}

TEST(Utility, MatchesTheSumsDoneByHand) {
  const Utility utility = computeUtility(handAttributes(), 2.0, handConfig());
  EXPECT_THAT(utility.factor_values,
              ElementsAre(::testing::DoubleNear(1.0 / 4.0, 1e-12), ::testing::DoubleNear(2.0 / 2.0, 1e-12),
                          ::testing::DoubleNear(1.0 / 10.0, 1e-12), ::testing::DoubleNear(4.0 / 5.0, 1e-12),
                          ::testing::DoubleNear(0.6 / 2.0, 1e-12)));
  // 0.1 x 0.25 + 0.2 x 1 + 0.3 x 0.1 + 0.25 x 0.8 + 0.15 x 0.3
  EXPECT_NEAR(utility.information, 0.5, 1e-12);
  EXPECT_NEAR(utility.failure_penalty, 0.25, 1e-15);  // 0.5^2
  EXPECT_NEAR(utility.utility, 0.375, 1e-12);
}

TEST(Utility, GrowsWithEachAttributeAndFallsWithDistance) {
  std::mt19937 rng(3);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  UtilityConfig config;
  for (FactorConfig& factor : config.factors) factor = {0.2, Logistic()};  // equal weights, 1 / (1 + exp(-x))
  for (int i = 0; i < 200; ++i) {
    for (const Factor factor : kFactors) {
      Attributes attributes{uniform(rng), uniform(rng), uniform(rng), uniform(rng), uniform(rng)};
      const double before = computeUtility(attributes, 10.0, config).utility;
      *attributeOf(&attributes, factor) += 0.01 + uniform(rng);
      const double after = computeUtility(attributes, 10.0, config).utility;
      if (factor == Factor::kTravel) {
        EXPECT_LT(after, before);
      } else {
        EXPECT_GT(after, before) << toString(factor);
      }
    }
  }
}

TEST(Utility, FailureCountsFullyAtOnceAndNotAtAllIfThereWasNone) {
  UtilityConfig config = handConfig();
  for (const double since_s : {0.0, -0.0, -1.0, -kInfinity}) {
    const Utility utility = computeUtility(handAttributes(), since_s, config);
    EXPECT_EQ(utility.failure_penalty, 1.0) << since_s;
    EXPECT_EQ(utility.utility, 0.0) << since_s;
    EXPECT_NEAR(utility.information, 0.5, 1e-12) << since_s;
  }
  const Utility never = computeUtility(handAttributes(), kInfinity, config);
  EXPECT_EQ(never.failure_penalty, 0.0);
  EXPECT_EQ(never.utility, never.information);
  double last = 0.0;
  for (const double since_s : {0.5, 1.0, 5.0, 60.0}) {
    const Utility utility = computeUtility(handAttributes(), since_s, config);
    EXPECT_NEAR(utility.failure_penalty, std::exp(since_s * std::log(0.5)), 1e-15);
    EXPECT_GT(utility.utility, last);
    last = utility.utility;
  }
  config.use_failures = false;
  EXPECT_EQ(computeUtility(handAttributes(), 0.0, config).utility, never.utility);
}

TEST(Utility, FailureCountsHalfAfterTheTimeTheHeaderSays) {
  // One second more or less is 1 % of a half.
  EXPECT_NEAR(computeUtility(handAttributes(), 69.0, UtilityConfig()).failure_penalty, 0.5, 0.005);
}

TEST(Utility, WhatIsInfinitelyFarHasNoTravelValue) {
  Attributes attributes = handAttributes();
  attributes.distance_m = kInfinity;
  const Utility utility = computeUtility(attributes, kInfinity, handConfig());
  EXPECT_EQ(utility.factor_values[static_cast<std::size_t>(Factor::kTravel)], 0.0);
  EXPECT_NEAR(utility.utility, 0.5 - 0.03, 1e-12);
}

TEST(Utility, NaNShowsUnlessItsFactorIsOff) {
  for (const Factor factor : kFactors) {
    Attributes attributes = handAttributes();
    EXPECT_TRUE(attributes.isFinite());
    *attributeOf(&attributes, factor) = kNaN;
    EXPECT_FALSE(attributes.isFinite()) << toString(factor);
    if (factor != Factor::kFrontier) {  // constant in handConfig()
      EXPECT_TRUE(std::isnan(computeUtility(attributes, kInfinity, handConfig()).utility)) << toString(factor);
    }
    const UtilityConfig without = handConfig().without(toString(factor));
    EXPECT_TRUE(std::isfinite(computeUtility(attributes, kInfinity, without).utility)) << toString(factor);
    *attributeOf(&attributes, factor) = -kInfinity;
    EXPECT_FALSE(attributes.isFinite()) << toString(factor);
  }
}

TEST(UtilityConfig, DefaultsAreValid) {
  EXPECT_THAT(problemsOf(UtilityConfig()), IsEmpty());
  EXPECT_THAT(problemsOf(handConfig()), IsEmpty());
}

TEST(UtilityConfig, NamesWhatIsImpossible) {
  struct Case {
    std::function<void(UtilityConfig*)> spoil;
    std::string message;
  };
  const auto weight = [](Factor factor, double value) {
    return [=](UtilityConfig* config) { config->of(factor).weight = value; };
  };
  const auto logistic = [](Factor factor, const Logistic& value) {
    return [=](UtilityConfig* config) { config->of(factor).logistic = value; };
  };
  const std::vector<Case> cases{
      {weight(Factor::kManipulability, -0.2), "weights/manipulability = -0.2, must be in [0, 1]"},
      {weight(Factor::kPickOrder, kNaN), "weights/pick_order = nan, must be in [0, 1]"},
      {weight(Factor::kTravel, kInfinity), "weights/travel = inf, must be in [0, 1]"},
      {weight(Factor::kUncertainty, -kInfinity), "weights/uncertainty = -inf, must be in [0, 1]"},
      {weight(Factor::kFrontier, -1e-9), "weights/frontier = -1.0e-09, must be in [0, 1]"},
      {weight(Factor::kFrontier, 0.3), "weights: their sum = 1.100000, must be 1 within 1e-06"},
      {weight(Factor::kFrontier, 0.200002), "weights: their sum = 1.000002, must be 1"},
      {weight(Factor::kFrontier, 0.199998), "weights: their sum = 0.999998, must be 1"},
      {logistic(Factor::kManipulability, {0.0, 1.0, 0.0}), "logistic/manipulability/l = 0, must be in [1.0e-06, 10]"},
      {logistic(Factor::kPickOrder, {10.1, 1.0, 0.0}), "logistic/pick_order/l = 10.1, must be in [1.0e-06, 10]"},
      {logistic(Factor::kTravel, {kNaN, 1.0, 0.0}), "logistic/travel/l = nan, must be in [1.0e-06, 10]"},
      {logistic(Factor::kTravel, {1.0, -0.1, 0.0}), "logistic/travel/a = -0.1, must be in [0, 1.0e+12]"},
      {logistic(Factor::kUncertainty, {1.0, kInfinity, 0.0}), "logistic/uncertainty/a = inf, must be in [0, 1.0e+12]"},
      {logistic(Factor::kUncertainty, {1.0, kNaN, 0.0}), "logistic/uncertainty/a = nan, must be in [0, 1.0e+12]"},
      {logistic(Factor::kFrontier, {1.0, 1.0, -kInfinity}),
       "logistic/frontier/b = -inf, must be in [-1.0e+09, 1.0e+09]"},
      {logistic(Factor::kFrontier, {1.0, 1.0, kNaN}), "logistic/frontier/b = nan, must be in [-1.0e+09, 1.0e+09]"},
      {[](UtilityConfig* config) { config->gamma_per_s = 0.0; }, "gamma_per_s = 0, must be in [1.0e-06, 0.999999]"},
      {[](UtilityConfig* config) { config->gamma_per_s = 1.0; }, "gamma_per_s = 1, must be in [1.0e-06, 0.999999]"},
      {[](UtilityConfig* config) { config->gamma_per_s = kNaN; }, "gamma_per_s = nan, must be in [1.0e-06, 0.999999]"},
      {[](UtilityConfig* config) { config->min_utility = -0.1; }, "min_utility = -0.1, must be in [0, 1]"},
      {[](UtilityConfig* config) { config->min_utility = 1.1; }, "min_utility = 1.1, must be in [0, 1]"},
      {[](UtilityConfig* config) { config->min_utility = kNaN; }, "min_utility = nan, must be in [0, 1]"},
  };
  for (const Case& c : cases) {
    UtilityConfig config;
    for (FactorConfig& factor : config.factors) factor.weight = 0.2;
    c.spoil(&config);
    EXPECT_THAT(problemsOf(config), ElementsAre(HasSubstr(c.message)));
  }
}

TEST(UtilityConfig, TakesTheEndsOfItsRanges) {
  UtilityConfig config;
  for (const Factor factor : kFactors) config.of(factor) = {0.0, {10.0, 0.0, -1e6}};
  config.of(Factor::kTravel).weight = 1.0;
  config.of(Factor::kFrontier).weight = 0.9e-6;
  for (const double min_utility : {0.0, 1.0}) {
    config.min_utility = min_utility;
    EXPECT_THAT(problemsOf(config), IsEmpty());
  }
}

TEST(UtilityConfig, ListsEveryProblem) {
  UtilityConfig config;
  config.of(Factor::kTravel) = {-1.0, {0.0, -1.0, kNaN}};
  config.of(Factor::kFrontier).weight = -1.0;
  config.gamma_per_s = 2.0;
  config.min_utility = 2.0;
  EXPECT_EQ(problemsOf(config).size(), 7u);
}

TEST(UtilityConfig, WithoutAFactorSharesItsWeightAmongTheOthers) {
  const UtilityConfig config = handConfig();
  for (const Factor removed : kFactors) {
    const UtilityConfig without = config.without(toString(removed));
    EXPECT_EQ(without.of(removed).weight, 0.0);
    EXPECT_THAT(problemsOf(without), IsEmpty());
    EXPECT_EQ(without.use_failures, true);
    for (const Factor factor : kFactors) {
      if (factor == removed) continue;
      // Their proportions stay; only rounding differs.
      EXPECT_NEAR(without.of(factor).weight, config.of(factor).weight / (1.0 - config.of(removed).weight), 1e-15);
      EXPECT_EQ(without.of(factor).logistic.a, config.of(factor).logistic.a);
      EXPECT_EQ(without.of(factor).logistic.b, config.of(factor).logistic.b);
    }
    // What the factor says no longer matters.
    Attributes attributes = handAttributes();
    const double before = computeUtility(attributes, 1.0, without).utility;
    *attributeOf(&attributes, removed) += 100.0;
    EXPECT_EQ(computeUtility(attributes, 1.0, without).utility, before) << toString(removed);
    // Nothing more to take from it.
    const UtilityConfig twice = without.without(toString(removed));
    for (const Factor factor : kFactors) EXPECT_THAT(twice.of(factor).weight, DoubleEq(without.of(factor).weight));
  }
}

TEST(UtilityConfig, WithoutFailurePenaltyOrNothingKeepsTheWeights) {
  const UtilityConfig config = handConfig();
  for (const char* name : {"failure_penalty", "none"}) {
    const UtilityConfig without = config.without(name);
    for (const Factor factor : kFactors) EXPECT_EQ(without.of(factor).weight, config.of(factor).weight);
  }
  EXPECT_FALSE(config.without("failure_penalty").use_failures);
  EXPECT_TRUE(config.without("none").use_failures);
  EXPECT_EQ(computeUtility(handAttributes(), 0.0, config.without("failure_penalty")).failure_penalty, 0.0);
}

TEST(UtilityConfig, WithoutRefusesUnknownNamesAndTheOnlyFactor) {
  UtilityConfig config = handConfig();
  for (const char* name : {"", "Travel", "distance"}) {
    EXPECT_THAT(messageOf<std::invalid_argument>([&] { config.without(name); }),
                AllOf(HasSubstr(std::string("\"") + name + "\""),
                      HasSubstr("manipulability, pick_order, travel, uncertainty, frontier, "
                                "failure_penalty, none")));
  }
  for (const Factor factor : kFactors) config.of(factor).weight = factor == Factor::kTravel ? 1.0 : 0.0;
  EXPECT_THROW(config.without("travel"), std::invalid_argument);
  EXPECT_EQ(config.without("frontier").of(Factor::kTravel).weight, 1.0);
}

}  // namespace
}  // namespace nbv_selection
