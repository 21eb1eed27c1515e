// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <interactive_mapping_msgs/MissionState.h>

#include "pick_mission_ros/mission_words.h"

namespace pick_mission_rviz {

using pick_mission_ros::Rgb;

constexpr double kGreyed = 0.35;  // opacity of what is not up to date

/// What the panel shows, without a widget: strings, colours, what may be pressed.
struct MissionView {
  struct Brick {
    int id{0};
    std::uint8_t status{0};  // of MissionBrick
    Rgb fill;
    Rgb ink;           // of its id: can be read on the fill
    std::string hint;  // all that is known of it
  };
  struct Count {
    std::string text;  // "3 picked"
    Rgb color;
  };
  struct Bar {
    std::string name;
    double share{0.0};  // of the bar's length, in [0, 1]
    std::string value;  // "-": none
    Rgb color;
    bool is_off{false};  // this run does without the factor
  };
  struct Failure {
    std::string when;  // "35 s ago"
    std::string what;  // state and what came back
    std::string then;  // what followed, or why; short
    std::string hint;  // the same as it was told; empty: `then` is all
  };

  bool is_live{false};  // else all but the buttons is greyed out
  std::string title;    // the state
  std::string since;    // "for 12 s"
  Rgb fill;             // of the title
  Rgb ink;
  std::string note;  // what has to be known beside the state; empty: nothing

  double time_share{0.0};  // used of the limit, in [0, 1]
  std::string time;

  std::string bricks_text;
  std::vector<Brick> bricks;
  std::vector<Count> counts;  // those that are not 0

  std::string decision;
  std::string hand;
  std::string view_text;  // of where it drives or stands
  std::vector<Bar> bars;  // five factors, failure penalty, utility; also without a view
  std::string failures_text;
  std::vector<Failure> failures;
  std::string run;  // scene, strategy ...

  bool can_start{false};
  bool can_pause{false};  // else the button is for resume
  bool can_resume{false};
  bool can_stop{false};
  bool can_hold{true};  // always: it stops the robot
};

/// After so long without a state the node is gone, or the clock stands: it publishes once per second. [s], wall time
constexpr double kStateTimeout_s = 3.0;

/// `state`: the last that came, null: none yet. `age_s`: wall time since then, or since the panel began to wait.
/// `node`: whose state it is, for sentences.
MissionView makeView(const interactive_mapping_msgs::MissionState* state, double age_s, const std::string& node);

/// "0 s", "59 s", "3 min 05 s", "2 h 07 min"; "-" unless finite. Negative ones count as 0.
std::string durationInWords(double duration_s);

/// What a button asks of the node.
enum class Request { kStart, kPause, kResume, kHold, kStop };
constexpr std::size_t kNumRequests = 5;
/// The service's name, below the node's.
const char* serviceOf(Request request);

/// How that went.
struct Answer {
  enum class Kind {
    kAnswered,
    kNoService,  // nobody offers it
    kBroken,     // the connection went away before the answer
  };
  Kind kind{Kind::kNoService};
  bool success{false};  // these two: if answered
  std::string message;
};
/// The sentence under the buttons. Whoever pressed hold has to learn that nothing was held.
std::string answerInWords(Request request, const Answer& answer, const std::string& node);
/// The same while there is no answer; `waited_s` in wall time.
std::string waitingInWords(Request request, double waited_s, const std::string& node);
/// An answer takes milliseconds: after so long the node or the network hangs. [s], wall time
constexpr double kAnswerTimeout_s = 3.0;

}  // namespace pick_mission_rviz
