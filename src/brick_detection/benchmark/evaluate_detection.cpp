// SPDX-License-Identifier: BSD-3-Clause
// How well bricks are found: rendered images with known poses through detector and pose estimator, as CSV. scripts/bench
// runs it and scripts/plot_detection.py makes table and plot of it.
#include <algorithm>
#include <cmath>
#include <ctime>
#include <fstream>
#include <iostream>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include <boost/program_options.hpp>

#include "brick_detection/brick_pose.h"
#include "brick_detection/tag_detector.h"
#include "libapriltag_alone.h"
#include "support/hard_negatives.h"
#include "support/tag_renderer.h"

namespace brick_detection {
namespace {

using mp700_ur5e_description::BrickCatalogue;
using mp700_ur5e_description::BrickFace;
using mp700_ur5e_description::BrickTag;

constexpr double kDegree = CV_PI / 180.0;
constexpr double kWrongNormal = 20.0 * kDegree;
constexpr double kBoardEdge = 0.17;

CameraModel vga() {
  return {640, 480, 525.0, 525.0, 319.5, 239.5, Distortion::kNone, {}};
}

/// A fair RGB-D camera indoors: the case that all others vary.
RenderEffects usual() {
  RenderEffects effects;
  effects.noise_std = 2.5;
  effects.blur_sigma_px = 0.5;
  effects.depth_noise = 0.003;
  effects.depth_noise_px = 4.0;
  effects.depth_holes = 0.02;
  return effects;
}

class Random {
 public:
  explicit Random(std::uint32_t seed) : engine_(seed) {}
  double uniform(double low, double high) { return low + (high - low) * static_cast<double>(engine_()) / 4294967296.0; }

 private:
  std::mt19937 engine_;
};

double median(std::vector<double> values, double quantile = 0.5) {
  if (values.empty()) return std::nan("");
  const auto rank = static_cast<std::ptrdiff_t>(quantile * static_cast<double>(values.size() - 1) + 0.5);
  std::nth_element(values.begin(), values.begin() + rank, values.end());
  return values[static_cast<std::size_t>(rank)];
}

/// Of this process: what else runs on the machine does not count. Everything here is one thread.
class ProcessorTime {
 public:
  double ms() const { return 1e3 * static_cast<double>(std::clock() - start_) / CLOCKS_PER_SEC; }

