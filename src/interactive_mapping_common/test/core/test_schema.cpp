// SPDX-License-Identifier: BSD-3-Clause
#include "interactive_mapping_common/config/schema.h"

#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <yaml-cpp/yaml.h>

#include "interactive_mapping_common/testing/temporary_folder.h"

namespace interactive_mapping {
namespace {

using test_support::messageOf;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

enum class Color { kRed, kGreen };
constexpr Names<Color> kColorNames = {{"red", Color::kRed}, {"green", Color::kGreen}};

struct Example {
  double reach_m{0.5};
  int count{3};
  bool enabled{true};
  std::string frame{"map"};
  Color color{Color::kGreen};
  std::vector<std::string> names{"a", "b c"};
  std::vector<double> weights{1.0, 0.25};
  Eigen::Vector3d low_m{-1.0, 0.0, 1.0};

  struct Inner {
    double low{0.1};
    double high{0.9};
    static void fields(Inner& c, Fields& f) {
      f.shorthand(
          "wide", [&c](const std::string& word) { c.low = word == "very" ? 0.0 : 0.05; }, {"very", "rather"},
          "instead of low");
      f("low", c.low, 0.0, 1.0, "", "the lower one");
      f("high", c.high, 0.0, 1.0, "", "the upper one");
      f.require(c.low < c.high, "low must be below inner/high");
    }
  } inner;

