// SPDX-License-Identifier: BSD-3-Clause
// Targets that work on a map: images and poses, cameras, map files, queries.
#include <zlib.h>

#include <algorithm>
#include <cstring>
#include <limits>
#include <optional>

#include "fuzz/fuzz_engine.h"
#include "fuzz/small_map.h"
#include "fuzz/targets.h"
#include "gpis_mapping/map_io.h"
#include "gpis_mapping/mesh_extractor.h"

namespace gpis_mapping_fuzz {
namespace {

using gpis_mapping::CameraModel;
using gpis_mapping::DepthImage;
using gpis_mapping::GpisConfig;
using gpis_mapping::GpisMap;
using gpis_mapping::HolePolicy;
using gpis_mapping::loadMap;
using gpis_mapping::MapContents;
using gpis_mapping::MapFileError;
using gpis_mapping::MapSnapshot;
using gpis_mapping::MeshExtractor;
using gpis_mapping::Points3d;
using gpis_mapping::QueryOptions;
using gpis_mapping::saveMap;

/// Feeds one image; a refusal must leave the map as it was.
Outcome feedMap(GpisMap* map, const DepthImage& image, const CameraModel& camera, const Eigen::Isometry3d& pose,
                double stamp_s) {
  const std::shared_ptr<const MapSnapshot> before = map->snapshot();
  const std::uint64_t checksum = checksumOf(map->contents());
  try {
    map->update(image, camera, pose, stamp_s);
  } catch (const std::invalid_argument&) {
    require(map->snapshot() == before, "a refused image replaced the snapshot");
    require(checksumOf(map->contents()) == checksum, "a refused image changed the map");
    return Outcome::kRefused;
  }
  const MapContents contents = map->contents();
  requireSound(contents);
  require(map->snapshot()->numPoints() == contents.points.size(), "the snapshot has another number of points");
  return Outcome::kAccepted;
}

void requireSoundMesh(const MapSnapshot& snapshot, MeshExtractor* extractor) {
  extractor->update(snapshot);
  const gpis_mapping::TriangleMesh mesh = extractor->mesh();
  for (std::size_t i = 0; i < mesh.vertices_map.size(); ++i) {
    require(mesh.vertices_map[i].allFinite() && mesh.normals_map[i].allFinite() && std::isfinite(mesh.variance_m2[i]),
            "a vertex of the mesh is not finite");
  }
  for (const auto& triangle : mesh.triangles) {
    for (const std::uint32_t index : triangle) require(index < mesh.vertices_map.size(), "a triangle without vertex");
  }
}

/// Images of all kinds, poses and stamps into one map after another.
class ImageTarget : public Target {
 public:
  explicit ImageTarget(Random* random) : map_(someConfig(random)), extractor_(map_.config()) {
    const auto [width, height] = random->pick<std::pair<int, int>>({{24, 18}, {24, 18}, {32, 24}, {17, 19}, {64, 16}});
    camera_ = smallCamera(width, height);
    const double away = random->pick({0.0, 0.0, 0.0, 3e3, 1e6});
    middle_ = Eigen::Vector3d(away, -away, 0.3 * away);
  }

