// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/tag_detector.h"

#include <algorithm>
#include <cmath>
#include <iostream>
#include <limits>
#include <random>
#include <set>

#include <gmock/gmock.h>
#include <interactive_mapping_common/testing/temporary_folder.h>
#include <mp700_ur5e_description/brick_types.h>
#include <opencv2/aruco.hpp>
#include <opencv2/imgproc.hpp>

extern "C" {
#include <apriltag/apriltag.h>
#include <apriltag/tag16h5.h>
#include <apriltag/tag25h9.h>
#include <apriltag/tag36h10.h>
#include <apriltag/tag36h11.h>
#include <apriltag/tagCircle21h7.h>
#include <apriltag/tagCircle49h12.h>
#include <apriltag/tagCustom48h12.h>
#include <apriltag/tagStandard41h12.h>
#include <apriltag/tagStandard52h13.h>
}

#include "brick_detection/brick_pose.h"
#include "brick_detection/calibration_session.h"
#include "support/hard_negatives.h"
#include "support/tag_renderer.h"

namespace brick_detection {
namespace {

using mp700_ur5e_description::TagLayout;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr double kDegree = CV_PI / 180.0;

CameraModel vga() {
  return {640, 480, 525.0, 525.0, 319.5, 239.5, Distortion::kNone, {}};
}

TagDetectorConfig ofFamily(const std::string& family) {
  TagDetectorConfig config;
  config.family = family;
  return config;
}

/// A good camera: some noise, some blur.
RenderEffects realistic() {
  RenderEffects effects;
  effects.noise_std = 2.5;
  effects.blur_sigma_px = 0.5;
  return effects;
}

RenderScene boards(const std::string& family, const std::vector<std::pair<int, Eigen::Isometry3d>>& tags) {
  RenderScene scene;
  scene.camera = vga();
  scene.family = family;
  for (const auto& [id, T_camera_tag] : tags) {
    const double edge_m = 0.12 * TagLayout::blackCells(family) / TagLayout::outerCells(family);
    scene.bricks.push_back(tagBoard(id, edge_m, 0.17, T_camera_tag));
  }
  return scene;
}

Eigen::Isometry3d facing(double u, double v, double distance_m) {
  return poseSeenAt(vga(), {u, v}, distance_m, 0.0, 0.0, 0.0);
}

std::vector<int> idsOf(const std::vector<TagObservation>& tags) {
  std::vector<int> ids;
  for (const TagObservation& tag : tags) ids.push_back(tag.id);
  return ids;
}

/// Root mean square of the corners' distances [px].
double cornerError(const TagObservation& tag, const RenderedTag& truth) {
  double sum = 0.0;
  for (std::size_t i = 0; i < 4; ++i) sum += (tag.corners_px[i] - truth.corners_px[i]).squaredNorm();
  return std::sqrt(sum / 4.0);
}

/// Paints cells of a rendered tag in the other colour; rows and columns count data cells within the border.
void flipCell(const RenderedTag& tag, int border_cells, int row, int column, bool to_white, cv::Mat* grey) {
  const double half_m = 0.5 * tag.corner_edge_m;
  const double cell_m = tag.corner_edge_m / border_cells;
  std::vector<cv::Point> polygon;
  for (const auto& [dx, dy] : {std::pair(0.1, 0.1), {0.9, 0.1}, {0.9, 0.9}, {0.1, 0.9}}) {
    const Eigen::Vector3d p(-half_m + (column + dx) * cell_m, half_m - (row + dy) * cell_m, 0.0);
    const Eigen::Vector2d pixel = vga().project(tag.T_camera_tag * p);
    polygon.emplace_back(static_cast<int>(std::lround(pixel.x())), static_cast<int>(std::lround(pixel.y())));
  }
  cv::fillConvexPoly(*grey, polygon, cv::Scalar(to_white ? 220 : 20));
}

class EitherLibrary : public testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Families, EitherLibrary, testing::Values("tag36h11", "DICT_5X5_1000"));

TEST_P(EitherLibrary, CornersAreSubPixelAccurate) {
  const auto detector = makeTagDetector(ofFamily(GetParam()));
  std::mt19937 engine(3);
  const auto uniform = [&](double low, double high) { return low + (high - low) * engine() / 4294967296.0; };
  double sum_squares = 0.0;
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  int count = 0;
  for (const double distance_m : {0.5, 1.0, 1.5}) {
    for (const double tilt : {0.0, 20.0, 40.0, 60.0}) {
      for (int k = 0; k < 2; ++k) {
        const Eigen::Isometry3d T_camera_tag =
            poseSeenAt(vga(), {uniform(150.0, 490.0), uniform(120.0, 360.0)}, distance_m, tilt * kDegree,
                       uniform(0.0, 6.28), uniform(0.0, 6.28));
        const RenderedView view =
            render(boards(GetParam(), {{11, T_camera_tag}}), realistic(), static_cast<std::uint32_t>(count));
        const std::vector<TagObservation> tags = detector->detect(view.grey);
        ASSERT_THAT(idsOf(tags), ElementsAre(11)) << distance_m << " m, " << tilt << " degrees";
        EXPECT_EQ(tags[0].hamming, 0);
        // Seen over 600 such tags: 95 % below 0.06 px, all below 0.12 px.
        EXPECT_LT(cornerError(tags[0], view.tags[0]), 0.15) << distance_m << " m, " << tilt << " degrees";
        sum_squares += std::pow(cornerError(tags[0], view.tags[0]), 2);
        for (std::size_t i = 0; i < 4; ++i) mean += tags[0].corners_px[i] - view.tags[0].corners_px[i];
        ++count;
      }
    }
  }
  // libapriltag alone: 0.08 px.
  EXPECT_LT(std::sqrt(sum_squares / count), 0.05);
  // Pixel centres at integers: a slip by half a pixel would show here first.
  EXPECT_LT((mean / (4.0 * count)).norm(), 0.01);
}

TEST_P(EitherLibrary, CornersStayAccurateUnderBadLight) {
  const auto detector = makeTagDetector(ofFamily(GetParam()));
  struct Case {
    const char* name;
    double limit_px;  // twice what is seen
    RenderEffects effects;
  };
  RenderEffects dark = realistic();
  dark.exposure = 0.15;
  RenderEffects blurred = realistic();
  blurred.blur_sigma_px = 1.2;
  RenderEffects noisy = realistic();
  noisy.noise_std = 10.0;
  RenderEffects sidelit = realistic();
  sidelit.light_gradient = {1.6, 0.6};
  RenderEffects hazy = realistic();
  hazy.contrast = 0.3;
  for (const Case& c : {Case{"dark", 0.3, dark}, Case{"blurred", 0.1, blurred}, Case{"noisy", 0.2, noisy},
                        Case{"light from the side", 0.08, sidelit}, Case{"hazy", 0.2, hazy}}) {
    const RenderedView view = render(
        boards(GetParam(), {{3, poseSeenAt(vga(), {250.0, 260.0}, 1.0, 35.0 * kDegree, 0.7, 0.4)}}), c.effects, 9);
    const std::vector<TagObservation> tags = detector->detect(view.grey);
    ASSERT_THAT(idsOf(tags), ElementsAre(3)) << c.name;
    EXPECT_LT(cornerError(tags[0], view.tags[0]), c.limit_px) << c.name;
  }
}

TEST_P(EitherLibrary, EveryBrickThatCarriesAnIdIsReported) {
  const auto detector = makeTagDetector(ofFamily(GetParam()));
  // 21 px from border to border: the plates touch.
  const RenderedView view =
      render(boards(GetParam(),
                    {{40, facing(200.0, 240.0, 1.0)}, {40, facing(290.0, 240.0, 1.0)}, {5, facing(450.0, 300.0, 0.9)}}),
             realistic(), 4);
  const std::vector<TagObservation> tags = detector->detect(view.grey);
  ASSERT_THAT(idsOf(tags), ElementsAre(5, 40, 40));
  EXPECT_LT(tags[1].corners_px[0].x(), tags[2].corners_px[0].x());
  EXPECT_LT(cornerError(tags[1], view.tags[0]), 0.1);
  EXPECT_LT(cornerError(tags[2], view.tags[1]), 0.1);
}

TEST_P(EitherLibrary, HiddenTagsAreNotInvented) {
  const auto detector = makeTagDetector(ofFamily(GetParam()));
  const double distance_m = 0.7;
  int num_hidden = 0;
  for (double shift_px = -60.0; shift_px <= 60.0; shift_px += 12.0) {
    RenderScene scene = boards(GetParam(), {{21, facing(320.0, 240.0, distance_m)}});
    RenderBox bar;
    bar.size_m = {0.3, 0.03, 0.01};
    bar.T_camera_box = Eigen::Isometry3d::Identity();
    bar.T_camera_box.translation() = 0.6 * vga().bearing({320.0 + shift_px, 240.0 + 0.7 * shift_px}).homogeneous();
    bar.T_camera_box.rotate(Eigen::AngleAxisd(0.4, Eigen::Vector3d::UnitZ()));
    scene.boxes = {bar};
    const RenderedView view = render(scene, realistic(), 7);
    if (view.tags[0].visible_share < 0.9) ++num_hidden;
    for (const TagObservation& tag : detector->detect(view.grey)) {
      EXPECT_EQ(tag.id, 21) << shift_px;
      EXPECT_GT(view.tags[0].visible_share, 0.85) << shift_px;
      EXPECT_LT(cornerError(tag, view.tags[0]), 0.5) << shift_px;
    }
  }
  EXPECT_GT(num_hidden, 5);
}

TEST_P(EitherLibrary, PartOfAnImageIsAnImage) {
  const auto detector = makeTagDetector(ofFamily(GetParam()));
  const cv::Mat grey = render(boards(GetParam(), {{12, facing(300.0, 200.0, 1.0)}}), realistic(), 2).grey;
  const cv::Mat kept = grey.clone();
  const cv::Rect roi(231, 133, 143, 141);  // odd, and no multiple of the library's tiles
  const std::vector<TagObservation> inside = detector->detect(grey(roi));
  const std::vector<TagObservation> copied = detector->detect(grey(roi).clone());
  const std::vector<TagObservation> whole = detector->detect(grey);
  ASSERT_THAT(idsOf(inside), ElementsAre(12));
  ASSERT_THAT(idsOf(copied), ElementsAre(12));
  ASSERT_THAT(idsOf(whole), ElementsAre(12));
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_EQ(inside[0].corners_px[i], copied[0].corners_px[i]);
    // The final lines are measured in the same pixels; only their start differs.
    EXPECT_LT((inside[0].corners_px[i] + Eigen::Vector2d(roi.x, roi.y) - whole[0].corners_px[i]).norm(), 0.02);
  }
  EXPECT_EQ(cv::norm(grey, kept), 0.0) << "the image was written to";
}

