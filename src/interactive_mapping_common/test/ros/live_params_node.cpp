// SPDX-License-Identifier: BSD-3-Clause
// For live_params.test: a node with live parameters. It writes those in use to ~in_use, as YAML.
#include <stdexcept>
#include <string>

#include <interactive_mapping_common_ros/live_params.h>
#include <interactive_mapping_common_ros/node_main.h>
#include <interactive_mapping_common_ros/params.h>

namespace {

using interactive_mapping::Fields;

enum class Color { kRed, kGreen };
constexpr interactive_mapping::Names<Color> kColorNames = {{"red", Color::kRed}, {"green", Color::kGreen}};

struct Gain {
  double p{1.0};

  static void fields(Gain& c, Fields& f) { f.live()("p", c.p, 0.0, 1e9, "", "proportional"); }
};

struct Example {
  double reach_m{0.5};
  int count{3};
  bool is_awake{true};
  std::string label{"it's \"quoted\""};
  Color color{Color::kGreen};
  int hidden{7};
  int written_by_the_node{0};
  Gain left, right;

  struct Band {
    double low{0.1};
    double high{0.9};

    static void fields(Band& c, Fields& f) {
      f.liveTogether("band_low")("low", c.low, 0.0, 1.0, "", "the lower one");
      f.liveTogether("band_high")("high", c.high, 0.0, 1.0, "", "the upper one");
      f.require(c.low < c.high, "low must be below band/high");
    }
  } band;

  static void fields(Example& c, Fields& f) {
    f.live()("reach_m", c.reach_m, 0.1, 2.0, "m", "of the arm");
    f.live()("count", c.count, 1, 10, "", "of tries");
    f.live()("is_awake", c.is_awake, "false: does nothing");
    f.live()("label", c.label, "shown");
    f.live()("color", c.color, kColorNames, "of the arrow");
    f("hidden", c.hidden, 0, 10, "", "not live");
    f.live()("written_by_the_node", c.written_by_the_node, 0, 1000000, "", "how often something was used");
    f.section("band", c.band);
    f.section("left", c.left);
    f.section("right", c.right);
  }
};

class Node {
 public:
  Node(const ros::NodeHandle& /*nh*/, const ros::NodeHandle& private_nh)
      : private_nh_(private_nh),
        live_(private_nh, interactive_mapping_ros::loadParams<Example>(private_nh),
              [this](const Example& params) { use(params); }) {
    // As what the user drags in rviz.
    timer_ = private_nh_.createWallTimer(ros::WallDuration(0.02), [this](const ros::WallTimerEvent&) {
      if (live_.get().written_by_the_node >= uses_) return;
      live_.edit([this](Example& params) { params.written_by_the_node = uses_; });
      live_.edit([](Example& params) { params.reach_m = -1.0; });  // or the client could set nothing from now on
    });
  }

  void stop() { private_nh_.setParam("has_stopped", true); }

 private:
  void use(const Example& params) {
    if (params.count == 5) throw std::invalid_argument("count = 5 is what this node refuses");
    private_nh_.setParam("in_use", interactive_mapping::toYaml(params));
    ++uses_;
  }

  ros::NodeHandle private_nh_;
  int uses_{0};
  interactive_mapping_ros::LiveParams<Example> live_;
  ros::WallTimer timer_;
};

}  // namespace

int main(int argc, char** argv) {
  return interactive_mapping_ros::runNode<Node>(argc, argv, "live_params_node", 1, [](Node& node) { node.stop(); });
}
