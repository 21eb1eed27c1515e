// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/depth_sequence.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>

#include <Eigen/SVD>
#include <interactive_mapping_common/formatted.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <yaml-cpp/yaml.h>

#include <depth_camera/depth_rectifier.h>

namespace gpis_mapping {
namespace {

using depth_camera::depthImageFromU16;
using depth_camera::DepthRectifier;
using depth_camera::LensDistortion;
using depth_camera::StampedPose;

namespace fs = std::filesystem;

constexpr double kTumUnitsPerMetre = 5000.0;
constexpr double kSevenScenesUnitsPerMetre = 1000.0;
constexpr double kSevenScenesRate_hz = 30.0;  // the recordings carry no stamps
// Between poses 0.1 s apart a body accelerating at 1 m/s^2 strays a dt^2 / 8 = 1.3 mm from the straight line.
constexpr double kMaxPoseGap_s = 0.1;
constexpr double kMaxPoseDistance_s = 0.02;
constexpr double kStampRounding_s = 1e-6;      // stamps of 1.5e9 s are 2e-7 s apart
constexpr double kMaxSeconds = 1e11;           // the year 5138; milliseconds since 1970 are beyond
constexpr double kQuaternionTolerance = 0.01;  // four printed decimals leave 1e-4
constexpr double kRotationTolerance = 0.01;    // largest entry of R^T R - I

std::string at(const std::string& path, std::size_t line) {
  return path + ":" + std::to_string(line) + ": ";
}

std::string format(double value) {
  return interactive_mapping::formatted("%.10g", value);
}

/// A moment [s], to the microsecond.
std::string formatStamp(double stamp_s) {
  return interactive_mapping::formatted("%.6f", stamp_s);
}

struct TextLine {
  std::size_t number;
  std::vector<std::string> words;
};

/// Lines that are neither blank nor comments (#), split at blanks.
std::vector<TextLine> readLines(const std::string& path) {
  std::error_code ignored;
  if (!fs::exists(path, ignored)) throw DepthSequenceError(path + ": is missing");
  std::ifstream in(path);
  if (!in) throw DepthSequenceError(path + ": cannot be read");
  std::vector<TextLine> lines;
  std::string text;
  for (std::size_t number = 1; std::getline(in, text); ++number) {
    if (number == 1 && text.compare(0, 3, "\xEF\xBB\xBF") == 0) text.erase(0, 3);  // byte order mark of Windows editors
    std::istringstream words(text);
    TextLine line{number, {}};
    for (std::string word; words >> word;) line.words.push_back(word);
    if (!line.words.empty() && line.words[0][0] != '#') lines.push_back(std::move(line));
  }
  if (in.bad()) throw DepthSequenceError(path + ": cannot be read to its end");
  return lines;
}

/// A finite number; anything else is refused with file and line.
double parseNumber(const std::string& word, const std::string& path, std::size_t line) {
  char* end = nullptr;
  const double value = std::strtod(word.c_str(), &end);
  if (end == word.c_str() || *end != '\0' || !std::isfinite(value)) {
    throw DepthSequenceError(at(path, line) + "'" + word + "' is not a finite number");
  }
  return value;
}

double parseStamp(const std::string& word, const std::string& path, std::size_t line) {
  const double stamp_s = parseNumber(word, path, line);
  if (std::abs(stamp_s) < kMaxSeconds) return stamp_s;
  const auto [unit, divisor] = std::abs(stamp_s) < 1e14   ? std::make_pair("milliseconds", "1e3")
                               : std::abs(stamp_s) < 1e17 ? std::make_pair("microseconds", "1e6")
                                                          : std::make_pair("nanoseconds", "1e9");
  throw DepthSequenceError(at(path, line) + "stamp " + word + " looks like " + unit +
                           ", must be in seconds: divide by " + divisor + " in all lists");
}

/// Whether a recorder says "lost" in place of a number: not finite, as C or older Windows runtimes print it.
bool isLost(const std::string& word) {
  if (word.compare(word[0] == '-' || word[0] == '+' ? 1 : 0, 3, "1.#") == 0) return true;  // -1.#IND, 1.#QNAN, 1.#INF
  char* end = nullptr;
  const double value = std::strtod(word.c_str(), &end);
  return end != word.c_str() && *end == '\0' && !std::isfinite(value);
}

void requireWords(const TextLine& line, std::size_t count, const std::string& path, const std::string& layout) {
  if (line.words.size() == count) return;
  throw DepthSequenceError(at(path, line.number) + "has " + std::to_string(line.words.size()) + " entries, must have " +
                           std::to_string(count) + ": " + layout);
}

/// `rows` x `cols` finite numbers, one row per line.
Eigen::MatrixXd readMatrix(const std::string& path, Eigen::Index rows, Eigen::Index cols) {
  const std::vector<TextLine> lines = readLines(path);
  if (static_cast<Eigen::Index>(lines.size()) != rows) {
    throw DepthSequenceError(path + ": has " + std::to_string(lines.size()) + " rows, must have " +
                             std::to_string(rows));
  }
  Eigen::MatrixXd matrix(rows, cols);
  for (Eigen::Index i = 0; i < rows; ++i) {
    const TextLine& line = lines[static_cast<std::size_t>(i)];
    requireWords(line, static_cast<std::size_t>(cols), path, "a row of the matrix");
    for (Eigen::Index j = 0; j < cols; ++j) {
      matrix(i, j) = parseNumber(line.words[static_cast<std::size_t>(j)], path, line.number);
    }
  }
  return matrix;
}

cv::Mat readRawImage(const std::string& path) {
  std::error_code error_code;
  if (!fs::is_regular_file(path, error_code)) {
    throw DepthSequenceError(path + ": image is missing" + (error_code ? ": " + error_code.message() : ""));
  }
  cv::Mat raw;
  try {
    raw = cv::imread(path, cv::IMREAD_UNCHANGED);
  } catch (const cv::Exception& error) {
    throw DepthSequenceError(path + ": image cannot be decoded: " + error.err);
  }
  if (raw.empty()) throw DepthSequenceError(path + ": image cannot be decoded");
  if (raw.type() != CV_16UC1) {
    throw DepthSequenceError(path + ": image has " + std::to_string(raw.channels()) + " channel(s) of " +
                             std::to_string(8 * raw.elemSize1()) + " bits, must be one of 16 bits without sign");
  }
  return raw;
}

/// A folder of images and the camera they share.
class FolderSequence : public DepthSequence {
 public:
  const CameraModel& camera() const override { return rectifier_.camera(); }