TEST_P(EitherLibrary, TinyAndPlainImagesHoldNothing) {
  const auto detector = makeTagDetector(ofFamily(GetParam()));
  for (const cv::Size& size : {cv::Size(1, 1), cv::Size(3, 200), cv::Size(200, 3), cv::Size(15, 15), cv::Size(17, 16),
                               cv::Size(33, 21), cv::Size(640, 480)}) {
    EXPECT_THAT(detector->detect(cv::Mat(size, CV_8UC1, cv::Scalar(0))), IsEmpty()) << size;
    EXPECT_THAT(detector->detect(cv::Mat(size, CV_8UC1, cv::Scalar(255))), IsEmpty()) << size;
    cv::Mat noise(size, CV_8UC1);
    cv::RNG(5).fill(noise, cv::RNG::UNIFORM, 0, 256);
    EXPECT_THAT(detector->detect(noise), IsEmpty()) << size;
  }
}

TEST_P(EitherLibrary, RefusesImagesThatAreNotGrey) {
  const auto detector = makeTagDetector(ofFamily(GetParam()));
  EXPECT_THROW(detector->detect(cv::Mat()), std::invalid_argument);
  EXPECT_THROW(detector->detect(cv::Mat(480, 640, CV_8UC3)), std::invalid_argument);
  EXPECT_THROW(detector->detect(cv::Mat(480, 640, CV_16UC1)), std::invalid_argument);
}

