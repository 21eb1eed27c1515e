// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/recording_guard.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include <gmock/gmock.h>

namespace gpis_mapping {
namespace {

using depth_camera::PoseLimits;
using depth_camera::StampedPose;

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

Eigen::Isometry3d poseAt(double x_m) {
  return Eigen::Isometry3d(Eigen::Translation3d(x_m, 0.0, 0.0));
}

class Recording : public DepthSequence {
 public:
  Recording(bool is_bag, std::vector<StampedPose> poses) : is_bag_(is_bag), poses_(std::move(poses)) {}

  std::size_t size() const override { return poses_.size(); }
  const CameraModel& camera() const override { return camera_; }
  bool hasClock() const override { return is_bag_; }
  std::optional<StampedPose> pose(std::size_t i, double time_offset_s, SkipReason* /*reason*/) override {
    if (is_broken) throw DepthSequenceError("broken");
    return time_offset_s == known_offset_s ? std::make_optional(poses_.at(i)) : std::nullopt;
  }
  std::optional<DepthFrame> frame(std::size_t i, SkipReason* /*reason*/) override {
    return DepthFrame{{1, 1, {depth_m}}, poses_.at(i).T_map_camera, poses_.at(i).stamp_s, std::to_string(i)};
  }

  float depth_m{1.0f};
  double known_offset_s{0.0};  // at any other there is no pose
  bool is_broken{false};