 protected:
  /// A camera with y up sees what one with y down sees, upside down.
  void takeCamera(CameraModel camera, const LensDistortion& distortion, const std::string& path) {
    if (camera.fy < 0.0) {
      if (!distortion.isZero()) {
        throw DepthSequenceError(path +
                                 ": fy < 0 (the camera's y axis points up) and distortion other than 0 cannot be read "
                                 "together. Rectify the images and set the distortion to 0");
      }
      camera.fy = -camera.fy;
      camera.cy = camera.height - 1 - camera.cy;
      is_upside_down_ = true;
      notes_.push_back(path + ": fy < 0, so the camera's y axis points up; images are read upside down with fy = " +
                       format(camera.fy) + ", cy = " + format(camera.cy));
    }
    try {
      rectifier_ = DepthRectifier(camera, distortion);
    } catch (const std::invalid_argument& error) {
      throw DepthSequenceError(path + ": " + error.what());
    }
  }

  DepthImage readImage(const std::string& path, double units_per_metre) const {
    cv::Mat raw = readRawImage(path);
    const CameraModel& camera = rectifier_.rawCamera();
    if (raw.cols != camera.width || raw.rows != camera.height) {
      throw DepthSequenceError(path + ": image is " + std::to_string(raw.cols) + " x " + std::to_string(raw.rows) +
                               " px, must be " + std::to_string(camera.width) + " x " + std::to_string(camera.height) +
                               " px as the camera");
    }
    if (is_upside_down_) cv::flip(raw, raw, 0);
    if (!raw.isContinuous()) raw = raw.clone();
    return rectifier_.rectify(depthImageFromU16(raw.ptr<std::uint16_t>(), raw.cols, raw.rows, units_per_metre));
  }

