// SPDX-License-Identifier: BSD-3-Clause
#include "synthetic_depth/tum_sequence.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <fstream>
#include <iomanip>
#include <limits>
#include <optional>
#include <sstream>
#include <stdexcept>

#include <boost/filesystem.hpp>
#include <interactive_mapping_common/formatted.h>
#include <opencv2/imgcodecs.hpp>
#include <yaml-cpp/yaml.h>

#include "synthetic_depth/depth_renderer.h"
#include "synthetic_depth/sensor.h"

namespace synthetic_depth {
namespace {

constexpr double kStampTolerance_s = 1e-6;

std::ofstream openForWriting(const boost::filesystem::path& path, std::ios::openmode mode = std::ios::out) {
  std::ofstream file(path.string(), mode | std::ios::trunc);
  if (!file) {
    throw std::runtime_error(path.string() + ": cannot be written");
  }
  return file;
}

void closeChecked(std::ofstream& file, const boost::filesystem::path& path) {
  file.close();
  if (!file) {
    throw std::runtime_error(path.string() + ": write failed (disk full?)");
  }
}

std::string frameName(int frame) {
  return interactive_mapping::formatted("depth/%06d.png", frame);
}

void writeStamp(std::ostream& out, double stamp_s) {
  out << std::fixed << std::setprecision(6) << stamp_s;
}

Eigen::Quaterniond quaternionOf(const Eigen::Isometry3d& pose) {
  Eigen::Quaterniond q(pose.linear());
  q.normalize();
  if (q.w() < 0.0) {
    q.coeffs() = -q.coeffs();
  }
  return q;
}

template <typename Vector>
void emitVector(YAML::Emitter& out, const std::string& key, const Vector& values) {
  out << YAML::Key << key << YAML::Value << YAML::Flow << YAML::BeginSeq;
  for (Eigen::Index i = 0; i < values.size(); ++i) {
    out << values[i];
  }
  out << YAML::EndSeq;
}

void emitPose(YAML::Emitter& out, const Eigen::Isometry3d& pose) {
  emitVector(out, "xyz_m", Eigen::Vector3d(pose.translation()));
  emitVector(out, "quaternion_xyzw", Eigen::Vector4d(quaternionOf(pose).coeffs()));
}

void emitMatrix(YAML::Emitter& out, const std::string& key, int rows, int cols, const Eigen::VectorXd& data) {
  out << YAML::Key << key << YAML::Value << YAML::BeginMap;
  out << YAML::Key << "rows" << YAML::Value << rows;
  out << YAML::Key << "cols" << YAML::Value << cols;
  emitVector(out, "data", data);
  out << YAML::EndMap;
}

std::string cameraInfoYaml(const CameraModel& camera) {
  Eigen::VectorXd intrinsics(9);
  intrinsics << camera.fx_px, 0.0, camera.cx_px, 0.0, camera.fy_px, camera.cy_px, 0.0, 0.0, 1.0;
  Eigen::VectorXd identity(9);
  identity << 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0;
  Eigen::VectorXd projection(12);
  projection << camera.fx_px, 0.0, camera.cx_px, 0.0, 0.0, camera.fy_px, camera.cy_px, 0.0, 0.0, 0.0, 1.0, 0.0;
  YAML::Emitter out;
  out << YAML::BeginMap;
  out << YAML::Key << "image_width" << YAML::Value << camera.width_px;
  out << YAML::Key << "image_height" << YAML::Value << camera.height_px;
  out << YAML::Key << "camera_name" << YAML::Value << "synthetic_depth";
  emitMatrix(out, "camera_matrix", 3, 3, intrinsics);
  out << YAML::Key << "distortion_model" << YAML::Value << "plumb_bob";
  emitMatrix(out, "distortion_coefficients", 1, 5, Eigen::VectorXd::Zero(5));
  emitMatrix(out, "rectification_matrix", 3, 3, identity);
  emitMatrix(out, "projection_matrix", 3, 4, projection);
  out << YAML::Key << "depth_units_per_metre" << YAML::Value << kTumUnitsPerMetre;
  out << YAML::EndMap;
  return std::string(out.c_str()) + "\n";
}

std::string groundTruthYaml(const Scene& scene, int num_frames, bool apply_sensor) {
  YAML::Emitter out;
  out.SetDoublePrecision(15);
  out << YAML::BeginMap;
  out << YAML::Key << "num_frames" << YAML::Value << num_frames;
  out << YAML::Key << "fps" << YAML::Value << scene.fps;
  out << YAML::Key << "start_time_s" << YAML::Value << scene.start_time_s;
  out << YAML::Key << "seed" << YAML::Value << scene.seed;
  out << YAML::Key << "has_ground" << YAML::Value << scene.has_ground
      << YAML::Comment("solid z <= 0 of the scene frame");
  out << YAML::Key << "T_map_scene" << YAML::Value << YAML::BeginMap;
  emitPose(out, scene.T_map_scene);
  out << YAML::EndMap;
  out << YAML::Key << "roi" << YAML::Comment("scene frame") << YAML::Value << YAML::BeginMap;
  emitVector(out, "min_m", scene.roi.min_m);
  emitVector(out, "max_m", scene.roi.max_m);
  out << YAML::EndMap;

  std::vector<int> removed;
  int removal_frame = -1;
  for (const Box& box : scene.boxes) {
    if (box.vanishes_at_frame < num_frames) {
      removed.push_back(box.id);
      removal_frame = removal_frame < 0 ? box.vanishes_at_frame : std::min(removal_frame, box.vanishes_at_frame);
    }
  }
  out << YAML::Key << "removed_ids" << YAML::Value << YAML::Flow << removed;
  out << YAML::Key << "removal_frame" << YAML::Value << removal_frame
      << YAML::Comment("first frame without one of them; -1 = nothing is removed");
  out << YAML::Key << "boxes" << YAML::Comment("poses in the scene frame") << YAML::Value << YAML::BeginSeq;
  for (const Box& box : scene.boxes) {
    out << YAML::BeginMap;
    out << YAML::Key << "id" << YAML::Value << box.id;
    emitPose(out, box.T_scene_box);
    emitVector(out, "half_extents_m", box.half_extents_m);
    out << YAML::Key << "albedo" << YAML::Value << box.albedo;
    out << YAML::Key << "appears_at_frame" << YAML::Value << box.appears_at_frame;
    out << YAML::Key << "vanishes_at_frame" << YAML::Value
        << (box.vanishes_at_frame < num_frames ? box.vanishes_at_frame : -1);
    out << YAML::EndMap;
  }
  out << YAML::EndSeq;

  const SensorModel sensor = apply_sensor ? scene.sensor : scene.sensor.withoutNoise();
  out << YAML::Key << "sensor" << YAML::Value << YAML::BeginMap;
  out << YAML::Key << "min_range_m" << YAML::Value << sensor.min_range_m;
  out << YAML::Key << "max_range_m" << YAML::Value << sensor.max_range_m;
  out << YAML::Key << "axial_noise_a_m" << YAML::Value << sensor.axial_noise_a_m;
  out << YAML::Key << "axial_noise_b" << YAML::Value << sensor.axial_noise_b;
  out << YAML::Key << "axial_noise_c_per_m" << YAML::Value << sensor.axial_noise_c_per_m;
  out << YAML::Key << "baseline_m" << YAML::Value << sensor.baseline_m;
  out << YAML::Key << "has_shadows" << YAML::Value << sensor.has_shadows;
  out << YAML::Key << "disparity_step_px" << YAML::Value << sensor.disparity_step_px;
  out << YAML::Key << "edge_mixing_fraction" << YAML::Value << sensor.edge_mixing_fraction;
  out << YAML::Key << "edge_threshold_m" << YAML::Value << sensor.edge_threshold_m;
  out << YAML::Key << "dropout_probability" << YAML::Value << sensor.dropout_probability;
  out << YAML::Key << "lateral_jitter_px" << YAML::Value << sensor.lateral_jitter_px;
  out << YAML::Key << "border_left_px" << YAML::Value << sensor.border_left_px;
  out << YAML::Key << "border_right_px" << YAML::Value << sensor.border_right_px;
  out << YAML::Key << "border_top_px" << YAML::Value << sensor.border_top_px;
  out << YAML::Key << "border_bottom_px" << YAML::Value << sensor.border_bottom_px;
  out << YAML::Key << "has_hexagonal_view" << YAML::Value << sensor.has_hexagonal_view;
  out << YAML::Key << "min_return_per_m2" << YAML::Value << sensor.min_return_per_m2;
  out << YAML::Key << "return_flicker" << YAML::Value << sensor.return_flicker;
  out << YAML::Key << "edge_loss_px" << YAML::Value << sensor.edge_loss_px;
  out << YAML::EndMap << YAML::EndMap;
  return std::string(out.c_str()) + "\n";
}

double millisecondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

/// Splits a TUM list into lines of exactly `num_fields` words, comments left out.
std::vector<std::vector<std::string>> readList(const boost::filesystem::path& path, std::size_t num_fields) {
  std::ifstream file(path.string());
  if (!file) {
    throw std::runtime_error(path.string() + ": cannot be read");
  }
  std::vector<std::vector<std::string>> rows;
  int number = 0;
  for (std::string line; std::getline(file, line);) {
    ++number;
    std::istringstream words(line);
    std::vector<std::string> row;
    for (std::string word; words >> word;) {
      row.push_back(word);
    }
    if (row.empty() || row.front().front() == '#') {
      continue;
    }
    if (row.size() != num_fields) {
      throw std::runtime_error(path.string() + ":" + std::to_string(number) + ": " + std::to_string(row.size()) +
                               " fields, must be " + std::to_string(num_fields));
    }
    rows.push_back(row);
  }
  return rows;
}

double toDouble(const std::string& word, const boost::filesystem::path& path) {
  std::size_t used = 0;
  double value = 0.0;
  try {
    value = std::stod(word, &used);
  } catch (const std::exception&) {
    used = 0;
  }
  if (used != word.size() || word.empty()) {
    throw std::runtime_error(path.string() + ": \"" + word + "\" is not a number");
  }
  return value;
}

int countMeasured(const cv::Mat& depth_m) {
  return static_cast<int>(
      std::count_if(depth_m.begin<float>(), depth_m.end<float>(), [](float z_m) { return std::isfinite(z_m); }));
}

void writeDepthPng(const cv::Mat& depth_m, const boost::filesystem::path& path) {
  bool is_written = false;
  try {
    // Level 1: depth noise does not compress, and higher levels only cost time.
    is_written =
        cv::imwrite(path.string(), encodeDepth16(depth_m, kTumUnitsPerMetre), {cv::IMWRITE_PNG_COMPRESSION, 1});
  } catch (const cv::Exception&) {
    is_written = false;
  }
  if (!is_written) throw std::runtime_error(path.string() + ": cannot be written");
}

void writePose(std::ofstream& out, double stamp_s, const Eigen::Isometry3d& T_map_camera) {
  const Eigen::Quaterniond q = quaternionOf(T_map_camera);
  writeStamp(out, stamp_s);
  out << std::setprecision(9);
  for (const double value : {T_map_camera.translation().x(), T_map_camera.translation().y(),
                             T_map_camera.translation().z(), q.x(), q.y(), q.z(), q.w()}) {
    out << ' ' << value;
  }
  out << '\n';
}

/// The same frames without PNG's rounding: float32 depths, float64 poses.
class RawFiles {
 public:
  explicit RawFiles(const boost::filesystem::path& root)
      : root_(root),
        frames_(openForWriting(root / kFrames, std::ios::binary)),
        poses_(openForWriting(root / kPoses, std::ios::binary)) {}
  void write(const cv::Mat& depth_m, const Eigen::Isometry3d& T_map_camera) {
    for (int v = 0; v < depth_m.rows; ++v) {
      frames_.write(reinterpret_cast<const char*>(depth_m.ptr<float>(v)),
                    static_cast<std::streamsize>(sizeof(float)) * depth_m.cols);
    }
    const Eigen::Matrix<double, 4, 4, Eigen::RowMajor> matrix = T_map_camera.matrix();
    poses_.write(reinterpret_cast<const char*>(matrix.data()), sizeof(double) * 16);
  }
  void close() {
    closeChecked(frames_, root_ / kFrames);
    closeChecked(poses_, root_ / kPoses);
  }

