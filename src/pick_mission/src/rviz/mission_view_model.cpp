// SPDX-License-Identifier: BSD-3-Clause
#include "mission_view_model.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include <interactive_mapping_common/formatted.h>
#include <interactive_mapping_msgs/MissionBrick.h>
#include <interactive_mapping_msgs/MissionFailure.h>
#include <interactive_mapping_msgs/NbvSegment.h>

namespace pick_mission_rviz {
namespace {

using interactive_mapping::formatted;
using interactive_mapping_msgs::MissionBrick;
using interactive_mapping_msgs::MissionFailure;
using interactive_mapping_msgs::MissionState;
using interactive_mapping_msgs::NbvSegment;
using pick_mission_ros::colorOfStatus;
using pick_mission_ros::stateInWords;
using pick_mission_ros::statusInWords;

constexpr Rgb kWhite{255, 255, 255};
constexpr Rgb kBlack{16, 16, 16};
constexpr Rgb kQuiet{95, 99, 104};     // nothing goes on
constexpr Rgb kActive{21, 101, 52};    // it works
constexpr Rgb kWaiting{255, 193, 7};   // interrupted, on the way to it
constexpr Rgb kStopped{179, 38, 30};   // somebody has to do something
constexpr Rgb kFinished{23, 78, 166};  // nothing is left to do
constexpr Rgb kFactor{46, 125, 120};
constexpr Rgb kPenalty{198, 40, 40};
constexpr Rgb kUtility{23, 78, 166};

constexpr double kPerMinute = 60.0;
constexpr double kPerHour = 3600.0;

/// Relative luminance, sRGB (WCAG 2.1).
double luminance(const Rgb& rgb) {
  const auto linear = [](std::uint8_t byte) {
    const double c = byte / 255.0;
    return c <= 0.04045 ? c / 12.92 : std::pow((c + 0.055) / 1.055, 2.4);
  };
  return 0.2126 * linear(rgb.r) + 0.7152 * linear(rgb.g) + 0.0722 * linear(rgb.b);
}

/// Black or white, whichever has the greater contrast.
Rgb inkOn(const Rgb& fill) {
  const double on_white = 1.05 / (luminance(fill) + 0.05);
  const double on_black = (luminance(fill) + 0.05) / (luminance(kBlack) + 0.05);
  return on_white >= on_black ? kWhite : kBlack;
}

double clampedShare(double value) {
  return std::isfinite(value) ? std::min(1.0, std::max(0.0, value)) : 0.0;
}

std::string number(double value, int decimals) {
  return std::isfinite(value) ? formatted("%.*f", decimals, value) : "-";
}

std::string capitalised(std::string text) {
  if (!text.empty() && text[0] >= 'a' && text[0] <= 'z') text[0] = static_cast<char>(text[0] - 'a' + 'A');
  return text;
}

std::string counted(std::size_t count, const std::string& one, const std::string& many) {
  return std::to_string(count) + " " + (count == 1 ? one : many);
}

bool hasWorkLeft(std::uint8_t end_reason) {
  return end_reason != MissionState::NO_BRICK_LEFT;
}

Rgb fillOf(const MissionState& state) {
  switch (state.state) {
    case MissionState::IDLE:
      return kQuiet;
    case MissionState::PAUSED:
    case MissionState::HALTING:
    case MissionState::WAIT:
    case MissionState::UNLOAD:
    case MissionState::RECOVER:
      return kWaiting;
    case MissionState::HELD:
      return kStopped;
    case MissionState::ENDED:
      return hasWorkLeft(state.end_reason) ? kStopped : kFinished;
    default:
      return pick_mission_ros::isActive(state.state) ? kActive : kStopped;
  }
}

std::string noteOf(const MissionState& state) {
  if (state.state == MissionState::ENDED) {
    std::string note = capitalised(pick_mission_ros::endReasonInWords(state.end_reason)) + ".";
    if (!state.end_message.empty()) note += "\n" + capitalised(state.end_message);
    if (state.end_message.find("STALE_STATE") != std::string::npos) {
      note += "\nIn simulation: the machine may be too slow; start with realtime_factor:=0.4 or clock:=lockstep.";
    }
    return note;
  }
  if (state.is_pause_wanted) return "Pauses when the running action has ended.";
  if (state.state == MissionState::HELD) return "The arm does not move until resume.";
  return "";
}

std::string handOf(const MissionState& state) {
  switch (state.hand) {
    case MissionState::EMPTY:
      return "empty";
    case MissionState::HOLDING: {
      const auto current = std::find_if(state.bricks.begin(), state.bricks.end(), [](const MissionBrick& brick) {
        return brick.status == MissionBrick::CURRENT;
      });
      if (current != state.bricks.end()) return "brick " + std::to_string(current->id);
      return "something unknown: the magnet is on";
    }
    case MissionState::UNKNOWN:
      return "unknown: the arm's bridge reports nothing";
    default:
      return "unknown value " + std::to_string(state.hand);
  }
}

std::string hintOf(const MissionBrick& brick) {
  std::string hint = "brick " + std::to_string(brick.id) + " (" + brick.type + "): " + statusInWords(brick.status);
  hint += "\n" + counted(brick.picks_begun, "pick", "picks") + " begun, " + std::to_string(brick.picks_failed) +
          " failed; " + counted(brick.plans_failed, "plan", "plans") + " failed";
  if (!brick.last_failure.empty()) hint += "\nlast failure: " + brick.last_failure;
  return hint;
}

void addBricks(const MissionState& state, MissionView* view) {
  std::map<std::uint8_t, std::size_t> counts;
  for (const MissionBrick& brick : state.bricks) {
    const Rgb fill = colorOfStatus(brick.status);
    view->bricks.push_back({brick.id, brick.status, fill, inkOn(fill), hintOf(brick)});
    ++counts[brick.status];
  }
  view->bricks_text = std::to_string(state.bricks_picked);
  if (state.bricks_total >= 0) view->bricks_text += " of " + std::to_string(state.bricks_total);
  view->bricks_text +=
      " picked, " + counted(state.picks_begun, "pick", "picks") + " begun, " + counted(state.views, "view", "views");
  // As on the strip: the mission's own figures count the brick in work as open.
  for (const std::uint8_t status :
       {MissionBrick::PICKED, MissionBrick::CURRENT, MissionBrick::OPEN, MissionBrick::EXHAUSTED, MissionBrick::AWAY}) {
    if (counts[status] == 0) continue;
    view->counts.push_back({std::to_string(counts[status]) + " " + statusInWords(status), colorOfStatus(status)});
  }
}

/// `segment`: null: none.
void addBars(const NbvSegment* segment, const std::string& removed_factor, MissionView* view) {
  struct Row {
    const char* name;
    const char* key;  // of an ablation
    double NbvSegment::*value;
    Rgb color;
  };
  static const std::array<Row, 7> kRows = {
      {{"manipulability", "manipulability", &NbvSegment::manipulability_factor, kFactor},
       {"pick order", "pick_order", &NbvSegment::pick_order_factor, kFactor},
       {"travel", "travel", &NbvSegment::travel_factor, kFactor},
       {"uncertainty", "uncertainty", &NbvSegment::uncertainty_factor, kFactor},
       {"frontier", "frontier", &NbvSegment::frontier_factor, kFactor},
       {"failure penalty", "", &NbvSegment::failure_penalty, kPenalty},
       {"utility", "", &NbvSegment::utility, kUtility}}};
  for (const Row& row : kRows) {
    MissionView::Bar bar;
    bar.name = row.name;
    bar.color = row.color;
    bar.is_off = row.key[0] != '\0' && removed_factor == row.key;
    if (segment != nullptr) bar.share = clampedShare(segment->*row.value);
    bar.value = segment != nullptr ? number(segment->*row.value, 2) : "-";
    if (bar.is_off) bar.name += " (off)";
    view->bars.push_back(bar);
  }
}

std::string viewTextOf(const MissionState& state) {
  if (state.view.empty()) return "none selected yet";
  const NbvSegment& segment = state.view.front();
  std::string text =
      "at " + number(segment.standing.position.x, 2) + ", " + number(segment.standing.position.y, 2) + " m";
  if (segment.kind == NbvSegment::FRONTIER) text += ", beside what is unseen";
  if (segment.kind == NbvSegment::HERE) text += ", where the robot stood";
  if (segment.kind == NbvSegment::GROUND) text += ", to see unseen ground";
  if (segment.kind == NbvSegment::IMAGINARY) text += ", where no image has looked";
  return text;
}

void addFailures(const MissionState& state, MissionView* view) {
  view->failures_text = state.failures == 0 ? "none" : std::to_string(state.failures) + " in all";
  for (const MissionFailure& failure : state.last_failures) {
    MissionView::Failure row;
    row.when = durationInWords((state.header.stamp - failure.stamp).toSec()) + " ago";
    row.what = stateInWords(failure.state) + ": " + failure.event;
    // Which face, joint or place it was stands in brackets, and in the log.
    row.then = failure.reason.substr(0, failure.reason.find(" ("));
    if (row.then != failure.reason) row.hint = failure.reason;
    view->failures.push_back(row);
  }
}

std::string runOf(const MissionState& state) {
  std::vector<std::string> parts;
  if (!state.scene.empty()) parts.push_back("scene " + state.scene);
  parts.push_back("strategy " + (state.strategy.empty() ? "by default" : state.strategy));
  if (!state.removed_factor.empty()) parts.push_back("without " + state.removed_factor);
  if (!state.run_folder.empty()) parts.push_back("log in " + state.run_folder);
  std::string run;
  for (const std::string& part : parts) run += (run.empty() ? "" : ", ") + part;
  return run;
}

void addButtons(const MissionState& state, MissionView* view) {
  const bool goes_on = pick_mission_ros::isActive(state.state) || state.state == MissionState::UNLOAD;
  const bool is_known = state.state < MissionState::NUM_STATES;
  // After one that has ended: another.
  view->can_start = state.state == MissionState::IDLE || state.state == MissionState::ENDED;
  view->can_pause = goes_on && !state.is_pause_wanted;
  // While it halts for a hold, resume takes that back.
  const bool is_interruption = state.state == MissionState::PAUSED || state.state == MissionState::HELD ||
                               state.state == MissionState::HALTING || (goes_on && state.is_pause_wanted);
  // Before a mission and after it resume releases a hold, without which none starts if it has been lost. The state does not
  // tell of one; where there is none, the node answers so.
  view->can_resume = is_interruption || view->can_start;
  // One that waits to go on after a crash has used time.
  const bool is_interrupted = state.state == MissionState::IDLE && state.used_s > 0.0;
  view->can_stop = goes_on || is_interruption || is_interrupted || !is_known;
}

}  // namespace

std::string durationInWords(double duration_s) {
  if (!std::isfinite(duration_s)) return "-";
  const double whole_s = std::floor(std::max(0.0, duration_s));
  if (whole_s < kPerMinute) return formatted("%.0f s", whole_s);
  if (whole_s < kPerHour) {
    return formatted("%.0f min %02.0f s", std::floor(whole_s / kPerMinute), std::fmod(whole_s, kPerMinute));
  }
  return formatted("%.0f h %02.0f min", std::floor(whole_s / kPerHour),
                   std::floor(std::fmod(whole_s, kPerHour) / kPerMinute));
}

MissionView makeView(const MissionState* state, double age_s, const std::string& node) {
  MissionView view;
  if (state == nullptr) {
    addBars(nullptr, "", &view);
    view.fill = kQuiet;
    view.ink = inkOn(view.fill);
    view.bricks_text = view.decision = view.hand = view.view_text = view.failures_text = "-";
    view.title = "No mission";
    view.note = age_s < kStateTimeout_s ? "Waiting for the first message of " + node + " ..."
                                        : "No message of " + node + " yet: is it running, and is this its name?";
    return view;
  }
  view.is_live = age_s < kStateTimeout_s;
  view.title = capitalised(stateInWords(*state));
  view.since = "for " + durationInWords((state->header.stamp - state->since).toSec());
  view.fill = fillOf(*state);
  view.note = noteOf(*state);
  view.time_share = state->limit_s > 0.0 ? clampedShare(state->used_s / state->limit_s) : 0.0;
  view.time = durationInWords(state->used_s) + " of " + durationInWords(state->limit_s);
  addBricks(*state, &view);
  view.decision = state->decision.empty() ? "-" : capitalised(state->decision);
  view.hand = handOf(*state);
  view.view_text = viewTextOf(*state);
  addBars(state->view.empty() ? nullptr : &state->view.front(), state->removed_factor, &view);
  addFailures(*state, &view);
  view.run = runOf(*state);
  if (view.is_live) {
    addButtons(*state, &view);
  } else {
    view.fill = kStopped;
    view.since = "";
    view.title = "No message for " + durationInWords(age_s);
    view.note = node + " has ended, or the clock is stopped. Its last state: " + stateInWords(*state) + ".";
  }
  view.ink = inkOn(view.fill);
  return view;
}

const char* serviceOf(Request request) {
  switch (request) {
    case Request::kStart:
      return "start";
    case Request::kPause:
      return "pause";
    case Request::kResume:
      return "resume";
    case Request::kHold:
      return "hold";
    case Request::kStop:
      return "stop";
  }
  return "?";
}

namespace {

std::string nameOf(Request request) {
  return capitalised(serviceOf(request));
}

/// Nodes' messages come with and without a full stop.
std::string sentence(std::string text) {
  if (!text.empty() && text.back() != '.' && text.back() != '!' && text.back() != '?') text += ".";
  return text;
}

std::string warningOf(Request request) {
  return request == Request::kHold ? " The arm is not held: use the emergency stop." : "";
}

std::string fullNameOf(Request request, const std::string& node) {
  return node + "/" + serviceOf(request);
}

}  // namespace

std::string answerInWords(Request request, const Answer& answer, const std::string& node) {
  switch (answer.kind) {
    case Answer::Kind::kAnswered: {
      if (answer.success) return sentence(nameOf(request) + ": " + (answer.message.empty() ? "done" : answer.message));
      const std::string why = answer.message.empty() ? "no reason was given" : answer.message;
      return sentence(nameOf(request) + " was refused: " + why) + warningOf(request);
    }
    case Answer::Kind::kNoService:
      return nameOf(request) + " failed: there is no service " + fullNameOf(request, node) + "; is the node running?" +
             warningOf(request);
    case Answer::Kind::kBroken:
      return nameOf(request) + " failed: " + fullNameOf(request, node) + " ended before it answered." +
             warningOf(request);
  }
  return "";
}

std::string waitingInWords(Request request, double waited_s, const std::string& node) {
  if (waited_s < kAnswerTimeout_s) return nameOf(request) + " ...";
  return nameOf(request) + ": no answer of " + fullNameOf(request, node) + " for " + durationInWords(waited_s) + "." +
         (request == Request::kHold ? " The arm may not be held: use the emergency stop." : "");
}

}  // namespace pick_mission_rviz