  static void fields(Example& c, Fields& f) {
    f("reach_m", c.reach_m, 0.1, 2.0, "m", "of the arm");
    f("count", c.count, 1, 10, "", "of tries");
    f("enabled", c.enabled, "false: does nothing");
    f("frame", c.frame, "of what is said");
    f("color", c.color, kColorNames, "of the arrow");
    f("names", c.names, "of the joints");
    f("weights", c.weights, 0.0, 1.0, "", "of the factors");
    f("low_m", c.low_m, -10.0, 10.0, "m", "x, y, z");
    f.section("inner", c.inner);
  }
};

std::vector<std::string> problemsOfText(const std::string& text) {
  Example config;
  FieldReader reader(text, "text");
  Example::fields(config, reader);
  return reader.finish();
}

TEST(Schema, WhatIsWrittenReadsBackTheSame) {
  Example config;
  config.reach_m = 1.0 / 3.0;
  config.count = -7;
  config.enabled = false;
  config.frame = "5";  // a text, though it looks like a number
  config.color = Color::kRed;
  config.names = {"", "true", "x: y", "a, b", "'", "#"};
  config.weights.clear();
  config.low_m = {1e-300, -0.1, 3e8};
  config.inner = {0.2, std::numeric_limits<double>::denorm_min()};
  for (const bool commented : {false, true}) {
    const std::string text = toYaml(config, commented);
    Example back;
    FieldReader reader(text, "text");
    Example::fields(back, reader);
    EXPECT_THAT(reader.finish(), IsEmpty()) << text;
    EXPECT_EQ(toYaml(back), toYaml(config)) << text;
    EXPECT_EQ(back.reach_m, config.reach_m);
    EXPECT_EQ(back.names, config.names) << text;
    EXPECT_EQ(back.low_m, config.low_m);
    EXPECT_EQ(back.inner.high, config.inner.high);
    EXPECT_EQ(back.color, config.color);
  }
}

TEST(Schema, LargeNumbersAreNumbersForRoslaunchToo) {
  Example config;
  config.reach_m = 1e9;
  config.low_m.x() = 1e-5;
  EXPECT_THAT(toYaml(config), AllOf(HasSubstr("reach_m: 1.0e+09\n"), HasSubstr("low_m: [1.0e-05, 0, 1]\n")));
}

TEST(Schema, MissingKeysKeepTheirDefault) {
  for (const char* text : {"", "inner:\n", "reach_m: 0.5"}) {
    EXPECT_EQ(toYaml(parse<Example>(text, "text")), toYaml(Example())) << text;
  }
  EXPECT_EQ(parse<Example>("inner: {low: 0.3}", "text").inner.low, 0.3);
}

TEST(Schema, ShorthandComesBeforeTheFieldsItStandsFor) {
  EXPECT_EQ(parse<Example>("inner: {wide: very}", "text").inner.low, 0.0);
  EXPECT_EQ(parse<Example>("inner: {low: 0.3, wide: very}", "text").inner.low, 0.3);
  EXPECT_THAT(problemsOfText("inner: {wide: little}"), ElementsAre("inner/wide = little, must be one of very, rather"));
}

struct Mistake {
  const char* text;
  const char* problem;
};
class Mistakes : public testing::TestWithParam<Mistake> {};

TEST_P(Mistakes, AreNamedWithKeyValueAndWhatIsAllowed) {
  EXPECT_THAT(messageOf<std::invalid_argument>([] { parse<Example>(GetParam().text, "file.yaml"); }),
              testing::AllOf(HasSubstr("file.yaml: "), HasSubstr(GetParam().problem)));
}

INSTANTIATE_TEST_SUITE_P(
    Schema, Mistakes,
    testing::Values(Mistake{"reach_m: 2.5", "reach_m = 2.5 m, must be in [0.1, 2] m"},
                    Mistake{"reach_m: .nan", "reach_m = nan m, must be in [0.1, 2] m"},
                    Mistake{"reach_m: far", "reach_m = far, must be a number"},
                    Mistake{"reach_m: '1.0'", "reach_m = '1.0', must be a number"},
                    Mistake{"reach_m: [1]", "reach_m = [1], must be a number"},
                    Mistake{"count: 0", "count = 0, must be in [1, 10]"},
                    Mistake{"count: 2.5", "count = 2.5, must be a whole number"},
                    Mistake{"count: 99999999999", "count = 99999999999, must be a whole number"},
                    Mistake{"enabled: 1", "enabled = 1, must be true or false"},
                    Mistake{"frame: [map]", "frame = [map], must be a text"},
                    Mistake{"color: blue", "color = blue, must be one of red, green"},
                    Mistake{"names: a", "names = a, must be a list of texts"},
                    Mistake{"names: [a, {b: c}]", "names = [a, {b: c}], must be a list of texts"},
                    Mistake{"weights: [1, x]", "weights = [1, x], must be a list of numbers"},
                    Mistake{"weights: [0.5, 2]", "weights = [0.5, 2], must be in [0, 1]"},
                    Mistake{"low_m: [1, 2]", "low_m = [1, 2], must be a list of three numbers"},
                    Mistake{"low_m: [1, 2, .inf]", "low_m = [1, 2, inf] m, must be in [-10, 10] m"},
                    Mistake{"inner: {high: 0.05}", "inner/low must be below inner/high"},
                    Mistake{"inner: 5", "inner = 5, must be a section with keys"},
                    Mistake{"inner: {lower: 5}", "inner/lower is unknown; known here: high, low"},
                    Mistake{"reach: 1", "reach is unknown; known here: color, count, "},
                    Mistake{"{[1]: 1}", "(not a name) is unknown"},
                    Mistake{"count: 1\ncount: 2", "count is given twice"},
                    Mistake{"reach_m: &x [1, *x]", "reach_m = [1, [1, [...]]], must be a number"},
                    Mistake{"frame: [1, 2, 3, 4, 5, 6, 7]", "frame = [1, 2, 3, 4, 5, 6, ...], must be a text"},
                    Mistake{"[1]", "must be a map of keys"}, Mistake{"a: [", "not YAML"}));

TEST(Schema, EverythingWrongIsInOneMessage) {
  const std::string message = messageOf<std::invalid_argument>(
      [] { parse<Example>("reach_m: 5\ncount: x\nunknown: 1\ninner: {low: 2}", "file.yaml"); });
  for (const char* part : {"reach_m = 5 m", "count = x", "unknown is unknown", "inner/low = 2, must be in [0, 1]"}) {
    EXPECT_THAT(message, HasSubstr(part));
  }
}

TEST(Schema, WhatOthersReadIsNotUnknown) {
  Example config;
  FieldReader reader("theirs: {a: 1}\ninner: {b: 2, low: 0.2}", "text");
  Example::fields(config, reader);
  reader.ignore("theirs");
  reader.ignore("inner/b");
  EXPECT_THAT(reader.finish(), IsEmpty());
}

TEST(Schema, ShippedFileSaysUnitRangeAndMeaning) {
  const std::string text = toYaml(Example(), true);
  EXPECT_THAT(text, HasSubstr("reach_m: 0.5                      # [0.1, 2] m: of the arm\n"));
  EXPECT_THAT(text, HasSubstr("color: green                      # red, green: of the arrow\n"));
  EXPECT_THAT(text, HasSubstr("\ninner:\n  # wide: very"));
  EXPECT_THAT(toYaml(Example()), Not(HasSubstr("#")));
  Example small;
  small.inner.low = 1e-5;
  EXPECT_THAT(toYaml(small), HasSubstr("low: 1.0e-05\n")) << "1e-05 is a text to rosparam";
}

TEST(Schema, LongCommentsGoOnInTheNextLine) {
  struct Long {
    double a{0.0};
    static void fields(Long& c, Fields& f) {
      f("a", c.a, 0.0, 1.0, "",
        "one two three four five six seven eight nine ten eleven twelve thirteen fourteen fifteen");
    }
  };
  EXPECT_EQ(toYaml(Long(), true),
            "a: 0                              # [0, 1]: one two three four five six seven eight nine ten eleven "
            "twelve thirteen\n"
            "                                  # fourteen fifteen\n");
}

struct Twice {
  double a{0.0};
  double b{0.0};
  static void fields(Twice& c, Fields& f) {
    f("a", c.a, 0.0, 1.0, "", "");
    f("b", c.a, 0.0, 1.0, "", "");
  }
};

TEST(Schema, MemberUnderTwoKeysIsAMistakeOfTheProgram) {
  EXPECT_THAT(messageOf<std::logic_error>([] { toYaml(Twice()); }), HasSubstr("b is declared twice"));
}

TEST(Schema, FilesThatCannotBeReadSayWhich) {
  const test_support::TemporaryFolder folder;
  test_support::writeText(folder.file("empty"), "");
  EXPECT_THAT(messageOf<std::invalid_argument>([&] { readTextFile(folder.file("none")); }),
              HasSubstr("none: cannot be read"));
  EXPECT_THAT(messageOf<std::invalid_argument>([&] { readTextFile(folder.file("empty")); }), HasSubstr("is empty"));
  EXPECT_THAT(messageOf<std::invalid_argument>([&] { readTextFile(folder.file("")); }), HasSubstr("is a folder"));
}

}  // namespace
}  // namespace interactive_mapping