class EveryFamily : public testing::TestWithParam<std::string> {};
std::vector<std::string> decodable() {
  std::vector<std::string> families = TagLayout::families();
  families.erase(std::remove(families.begin(), families.end(), "ALVAR_5X5"), families.end());
  return families;
}
INSTANTIATE_TEST_SUITE_P(Families, EveryFamily, testing::ValuesIn(decodable()));

TEST_P(EveryFamily, IsDrawnAndDecoded) {
  const auto detector = makeTagDetector(ofFamily(GetParam()));
  const int last = TagLayout::numIds(GetParam()) - 1;
  const RenderedView view =
      render(boards(GetParam(), {{0, poseSeenAt(vga(), {130.0, 240.0}, 0.6, 0.3, 1.0, 0.0)},
                                 {last / 2, poseSeenAt(vga(), {320.0, 240.0}, 0.6, 0.3, 3.0, 2.0)},
                                 {last, poseSeenAt(vga(), {510.0, 240.0}, 0.6, 0.3, 5.0, 4.0)}}),
             realistic(), 1);
  const std::vector<TagObservation> tags = detector->detect(view.grey);
  ASSERT_THAT(idsOf(tags), ElementsAre(0, last / 2, last));
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_LT(cornerError(tags[i], view.tags[i]), 0.15) << "order or place of the corners of " << tags[i].id;
    EXPECT_EQ(tags[i].hamming, 0);
    EXPECT_GT(tags[i].margin, 50.0);
  }
}

