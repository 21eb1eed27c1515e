// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/time_offset.h"

#include <cmath>
#include <functional>
#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <interactive_mapping_common/testing/temporary_folder.h>
#include "../support/depth_frames.h"

namespace gpis_mapping {
namespace {

using test_support::messageOf;
using testing::HasSubstr;

using Motion = std::function<Eigen::Isometry3d(double)>;

/// A handheld camera's: to and fro about all axes, in about the middle of the room.
Eigen::Isometry3d shaken(double t_s) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translate(Eigen::Vector3d(0.1 * std::sin(3.0 * t_s), 0.08 * std::sin(4.1 * t_s), 0.1 * std::cos(2.3 * t_s)));
  T.rotate(Eigen::AngleAxisd(0.2 * std::sin(4.3 * t_s), Eigen::Vector3d(0.3, 1.0, 0.2).normalized()));
  T.rotate(Eigen::AngleAxisd(0.15 * std::sin(3.1 * t_s + 1.0), Eigen::Vector3d::UnitX()));
  return T;
}

/// Images of the inside of a box, with noise. Their stamps are right when `offset_s` is added to them.
class Room : public DepthSequence {
 public:
  Room(Motion motion, double offset_s) : motion_(std::move(motion)), offset_s_(offset_s) {}

  std::size_t size() const override { return 200; }
  const CameraModel& camera() const override { return camera_; }
  std::optional<depth_camera::StampedPose> pose(std::size_t i, double time_offset_s, SkipReason*) override {
    return depth_camera::StampedPose{motion_(stamp(i) + time_offset_s), stamp(i)};
  }
  std::optional<DepthFrame> frame(std::size_t i, SkipReason* reason) override {
    std::mt19937 random(static_cast<unsigned>(i));
    std::normal_distribution<float> noise(0.0f, 0.003f);
    const Eigen::Isometry3d T = motion_(stamp(i) + offset_s_);
    DepthFrame frame{{camera_.width, camera_.height, {}}, pose(i, timeOffset(), reason)->T_map_camera, stamp(i), ""};
    for (int v = 0; v < camera_.height; ++v) {
      for (int u = 0; u < camera_.width; ++u) {
        const Eigen::Vector3d ray = T.linear() * camera_.ray(u, v);
        const Eigen::Vector3d wall(ray.x() > 0.0 ? 1.3 : -1.1, ray.y() > 0.0 ? 0.9 : -1.2, ray.z() > 0.0 ? 2.2 : -2.0);
        const double z = ((wall - T.translation()).array() / ray.array()).minCoeff();
        frame.image.depth_m.push_back(static_cast<float>(z) + noise(random));
      }
    }
    return frame;
  }
  bool hasPoseStamps() const override { return has_stamps; }

  bool has_stamps{true};

 private:
  double stamp(std::size_t i) const { return 100.0 + static_cast<double>(i) / 30.0; }

  CameraModel camera_{80, 60, 65.0, 65.0, 39.5, 29.5};
  Motion motion_;
  double offset_s_;
};

std::string refusalOf(DepthSequence* sequence) {
  return messageOf<DepthSequenceError>([&] { estimateTimeOffset(sequence, 0, sequence->size() - 1); });
}

TEST(TimeOffset, IsFoundFromImagePairs) {
  for (const double offset_s : {-0.024, 0.0, 0.0371, 0.15}) {
    Room room(shaken, offset_s);
    const TimeOffsetEstimate estimate = estimateTimeOffset(&room, 0, room.size() - 1);
    // 3 mm of noise and about 1 m/s: some hundred thousand differences leave far less than 1 ms of it; the rest is from
    // the pixels' size.
    EXPECT_NEAR(estimate.offset_s, offset_s, 0.001);
    EXPECT_LT(estimate.spread_s, 0.003);
    EXPECT_GE(estimate.num_parts, 3u);
    EXPECT_LT(estimate.residual_m, 0.006);
    if (offset_s != 0.0) {
      EXPECT_GT(estimate.residual_at_zero_m, 1.5 * estimate.residual_m);
    }
  }
}

TEST(TimeOffset, IsNotFoundWithoutAChangeOfVelocity) {
  Room at_rest([](double) { return Eigen::Isometry3d::Identity(); }, 0.024);
  EXPECT_THAT(refusalOf(&at_rest), HasSubstr("moves too little or too steadily: 0 of 8 parts"));
  // The relative pose of two images does not depend on the offset.
  Room steady([](double t_s) { return Eigen::Isometry3d(Eigen::AngleAxisd(0.5 * t_s, Eigen::Vector3d::UnitY())); },
              0.024);
  EXPECT_THAT(refusalOf(&steady), HasSubstr("moves too little or too steadily: 0 of 8 parts"));
}

TEST(TimeOffset, BeyondItsRangeIsNotFound) {
  Room room([](double t_s) { return shaken(0.5 * t_s); }, 0.4);  // slow: without a second way to fit
  EXPECT_THAT(refusalOf(&room), HasSubstr("time offset"));
}

TEST(TimeOffset, NeedsPosesWithStamps) {
  Room room(shaken, 0.0);
  room.has_stamps = false;
  EXPECT_THAT(refusalOf(&room), HasSubstr("no stamps of their own"));
  EXPECT_THAT(messageOf<DepthSequenceError>([&] { room.setTimeOffset(0.01); }), HasSubstr("poses have no stamps"));
  room.setTimeOffset(0.0);
}

TEST(TimeOffset, NeedsImagesThatExist) {
  Room room(shaken, 0.0);
  EXPECT_THROW(estimateTimeOffset(&room, 0, room.size()), std::out_of_range);
  EXPECT_THROW(estimateTimeOffset(&room, 5, 4), std::out_of_range);
}

}  // namespace
}  // namespace gpis_mapping