 private:
  DepthRectifier rectifier_;
  bool is_upside_down_{false};
};

// ---------------------------------------------------------------------------------------------------- TUM RGB-D

struct PoseLine {
  double stamp_s;
  Eigen::Vector3d t_map;
  Eigen::Quaterniond q_map_camera;
};

std::vector<PoseLine> readTrajectory(const std::string& path) {
  std::vector<PoseLine> poses;
  for (const TextLine& line : readLines(path)) {
    requireWords(line, 8, path, "timestamp tx ty tz qx qy qz qw");
    std::array<double, 8> n{parseStamp(line.words[0], path, line.number)};
    // Where tracking was lost the images have no pose and are skipped one by one.
    if (std::any_of(line.words.begin() + 1, line.words.end(), isLost)) continue;
    for (std::size_t i = 1; i < n.size(); ++i) n[i] = parseNumber(line.words[i], path, line.number);
    Eigen::Quaterniond q(n[7], n[4], n[5], n[6]);
    if (q.norm() == 0.0) continue;  // lost, too
    if (std::abs(q.norm() - 1.0) > kQuaternionTolerance) {
      throw DepthSequenceError(at(path, line.number) + "quaternion has norm " + format(q.norm()) +
                               ", must be 1 within " + format(kQuaternionTolerance));
    }
    poses.push_back({n[0], {n[1], n[2], n[3]}, q.normalized()});
  }
  if (poses.empty()) throw DepthSequenceError(path + ": holds no pose");
  std::stable_sort(poses.begin(), poses.end(),
                   [](const PoseLine& a, const PoseLine& b) { return a.stamp_s < b.stamp_s; });
  return poses;
}

Eigen::Isometry3d isometry(const Eigen::Vector3d& t, const Eigen::Quaterniond& q) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = q.toRotationMatrix();
  T.translation() = t;
  return T;
}

/// The pose at `stamp_s`, or nothing when the trajectory says too little about that moment.
std::optional<Eigen::Isometry3d> poseAt(const std::vector<PoseLine>& poses, double stamp_s, SkipReason* reason) {
  const auto after = std::lower_bound(poses.begin(), poses.end(), stamp_s,
                                      [](const PoseLine& pose, double stamp) { return pose.stamp_s < stamp; });
  const PoseLine* next = after == poses.end() ? nullptr : &*after;
  const PoseLine* last = after == poses.begin() ? nullptr : &*(after - 1);
  const double to_next = next ? next->stamp_s - stamp_s : std::numeric_limits<double>::infinity();
  const double to_last = last ? stamp_s - last->stamp_s : std::numeric_limits<double>::infinity();
  const double nearest = std::min(to_next, to_last);
  const bool is_near = nearest <= kMaxPoseDistance_s + kStampRounding_s;
  const bool is_bracketed = to_next + to_last <= kMaxPoseGap_s + kStampRounding_s;
  if (!is_near && !is_bracketed) {
    *reason = {"no pose near enough in time", "nearest pose is " + format(nearest) + " s from " + formatStamp(stamp_s) +
                                                  " s, must be within " + format(kMaxPoseDistance_s) +
                                                  " s or between two at most " + format(kMaxPoseGap_s) + " s apart"};
    return std::nullopt;
  }
  if (!last || to_next == 0.0) return isometry(next->t_map, next->q_map_camera);
  if (!next) return isometry(last->t_map, last->q_map_camera);
  const double share = to_last / (to_last + to_next);
  return isometry(last->t_map + share * (next->t_map - last->t_map),
                  last->q_map_camera.slerp(share, next->q_map_camera));
}

class TumSequence : public FolderSequence {
 public:
  TumSequence(const fs::path& folder, std::optional<double> units_per_metre) {
    readCameraInfo((folder / "camera_info.yaml").string());
    if (units_per_metre) units_per_metre_ = *units_per_metre;
    const std::string list = (folder / "depth.txt").string();
    for (const TextLine& line : readLines(list)) {
      requireWords(line, 2, list, "timestamp file");
      entries_.push_back({parseStamp(line.words[0], list, line.number), (folder / line.words[1]).string()});
    }
    if (entries_.empty()) throw DepthSequenceError(list + ": lists no image");
    poses_ = readTrajectory((folder / "groundtruth.txt").string());
  }

  std::size_t size() const override { return entries_.size(); }

  std::optional<DepthFrame> frame(std::size_t i, SkipReason* reason) override {
    const Entry& entry = entries_.at(i);
    const std::optional<StampedPose> at = pose(i, timeOffset(), reason);
    if (!at) return std::nullopt;
    return DepthFrame{readImage(entry.path, units_per_metre_), at->T_map_camera, at->stamp_s, entry.path};
  }

  std::optional<StampedPose> pose(std::size_t i, double time_offset_s, SkipReason* reason) override {
    const double stamp_s = entries_.at(i).stamp_s;
    const std::optional<Eigen::Isometry3d> T_map_camera = poseAt(poses_, stamp_s + time_offset_s, reason);
    return T_map_camera ? std::make_optional(StampedPose{*T_map_camera, stamp_s}) : std::nullopt;
  }

 private:
  struct Entry {
    double stamp_s;
    std::string path;
  };

