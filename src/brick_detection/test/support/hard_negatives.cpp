// SPDX-License-Identifier: BSD-3-Clause
#include "support/hard_negatives.h"

#include <array>
#include <random>
#include <string>
#include <vector>

#include <opencv2/imgproc.hpp>

#include "support/tag_renderer.h"

namespace brick_detection {
namespace {

constexpr int kWidth = 640;
constexpr int kHeight = 480;

using Engine = std::mt19937;

/// Uniform in [low, high). The standard's distributions differ between libraries; the engine does not.
double uniform(Engine* engine, double low, double high) {
  return low + (high - low) * static_cast<double>((*engine)()) / 4294967296.0;
}

int whole(Engine* engine, int low, int high) {  // both included
  return low + static_cast<int>((*engine)() % static_cast<std::uint32_t>(high - low + 1));
}

cv::Mat plain(Engine* engine) {
  return cv::Mat(kHeight, kWidth, CV_8UC1, cv::Scalar(whole(engine, 60, 230)));
}

/// Lays `patch` into the image as a quadrangle about `middle`, each corner off by up to a quarter of `edge_px`.
void layAslant(const cv::Mat& patch, const cv::Point2f& middle, double edge_px, Engine* engine, cv::Mat* image) {
  const auto width = static_cast<float>(patch.cols);
  const auto height = static_cast<float>(patch.rows);
  const std::array<cv::Point2f, 4> source = {cv::Point2f(0, 0), {width, 0}, {width, height}, {0, height}};
  std::array<cv::Point2f, 4> target;
  const double turn = uniform(engine, 0.0, 2.0 * CV_PI);
  for (std::size_t i = 0; i < 4; ++i) {
    const double angle = turn + CV_PI / 2.0 * static_cast<double>(i);
    const double radius = edge_px * uniform(engine, 0.5, 0.8);
    target[i] = middle +
                cv::Point2f(static_cast<float>(radius * std::cos(angle)), static_cast<float>(radius * std::sin(angle)));
  }
  const cv::Mat transform = cv::getPerspectiveTransform(source.data(), target.data());
  cv::warpPerspective(patch, *image, transform, image->size(), cv::INTER_AREA, cv::BORDER_TRANSPARENT);
}

cv::Mat checkerboard(Engine* engine) {
  cv::Mat image = plain(engine);
  const int cells = whole(engine, 4, 14);
  const int cell_px = 24;
  cv::Mat board(cells * cell_px, cells * cell_px, CV_8UC1, cv::Scalar(235));
  for (int row = 0; row < cells; ++row) {
    for (int column = row % 2; column < cells; column += 2) {
      board(cv::Rect(column * cell_px, row * cell_px, cell_px, cell_px)).setTo(20);
    }
  }
  layAslant(board, {320.0F, 240.0F}, uniform(engine, 150.0, 420.0), engine, &image);
  return image;
}

cv::Mat text(Engine* engine) {
  cv::Mat image = plain(engine);
  for (int line = 0; line < 40; ++line) {
    std::string words;
    for (int i = whole(engine, 2, 14); i > 0; --i) words += static_cast<char>(whole(engine, '!', '~'));
    const int font = whole(engine, 0, 7);
    const double scale = uniform(engine, 0.3, 2.5);
    const cv::Point at(whole(engine, -20, kWidth - 60), whole(engine, 10, kHeight));
    const int ink = whole(engine, 0, 1) == 0 ? 15 : 245;
    cv::putText(image, words, at, font, scale, cv::Scalar(ink), whole(engine, 1, 5), cv::LINE_AA);
    if (line % 4 == 0) {
      const cv::Size box = cv::getTextSize(words.substr(0, 2), font, scale, 2, nullptr);
      cv::rectangle(image, at + cv::Point(-8, 8), at + cv::Point(box.width + 8, -box.height - 8), cv::Scalar(ink),
                    whole(engine, 2, 8), cv::LINE_AA);
    }
  }
  return image;
}

cv::Mat randomSquares(Engine* engine) {
  cv::Mat image = plain(engine);
  const int cell_px = 16;
  for (int y = 0; y < 3; ++y) {
    for (int x = 0; x < 4; ++x) {
      const int cells = whole(engine, 6, 9);
      cv::Mat paper((cells + 2) * cell_px, (cells + 2) * cell_px, CV_8UC1, cv::Scalar(235));
      paper(cv::Rect(cell_px, cell_px, cells * cell_px, cells * cell_px)).setTo(15);
      for (int row = 2; row < cells; ++row) {
        for (int column = 2; column < cells; ++column) {
          if (whole(engine, 0, 1) == 1) paper(cv::Rect(column * cell_px, row * cell_px, cell_px, cell_px)).setTo(235);
        }
      }
      layAslant(paper, cv::Point2f(80.0F + 160.0F * static_cast<float>(x), 80.0F + 160.0F * static_cast<float>(y)),
                uniform(engine, 50.0, 105.0), engine, &image);
    }
  }
  return image;
}

cv::Mat noise(std::uint32_t seed, Engine* engine) {
  cv::RNG random(seed + 1);
  cv::Mat_<float> field(kHeight, kWidth);
  random.fill(field, cv::RNG::NORMAL, 0.0, 1.0);
  const double length_px = uniform(engine, 0.0, 12.0);
  if (length_px > 1.0) cv::GaussianBlur(field, field, cv::Size(), length_px);
  cv::Scalar mean;
  cv::Scalar deviation;
  cv::meanStdDev(field, mean, deviation);
  cv::Mat image;
  field.convertTo(image, CV_8U, uniform(engine, 20.0, 120.0) / deviation[0], 127.0);
  if (whole(engine, 0, 1) == 0) cv::threshold(image, image, 127.0, 255.0, cv::THRESH_BINARY);
  return image;
}

cv::Mat pile(std::uint32_t seed, Engine* engine) {
  RenderScene scene;
  scene.camera = {kWidth, kHeight, 525.0, 525.0, 319.5, 239.5, Distortion::kNone, {}};
  scene.T_camera_ground = poseSeenAt(scene.camera, {320.0, 240.0}, 1.6, uniform(engine, 0.3, 1.2), CV_PI, 0.0);
  for (int i = 0; i < 8; ++i) {
    RenderBrick brick;
    brick.type.size_m = {0.3, 0.2, 0.2};
    brick.type.plate_edge_m = whole(engine, 0, 1) == 0 ? 0.17 : 0.12;
    const double shade = uniform(engine, 0.05, 1.0);
    brick.type.color_rgb = Eigen::Vector3d(shade, 0.8 * shade, 0.7 * shade);
    brick.T_camera_brick = poseSeenAt(scene.camera, {uniform(engine, 60.0, 580.0), uniform(engine, 60.0, 420.0)},
                                      uniform(engine, 0.8, 2.0), uniform(engine, 0.0, 1.4), uniform(engine, 0.0, 6.3),
                                      uniform(engine, 0.0, 6.3));
    scene.bricks.push_back(brick);
  }
  RenderEffects effects;
  effects.noise_std = 2.5;
  effects.blur_sigma_px = 0.5;
  return render(scene, effects, seed).grey;
}

cv::Mat frames(Engine* engine) {
  cv::Mat image = plain(engine);
  for (int i = 0; i < 10; ++i) {
    cv::Mat paper(160, 160, CV_8UC1, cv::Scalar(240));
    const int thick = whole(engine, 8, 24);
    cv::rectangle(paper, {20, 20}, {140, 140}, cv::Scalar(10), cv::FILLED);
    if (i % 3 != 0)
      cv::rectangle(paper, {20 + thick, 20 + thick}, {140 - thick, 140 - thick}, cv::Scalar(240), cv::FILLED);
    if (i % 3 == 2) cv::rectangle(paper, {60, 60}, {100, 100}, cv::Scalar(10), cv::FILLED);
    const cv::Point2f middle(static_cast<float>(uniform(engine, 60.0, 580.0)),
                             static_cast<float>(uniform(engine, 60.0, 420.0)));
    layAslant(paper, middle, uniform(engine, 30.0, 140.0), engine, &image);
  }
  return image;
}

cv::Mat grid(Engine* engine) {
  cv::Mat tiles(512, 512, CV_8UC1, cv::Scalar(whole(engine, 150, 240)));
  const int step = whole(engine, 24, 80);
  const int thick = whole(engine, 2, 12);
  for (int at = 0; at < 512; at += step) {
    tiles(cv::Rect(at, 0, std::min(thick, 512 - at), 512)).setTo(30);
    tiles(cv::Rect(0, at, 512, std::min(thick, 512 - at))).setTo(30);
  }
  cv::Mat image = plain(engine);
  layAslant(tiles, {320.0F, 240.0F}, uniform(engine, 200.0, 500.0), engine, &image);
  return image;
}

cv::Mat rectangles(Engine* engine) {
  cv::Mat image = plain(engine);
  for (int i = 0; i < 150; ++i) {
    const cv::RotatedRect box(
        cv::Point2f(static_cast<float>(whole(engine, 0, kWidth)), static_cast<float>(whole(engine, 0, kHeight))),
        cv::Size2f(static_cast<float>(whole(engine, 5, 120)), static_cast<float>(whole(engine, 5, 120))),
        static_cast<float>(whole(engine, 0, 90)));
    std::array<cv::Point2f, 4> corners;
    box.points(corners.data());
    const std::vector<cv::Point> polygon(corners.begin(), corners.end());
    cv::fillConvexPoly(image, polygon, cv::Scalar(whole(engine, 0, 255)), cv::LINE_AA);
  }
  return image;
}

cv::Mat draw(HardNegative kind, std::uint32_t seed, Engine* engine) {
  switch (kind) {
    case HardNegative::kCheckerboard:
      return checkerboard(engine);
    case HardNegative::kText:
      return text(engine);
    case HardNegative::kRandomSquares:
      return randomSquares(engine);
    case HardNegative::kNoise:
      return noise(seed, engine);
    case HardNegative::kPile:
      return pile(seed, engine);
    case HardNegative::kFrames:
      return frames(engine);
    case HardNegative::kGrid:
      return grid(engine);
    case HardNegative::kRectangles:
      return rectangles(engine);
  }
  return {};
}

}  // namespace

cv::Mat hardNegative(HardNegative kind, std::uint32_t seed) {
  Engine engine(seed * static_cast<std::uint32_t>(kNumHardNegatives) + static_cast<std::uint32_t>(kind));
  cv::Mat image = draw(kind, seed, &engine);
  if (kind == HardNegative::kPile || kind == HardNegative::kNoise) return image;
  cv::GaussianBlur(image, image, cv::Size(), uniform(&engine, 0.4, 1.0));
  cv::RNG random(seed + 1);
  cv::Mat_<short> grain(image.size());
  random.fill(grain, cv::RNG::NORMAL, 0.0, 2.5);
  cv::Mat_<short> sum;
  image.convertTo(sum, CV_16S);
  sum += grain;
  sum.convertTo(image, CV_8U);
  return image;
}

}  // namespace brick_detection
