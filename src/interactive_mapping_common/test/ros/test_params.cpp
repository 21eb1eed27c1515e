// SPDX-License-Identifier: BSD-3-Clause
#include <stdexcept>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <ros/ros.h>
#include <yaml-cpp/yaml.h>

#include "interactive_mapping_common/testing/temporary_folder.h"
#include "interactive_mapping_common_ros/param_reader.h"
#include "interactive_mapping_common_ros/param_writer.h"

namespace interactive_mapping_ros {
namespace {

using test_support::messageOf;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

TEST(ParamReader, ReadsAListOfTextsWholeOrNotAtAll) {
  ros::NodeHandle nh("~lists");
  const auto read = [&nh](std::string* complaint) {
    ParamReader reader(nh);
    std::vector<std::string> texts{"as", "before"};
    reader.read("section/names", &texts);
    *complaint = messageOf<std::invalid_argument>([&reader] { reader.finish(); });
    return texts;
  };
  std::string complaint;
  EXPECT_THAT(read(&complaint), ElementsAre("as", "before"));
  EXPECT_EQ(complaint, "");
  nh.setParam("section/names", std::vector<std::string>{"one", "", "three 3"});
  EXPECT_THAT(read(&complaint), ElementsAre("one", "", "three 3"));
  EXPECT_EQ(complaint, "");
  XmlRpc::XmlRpcValue none;
  none.setSize(0);
  nh.setParam("section/names", none);
  EXPECT_THAT(read(&complaint), testing::IsEmpty());
  EXPECT_EQ(complaint, "");
  // Not one of these is a list of texts.
  nh.setParam("section/names", "one");
  EXPECT_THAT(read(&complaint), ElementsAre("as", "before"));
  EXPECT_THAT(complaint, AllOf(HasSubstr("/lists/section/names = "), HasSubstr("must be a list of texts")));
  XmlRpc::XmlRpcValue mixed;
  mixed.setSize(2);
  mixed[0] = "one";
  mixed[1] = 2;
  nh.setParam("section/names", mixed);
  EXPECT_THAT(read(&complaint), ElementsAre("as", "before"));
  EXPECT_THAT(complaint, AllOf(HasSubstr("/lists/section/names = "), HasSubstr("must be a list of texts")));
  nh.deleteParam("section/names");
  nh.setParam("section/names/one", "1");
  EXPECT_THAT(read(&complaint), ElementsAre("as", "before"));
  EXPECT_THAT(complaint, HasSubstr("must be a list of texts"));
}

TEST(ParamWriter, WritesAListOfTextsAsOneValue) {
  ParamWriter writer;
  writer.write("section/names", std::vector<std::string>{"one", "", "three: 3"});
  writer.write("section/none", std::vector<std::string>());
  const YAML::Node yaml = YAML::Load(writer.text());
  EXPECT_EQ(yaml["section"]["names"].as<std::vector<std::string>>(), (std::vector<std::string>{"one", "", "three: 3"}));
  ASSERT_TRUE(yaml["section"]["none"].IsSequence()) << writer.text();
  EXPECT_EQ(yaml["section"]["none"].size(), 0u);
}

TEST(ParamReader, ReadsAListOfNumbersWholeOrNotAtAll) {
  ros::NodeHandle nh("~numbers");
  const auto read = [&nh](std::string* complaint) {
    ParamReader reader(nh);
    std::vector<double> numbers{1.5, 2.5};
    reader.read("section/numbers", &numbers);
    *complaint = messageOf<std::invalid_argument>([&reader] { reader.finish(); });
    return numbers;
  };
  std::string complaint;
  EXPECT_THAT(read(&complaint), ElementsAre(1.5, 2.5));
  EXPECT_EQ(complaint, "");
  XmlRpc::XmlRpcValue numbers;
  numbers.setSize(3);
  numbers[0] = 0.25;
  numbers[1] = -3;  // an integer will do
  numbers[2] = 1e-9;
  nh.setParam("section/numbers", numbers);
  EXPECT_THAT(read(&complaint), ElementsAre(0.25, -3.0, 1e-9));
  EXPECT_EQ(complaint, "");
  XmlRpc::XmlRpcValue none;
  none.setSize(0);
  nh.setParam("section/numbers", none);
  EXPECT_THAT(read(&complaint), testing::IsEmpty());
  EXPECT_EQ(complaint, "");
  // Not one of these is a list of numbers.
  nh.setParam("section/numbers", 0.25);
  EXPECT_THAT(read(&complaint), ElementsAre(1.5, 2.5));
  EXPECT_THAT(complaint, AllOf(HasSubstr("/numbers/section/numbers = "), HasSubstr("must be a list of numbers")));
  for (const XmlRpc::XmlRpcValue& bad : {XmlRpc::XmlRpcValue("1.0"), XmlRpc::XmlRpcValue(true)}) {
    numbers[1] = bad;
    nh.setParam("section/numbers", numbers);
    EXPECT_THAT(read(&complaint), ElementsAre(1.5, 2.5));
    EXPECT_THAT(complaint, AllOf(HasSubstr("/numbers/section/numbers = "), HasSubstr("must be a list of numbers")));
  }
}

TEST(ParamWriter, WritesAListOfNumbersThatReadsBackTheSame) {
  ParamWriter writer;
  const std::vector<double> numbers{0.1, -3.0, 1.0 / 3.0, 1e-9};
  writer.write("section/numbers", numbers);
  writer.write("section/none", std::vector<double>());
  const YAML::Node yaml = YAML::Load(writer.text());
  EXPECT_EQ(yaml["section"]["numbers"].as<std::vector<double>>(), numbers) << writer.text();
  ASSERT_TRUE(yaml["section"]["none"].IsSequence()) << writer.text();
  EXPECT_EQ(yaml["section"]["none"].size(), 0u);
}

}  // namespace
}  // namespace interactive_mapping_ros

int main(int argc, char** argv) {
  testing::InitGoogleMock(&argc, argv);
  ros::init(argc, argv, "test_params");
  const ros::NodeHandle keep_alive;
  return RUN_ALL_TESTS();
}