TEST_P(EveryFamily, IsSeenAtItsDistance) {
  constexpr double kBlackBorder_m = 0.12;
  const Eigen::Isometry3d T_camera_tag = poseSeenAt(vga(), {300.0, 250.0}, 0.8, 0.5, 1.0, 0.3);
  RenderScene scene;
  scene.camera = vga();
  scene.family = GetParam();
  scene.bricks = {tagBoard(1, kBlackBorder_m, 0.3, T_camera_tag)};
  const RenderedView view = render(scene, realistic(), 3);
  const std::vector<TagObservation> tags = makeTagDetector(ofFamily(GetParam()))->detect(view.grey);
  ASSERT_THAT(idsOf(tags), ElementsAre(1));
  const BrickPoseEstimator estimator(loneTag(GetParam(), 1, kBlackBorder_m), {});
  const auto result = estimator.estimate(tags, vga(), cv::Mat(), view.grey);
  ASSERT_EQ(result.bricks.size(), 1U) << toString(result.tags[0].status);
  // 0.1 px of 50 are 2 mm; another edge would be 30 cm.
  EXPECT_LT((result.bricks[0].T_camera_brick.translation() - T_camera_tag.translation()).norm(), 0.006);
}

TEST(TagFamilies, OpenCVPrintsAprilTagsTurnedByHalfATurn) {
  const auto dictionary = cv::aruco::getPredefinedDictionary(cv::aruco::DICT_APRILTAG_36h11);
  cv::Mat marker;
  dictionary->drawMarker(5, 80, marker, 1);
  cv::Mat grey(160, 200, CV_8UC1, cv::Scalar(255));
  marker.copyTo(grey(cv::Rect(60, 40, 80, 80)));
  const std::vector<TagObservation> tags = makeTagDetector({})->detect(grey);
  ASSERT_THAT(idsOf(tags), ElementsAre(5));
  // What is the top left corner of the upright tag is at the bottom right.
  EXPECT_LT((tags[0].corners_px[0] - Eigen::Vector2d(139.5, 119.5)).norm(), 0.5);
}