 private:
  bool is_bag_;
  std::vector<StampedPose> poses_;
  CameraModel camera_;
};

/// Numbers of the frames that are refused, with the kind of the last one.
std::vector<std::size_t> refusedOf(Recording recording, std::optional<PoseLimits> limits = PoseLimits{},
                                   SkipReason* last = nullptr, std::size_t* settled = nullptr) {
  std::vector<std::size_t> frames(recording.size());
  std::iota(frames.begin(), frames.end(), 0u);
  RecordingGuard guard(&recording, frames, limits);
  std::vector<std::size_t> refused;
  SkipReason ignored;
  for (const std::size_t i : frames) {
    const std::optional<SkipReason> reason = guard.check(*recording.frame(i, &ignored));
    if (!reason) continue;
    refused.push_back(i);
    if (last != nullptr) *last = *reason;
  }
  if (settled != nullptr) *settled = guard.numSettledJumps();
  return refused;
}

/// 30 Hz, 0.5 m/s along x, with an offset from frame `jump` to before frame `back`.
std::vector<StampedPose> motion(std::size_t num, std::size_t jump, std::size_t back, double offset_m) {
  std::vector<StampedPose> poses;
  for (std::size_t i = 0; i < num; ++i) {
    const double t = static_cast<double>(i) / 30.0;
    poses.push_back({poseAt(0.5 * t + (i >= jump && i < back ? offset_m : 0.0)), 100.0 + t});
  }
  return poses;
}

TEST(RecordingGuard, RefusesPosesThatTheCameraCannotHaveMovedTo) {
  for (const bool is_bag : {true, false}) {
    SkipReason reason;
    EXPECT_THAT(refusedOf({is_bag, motion(20, 8, 10, 0.5)}, PoseLimits{}, &reason), ElementsAre(8u, 9u));
    EXPECT_EQ(reason.kind, "pose jump");
    EXPECT_THAT(reason.detail, AllOf(HasSubstr("9: "), HasSubstr("must be at most")));
    EXPECT_THAT(refusedOf({is_bag, motion(20, 8, 10, 0.5)}, std::nullopt), IsEmpty());
    EXPECT_THAT(refusedOf({is_bag, motion(20, 20, 20, 0.0)}), IsEmpty());
  }
}

TEST(RecordingGuard, BelievesAndCountsAJumpThatStays) {
  std::size_t settled = 0;
  EXPECT_THAT(refusedOf({true, motion(20, 8, 20, 0.5)}, PoseLimits{}, nullptr, &settled),
              ElementsAre(8u, 9u, 10u, 11u));
  EXPECT_EQ(settled, 1u);
}

TEST(RecordingGuard, ListsMayRepeatAndReorderFrames) {
  std::vector<StampedPose> poses = motion(60, 60, 60, 0.0);
  std::reverse(poses.begin(), poses.end());
  poses.insert(poses.begin() + 7, poses[7]);
  std::swap(poses[3], poses[40]);
  EXPECT_THAT(refusedOf({false, poses}), IsEmpty());
}

TEST(RecordingGuard, FoldersMayHoldSeparateViews) {
  std::vector<StampedPose> row;  // of an arm: 0.15 m from view to view, 0.5 m between rows; numbered at 30 Hz
  double x_m = 0.0;
  for (int i = 0; i < 15; ++i) {
    row.push_back({poseAt(x_m), i / 30.0});
    x_m += i % 5 == 4 ? 0.5 : 0.15;
  }
  EXPECT_THAT(refusedOf({false, row}), IsEmpty());
  std::vector<StampedPose> far;
  for (int i = 0; i < 5; ++i) far.push_back({poseAt(0.8 * i), i / 30.0});
  EXPECT_THAT(refusedOf({false, far}), IsEmpty());
}

TEST(RecordingGuard, LimitsAreOfThePosesAtTheTimeOffsetThatIsSet) {
  std::vector<StampedPose> far;
  for (int i = 0; i < 5; ++i) far.push_back({poseAt(0.8 * i), i / 30.0});
  Recording recording(false, far);
  recording.known_offset_s = -0.024;
  EXPECT_THAT(refusedOf(recording), ElementsAre(1u, 2u, 3u, 4u));
  recording.setTimeOffset(-0.024);
  EXPECT_THAT(refusedOf(recording), IsEmpty());
  recording.is_broken = true;
  EXPECT_THAT(refusedOf(recording), ElementsAre(1u, 2u, 3u, 4u)) << "the frame itself says what is broken";
}

TEST(RecordingGuard, LimitsOfABagAreTheLiveNodes) {
  std::vector<StampedPose> far;
  for (int i = 0; i < 5; ++i) far.push_back({poseAt(0.8 * i), 100.0 + i / 30.0});
  EXPECT_THAT(refusedOf({true, far}), ElementsAre(1u, 2u, 3u, 4u));
}

TEST(RecordingGuard, LimitsGrowWithTheTimeBetweenFrames) {
  std::vector<StampedPose> poses;
  for (int i = 0; i < 6; ++i) poses.push_back({poseAt(1.0 * i), 100.0 + i});
  EXPECT_THAT(refusedOf({true, poses}), IsEmpty());
}

TEST(RecordingGuard, StampsOfABagMustRise) {
  std::vector<StampedPose> poses = motion(6, 6, 6, 0.0);
  poses[3].stamp_s = poses[2].stamp_s;
  SkipReason reason;
  EXPECT_THAT(refusedOf({true, poses}, PoseLimits{}, &reason), ElementsAre(3u));
  EXPECT_EQ(reason.kind, "time ran back");
  poses[3].stamp_s = 0.0;
  EXPECT_THAT(refusedOf({true, poses}, PoseLimits{}, &reason), ElementsAre(3u));
  EXPECT_EQ(reason.kind, "no stamp");
  EXPECT_THAT(refusedOf({false, poses}), IsEmpty()) << "a list may begin at 0";
}

TEST(RecordingGuard, AfterATimeThatRanBackPosesBeginAnew) {
  std::vector<StampedPose> poses = motion(12, 6, 12, 2.0);
  for (std::size_t i = 6; i < 12; ++i) poses[i].stamp_s -= 50.0;
  EXPECT_THAT(refusedOf({true, poses}), ElementsAre(6u));
}

TEST(RecordingGuard, RefusesFramesWithoutAMeasurement) {
  Recording covered(false, motion(2, 2, 2, 0.0));
  for (const float depth_m : {0.0f, std::nanf(""), -1.0f}) {
    covered.depth_m = depth_m;
    SkipReason reason;
    EXPECT_THAT(refusedOf(covered, PoseLimits{}, &reason), ElementsAre(0u, 1u));
    EXPECT_EQ(reason.kind, "nothing measured");
  }
  covered.depth_m = std::numeric_limits<float>::infinity();
  EXPECT_THAT(refusedOf(covered), IsEmpty());
}

}  // namespace
}  // namespace gpis_mapping
