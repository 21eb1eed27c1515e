// SPDX-License-Identifier: BSD-3-Clause
#include "system_diagnostics/image_shift.h"

#include <cmath>
#include <random>
#include <stdexcept>

#include <gmock/gmock.h>

namespace system_diagnostics {
namespace {

/// Sum of waves, known at every place: no interpolation between what is seen before and after a shift.
cv::Mat texture(double shift_x_px, double shift_y_px, int width_px = 160, int height_px = 120, unsigned seed = 1) {
  std::mt19937 engine(seed);
  std::uniform_real_distribution<double> wave(-0.9, 0.9), phase(0.0, 2.0 * M_PI);
  struct Wave {
    double x, y, phase;
  };
  std::vector<Wave> waves;
  for (int i = 0; i < 40; ++i) waves.push_back({wave(engine), wave(engine), phase(engine)});
  cv::Mat image(height_px, width_px, CV_8UC1);
  for (int row = 0; row < height_px; ++row) {
    for (int column = 0; column < width_px; ++column) {
      double value = 0.0;
      for (const Wave& w : waves) value += std::cos(w.x * (column - shift_x_px) + w.y * (row - shift_y_px) + w.phase);
      image.at<unsigned char>(row, column) = static_cast<unsigned char>(std::lround(128.0 + 8.0 * value));
    }
  }
  return image;
}

TEST(ImageShiftMeter, FindsShiftsOfWhatIsSeenToAFractionOfAPixel) {
  for (const auto& [x_px, y_px] :
       std::vector<std::pair<double, double>>{{0.0, 0.0}, {3.0, 0.0}, {-3.0, 2.0}, {7.4, -1.6}, {0.5, 0.25}}) {
    ImageShiftMeter meter({});
    EXPECT_FALSE(meter.add(texture(0.0, 0.0)).has_value());
    const auto shift = meter.add(texture(x_px, y_px));
    ASSERT_TRUE(shift.has_value());
    // Between two pixels OpenCV's centroid of 5 x 5 of them is drawn aside, by up to 0.21 px here; 0.25 px is 2 mrad of 160 px.
    EXPECT_NEAR(shift->x_px, x_px, 0.25);
    EXPECT_NEAR(shift->y_px, y_px, 0.25);
  }
}

TEST(ImageShiftMeter, LargeImagesAreMeasuredSmall) {
  ImageShiftMeter meter({});
  cv::Mat large(480, 640, CV_8UC1), moved(480, 640, CV_8UC1);
  const cv::Mat before = texture(0.0, 0.0, 160, 120), after = texture(5.0, 0.0, 160, 120);
  for (int row = 0; row < 480; ++row) {
    for (int column = 0; column < 640; ++column) {
      large.at<unsigned char>(row, column) = before.at<unsigned char>(row / 4, column / 4);
      moved.at<unsigned char>(row, column) = after.at<unsigned char>(row / 4, column / 4);
    }
  }
  meter.add(large);
  const auto shift = meter.add(moved);
  ASSERT_TRUE(shift.has_value());
  EXPECT_NEAR(shift->x_px, 5.0, 0.15);  // whole pixels: no centroid to be drawn aside
}

TEST(ImageShiftMeter, ImagesThatHaveNothingInCommonGiveNoShift) {
  ImageShiftMeter meter({});
  meter.add(texture(0.0, 0.0));
  EXPECT_FALSE(meter.add(texture(0.0, 0.0, 160, 120, 2)).has_value());
  // And from there the next is measured.
  EXPECT_TRUE(meter.add(texture(1.0, 0.0, 160, 120, 2)).has_value());
}

TEST(ImageShiftMeter, WithoutTextureThereIsNoShift) {
  ImageShiftMeter meter({});
  const cv::Mat grey(120, 160, CV_8UC1, cv::Scalar(90));
  meter.add(grey);
  EXPECT_FALSE(meter.add(grey).has_value());
}

TEST(ImageShiftMeter, AnotherSizeBeginsAnew) {
  ImageShiftMeter meter({});
  meter.add(texture(0.0, 0.0));
  EXPECT_FALSE(meter.add(texture(0.0, 0.0, 160, 90)).has_value());
  EXPECT_TRUE(meter.add(texture(1.0, 0.0, 160, 90)).has_value());
  meter.clear();
  EXPECT_FALSE(meter.add(texture(0.0, 0.0, 160, 90)).has_value());
}

TEST(ImageShiftMeter, WrongImagesAndLimitsAreRefused) {
  ImageShiftMeter meter({});
  EXPECT_THROW(meter.add(cv::Mat(120, 160, CV_8UC3)), std::invalid_argument);
  EXPECT_THROW(meter.add(cv::Mat()), std::invalid_argument);
  ImageShiftConfig config;
  config.width_px = 8;
  EXPECT_THROW(ImageShiftMeter{config}, std::invalid_argument);
}

}  // namespace
}  // namespace system_diagnostics