 private:
  std::clock_t start_{std::clock()};
};

/// Boards with one tag each, and the bricks of the catalogue. Board i has the tag i; the bricks' tags come after.
BrickCatalogue evaluationCatalogue(BrickCatalogue catalogue, int num_boards) {
  RenderBrick board = tagBoard(0, catalogue.tags.black_border_edge_m, kBoardEdge, Eigen::Isometry3d::Identity());
  catalogue.types.push_back(board.type);
  catalogue.tags.first_id = num_boards;
  catalogue.tags.num_bricks = 20;
  for (int i = 0; i < num_boards; ++i) {
    mp700_ur5e_description::LabelledBrick labelled;
    labelled.id = 1000 + i;
    labelled.type = board.type.name;
    BrickTag tag = board.tags.begin()->second;
    tag.brick_id = labelled.id;
    labelled.tags[i] = tag;
    catalogue.bricks.push_back(labelled);
  }
  return catalogue;
}

struct Sample {
  bool is_detected{false};
  bool is_used{false};
  bool is_ambiguous{false};
  double side_px{0.0};
  double position_m{0.0};
  double angle_rad{0.0};
  double normal_rad{0.0};
};

struct Row {
  std::string group;
  std::string name;
  double distance_m{1.0};
  double tilt_deg{std::nan("")};
  bool has_depth{false};
  std::vector<Sample> samples;
  std::vector<double> detect_ms;
  std::vector<double> pose_ms;
  int false_tags{0};
  int false_bricks{0};
};

void writeHeader(std::ostream& out) {
  out << "group,name,distance_m,tilt_deg,depth,tags,detected,used,ambiguous,side_px,position_median_mm,position_p95_mm,"
         "angle_median_deg,angle_p95_deg,wrong_normals,detect_ms,detect_p95_ms,pose_ms,pose_p95_ms,false_tags,"
         "false_bricks\n";
}

void write(const Row& row, std::ostream& out) {
  std::vector<double> side_px;
  std::vector<double> position_mm;
  std::vector<double> angle_deg;
  int detected = 0;
  int ambiguous = 0;
  int wrong = 0;
  for (const Sample& sample : row.samples) {
    side_px.push_back(sample.side_px);
    detected += sample.is_detected;
    ambiguous += sample.is_ambiguous;
    if (!sample.is_used) continue;
    position_mm.push_back(1e3 * sample.position_m);
    angle_deg.push_back(sample.angle_rad / kDegree);
    wrong += sample.normal_rad > kWrongNormal;
  }
  out << row.group << ',' << row.name << ',' << row.distance_m << ',' << row.tilt_deg << ',' << row.has_depth << ','
      << row.samples.size() << ',' << detected << ',' << position_mm.size() << ',' << ambiguous << ','
      << median(side_px) << ',' << median(position_mm) << ',' << median(position_mm, 0.95) << ',' << median(angle_deg)
      << ',' << median(angle_deg, 0.95) << ',' << wrong << ',' << median(row.detect_ms) << ','
      << median(row.detect_ms, 0.95) << ',' << median(row.pose_ms) << ',' << median(row.pose_ms, 0.95) << ','
      << row.false_tags << ',' << row.false_bricks << std::endl;
}

class Evaluation {
 public:
  Evaluation(const BrickCatalogue& catalogue, std::ostream* out)
      : catalogue_(evaluationCatalogue(catalogue, kNumBoards)), estimator_(catalogue_, {}), out_(out) {
    TagDetectorConfig config;
    config.family = catalogue.tags.family;
    detector_ = makeTagDetector(config);
    config.decimate = 2.0;
    coarse_detector_ = makeTagDetector(config);
    if (catalogue.tags.family == "tag36h11") {
      peer_ = std::make_unique<LibapriltagAlone>(1.0);
      coarse_peer_ = std::make_unique<LibapriltagAlone>(2.0);
    }
    writeHeader(*out);
  }

  /// One tag, alone: distance by tilt.
  void grid(int num_poses) {
    std::vector<Row> summaries;
    for (const double distance_m : {0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0}) {
      for (double tilt_deg = 0.0; tilt_deg <= 70.0; tilt_deg += 10.0) {
        for (const Row& row : boards("grid", "", distance_m, tilt_deg, num_poses, usual(), 0.0)) {
          collect(row, &summaries);
        }
      }
    }
    for (const Row& row : summaries) write(row, *out_);
  }

  /// One effect at a time, 1 m, tilt from 0 to 60 degrees.
  void effects(int num_poses) {
    const auto run = [&](const std::string& name, const RenderEffects& effects, double hidden = 0.0) {
      boards("effect", name, 1.0, std::nan(""), num_poses, effects, hidden);
    };
    run("usual", usual());
    const auto vary = [&](const std::string& name, double RenderEffects::*member, const std::vector<double>& values) {
      for (const double value : values) {
        RenderEffects effects = usual();
        effects.*member = value;
        std::string text = std::to_string(value);
        text.erase(text.find_last_not_of('0') + 1);
        if (text.back() == '.') text.pop_back();
        run(name + " " + text, effects);
      }
    };
    vary("blur px", &RenderEffects::blur_sigma_px, {0.0, 1.0, 1.5, 2.0, 3.0});
    vary("noise grey", &RenderEffects::noise_std, {0.0, 5.0, 10.0, 20.0});
    vary("exposure", &RenderEffects::exposure, {0.5, 0.2, 0.1, 0.05});
    vary("contrast", &RenderEffects::contrast, {0.5, 0.2});
    vary("tone curve", &RenderEffects::gamma, {1.4, 2.2});
    vary("depth noise 1/m", &RenderEffects::depth_noise, {0.001, 0.006, 0.012});
    vary("depth holes", &RenderEffects::depth_holes, {0.2, 0.5, 1.0});
    for (const double motion_px : {2.0, 4.0, 8.0}) {
      RenderEffects effects = usual();
      effects.motion_px = motion_px * Eigen::Vector2d(0.8, 0.6);
      run("motion px " + std::to_string(static_cast<int>(motion_px)), effects);
    }
    RenderEffects effects = usual();
    effects.light_gradient = {1.5, 0.5};
    run("light from the side", effects);
    for (const double hidden : {0.05, 0.1, 0.2}) {
      run("hidden edge " + std::to_string(hidden).substr(0, 4), usual(), hidden);
    }
  }