  Outcome feed(Random* random) override {
    Eigen::Isometry3d pose = somePose(middle_, random);
    DepthImage image = renderScene(camera_, pose, middle_, random->chance(0.7), random);
    CameraModel camera = camera_;
    stamp_s_ += 0.1;
    double stamp_s = stamp_s_;
    bool must_refuse = false;
    bool may_refuse = false;
    if (random->chance(0.6)) corrupt(&image, random);
    if (random->chance(0.1)) must_refuse |= spoilSize(&image, &camera, random);
    if (random->chance(0.1)) must_refuse |= spoilPose(&pose, random, &may_refuse);
    if (random->chance(0.1)) must_refuse |= spoilStamp(&stamp_s, random, &may_refuse);

    const Outcome outcome = feedMap(&map_, image, camera, pose, stamp_s);
    require(!must_refuse || outcome == Outcome::kRefused, "took what it must refuse");
    require(must_refuse || may_refuse || outcome == Outcome::kAccepted, "refused what is in order");
    if (outcome == Outcome::kRefused) return outcome;
    if (random->chance(0.5)) requireSoundAnswers(*map_.snapshot(), random);
    if (random->chance(0.02)) clear(random);
    if (random->chance(0.03)) requireSoundMesh(*map_.snapshot(), &extractor_);
    if (random->chance(0.05)) {
      static const ScratchFolder folder;
      saveMap(map_.contents(), folder.file("map.gpis"));
      const GpisMap restored(loadMap(folder.file("map.gpis")));
      require(checksumOf(restored.contents()) == checksumOf(map_.contents()), "saving and loading changed the map");
    }
    return outcome;
  }

 private:
  static GpisConfig someConfig(Random* random) {
    GpisConfig config = smallConfig();
    config.sensor.hole_policy = random->pick({HolePolicy::kAuto, HolePolicy::kWall, HolePolicy::kNoInformation});
    config.sensor.baseline_m = random->pick({0.0, 0.05, 1.0});
    config.sensor.pose_std_m = random->pick({0.0, 0.004, 0.1});
    config.sensor.noise = {random->pick({0.0005, 0.05}), 0.0, random->pick({0.0, 0.0017, 0.1})};
    config.dynamic.enabled = random->chance(0.9);
    config.dynamic.min_tolerance_m = random->pick({0.0, 0.012, 0.2});
    if (random->chance(0.1)) {  // the shipped sizes
      config.surface = {};
      config.cells = {};
    }
    config.surface.min_noise_std_m = random->pick({1e-4, 0.001, 0.05});
    config.surface.signal_std_m = random->pick({0.0, 0.0, 0.001, 1.0});
    config.region.min_m.setConstant(-1e7);
    config.region.max_m.setConstant(1e7);
    config.frame_map.tile_px = random->pick({4, 4, 4, 4, 4, 4, 4, 8});
    return config;
  }

  static void corrupt(DepthImage* image, Random* random) {
    std::vector<float>& depth = image->depth_m;
    switch (random->below(7)) {
      case 0: {  // single pixels of any value
        const double share = random->pick({0.01, 0.1, 0.5, 1.0});
        for (float& z : depth) {
          if (random->chance(share)) z = random->oddFloat();
        }
        return;
      }
      case 1: {  // all the same
        const float value = random->oddFloat();
        std::fill(depth.begin(), depth.end(), value);
        return;
      }
      case 2: {  // a rectangle of one value
        const float value = random->oddFloat();
        const int u0 = random->between(0, image->width - 1), u1 = random->between(u0, image->width - 1);
        const int v0 = random->between(0, image->height - 1), v1 = random->between(v0, image->height - 1);
        for (int v = v0; v <= v1; ++v) {
          for (int u = u0; u <= u1; ++u) depth[static_cast<std::size_t>(v) * image->width + u] = value;
        }
        return;
      }
      case 3: {  // another scale or offset
        const float factor = random->pick({1e-3f, 0.5f, 1.01f, 2.0f, 1e3f, -1.0f, 1e-38f, 1e38f});
        for (float& z : depth) z *= factor;
        return;
      }
      case 4: {  // as a 16-bit driver would deliver it, in some unit
        std::vector<std::uint16_t> raw;
        for (const float z : depth) {
          raw.push_back(z > 0.0f && z < 60.0f ? static_cast<std::uint16_t>(1000.0f * z)
                                              : random->pick<std::uint16_t>({0, 1, 65535, 65534}));
        }
        *image = depth_camera::depthImageFromU16(raw.data(), image->width, image->height,
                                                 random->pick({1000.0, 1000.0, 5000.0, 1.0, 1e-3, 1e300, 1e-300}));
        return;
      }
      case 5: {  // depth noise of any size
        const double size = random->pick({0.001, 0.01, 0.1, 1.0});
        for (float& z : depth) z += static_cast<float>(random->uniform(-size, size));
        return;
      }
      default: {  // rows shifted, as by a broken transfer
        const std::size_t shift = random->below(depth.size());
        std::rotate(depth.begin(), depth.begin() + static_cast<std::ptrdiff_t>(shift), depth.end());
      }
    }
  }

