// SPDX-License-Identifier: BSD-3-Clause
// A slice of every fuzzing target with fixed seeds; scripts/soak runs a million inputs under the sanitizers.
#include <stdexcept>

#include <gtest/gtest.h>

#include "fuzz/fuzz_engine.h"

namespace gpis_mapping_fuzz {
namespace {

class Fuzz : public testing::TestWithParam<TargetInfo> {};

TEST_P(Fuzz, ASliceIsTakenWell) {
  // 1/30 of a full run: about two seconds per target.
  const Report report = runTarget(GetParam(), 20250, 0, GetParam().inputs / 30);
  EXPECT_EQ(report.failure, "") << "fuzz_map --target " << GetParam().name << " --seed 20250 --only "
                                << report.failed_at;
  // Inputs that are all refused, or all accepted, would try one half of the program only.
  EXPECT_GT(report.accepted, 0u);
  EXPECT_GT(report.refused, 0u);
}

TEST_P(Fuzz, TheSameSeedGivesTheSameInputsWhereverTheRunBegins) {
  const Report whole = runTarget(GetParam(), 7, 0, 60);
  const Report again = runTarget(GetParam(), 7, 0, 60);
  EXPECT_EQ(whole.digest, again.digest);
  const Report first = runTarget(GetParam(), 7, 0, 30);
  const Report second = runTarget(GetParam(), 7, 30, 60);
  EXPECT_EQ(whole.accepted, first.accepted + second.accepted);
  EXPECT_EQ(whole.refused, first.refused + second.refused);
}

INSTANTIATE_TEST_SUITE_P(AllTargets, Fuzz, testing::ValuesIn(allTargets()),
                         [](const testing::TestParamInfo<TargetInfo>& target) { return target.param.name; });

/// Fails at input 3 of an episode.
class FaultyTarget : public Target {
 public:
  Outcome feed(Random*) override {
    require(count_++ != 3, "wrong");
    return Outcome::kAccepted;
  }

 private:
  int count_{0};
};

TEST(FuzzEngine, AFailureIsReportedWithItsInput) {
  const TargetInfo target{"faulty", 100, 50, [](Random*) { return std::make_unique<FaultyTarget>(); }};
  const Report report = runTarget(target, 1, 0, 100);
  EXPECT_EQ(report.failure, "wrong");
  EXPECT_EQ(report.failed_at, 3u);
  EXPECT_EQ(report.inputs, 3u);
  // Alone, with what its episode needs before it.
  EXPECT_EQ(runTarget(target, 1, 53, 54).failed_at, 53u);
}

TEST(FuzzEngine, AnEscapedExceptionIsAFailure) {
  class Escaping : public Target {
   public:
    Outcome feed(Random*) override { throw std::out_of_range("escaped"); }
  };
  const TargetInfo target{"escaping", 1, 1, [](Random*) { return std::make_unique<Escaping>(); }};
  EXPECT_NE(runTarget(target, 1, 0, 1).failure.find("escaped"), std::string::npos);
}

TEST(FuzzEngine, MutationsChangeWhatTheyAreGiven) {
  int num_changed = 0;
  for (std::uint64_t i = 0; i < 200; ++i) {
    Random random(1, 0, i);
    num_changed += mutateBytes("a few bytes, 24 of them.", &random) != "a few bytes, 24 of them.";
    num_changed += mutateText("key: 1\nother: [2, 3]\n", {"x", "17"}, &random) != "key: 1\nother: [2, 3]\n";
    mutateBytes("", &random);
    mutateText("", {"x"}, &random);
  }
  EXPECT_GT(num_changed, 360);  // two lines swapped with themselves and the like change nothing
}

TEST(FuzzEngine, TextsHaveNoEndlessYaml) {
  for (std::uint64_t i = 0; i < 200; ++i) {
    Random random(1, 0, i);
    const std::string text = mutateText("[1, 2]", {":"}, &random);
    EXPECT_EQ(text.find(":]"), std::string::npos) << text;
    EXPECT_TRUE(text.empty() || text.back() != ':') << text;
  }
}

}  // namespace
}  // namespace gpis_mapping_fuzz