  /// Whole bricks with all their tags, turned anyhow.
  void bricks(int num_poses) {
    for (const double distance_m : {0.5, 1.0, 1.5, 2.0, 3.0}) {
      std::vector<Row> rows = twoRows("brick", "", distance_m, std::nan(""));
      for (int pose = 0; pose < num_poses; ++pose) {
        Random random(seed_);
        RenderScene scene = emptyScene();
        const int id = pose % 20;
        scene.bricks = {
            catalogueBrick(catalogue_, id,
                           poseSeenAt(scene.camera, {random.uniform(160.0, 480.0), random.uniform(160.0, 320.0)},
                                      distance_m, random.uniform(0.0, CV_PI), random.uniform(0.0, 2.0 * CV_PI),
                                      random.uniform(0.0, 2.0 * CV_PI)))};
        measure(scene, usual(), id, &rows);
      }
      for (const Row& row : rows) write(row, *out_);
    }
  }

  void negatives(int num_images) {
    Row row;
    row.group = "tagless";
    row.name = std::to_string(num_images) + " images";
    for (int i = 0; i < num_images; ++i) {
      const cv::Mat grey = hardNegative(static_cast<HardNegative>(i % kNumHardNegatives),
                                        static_cast<std::uint32_t>(1000 + i / kNumHardNegatives));
      const ProcessorTime time;
      const std::vector<TagObservation> tags = detector_->detect(grey);
      row.detect_ms.push_back(time.ms());
      const auto result = estimator_.estimate(tags, vga(), cv::Mat(), grey);
      row.false_tags += static_cast<int>(tags.size());
      row.false_bricks += static_cast<int>(result.bricks.size());
    }
    write(row, *out_);
  }