  /// A box of any size and pose.
  void clear(Random* random) {
    Eigen::Isometry3d T_map_box = Eigen::Isometry3d::Identity();
    T_map_box.translation() = middle_ + Eigen::Vector3d(random->uniform(-1, 1), random->uniform(-1, 1), 0.0);
    Eigen::Vector3d size(random->uniform(0.0, 0.5), random->uniform(0.0, 0.5), random->uniform(0.0, 0.5));
    if (random->chance(0.3)) size[random->between(0, 2)] = random->oddDouble();
    if (random->chance(0.3)) T_map_box.matrix()(random->between(0, 2), random->between(0, 3)) = random->oddDouble();
    const std::uint64_t checksum = checksumOf(map_.contents());
    const std::size_t before = map_.contents().points.size();
    try {
      const std::size_t removed = map_.clearBox(T_map_box, size).size();
      require(map_.contents().points.size() + removed == before, "more or fewer points went than were reported");
    } catch (const std::invalid_argument&) {
      require(checksumOf(map_.contents()) == checksum, "a refused box changed the map");
    }
    requireSound(map_.contents());
  }

  /// Image, values and camera no longer agree.
  static bool spoilSize(DepthImage* image, CameraModel* camera, Random* random) {
    switch (random->below(5)) {
      case 0:
        image->width = random->oddInt();
        break;
      case 1:
        image->height = random->oddInt();
        break;
      case 2:
        image->depth_m.resize(random->below(4096));
        break;
      case 3:
        camera->width = random->oddInt();
        break;
      default:
        *image = {random->between(0, 64), random->between(0, 64), {}};
        image->depth_m.resize(random->chance(0.5) ? static_cast<std::size_t>(image->width) * image->height
                                                  : random->below(4096));
    }
    return image->width != camera->width || image->height != camera->height || image->width < 16 ||
           image->height < 16 ||
           image->depth_m.size() != static_cast<std::size_t>(image->width) * static_cast<std::size_t>(image->height);
  }

  static bool spoilPose(Eigen::Isometry3d* pose, Random* random, bool* may_refuse) {
    switch (random->below(6)) {
      case 0: {
        const double value = random->oddDouble();
        pose->translation()[random->between(0, 2)] = value;
        *may_refuse = true;  // there may be a limit on distances
        return !std::isfinite(value);
      }
      case 1: {
        const int entry = random->between(0, 8);
        const double value = random->oddDouble();
        const double before = pose->linear()(entry % 3, entry / 3);
        pose->linear()(entry % 3, entry / 3) = value;
        *may_refuse = true;
        return !(std::abs(value - before) < 0.01);
      }
      case 2:
        pose->linear() *= random->pick({0.0, 0.99, 1.01, 1e9, -1.0});
        return true;
      case 3:
        pose->linear().col(0) *= -1.0;
        return true;
      case 4:
        pose->translation() += Eigen::Vector3d::Constant(random->pick({1e9, -1e9, 5e8, 1e4}));
        *may_refuse = true;
        return false;
      default:
        pose->linear() = Eigen::AngleAxisd(random->uniform(0.0, 3.0), Eigen::Vector3d::UnitX()).toRotationMatrix();
        return false;
    }
  }

  static bool spoilStamp(double* stamp_s, Random* random, bool* may_refuse) {
    if (random->chance(0.5)) {
      *stamp_s -= random->uniform(0.0, 50.0);  // backwards
      return false;
    }
    *stamp_s = random->oddDouble();
    *may_refuse = true;
    return !std::isfinite(*stamp_s);
  }