TEST(TagFamilies, TableOfTheCatalogueIsThatOfTheLibraries) {
  struct Functions {
    apriltag_family_t* (*create)();
    void (*destroy)(apriltag_family_t*);
  };
  const std::map<std::string, Functions> april_tags = {
      {"tag16h5", {tag16h5_create, tag16h5_destroy}},
      {"tag25h9", {tag25h9_create, tag25h9_destroy}},
      {"tag36h10", {tag36h10_create, tag36h10_destroy}},
      {"tag36h11", {tag36h11_create, tag36h11_destroy}},
      {"tagCircle21h7", {tagCircle21h7_create, tagCircle21h7_destroy}},
      {"tagCircle49h12", {tagCircle49h12_create, tagCircle49h12_destroy}},
      {"tagCustom48h12", {tagCustom48h12_create, tagCustom48h12_destroy}},
      {"tagStandard41h12", {tagStandard41h12_create, tagStandard41h12_destroy}},
      {"tagStandard52h13", {tagStandard52h13_create, tagStandard52h13_destroy}}};
  for (const auto& [name, functions] : april_tags) {
    apriltag_family_t* family = functions.create();
    EXPECT_EQ(TagLayout::numIds(name), static_cast<int>(family->ncodes)) << name;
    EXPECT_EQ(TagLayout::borderCells(name), family->width_at_border) << name;
    // Corners are where black meets white: outside the black border, or inside it.
    EXPECT_EQ(TagLayout::blackCells(name), family->width_at_border + (family->reversed_border ? 2 : 0)) << name;
    // Those with a black border count the white ring round it; the catalogue calls that margin.
    EXPECT_EQ(TagLayout::outerCells(name), family->reversed_border ? family->total_width : family->width_at_border)
        << name;
    functions.destroy(family);
  }
  const std::map<std::string, int> dictionaries = {{"DICT_4X4_1000", cv::aruco::DICT_4X4_1000},
                                                   {"DICT_5X5_1000", cv::aruco::DICT_5X5_1000},
                                                   {"DICT_6X6_1000", cv::aruco::DICT_6X6_1000}};
  for (const auto& [name, id] : dictionaries) {
    const auto dictionary = cv::aruco::getPredefinedDictionary(id);
    EXPECT_EQ(TagLayout::numIds(name), dictionary->bytesList.rows) << name;
    EXPECT_EQ(TagLayout::borderCells(name), dictionary->markerSize + 2) << name;
    EXPECT_EQ(TagLayout::blackCells(name), dictionary->markerSize + 2) << name;
    EXPECT_EQ(TagLayout::outerCells(name), dictionary->markerSize + 2) << name;
  }
  EXPECT_EQ(april_tags.size() + dictionaries.size() + 1, TagLayout::families().size());
}

/// What is found of a tag of which some data cells were painted over, by the number of cells.
struct Flipped {
  std::vector<int> ids;
  int hamming{-1};
};
Flipped detectFlipped(const TagDetectorConfig& config, int num_flips) {
  const RenderedView view = render(boards(config.family, {{17, facing(320.0, 240.0, 0.5)}}), {}, 1);
  cv::Mat grey = view.grey.clone();
  const cv::Mat cells = tagCells(config.family, 17);
  const int offset = (TagLayout::outerCells(config.family) - TagLayout::borderCells(config.family)) / 2;
  // Cells within the border hold data in all families, beyond its own ring.
  for (int i = 0; i < num_flips; ++i) {
    const int row = 2;
    const int column = 2 + i;
    const bool is_white = cells.at<std::uint8_t>(row + offset, column + offset) != 0;
    flipCell(view.tags[0], TagLayout::borderCells(config.family), row, column, !is_white, &grey);
  }
  const std::vector<TagObservation> tags = makeTagDetector(config)->detect(grey);
  return {idsOf(tags), tags.empty() ? -1 : tags[0].hamming};
}