  /// A pile of twelve bricks, the usual picture of this robot: time by decimation.
  void times(int num_images) {
    for (const bool is_coarse : {false, true}) {
      Row row;
      row.group = "time";
      row.name = is_coarse ? "pile; decimate 2" : "pile; decimate 1";
      row.has_depth = true;
      Row peer = row;
      peer.group = "peer time";
      peer.has_depth = false;
      row.distance_m = std::nan("");
      for (int i = 0; i < num_images; ++i) {
        Random random(static_cast<std::uint32_t>(7000 + i));
        RenderScene scene = emptyScene();
        scene.T_camera_ground = poseSeenAt(scene.camera, {320.0, 260.0}, 1.7, 0.8, CV_PI, 0.0);
        for (int k = 0; k < 12; ++k) {
          Eigen::Isometry3d T_camera_brick = *scene.T_camera_ground;
          T_camera_brick.translate(
              Eigen::Vector3d(random.uniform(-0.5, 0.5), random.uniform(-0.5, 0.5), 0.1 + 0.1 * (k / 4)));
          T_camera_brick.rotate(Eigen::AngleAxisd(random.uniform(0.0, 6.28), Eigen::Vector3d::UnitZ()) *
                                Eigen::AngleAxisd(random.uniform(-0.6, 0.6), Eigen::Vector3d::UnitX()));
          scene.bricks.push_back(catalogueBrick(catalogue_, k, T_camera_brick));
        }
        const RenderedView view = render(scene, usual(), static_cast<std::uint32_t>(i));
        const ProcessorTime detect_time;
        const std::vector<TagObservation> tags = (is_coarse ? coarse_detector_ : detector_)->detect(view.grey);
        row.detect_ms.push_back(detect_time.ms());
        const ProcessorTime pose_time;
        const auto result = estimator_.estimate(tags, scene.camera, view.depth_m, view.grey);
        row.pose_ms.push_back(pose_time.ms());
        std::vector<LibapriltagAlone::Tag> of_peer;
        if (peer_) {
          const ProcessorTime peer_time;
          of_peer =
              (is_coarse ? coarse_peer_ : peer_)->detect(view.grey, scene.camera, catalogue_.tags.black_border_edge_m);
          peer.detect_ms.push_back(peer_time.ms());
        }
        for (const RenderedTag& truth : view.tags) {
          // What a detector can be asked to find: the white margin counts too, so nothing may lie close by.
          if (truth.visible_share < 1.0 || truth.shortest_side_px < 12.0) continue;
          Sample sample;
          sample.side_px = truth.shortest_side_px;
          sample.is_detected =
              std::any_of(tags.begin(), tags.end(), [&](const auto& tag) { return tag.id == truth.id; });
          judge(result, scene.bricks[truth.brick_index].T_camera_brick, static_cast<int>(truth.brick_index), &sample);
          row.samples.push_back(sample);
          Sample by_peer;
          by_peer.side_px = truth.shortest_side_px;
          by_peer.is_detected =
              std::any_of(of_peer.begin(), of_peer.end(), [&](const auto& tag) { return tag.id == truth.id; });
          peer.samples.push_back(by_peer);
        }
      }
      write(row, *out_);
      if (peer_) write(peer, *out_);
    }
  }

 private:
  static constexpr int kNumBoards = 60;
  static constexpr const char* kPeer = "peer";

  static RenderScene emptyScene() {
    RenderScene scene;
    scene.camera = vga();
    return scene;
  }

  /// Adds a row of the grid to the summaries it belongs to.
  void collect(const Row& row, std::vector<Row>* summaries) const {
    const double edge_px = catalogue_.tags.black_border_edge_m / row.distance_m * vga().fx_px;
    const auto add = [&](const std::string& name, bool belongs, const auto& counts) {
      const auto known = std::find_if(summaries->begin(), summaries->end(), [&](const Row& summary) {
        return summary.name == name && summary.has_depth == row.has_depth &&
               (summary.group == "peer summary") == (row.group == kPeer);
      });
      Row& summary = known != summaries->end() ? *known : summaries->emplace_back();
      summary.group = row.group == kPeer ? "peer summary" : "summary";
      summary.name = name;
      summary.distance_m = std::nan("");
      summary.has_depth = row.has_depth;
      if (!belongs) return;
      for (const Sample& sample : row.samples) {
        if (counts(sample)) summary.samples.push_back(sample);
      }
      summary.detect_ms.insert(summary.detect_ms.end(), row.detect_ms.begin(), row.detect_ms.end());
      summary.pose_ms.insert(summary.pose_ms.end(), row.pose_ms.begin(), row.pose_ms.end());
    };
    const auto all = [](const Sample&) { return true; };
    const auto large = [](const Sample& sample) { return sample.side_px >= 30.0; };
    add("up to 1.5 m; tilt to 60 degrees", row.distance_m <= 1.5 && row.tilt_deg <= 60.0, all);
    add("up to 1.5 m; tilt 70 degrees", row.distance_m <= 1.5 && row.tilt_deg == 70.0, all);
    add("shortest side 30 px or more", true, large);
    add("edge from the front 30 px or more", edge_px >= 30.0, all);
    add("everything", true, all);
  }

  static std::vector<Row> twoRows(const std::string& group, const std::string& name, double distance_m,
                                  double tilt_deg) {
    std::vector<Row> rows(2);
    for (std::size_t i = 0; i < 2; ++i) {
      rows[i].group = group;
      rows[i].name = name;
      rows[i].distance_m = distance_m;
      rows[i].tilt_deg = tilt_deg;
      rows[i].has_depth = i == 1;
    }
    return rows;
  }