  GpisMap map_;
  MeshExtractor extractor_;
  CameraModel camera_;
  Eigen::Vector3d middle_;
  double stamp_s_{1000.0};
};

/// Camera models into one map; those of absurd size must be refused before anything is allocated for them.
class CameraTarget : public Target {
 public:
  CameraTarget() : map_(smallConfig()) {}

  Outcome feed(Random* random) override {
    CameraModel camera = smallCamera(random->between(16, 40), random->between(16, 40));
    int spoils = random->between(0, 2);
    bool in_order = spoils == 0;
    while (spoils-- > 0) {
      switch (random->below(6)) {
        case 0:
          camera.width = random->oddInt();
          break;
        case 1:
          camera.height = random->oddInt();
          break;
        case 2:
          camera.fx = random->oddDouble();
          break;
        case 3:
          camera.fy = random->oddDouble();
          break;
        case 4:
          camera.cx = random->oddDouble();
          break;
        default:
          camera.cy = random->oddDouble();
      }
    }
    const bool bad_number = !(camera.fx > 0.0) || !(camera.fy > 0.0) || !std::isfinite(camera.fx) ||
                            !std::isfinite(camera.fy) || !std::isfinite(camera.cx) || !std::isfinite(camera.cy);
    const bool bad_size = camera.width < 16 || camera.height < 16 || camera.width > 8192 || camera.height > 8192;
    const bool fits = !bad_size && camera.width <= 64 && camera.height <= 64;
    require(camera.validate().empty() || !in_order, "a good camera is called impossible");
    require(!camera.validate().empty() || !(bad_number || bad_size), "an impossible camera is called good");

    const Eigen::Isometry3d pose = somePose(Eigen::Vector3d::Zero(), random);
    // Rendered with a camera in order: what matters is that the map gets depths.
    DepthImage image{camera.width, camera.height, {}};
    const CameraModel eye = smallCamera(fits ? camera.width : 32, fits ? camera.height : 24);
    image.depth_m = renderScene(eye, pose, Eigen::Vector3d::Zero(), true, random).depth_m;
    const Outcome outcome = feedMap(&map_, image, camera, pose, 1000.0 + 0.1 * count_++);
    require(outcome == Outcome::kRefused || (fits && !bad_number), "took an impossible camera");
    require(outcome == Outcome::kAccepted || !in_order, "refused a good camera");
    if (outcome == Outcome::kAccepted) requireSoundAnswers(*map_.snapshot(), random);
    return outcome;
  }

 private:
  GpisMap map_;
  int count_{0};
};

/// Damaged map files, most with their checksum made right again, so that the damage reaches the parser.
class MapFileTarget : public Target {
 public:
  MapFileTarget() : path_(folder_.file("map.gpis")) {
    static const std::string kGood = [this] {
      saveMap(smallMap(), path_);
      return readFile(path_);
    }();
    good_ = &kGood;
  }

  Outcome feed(Random* random) override {
    std::string bytes = damaged(random);
    if (random->chance(0.9)) makeConsistent(&bytes, random);
    writeFile(path_, bytes);
    std::optional<MapContents> contents;
    try {
      contents.emplace(loadMap(path_));
    } catch (const MapFileError& error) {
      require(std::string(error.what()).find(path_) == 0, "a refusal does not name the file");
      return Outcome::kRefused;
    }
    use(std::move(*contents), random);
    return Outcome::kAccepted;
  }

 private:
  static constexpr std::size_t kHeader = 24;

  struct Section {
    std::size_t begin;  // of the tag
    std::size_t end;    // of the payload
  };

  /// As the file is laid out, while its lengths can be believed.
  static std::vector<Section> sectionsOf(const std::string& bytes) {
    std::vector<Section> sections;
    for (std::size_t at = kHeader; at + 12 + 4 <= bytes.size();) {
      std::uint64_t length = 0;
      std::memcpy(&length, &bytes[at + 4], sizeof(length));
      if (length > bytes.size() - at - 12 - 4) break;
      sections.push_back({at, at + 12 + static_cast<std::size_t>(length)});
      at = sections.back().end;
    }
    return sections;
  }