 private:
  static constexpr const char* kFrames = "frames.f32";
  static constexpr const char* kPoses = "poses.f64";
  boost::filesystem::path root_;
  std::ofstream frames_, poses_;
};

}  // namespace

SequenceStatistics writeTumSequence(const Scene& scene, const std::string& directory, const SequenceOptions& options) {
  const int num_frames = options.num_frames < 0 ? scene.numFrames() : options.num_frames;
  if (num_frames < 1 || num_frames > scene.numFrames()) {
    throw std::invalid_argument("number of frames = " + std::to_string(num_frames) + ", must be in [1, " +
                                std::to_string(scene.numFrames()) + "]");
  }
  Scene measured_scene = scene;
  if (!options.apply_sensor) {
    measured_scene.sensor = scene.sensor.withoutNoise();
  }

  const boost::filesystem::path root(directory);
  boost::system::error_code failure;
  boost::filesystem::create_directories(root / "depth", failure);
  if (failure) {
    throw std::runtime_error((root / "depth").string() + ": cannot be created: " + failure.message());
  }
  std::ofstream info = openForWriting(root / "camera_info.yaml");
  info << cameraInfoYaml(scene.camera);
  closeChecked(info, root / "camera_info.yaml");
  std::ofstream truth = openForWriting(root / "ground_truth.yaml");
  truth << groundTruthYaml(scene, num_frames, options.apply_sensor);
  closeChecked(truth, root / "ground_truth.yaml");

  std::ofstream depth_list = openForWriting(root / "depth.txt");
  depth_list << "# timestamp filename\n";
  std::ofstream pose_list = openForWriting(root / "groundtruth.txt");
  pose_list << "# timestamp tx ty tz qx qy qz qw\n";
  std::optional<RawFiles> raw;
  if (options.write_raw) raw.emplace(root);

  SequenceStatistics statistics;
  double num_valid = 0.0;
  for (int frame = 0; frame < num_frames; ++frame) {
    const auto render_start = std::chrono::steady_clock::now();
    const cv::Mat exact_m = renderDepth(scene, frame);
    statistics.render_ms += millisecondsSince(render_start) / num_frames;
    const auto sensor_start = std::chrono::steady_clock::now();
    const cv::Mat depth_m = applySensor(measured_scene, frame, exact_m);
    statistics.sensor_ms += millisecondsSince(sensor_start) / num_frames;
    num_valid += countMeasured(depth_m);

    const std::string name = frameName(frame);
    writeDepthPng(depth_m, root / name);
    const Eigen::Isometry3d T_map_camera = scene.cameraInMap(frame);
    writeStamp(depth_list, scene.stampSeconds(frame));
    depth_list << ' ' << name << '\n';
    writePose(pose_list, scene.stampSeconds(frame), T_map_camera);
    if (raw) raw->write(depth_m, T_map_camera);
    if (options.on_progress) {
      options.on_progress(frame + 1, num_frames);
    }
  }
  closeChecked(depth_list, root / "depth.txt");
  closeChecked(pose_list, root / "groundtruth.txt");
  if (raw) raw->close();
  statistics.num_frames = num_frames;
  statistics.valid_fraction =
      num_valid / (static_cast<double>(num_frames) * scene.camera.width_px * scene.camera.height_px);
  return statistics;
}

std::vector<TumFrame> readTumSequence(const std::string& directory) {
  const boost::filesystem::path root(directory);
  const auto depth_rows = readList(root / "depth.txt", 2);
  const auto pose_rows = readList(root / "groundtruth.txt", 8);
  std::vector<TumFrame> frames;
  for (const auto& depth_row : depth_rows) {
    TumFrame frame;
    frame.stamp_s = toDouble(depth_row[0], root / "depth.txt");
    frame.depth_path = (root / depth_row[1]).string();
    bool has_pose = false;
    for (const auto& pose_row : pose_rows) {
      double values[8];
      for (std::size_t i = 0; i < 8; ++i) {
        values[i] = toDouble(pose_row[i], root / "groundtruth.txt");
      }
      if (std::abs(values[0] - frame.stamp_s) <= kStampTolerance_s) {
        has_pose = true;
        frame.T_map_camera.translation() << values[1], values[2], values[3];
        frame.T_map_camera.linear() =
            Eigen::Quaterniond(values[7], values[4], values[5], values[6]).normalized().toRotationMatrix();
        break;
      }
    }
    if (!has_pose) {
      throw std::runtime_error((root / "groundtruth.txt").string() + ": no pose for stamp " + depth_row[0]);
    }
    frames.push_back(frame);
  }
  return frames;
}

cv::Mat readTumDepth(const std::string& path) {
  const cv::Mat units = cv::imread(path, cv::IMREAD_UNCHANGED);
  if (units.empty() || units.type() != CV_16UC1) {
    throw std::runtime_error(path + ": is missing or not a 16-bit grey image");
  }
  return decodeDepth16(units, kTumUnitsPerMetre);
}

}  // namespace synthetic_depth