  /// `tilt_deg` NaN: anything up to 60. `hidden`: share of the border's width behind a bar along one edge.
  std::vector<Row> boards(const std::string& group, const std::string& name, double distance_m, double tilt_deg,
                          int num_poses, const RenderEffects& effects, double hidden) {
    std::vector<Row> rows = twoRows(group, name, distance_m, tilt_deg);
    if (peer_ && group == "grid") {
      rows.push_back(rows[0]);
      rows.back().group = kPeer;
    }
    for (int pose = 0; pose < num_poses; ++pose) {
      Random random(seed_);
      RenderScene scene = emptyScene();
      const double reach_px = 0.5 * std::sqrt(2.0) * kBoardEdge / distance_m * scene.camera.fx_px + 2.0;
      const Eigen::Vector2d pixel(random.uniform(reach_px, scene.camera.width_px - reach_px),
                                  random.uniform(reach_px, scene.camera.height_px - reach_px));
      const double tilt_rad = (std::isnan(tilt_deg) ? random.uniform(0.0, 60.0) : tilt_deg) * kDegree;
      const Eigen::Isometry3d T_camera_tag =
          poseSeenAt(scene.camera, pixel, distance_m, tilt_rad, random.uniform(0.0, 2.0 * CV_PI),
                     random.uniform(0.0, 2.0 * CV_PI));
      const int id = static_cast<int>(seed_ % kNumBoards);
      const RenderBrick board = catalogueBrick(catalogue_, 1000 + id, Eigen::Isometry3d::Identity());
      scene.bricks = {board};
      scene.bricks[0].T_camera_brick = T_camera_tag * board.tags.begin()->second.T_brick_tag.inverse();
      if (hidden > 0.0) {
        const double edge_m = catalogue_.tags.black_border_edge_m;
        RenderBox bar;
        bar.size_m = {0.05, 0.3, 0.002};
        bar.T_camera_box = T_camera_tag * Eigen::Translation3d((0.5 - hidden) * edge_m + 0.025, 0.0, 0.002);
        bar.color_rgb = {0.2, 0.25, 0.2};
        scene.boxes = {bar};
      }
      measure(scene, effects, 1000 + id, &rows);
    }
    for (const Row& row : rows) write(row, *out_);
    return rows;
  }

  /// Renders once, detects once, estimates without (rows[0]) and with depth (rows[1]).
  void measure(const RenderScene& scene, const RenderEffects& effects, int brick_id, std::vector<Row>* rows) {
    const RenderedView view = render(scene, effects, seed_++);
    const ProcessorTime detect_time;
    const std::vector<TagObservation> tags = detector_->detect(view.grey);
    const double detect_ms = detect_time.ms();
    double largest_side_px = 0.0;
    for (const RenderedTag& tag : view.tags) largest_side_px = std::max(largest_side_px, tag.shortest_side_px);
    for (Row& row : *rows) {
      if (row.group == kPeer) {
        row.samples.push_back(measurePeer(scene, view, largest_side_px, &row));
        continue;
      }
      const ProcessorTime pose_time;
      const auto result = estimator_.estimate(tags, scene.camera, row.has_depth ? view.depth_m : cv::Mat(), view.grey);
      row.pose_ms.push_back(pose_time.ms());
      row.detect_ms.push_back(detect_ms);
      Sample sample;
      sample.side_px = largest_side_px;
      sample.is_detected = std::any_of(result.tags.begin(), result.tags.end(),
                                       [&](const TagSighting& tag) { return tag.brick_id == brick_id; });
      judge(result, scene.bricks[0].T_camera_brick, brick_id, &sample);
      sample.is_ambiguous = !sample.is_used && std::any_of(result.tags.begin(), result.tags.end(), [](const auto& tag) {
        return tag.status == TagStatus::kAmbiguous;
      });
      row.false_bricks += static_cast<int>(result.bricks.size()) - (sample.is_used ? 1 : 0);
      row.samples.push_back(sample);
    }
  }

