// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_FUZZ_SMALL_MAP_H
#define GPIS_MAPPING_FUZZ_SMALL_MAP_H

#include <cstdint>
#include <filesystem>
#include <string>

#include "fuzz/fuzz_engine.h"
#include "gpis_mapping/gpis_map.h"

namespace gpis_mapping_fuzz {

/// Tiny images and a map to match: an update takes about a millisecond.
gpis_mapping::CameraModel smallCamera(int width, int height);
gpis_mapping::GpisConfig smallConfig();

/// From somewhere around the scene, looking at its middle.
Eigen::Isometry3d somePose(const Eigen::Vector3d& middle_map, Random* random);

/// A ball on a floor, with a little noise, as the camera at `T_map_camera` sees it; +Inf where there is nothing.
/// The ball is left out on request, so that its points are deleted.
gpis_mapping::DepthImage renderScene(const gpis_mapping::CameraModel& camera, const Eigen::Isometry3d& T_map_camera,
                                     const Eigen::Vector3d& middle_map, bool with_ball, Random* random);

/// A few frames of that scene about the origin.
gpis_mapping::MapContents smallMap();

/// The same contents give the same number.
std::uint64_t checksumOf(const gpis_mapping::MapContents& contents);

/// Throws Violation if a point could not be trained on, asked for, or saved.
void requireSound(const gpis_mapping::MapContents& contents);

/// Asks, and throws Violation for an answer that must not be.
void requireSoundAnswers(const gpis_mapping::MapSnapshot& snapshot, const gpis_mapping::Points3d& points_map,
                         const gpis_mapping::QueryOptions& options);

/// The same at a few points: of the map, beside them, anywhere.
void requireSoundAnswers(const gpis_mapping::MapSnapshot& snapshot, Random* random);

/// A folder in memory where there is one: flushing to disk a million times would measure the disk.
class ScratchFolder {
 public:
  ScratchFolder();
  ~ScratchFolder();
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;

  std::string path() const { return path_.string(); }
  std::string file(const std::string& name) const { return (path_ / name).string(); }

 private:
  std::filesystem::path path_;
};

void writeFile(const std::string& path, const std::string& bytes);
std::string readFile(const std::string& path);

}  // namespace gpis_mapping_fuzz

#endif  // GPIS_MAPPING_FUZZ_SMALL_MAP_H