  void readCameraInfo(const std::string& path) {
    if (!fs::exists(path)) {
      throw DepthSequenceError(path +
                               ": is missing; it must hold image_width, image_height and camera_matrix as written by "
                               "camera_info_manager (or be what rostopic echo prints of a CameraInfo). It may hold "
                               "the distortion and depth_units_per_metre");
    }
    CameraModel camera;
    LensDistortion distortion;
    try {
      const YAML::Node root = withFileKeys(YAML::LoadFile(path));
      camera.width = required(root, "image_width").as<int>();
      camera.height = required(root, "image_height").as<int>();
      const auto K = required(required(root, "camera_matrix"), "data").as<std::vector<double>>();
      if (K.size() != 9) {
        throw DepthSequenceError(path + ": camera_matrix/data has " + std::to_string(K.size()) +
                                 " numbers, must have 9");
      }
      camera.fx = K[0];
      camera.cx = K[2];
      camera.fy = K[4];
      camera.cy = K[5];
      const YAML::Node model = root["distortion_model"];
      distortion.model = model ? model.as<std::string>() : "plumb_bob";  // as camera_calibration_parsers does
      const YAML::Node coefficients = root["distortion_coefficients"];
      if (coefficients && coefficients.IsMap() && coefficients["data"]) {
        distortion.coefficients = coefficients["data"].as<std::vector<double>>();
      }
      const YAML::Node units = root["depth_units_per_metre"];
      if (units) units_per_metre_ = units.as<double>();
    } catch (const YAML::Exception& error) {
      throw DepthSequenceError(path + ": " + error.what());
    } catch (const std::invalid_argument& error) {
      throw DepthSequenceError(path + ": " + error.what());
    }
    if (!(std::isfinite(units_per_metre_) && units_per_metre_ > 0.0)) {
      throw DepthSequenceError(path + ": depth_units_per_metre = " + format(units_per_metre_) + ", must be > 0");
    }
    takeCamera(camera, distortion, path);
  }

  /// What rostopic echo prints of a CameraInfo gets the keys of camera_info_manager.
  static YAML::Node withFileKeys(YAML::Node root) {
    if (!root.IsMap() || !root["K"]) return root;
    root["camera_matrix"]["data"] = root["K"];
    for (const auto& [key, of_message] : {std::make_pair("image_width", "width"), {"image_height", "height"}}) {
      if (root[of_message]) root[key] = root[of_message];
    }
    if (root["D"]) root["distortion_coefficients"]["data"] = root["D"];
    return root;
  }

  static YAML::Node required(const YAML::Node& parent, const std::string& key) {
    const YAML::Node node = parent.IsMap() ? parent[key] : YAML::Node(YAML::NodeType::Undefined);
    if (!node) throw std::invalid_argument("key " + key + " is missing");
    return node;
  }