TEST(TagDetector, LargeArucoTagsAreNotMistakenForTheirPaper) {
  const auto detector = makeTagDetector(ofFamily("DICT_6X6_1000"));
  for (int k = 0; k < 12; ++k) {
    const Eigen::Isometry3d T_camera_tag =
        poseSeenAt(vga(), {320.0 + k, 240.0}, k % 2 ? 0.5 : 1.0, 0.1 * (k % 3), k, 0.0);
    const cv::Mat grey = render(boards("DICT_6X6_1000", {{17 * k, T_camera_tag}}), realistic(), 1).grey;
    EXPECT_THAT(idsOf(detector->detect(grey)), ElementsAre(17 * k));
  }
}

TEST(TagDetector, CorrectsAsManyBitsAsAllowed) {
  for (const std::string family : {"tag36h11", "DICT_6X6_1000"}) {
    TagDetectorConfig config = ofFamily(family);
    for (int allowed = 0; allowed <= 2; ++allowed) {
      config.max_hamming = allowed;
      for (int flips = 0; flips <= 3; ++flips) {
        const Flipped found = detectFlipped(config, flips);
        if (flips <= allowed) {
          EXPECT_THAT(found.ids, ElementsAre(17)) << family << ", " << flips << " of " << allowed;
          EXPECT_EQ(found.hamming, flips) << family;
        } else {
          EXPECT_THAT(found.ids, IsEmpty()) << family << ", " << flips << " of " << allowed;
        }
      }
    }
  }
}

TEST(TagDetector, FamiliesOfManyCodesCorrectOneBit) {
  const TagDetectorConfig config = ofFamily("tagStandard52h13");
  ASSERT_EQ(config.max_hamming, 2);
  EXPECT_EQ(detectFlipped(config, 1).hamming, 1);
  EXPECT_THAT(detectFlipped(config, 2).ids, IsEmpty());
}

TEST(TagDetector, FindsSmallTagsAndTagsInTheDark) {
  const auto detector = makeTagDetector({});
  std::vector<std::pair<int, Eigen::Isometry3d>> tags;
  for (int i = 0; i < 12; ++i) {
    tags.emplace_back(i,
                      poseSeenAt(vga(), {80.0 + 160.0 * (i % 4), 80.0 + 160.0 * (i / 4)}, 4.5, 0.2, 0.5 * i, 0.7 * i));
  }
  // 14 px.
  EXPECT_EQ(detector->detect(render(boards("tag36h11", tags), realistic(), 3).grey).size(), 12U);
  for (auto& [id, T_camera_tag] : tags) T_camera_tag.translation() *= 1.5 / 4.5;
  RenderEffects dark = realistic();
  dark.exposure = 0.1;  // black to white are 22 grey levels
  EXPECT_EQ(detector->detect(render(boards("tag36h11", tags), dark, 3).grey).size(), 12U);
}

/// How many of twelve boards are found: by the shortest side, the lens' blur and the noise.
class BlurSweep {
 public:
  static constexpr int kNumTags = 12;

  BlurSweep(double side_px, double lens_px, double noise_std) {
    constexpr double kEdge_m = 0.12;
    std::vector<std::pair<int, Eigen::Isometry3d>> tags;
    for (int i = 0; i < kNumTags; ++i) {
      // Places between pixels, tilts and rolls of all kinds.
      const Eigen::Vector2d pixel(80.37 + 160.21 * (i % 4), 80.61 + 159.83 * (i / 4));
      const double distance_m = kEdge_m * vga().fx_px / side_px;
      tags.emplace_back(i, poseSeenAt(vga(), pixel, distance_m, 0.04 * i, 0.5 * i, 0.7 * i));
    }
    RenderEffects effects;
    effects.blur_sigma_px = lens_px;
    effects.noise_std = noise_std;
    grey_ = render(boards("tag36h11", tags), effects, static_cast<std::uint32_t>(10.0 * side_px)).grey;
  }

