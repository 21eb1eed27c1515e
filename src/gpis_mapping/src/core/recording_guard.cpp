// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/recording_guard.h"

#include <algorithm>

namespace gpis_mapping {
namespace {

using depth_camera::PoseGuard;
using depth_camera::PoseLimits;
using depth_camera::StampedPose;
using depth_camera::StampGuard;

// A jump stands out from the motion around it. Between rows of views an arm moves two to four times as far as in a row.
constexpr double kJumpMedians = 5.0;

/// How much wider than `limits` must be for a recording in which the median step uses up this share of them.
double paceOf(DepthSequence* sequence, const std::vector<std::size_t>& frames, const PoseLimits& limits) {
  if (sequence->hasClock()) return 1.0;
  std::vector<StampedPose> poses;
  for (const std::size_t i : frames) {
    try {
      SkipReason ignored;
      const std::optional<StampedPose> pose = sequence->pose(i, sequence->timeOffset(), &ignored);
      if (pose) poses.push_back(*pose);
    } catch (const DepthSequenceError&) {  // said when the frame is read
    }
  }
  if (poses.size() < 2) return 1.0;
  std::sort(poses.begin(), poses.end(),
            [](const StampedPose& a, const StampedPose& b) { return a.stamp_s < b.stamp_s; });
  std::vector<double> shares;
  for (std::size_t i = 1; i < poses.size(); ++i) shares.push_back(limits.shareUsed(poses[i - 1], poses[i]));
  const auto median = shares.begin() + static_cast<std::ptrdiff_t>((shares.size() - 1) / 2);
  std::nth_element(shares.begin(), median, shares.end());
  return std::max(1.0, kJumpMedians * *median);
}

}  // namespace

RecordingGuard::RecordingGuard(DepthSequence* sequence, const std::vector<std::size_t>& frames,
                               std::optional<PoseLimits> limits)
    : is_clock_(sequence->hasClock()) {
  if (!limits) return;
  const double pace = paceOf(sequence, frames, *limits);
  limits->max_step_m *= pace;
  limits->max_step_rad *= pace;
  limits->max_speed_mps *= pace;
  limits->max_turn_radps *= pace;
  poses_.emplace(*limits);
}

std::optional<SkipReason> RecordingGuard::check(const DepthFrame& frame) {
  if (is_clock_) {
    const StampGuard::Verdict verdict = stamps_.check(frame.stamp_s);
    if (verdict == StampGuard::Verdict::kZero) return SkipReason{"no stamp", frame.name + ": " + stamps_.message()};
    if (verdict == StampGuard::Verdict::kRestarted && poses_) poses_->reset();
    if (verdict != StampGuard::Verdict::kGood) {
      return SkipReason{"time ran back", frame.name + ": " + stamps_.message()};
    }
  }
  if (!holdsMeasurement(frame.image))
    return SkipReason{"nothing measured", frame.name + ": " + nothingMeasured(frame.image)};
  if (!poses_) return std::nullopt;
  const PoseGuard::Verdict verdict = poses_->check(frame.T_map_camera, frame.stamp_s);
  if (verdict == PoseGuard::Verdict::kJump) return SkipReason{"pose jump", frame.name + ": " + poses_->message()};
  if (verdict == PoseGuard::Verdict::kSettled) ++num_settled_;
  return std::nullopt;
}

}  // namespace gpis_mapping
