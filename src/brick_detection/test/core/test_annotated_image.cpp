// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/annotated_image.h"

#include <limits>

#include <Eigen/Geometry>
#include <gmock/gmock.h>

#include "support/tag_renderer.h"

namespace brick_detection {
namespace {

CameraModel vga() {
  return {640, 480, 525.0, 525.0, 319.5, 239.5, Distortion::kNone, {}};
}

mp700_ur5e_description::BrickCatalogue catalogue() {
  return mp700_ur5e_description::loadBrickTypes(BRICKS_YAML);
}

BrickSighting brickAt(const Eigen::Isometry3d& T_camera_brick) {
  BrickSighting brick;
  brick.brick_id = 3;
  brick.T_camera_brick = T_camera_brick;
  return brick;
}

TagSighting tagAt(double u, double v, TagStatus status) {
  TagSighting tag;
  tag.tag.id = 18;
  tag.tag.corners_px = {
      Eigen::Vector2d(u - 20.0, v - 20.0), {u + 20.0, v - 20.0}, {u + 20.0, v + 20.0}, {u - 20.0, v + 20.0}};
  tag.status = status;
  return tag;
}

/// Share of pixels that are no longer those of `before`, within a rectangle.
double changed(const cv::Mat& before, const cv::Mat& after, const cv::Rect& rect) {
  cv::Mat difference;
  cv::absdiff(before(rect), after(rect), difference);
  cv::Mat any;
  cv::reduce(difference.reshape(1, static_cast<int>(difference.total())), any, 1, cv::REDUCE_MAX);
  return static_cast<double>(cv::countNonZero(any)) / rect.area();
}

TEST(AnnotatedImage, KeepsTheImageAndItsSize) {
  const cv::Mat color(480, 640, CV_8UC3, cv::Scalar(90, 100, 110));
  const cv::Mat kept = color.clone();
  const cv::Mat drawn = drawDetections(color, vga(), {}, catalogue());
  EXPECT_EQ(drawn.type(), CV_8UC3);
  EXPECT_EQ(cv::norm(drawn, kept), 0.0) << "nothing was found: nothing is drawn";
  BrickPoseEstimator::Result result;
  result.bricks = {brickAt(poseSeenAt(vga(), {320.0, 240.0}, 1.0, 0.5, 0.3, 0.2))};
  const cv::Mat marked = drawDetections(color, vga(), result, catalogue());
  EXPECT_EQ(marked.size(), color.size());
  EXPECT_GT(changed(color, marked, {0, 0, 640, 480}), 0.005);
  EXPECT_EQ(cv::norm(color, kept), 0.0) << "the input was written to";
}

TEST(AnnotatedImage, GreyBecomesColour) {
  const cv::Mat grey(480, 640, CV_8UC1, cv::Scalar(100));
  const cv::Mat drawn = drawDetections(grey, vga(), {}, catalogue());
  EXPECT_EQ(drawn.type(), CV_8UC3);
  EXPECT_EQ(drawn.at<cv::Vec3b>(10, 10), cv::Vec3b(100, 100, 100));
}

TEST(AnnotatedImage, OutlinesLieOnTheirBricks) {
  const cv::Mat color(480, 640, CV_8UC3, cv::Scalar(0, 0, 0));
  BrickPoseEstimator::Result result;
  result.bricks = {brickAt(poseSeenAt(vga(), {320.0, 240.0}, 1.0, 0.0, 0.0, 0.0))};
  const cv::Mat drawn = drawDetections(color, vga(), result, catalogue());
  // 0.3 x 0.2 m, its upper face 0.9 m away: 175 x 116.7 px.
  EXPECT_GT(changed(color, drawn, {228, 200, 8, 80}), 0.1) << "left edge, at 232";
  EXPECT_GT(changed(color, drawn, {280, 177, 80, 8}), 0.1) << "upper edge, at 181";
  EXPECT_EQ(changed(color, drawn, {0, 0, 640, 160}), 0.0) << "the tip of the axis y is at 166";
  EXPECT_EQ(changed(color, drawn, {0, 0, 220, 480}), 0.0);
}

TEST(AnnotatedImage, UsedTagsAreGreenAndOthersRed) {
  const cv::Mat color(480, 640, CV_8UC3, cv::Scalar(0, 0, 0));
  for (const TagStatus status : {TagStatus::kUsed, TagStatus::kAmbiguous}) {
    BrickPoseEstimator::Result result;
    result.tags = {tagAt(200.0, 200.0, status)};
    const cv::Vec3b pixel = drawDetections(color, vga(), result, catalogue()).at<cv::Vec3b>(200, 180);
    EXPECT_EQ(pixel[1] > 150, status == TagStatus::kUsed);
    EXPECT_EQ(pixel[2] > 150, status != TagStatus::kUsed);
  }
}

TEST(AnnotatedImage, DrawsWhatIsPartlyBehindOrOutside) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  CameraModel bent = vga();
  bent.distortion = Distortion::kPlumbBob;
  bent.coefficients = {-0.28, 0.0, 0.0, 0.0};
  const cv::Mat color(480, 640, CV_8UC3, cv::Scalar(0, 0, 0));
  for (const CameraModel& camera : {vga(), bent}) {
    BrickPoseEstimator::Result result;
    for (const double z_m : {-2.0, -0.1, 0.0, 0.05, 0.2}) {
      for (const double x_m : {-1.0, 0.0, 0.05, 30.0}) {
        Eigen::Isometry3d T_camera_brick = Eigen::Isometry3d::Identity();
        T_camera_brick.translation() = Eigen::Vector3d(x_m, 0.02, z_m);
        result.bricks.push_back(brickAt(T_camera_brick));
      }
    }
    result.bricks.push_back(brickAt(Eigen::Isometry3d(Eigen::Translation3d(nan, 0.0, 1.0))));
    result.tags = {tagAt(0.0, 0.0, TagStatus::kTooSmall), tagAt(639.0, 479.0, TagStatus::kUnsure),
                   tagAt(nan, 5.0, TagStatus::kUnsure), tagAt(-9000.0, 100.0, TagStatus::kInconsistent)};
    const cv::Mat drawn = drawDetections(color, camera, result, catalogue());
    EXPECT_EQ(drawn.size(), color.size());
    // On a thumbnail labels are larger than the image.
    EXPECT_NO_THROW(drawDetections(color(cv::Rect(0, 0, 20, 10)), camera, result, catalogue()));
  }
}

TEST(AnnotatedImage, RefusesOtherImages) {
  EXPECT_THROW(drawDetections({}, vga(), {}, catalogue()), std::invalid_argument);
  EXPECT_THROW(drawDetections(cv::Mat(480, 640, CV_16UC1), vga(), {}, catalogue()), std::invalid_argument);
}

}  // namespace
}  // namespace brick_detection