  int numFound(double blur_sigma_px) const {
    TagDetectorConfig config;
    config.blur_sigma_px = blur_sigma_px;
    const std::vector<TagObservation> tags = makeTagDetector(config)->detect(grey_);
    // With as many corrected bits as a tag may have that is used.
    return static_cast<int>(std::count_if(tags.begin(), tags.end(), [](const auto& tag) { return tag.hamming <= 1; }));
  }

 private:
  cv::Mat grey_;
};

// Prints the table of docs/poses.md: ctest -R test_tag_detector -V.
TEST(TagDetector, NoBlurFindsMoreThanTheDefault) {
  constexpr std::size_t kDefault = 1;
  const std::array<double, 5> blurs = {0.0, TagDetectorConfig().blur_sigma_px, 0.45, 0.6, 0.8};
  std::array<int, 5> found{};
  int num_tags = 0;
  std::cout << "side px, lens px, noise: found of 12 at blur_sigma_px 0, default, 0.45, 0.6, 0.8\n";
  for (const double side_px : {13.0, 15.0, 18.0, 25.0, 40.0}) {
    for (const double lens_px : {0.3, 0.5, 0.8, 1.0}) {
      for (const double noise_std : {1.0, 4.0, 8.0}) {
        const BlurSweep sweep(side_px, lens_px, noise_std);
        num_tags += BlurSweep::kNumTags;
        std::cout << side_px << " " << lens_px << " " << noise_std << ":";
        int of_default = 0;
        for (std::size_t i = 0; i < blurs.size(); ++i) {
          const int count = sweep.numFound(blurs[i]);
          if (i == kDefault) of_default = count;
          found[i] += count;
          std::cout << " " << count;
        }
        std::cout << "\n";
        // The reach that docs/poses.md names.
        if (side_px >= 25.0 || (side_px >= 18.0 && noise_std <= 4.0) || (side_px >= 15.0 && lens_px <= 0.8)) {
          EXPECT_EQ(of_default, BlurSweep::kNumTags) << side_px << " px, " << lens_px << " px, " << noise_std;
        }
      }
    }
  }
  std::cout << "all " << num_tags << ":";
  for (const int count : found) std::cout << " " << count;
  std::cout << "\n";
  // Half a percent: a tag more or less is chance.
  EXPECT_GE(found[kDefault], *std::max_element(found.begin(), found.end()) - num_tags / 200);
}

TEST(TagDetector, NoiseDoesNotHideTags) {
  RenderEffects noisy;
  noisy.blur_sigma_px = 0.5;
  const auto detector = makeTagDetector({});
  for (const double noise_std : {0.0, 5.0, 15.0, 25.0}) {
    noisy.noise_std = noise_std;
    EXPECT_THAT(idsOf(detector->detect(render(boards("tag36h11", {{9, facing(300.0, 200.0, 1.2)}}), noisy, 2).grey)),
                ElementsAre(9))
        << noise_std;
  }
}

TEST(TagDetector, OptionsOfTheSearchLeaveTheCorners) {
  const RenderedView view =
      render(boards("tag36h11", {{8, poseSeenAt(vga(), {300.0, 200.0}, 0.8, 0.5, 1.0, 1.0)}}), realistic(), 2);
  const std::vector<TagObservation> plain = makeTagDetector({})->detect(view.grey);
  ASSERT_THAT(idsOf(plain), ElementsAre(8));
  TagDetectorConfig decimated;
  decimated.decimate = 2.0;
  TagDetectorConfig blurred;
  blurred.blur_sigma_px = 1.5;
  TagDetectorConfig parallel;
  parallel.threads = 3;
  for (const TagDetectorConfig& config : {decimated, blurred, parallel}) {
    const std::vector<TagObservation> tags = makeTagDetector(config)->detect(view.grey);
    ASSERT_THAT(idsOf(tags), ElementsAre(8));
    for (std::size_t i = 0; i < 4; ++i) EXPECT_LT((tags[0].corners_px[i] - plain[0].corners_px[i]).norm(), 0.02);
  }
}