  double units_per_metre_{kTumUnitsPerMetre};
  std::vector<Entry> entries_;
  std::vector<PoseLine> poses_;
};

// ---------------------------------------------------------------------------------------------------- 7-Scenes

/// The rigid motion in a 4 x 4 matrix; its rotation is made orthonormal when only rounding keeps it from being so.
Eigen::Isometry3d readPoseMatrix(const std::string& path) {
  const Eigen::Matrix4d matrix = readMatrix(path, 4, 4);
  if ((matrix.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).cwiseAbs().maxCoeff() > 1e-6) {
    throw DepthSequenceError(path + ": last row must be 0 0 0 1");
  }
  const Eigen::Matrix3d R = matrix.topLeftCorner<3, 3>();
  const double error = (R.transpose() * R - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  if (error > kRotationTolerance || R.determinant() < 0.0) {
    throw DepthSequenceError(path + ": upper left 3 x 3 is no rotation: |R'R - I| = " + format(error) +
                             ", must be <= " + format(kRotationTolerance) + ", determinant " + format(R.determinant()) +
                             ", must be 1");
  }
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(R, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = svd.matrixU() * svd.matrixV().transpose();
  T.translation() = matrix.topRightCorner<3, 1>();
  return T;
}

constexpr char kDepthPrefix[] = "frame-";
constexpr char kDepthSuffix[] = ".depth.png";

/// The number in frame-NNNNNN.depth.png, or nothing for another name.
std::optional<long> frameNumber(const std::string& name) {
  const std::size_t prefix = sizeof(kDepthPrefix) - 1;
  const std::size_t suffix = sizeof(kDepthSuffix) - 1;
  if (name.size() <= prefix + suffix || name.compare(0, prefix, kDepthPrefix) != 0) return std::nullopt;
  if (name.compare(name.size() - suffix, suffix, kDepthSuffix) != 0) return std::nullopt;
  const std::string digits = name.substr(prefix, name.size() - prefix - suffix);
  if (digits.size() > 9 || digits.find_first_not_of("0123456789") != std::string::npos) return std::nullopt;
  return std::stol(digits);
}

class SevenScenesSequence : public FolderSequence {
 public:
  SevenScenesSequence(const fs::path& folder, std::optional<double> units_per_metre)
      : units_per_metre_(units_per_metre.value_or(kSevenScenesUnitsPerMetre)) {
    std::set<std::pair<long, std::string>> found;
    for (const fs::directory_entry& file : fs::directory_iterator(folder)) {
      const std::string name = file.path().filename().string();
      const std::optional<long> number = frameNumber(name);
      if (number) found.emplace(*number, name);
    }
    const std::string suffix = kDepthSuffix;
    for (const auto& [number, name] : found) {
      const std::string stem = (folder / name.substr(0, name.size() - suffix.size())).string();
      entries_.push_back({static_cast<double>(number) / kSevenScenesRate_hz, stem + suffix, stem + ".pose.txt"});
    }
    if (entries_.empty()) throw DepthSequenceError(folder.string() + ": holds no frame-NNNNNN.depth.png");
    readIntrinsics((folder / "camera-intrinsics.txt").string());
  }

  std::size_t size() const override { return entries_.size(); }

  std::optional<DepthFrame> frame(std::size_t i, SkipReason* reason) override {
    const Entry& entry = entries_.at(i);
    const std::optional<StampedPose> known = pose(i, 0.0, reason);
    if (!known) return std::nullopt;
    return DepthFrame{readImage(entry.image_path, units_per_metre_), known->T_map_camera, known->stamp_s,
                      entry.image_path};
  }

  std::optional<StampedPose> pose(std::size_t i, double /*time_offset_s*/, SkipReason* reason) override {
    const Entry& entry = entries_.at(i);
    if (fs::exists(entry.pose_path)) return StampedPose{readPoseMatrix(entry.pose_path), entry.stamp_s};
    *reason = {"no pose file", entry.pose_path + ": is missing"};
    return std::nullopt;
  }

  bool hasPoseStamps() const override { return false; }

 private:
  struct Entry {
    double stamp_s;
    std::string image_path;
    std::string pose_path;
  };

  void readIntrinsics(const std::string& path) {
    if (!fs::exists(path)) {
      throw DepthSequenceError(path + ": is missing; it must hold the 3 x 3 camera matrix of the depth images");
    }
    const Eigen::Matrix3d K = readMatrix(path, 3, 3);
    if (K(0, 1) != 0.0 || K(1, 0) != 0.0 || K.row(2) != Eigen::RowVector3d(0, 0, 1)) {
      throw DepthSequenceError(path + ": must be fx 0 cx / 0 fy cy / 0 0 1");
    }
    const cv::Mat first = readRawImage(entries_.front().image_path);  // the intrinsics carry no image size
    takeCamera({first.cols, first.rows, K(0, 0), K(1, 1), K(0, 2), K(1, 2)}, {}, path);
  }

  double units_per_metre_;
  std::vector<Entry> entries_;
};

bool holdsSevenScenes(const fs::path& folder) {
  if (fs::exists(folder / "camera-intrinsics.txt")) return true;
  for (const fs::directory_entry& file : fs::directory_iterator(folder)) {
    if (frameNumber(file.path().filename().string())) return true;
  }
  return false;
}

}  // namespace

std::unique_ptr<DepthSequence> openDepthSequence(const std::string& path, std::optional<double> units_per_metre) {
  try {
    if (!fs::exists(path)) throw DepthSequenceError(path + ": no such file or folder");
    if (!fs::is_directory(path)) throw DepthSequenceError(path + ": is not a folder");
    if (fs::exists(fs::path(path) / "depth.txt")) return std::make_unique<TumSequence>(path, units_per_metre);
    if (holdsSevenScenes(path)) return std::make_unique<SevenScenesSequence>(path, units_per_metre);
  } catch (const fs::filesystem_error& error) {
    throw DepthSequenceError(path + ": " + error.code().message());
  }
  throw DepthSequenceError(path +
                           ": is no recording; a TUM RGB-D folder holds depth.txt, groundtruth.txt and "
                           "camera_info.yaml, a 7-Scenes folder frame-*.depth.png, frame-*.pose.txt and "
                           "camera-intrinsics.txt");
}

}  // namespace gpis_mapping