  std::string damaged(Random* random) const {
    std::string bytes = *good_;
    const std::vector<Section> sections = sectionsOf(bytes);
    const Section& section = random->pick(sections);
    const std::size_t payload = section.begin + 12;
    switch (random->below(8)) {
      case 0:  // anywhere: mostly the chunks, which are the most of it
        return mutateBytes(std::move(bytes), random);
      case 1: {  // length of a section
        const std::uint64_t length =
            random->pick<std::uint64_t>({0, 1, section.end - payload - 1, section.end - payload + 1, bytes.size(),
                                         1ULL << 31, 1ULL << 63, ~0ULL, ~0ULL - 11, random->next()});
        std::memcpy(&bytes[section.begin + 4], &length, sizeof(length));
        return bytes;
      }
      case 2: {  // sections swapped
        const Section& other = random->pick(sections);
        const auto& [first, second] = std::minmax(section, other, [](auto& a, auto& b) { return a.begin < b.begin; });
        if (first.begin == second.begin) return bytes;
        return bytes.substr(0, first.begin) + bytes.substr(second.begin, second.end - second.begin) +
               bytes.substr(first.end, second.begin - first.end) + bytes.substr(first.begin, first.end - first.begin) +
               bytes.substr(second.end);
      }
      case 3:
        return mutateBytes(bytes.substr(0, kHeader), random) + bytes.substr(kHeader);
      case 4:
        bytes.resize(random->below(bytes.size()));
        return bytes;
      default: {  // inside a section, its length made right
        std::string inside = bytes.substr(payload, section.end - payload);
        if (section.begin == kHeader) {
          inside = mutateText(std::move(inside), yamlDictionary(), random);
        } else if (random->chance(0.5) && inside.size() > 60) {  // a number in place, among the first records
          const std::size_t at = random->below(std::min<std::size_t>(inside.size() - 8, 520));
          const double value = random->oddDouble();
          const float single = random->oddFloat();
          if (random->chance(0.5)) {
            std::memcpy(&inside[at / 4 * 4], &value, sizeof(value));
          } else {
            std::memcpy(&inside[at / 4 * 4], &single, sizeof(single));
          }
        } else {
          inside = mutateBytes(std::move(inside), random);
        }
        const std::uint64_t length = inside.size();
        std::memcpy(&bytes[section.begin + 4], &length, sizeof(length));
        return bytes.replace(payload, section.end - payload, inside);
      }
    }
  }

  /// The length in the header and the checksum as a careful forger would write them.
  static void makeConsistent(std::string* bytes, Random* random) {
    if (bytes->size() < kHeader + 4) return;
    const std::uint64_t length = bytes->size();
    if (random->chance(0.95)) std::memcpy(&(*bytes)[16], &length, sizeof(length));
    const auto* data = reinterpret_cast<const Bytef*>(bytes->data());
    const auto crc = static_cast<std::uint32_t>(::crc32(0L, data, static_cast<uInt>(bytes->size() - 4)));
    std::memcpy(&(*bytes)[bytes->size() - 4], &crc, 4);
  }

