// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/run_pictures.h"

#include <cstdio>
#include <filesystem>
#include <stdexcept>
#include <system_error>

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

namespace simulated_world {

RunPictures::RunPictures(const std::string& run_folder) : folder_(run_folder + "/pictures") {
  std::error_code error;
  std::filesystem::create_directories(folder_, error);
  if (error) {
    throw std::runtime_error("pictures: " + folder_ + ": cannot make the folder: " + error.message());
  }
}

void RunPictures::watch(Simulation& simulation) {
  if (stowed_ != simulation.bricksStowed()) {
    take(simulation);
  }
}

void RunPictures::finish(Simulation& simulation) {
  if (!stowed_ || digest_ != simulation.digest()) {
    take(simulation);
  }
}

void RunPictures::take(Simulation& simulation) {
  char name[64];
  // Leading zeros, so that names are in the order of time; milliseconds, so that no two are the same.
  std::snprintf(name, sizeof name, "/world_%09.3f_%03d.png", simulation.now(), simulation.bricksStowed());
  cv::Mat bgr;
  cv::cvtColor(simulation.picture(), bgr, cv::COLOR_RGB2BGR);
  // Under another name first: who looks into the folder meanwhile sees whole pictures alone.
  const std::string path = folder_ + name;
  const std::string unfinished = folder_ + "/unfinished.png";
  bool is_written = false;
  try {
    is_written = cv::imwrite(unfinished, bgr);
  } catch (const cv::Exception& error) {
    throw std::runtime_error("pictures: cannot write " + path + ": " + error.what());
  }
  std::error_code error;
  if (is_written) {
    std::filesystem::rename(unfinished, path, error);
  }
  if (!is_written || error) {
    throw std::runtime_error("pictures: cannot write " + path + (error ? ": " + error.message() : ""));
  }
  stowed_ = simulation.bricksStowed();
  digest_ = simulation.digest();
}

}  // namespace simulated_world