  /// On a scene of one board.
  Sample measurePeer(const RenderScene& scene, const RenderedView& view, double side_px, Row* row) {
    const auto& [tag_id, label] = *scene.bricks[0].tags.begin();
    const ProcessorTime time;
    const std::vector<LibapriltagAlone::Tag> tags = peer_->detect(view.grey, scene.camera, label.black_border_edge_m);
    row->detect_ms.push_back(time.ms());
    Sample sample;
    sample.side_px = side_px;
    for (const LibapriltagAlone::Tag& tag : tags) {
      if (tag.id != tag_id || sample.is_used) continue;
      sample.is_detected = true;
      compare(tag.T_camera_tag * label.T_brick_tag.inverse(), scene.bricks[0].T_camera_brick, &sample);
    }
    row->false_bricks += static_cast<int>(tags.size()) - (sample.is_used ? 1 : 0);
    return sample;
  }

  static void compare(const Eigen::Isometry3d& found, const Eigen::Isometry3d& truth, Sample* sample) {
    sample->is_used = true;
    sample->position_m = (found.translation() - truth.translation()).norm();
    const Eigen::Matrix3d R = found.linear().transpose() * truth.linear();
    sample->angle_rad = Eigen::AngleAxisd(R).angle();
    sample->normal_rad = std::acos(std::clamp(R(2, 2), -1.0, 1.0));
  }

  static void judge(const BrickPoseEstimator::Result& result, const Eigen::Isometry3d& T_camera_brick, int brick_id,
                    Sample* sample) {
    for (const BrickSighting& brick : result.bricks) {
      if (brick.brick_id != brick_id || sample->is_used) continue;
      compare(brick.T_camera_brick, T_camera_brick, sample);
    }
  }

  BrickCatalogue catalogue_;
  BrickPoseEstimator estimator_;
  std::unique_ptr<TagDetector> detector_;
  std::unique_ptr<TagDetector> coarse_detector_;
  std::unique_ptr<LibapriltagAlone> peer_;         ///< null for other families
  std::unique_ptr<LibapriltagAlone> coarse_peer_;  ///< as its defaults are
  std::ostream* out_;
  std::uint32_t seed_{1};
};

int run(int argc, char** argv) {
  namespace po = boost::program_options;
  std::string bricks;
  std::string out_path;
  int num_poses = 0;
  int num_tagless = 0;
  po::options_description options("evaluate_detection --bricks bricks.yaml --out results.csv [options]");
  options.add_options()("help,h", "this text")("bricks", po::value(&bricks)->required(), "the catalogue")(
      "out", po::value(&out_path)->required(), "CSV to write")("poses", po::value(&num_poses)->default_value(20),
                                                               "per distance and tilt; others take twice as many")(
      "tagless", po::value(&num_tagless)->default_value(1000), "images without tags");
  po::variables_map values;
  po::store(po::parse_command_line(argc, argv, options), values);
  if (values.count("help") > 0) {
    std::cout << options;
    return 0;
  }
  po::notify(values);
  if (num_poses < 1 || num_tagless < 0) throw std::invalid_argument("poses must be at least 1, tagless at least 0");
  std::ofstream out(out_path);
  if (!out) throw std::invalid_argument("out = " + out_path + ", must be a file that can be written");
  cv::setNumThreads(1);
  Evaluation evaluation(mp700_ur5e_description::loadBrickTypes(bricks), &out);
  evaluation.times(2 * num_poses);
  evaluation.grid(num_poses);
  evaluation.bricks(2 * num_poses);
  evaluation.effects(2 * num_poses);
  evaluation.negatives(num_tagless);
  if (!out) throw std::runtime_error("out = " + out_path + ": writing failed");
  return 0;
}

}  // namespace
}  // namespace brick_detection

int main(int argc, char** argv) {
  try {
    return brick_detection::run(argc, argv);
  } catch (const std::exception& error) {
    std::cerr << "evaluate_detection: " << error.what() << "\n";
    return 1;
  }
}