TEST(TagDetector, FindsNothingWhereThereIsNothing) {
  // Of 36 bits and 587 codes one random square in 40000 passes with two errors, of DICT_6X6_1000 one in 25000; what is
  // here are 84 squares, and 6 images of everything else.
  for (const std::string family : {"tag36h11", "DICT_6X6_1000"}) {
    const auto detector = makeTagDetector(ofFamily(family));
    for (int kind = 0; kind < kNumHardNegatives; ++kind) {
      for (std::uint32_t seed = 0; seed < 7; ++seed) {
        EXPECT_THAT(idsOf(detector->detect(hardNegative(static_cast<HardNegative>(kind), seed))), IsEmpty())
            << family << ", kind " << kind << ", seed " << seed;
      }
    }
  }
}

TEST(TagDetectorConfig, RefusesWhatCannotBe) {
  const auto refusalOf = [](void (*spoil)(TagDetectorConfig*)) {
    TagDetectorConfig config;
    spoil(&config);
    return test_support::messageOf<std::invalid_argument>([&config] { makeTagDetector(config); });
  };
  EXPECT_THAT(interactive_mapping::problemsOf(TagDetectorConfig()), IsEmpty());
  EXPECT_THAT(refusalOf([](TagDetectorConfig* c) { c->family = "tag36h12"; }),
              HasSubstr("family = tag36h12, must be one of: tag36h11, "));
  EXPECT_THAT(
      refusalOf([](TagDetectorConfig* c) { c->family = "ALVAR_5X5"; }),
      testing::AllOf(HasSubstr("family = ALVAR_5X5, must be "), HasSubstr("ar_track_alvar"), HasSubstr("alvar input")));
  EXPECT_THAT(refusalOf([](TagDetectorConfig* c) {
                c->threads = 0;
                c->blur_sigma_px = -0.5;
                c->sharpening = std::numeric_limits<double>::quiet_NaN();
                c->max_hamming = 3;
              }),
              testing::AllOf(HasSubstr("threads = 0, must be in [1, 64]"),
                             HasSubstr("blur_sigma_px = -0.5 px, must be in [0, 10] px"),
                             HasSubstr("sharpening = nan, must be in [0, 10]"),
                             HasSubstr("max_hamming = 3, must be in [0, 2]")));
}

TEST(TagDetectorConfig, DecimatesByWhatLibapriltagKnows) {
  TagDetectorConfig config;
  config.decimate = 1.5;
  EXPECT_THAT(interactive_mapping::problemsOf(config), IsEmpty());
  config.decimate = 2.5;
  EXPECT_THAT(interactive_mapping::problemsOf(config), ElementsAre("decimate = 2.500000, must be 1, 1.5, 2, 3 or 4"));
  config.decimate = 5.0;
  EXPECT_THAT(interactive_mapping::problemsOf(config), ElementsAre("decimate = 5, must be in [1, 4]"));
}

TEST(TagObservation, ShortestSideIsTheShortestOfFour) {
  TagObservation tag;
  tag.corners_px = {Eigen::Vector2d(0.0, 0.0), {10.0, 0.0}, {10.0, 7.0}, {0.0, 5.0}};
  EXPECT_DOUBLE_EQ(tag.shortestSide(), 5.0);
  tag.corners_px = {Eigen::Vector2d(0.0, 0.0), {3.0, 0.0}, {10.0, 7.0}, {0.0, 5.0}};
  EXPECT_DOUBLE_EQ(tag.shortestSide(), 3.0);
}

}  // namespace
}  // namespace brick_detection