  /// What was accepted must be a map like any other.
  void use(MapContents contents, Random* random) const {
    requireSound(contents);
    require(contents.config.validate().empty(), "a loaded configuration is impossible");
    contents.config.threads = 1;
    const int window = contents.config.frame_map.tile_px + 2 * contents.config.frame_map.overlap_px;
    GpisMap map(std::move(contents));
    requireSoundAnswers(*map.snapshot(), random);
    if (!random->chance(0.25) || window > 10) return;  // the frame regressor of a large window takes seconds
    const CameraModel camera = smallCamera(24, 18);
    const Eigen::Isometry3d pose = somePose(Eigen::Vector3d::Zero(), random);
    const DepthImage image = renderScene(camera, pose, Eigen::Vector3d::Zero(), random->chance(0.7), random);
    for (int i = 0; i < 2; ++i) {
      require(feedMap(&map, image, camera, pose, map.contents().epoch_s + 10.0 + i) == Outcome::kAccepted,
              "a loaded map refuses an image that is in order");
      requireSoundAnswers(*map.snapshot(), random);
    }
    MeshExtractor extractor(map.config());
    requireSoundMesh(*map.snapshot(), &extractor);
    saveMap(map.contents(), path_);
    require(checksumOf(loadMap(path_)) == checksumOf(map.contents()), "saving and loading changed the map");
  }

  ScratchFolder folder_;
  std::string path_;
  const std::string* good_;
};

/// Questions about a map that is in order.
class QueryTarget : public Target {
 public:
  QueryTarget() {
    static const GpisMap kMap(smallMap());
    static const GpisMap kEmpty(smallConfig());
    map_ = kMap.snapshot();
    empty_ = kEmpty.snapshot();
  }

  Outcome feed(Random* random) override {
    const MapSnapshot& map = random->chance(0.97) ? *map_ : *empty_;
    Points3d points(3, random->between(0, random->pick({1, 4, 12})));
    bool all_finite = true;
    for (Eigen::Index i = 0; i < points.cols(); ++i) {
      points.col(i) = somePoint(random);
      all_finite = all_finite && points.col(i).allFinite();
    }
    QueryOptions options;
    options.threads = random->pick({1, 1, 1, 1, 1, 1, 2, -3});
    options.variance = random->chance(0.7);
    options.variance_gradient = random->chance(0.3);
    requireSoundAnswers(map, points, options);
    if (points.cols() == 0) return Outcome::kAccepted;
    const Eigen::Vector3d p = points.col(0);
    const gpis_mapping::FieldSample field = map.field(p);
    require(!field.valid || (std::isfinite(field.value) && field.gradient.allFinite() && p.allFinite()),
            "the field is valid but not finite");
    map.state(p, random->oddDouble());
    map.observed().lastFree(p);
    // An answer depends on its own point only.
    options.variance_gradient = false;
    const double together = map.query(points, options).distance[0];
    const double alone = map.query(Points3d(p), options).distance[0];
    require(together == alone || (std::isnan(together) && std::isnan(alone)), "an answer depends on its neighbours");
    return all_finite ? Outcome::kAccepted : Outcome::kRefused;
  }

 private:
  static Eigen::Vector3d somePoint(Random* random) {
    Eigen::Vector3d p(random->uniform(-1.0, 1.0), random->uniform(-1.0, 1.0), random->uniform(-0.2, 0.8));
    switch (random->below(8)) {
      case 0:
        p = Eigen::Vector3d::NullaryExpr([&](Eigen::Index) { return random->oddDouble(); });
        break;
      case 1:
        p[random->between(0, 2)] = random->oddDouble();
        break;
      case 2:  // on the borders of cells
        p = (p * 10.0).array().round() * 0.1;
        break;
      case 3:
        p *= random->pick({1e-300, 1e-9, 3.0, 1e3, 1e7, 1e12, 1e300});
        break;
      default:
        break;
    }
    return p;
  }

  std::shared_ptr<const MapSnapshot> map_;
  std::shared_ptr<const MapSnapshot> empty_;
};

}  // namespace

std::vector<TargetInfo> mapTargets() {
  return {
      {"images", 30000, 50, [](Random* random) { return std::make_unique<ImageTarget>(random); }},
      {"cameras", 20000, 50, [](Random*) { return std::make_unique<CameraTarget>(); }},
      {"map_files", 40000, 1000, [](Random*) { return std::make_unique<MapFileTarget>(); }},
      {"queries", 300000, 1000, [](Random*) { return std::make_unique<QueryTarget>(); }},
  };
}

}  // namespace gpis_mapping_fuzz
