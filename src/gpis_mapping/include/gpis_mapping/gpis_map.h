// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_GPIS_MAP_H
#define GPIS_MAPPING_GPIS_MAP_H

#include <algorithm>
#include <functional>
#include <limits>
#include <memory>
#include <mutex>
#include <unordered_map>
#include <utility>
#include <vector>

#include <Eigen/Geometry>

#include "gpis_mapping/cell_gp.h"
#include "gpis_mapping/depth_classifier.h"
#include "gpis_mapping/frame_map.h"
#include "gpis_mapping/gpis_config.h"
#include "gpis_mapping/map_snapshot.h"
#include "gpis_mapping/observed_layer.h"
#include "gpis_mapping/types.h"

namespace gpis_mapping {

class Frame;
struct CameraMotion;
struct FrameBlanket;

/// What one update did, and how long each stage took [ms].
struct UpdateStatistics {
  double total_ms{0};
  double classify_ms{0};  // pixels to inverse range; walls, shadows, no information
  double regress_ms{0};   // 2.5D^-1 map
  double fuse_ms{0};      // delete, fuse, ignore
  double insert_ms{0};
  double train_ms{0};
  double observe_ms{0};      // free space
  double publish_ms{0};      // snapshot
  std::size_t points_in{0};  // measured pixels
  std::size_t inserted{0};
  std::size_t fused{0};
  std::size_t deleted{0};
  std::size_t occluded{0};
  std::size_t map_points{0};
  std::size_t cells_retrained{0};
  std::size_t cells_looked_at{0};                   // to find those in view; with each search counted
  std::size_t cells_copied{0};                      // into pages of the snapshot
  std::vector<Eigen::Vector3d> removed_points_map;  // where points were deleted
  Eigen::AlignedBox3d view_box_map;                 // see DepthClassifier::viewBox()
};

/// What is remembered of the camera from image to image.
struct CameraView {
  CameraModel camera;
  // Row major; pixels outside of the stated field of view do not measure. Depth that is registered to a colour image has
  // margins that never do.
  std::vector<PixelHistory> pixel_history;
  int num_full{0};  // images so far with a depth at more than half of the pixels
  Eigen::Isometry3d T_map_camera{Eigen::Isometry3d::Identity()};  // of the last image
  double stamp_s{-std::numeric_limits<double>::infinity()};
  int num_displaced{0};        // images running that lay off the map as a whole
  std::size_t num_surface{0};  // pixels with a depth in the last image that had any
};

/// Everything that is kept of a map: what save writes and load restores, but for the view, which is camera 0's. GPs are
/// trained from it.
struct MapContents {
  GpisConfig config;
  double epoch_s{0.0};
  std::uint64_t num_updates{0};
  std::vector<SurfacePoint> points;
  ObservedLayer observed{0.05};
  CameraView view;
};

/// The dynamic Gaussian-process implicit surface (Algorithm 1).
/// One thread updates; snapshots are taken and queried from any thread meanwhile.
/// Long: the stages of an update change the same cells, in one order.
class GpisMap {
 public:
  /// Throws std::invalid_argument listing every impossible value.
  explicit GpisMap(const GpisConfig& config);
  /// Restores a saved map; trains all its cells.
  explicit GpisMap(MapContents contents);
  ~GpisMap();

  /// Takes in one depth image seen from `T_map_camera` (optical frame to map) at `stamp_s` [s].
  /// Throws std::invalid_argument, and leaves the map as it was, if the image does not fit the camera or the camera is
  /// impossible. So it does if pose or stamp are not finite or the pose is no rigid motion. `blanket`: filled, unless
  /// null. `camera_index` tells several cameras apart: speed and field of view are those of each. Images of different
  /// cameras may have equal stamps, or come a little out of order.
  UpdateStatistics update(const DepthImage& image, const CameraModel& camera, const Eigen::Isometry3d& T_map_camera,
                          double stamp_s, FrameBlanket* blanket = nullptr, std::size_t camera_index = 0);

  /// Forgets what lies inside the box: points, and that space was seen free there. `T_map_box` is the pose of its centre,
  /// `size_m` its edge lengths. Returns the points removed [m, map frame]. Throws std::invalid_argument, and leaves the map
  /// as it was, unless the pose is rigid and all edges are finite and positive. Call from the updating thread.
  std::vector<Eigen::Vector3d> clearBox(const Eigen::Isometry3d& T_map_box, const Eigen::Vector3d& size_m);

  /// A solid that filled the box was taken away at `stamp_s` [s]. Forgets the points in it and within `padding_m` of
  /// it. Also forgets them where it may have been before it came to the box, moved by up to `moved_m` [m, map frame].
  /// The box is free from now on: the caller took the solid. Space beside it that was free before stays free, although
  /// the surface that showed this is gone. Returns the points removed [m, map frame]. Throws as clearBox(), also for an
  /// edge above 2 m, a negative padding, or a stamp or a move that is not finite. Call from the updating thread.
  std::vector<Eigen::Vector3d> takeOut(const Eigen::Isometry3d& T_map_box, const Eigen::Vector3d& size_m,
                                       double padding_m, double stamp_s,
                                       const Eigen::Vector3d& moved_m = Eigen::Vector3d::Zero());

  /// Changes what may change while the map lives, from the next update on; what is mapped stays. Throws
  /// std::invalid_argument listing every impossible value and changes nothing then. Call from the updating thread.
  void retune(const GpisConfig::Sensor& sensor, const GpisConfig::Dynamic& dynamic);

  /// The map after the last update. Never null.
  std::shared_ptr<const MapSnapshot> snapshot() const;

  /// A copy of what save needs. Call from the updating thread.
  MapContents contents() const;

  const GpisConfig& config() const { return config_; }

 private:
  /// A cell as the updating thread sees it. Defined here: GCC 9 has no map of an incomplete type.
  struct Cell {
    /// A training point, and where it stood when the cells around were last told of a change.
    struct Entry {
      SurfacePoint point;
      Eigen::Vector3d reported_position;
      float reported_std;
      // Number of the update that fused it last, 0: none. Stamps of an old map are too coarse to tell images apart.
      std::uint32_t fused_in{0};
    };

    std::vector<Entry> entries;
    std::shared_ptr<const CellGp> gp;
    bool dirty{false};        // a point came or went: train in this update
    float num_changes{0.0f};  // points that moved or firmed up since the last training
  };
  struct CellUpdate;

  struct RemovedPoint {
    std::uint64_t update;  // in which it was removed
    SurfacePoint point;
  };

  /// The cells by place, and by blocks of 8 x 8 x 8 cells, so that what is far from an image costs nothing.
  class CellMap {
   public:
    using Cells = std::unordered_map<LatticeKey, Cell, LatticeKeyHash>;
    using value_type = Cells::value_type;

    Cell& operator[](const LatticeKey& key) {
      const auto [at, is_new] = cells_.try_emplace(key);
      if (is_new) blocks_[blockOf(key)].push_back(&*at);
      return at->second;
    }
    void erase(const LatticeKey& key);
    Cells::iterator find(const LatticeKey& key) { return cells_.find(key); }
    Cells::const_iterator find(const LatticeKey& key) const { return cells_.find(key); }
    Cells::iterator begin() { return cells_.begin(); }
    Cells::const_iterator begin() const { return cells_.begin(); }
    Cells::iterator end() { return cells_.end(); }
    Cells::const_iterator end() const { return cells_.end(); }
    Cell& at(const LatticeKey& key) { return cells_.at(key); }

    /// Of all blocks that pass `mayHold(center [cells], side [cells])` the cells that pass `isWanted(key)`, sorted by
    /// place.
    template <typename BlockTest, typename CellTest>
    std::vector<value_type*> select(const BlockTest& mayHold, const CellTest& isWanted) {
      std::vector<value_type*> selected;
      for (const auto& [block, cells] : blocks_) {
        const Eigen::Vector3d middle = block.corner(kBlockCells) + Eigen::Vector3d::Constant(0.5 * (kBlockCells - 1));
        if (!mayHold(middle, kBlockCells)) continue;
        for (value_type* const cell : cells) {
          ++num_looked_at_;
          if (isWanted(cell->first)) selected.push_back(cell);
        }
      }
      // The hash maps' order depends on their history.
      std::sort(selected.begin(), selected.end(),
                [](const value_type* a, const value_type* b) { return a->first < b->first; });
      return selected;
    }

    /// Cells that select() has tested since the last call.
    std::size_t numLookedAt() { return std::exchange(num_looked_at_, 0); }

   private:
    static constexpr int kBlockShift = 3;
    static constexpr int kBlockCells = 1 << kBlockShift;
    static LatticeKey blockOf(const LatticeKey& key) {
      return {key.x >> kBlockShift, key.y >> kBlockShift, key.z >> kBlockShift};
    }

    Cells cells_;  // pointers to its entries last as long as these
    std::unordered_map<LatticeKey, std::vector<value_type*>, LatticeKeyHash> blocks_;
    std::size_t num_looked_at_{0};
  };

  /// How far a point may drift out of its cell before it changes to another [m]. Without it points on a border would
  /// have their cells trained again in every update.
  double strayTolerance() const { return 0.25 * config_.surface.spacing_m; }

  /// Without publishing. `isInside`: in the map frame.
  std::vector<Eigen::Vector3d> removePoints(const std::function<bool(const Eigen::Vector3d&)>& isInside);
  /// Makes this camera's eye the present one.
  void selectCamera(std::size_t index);
  void prepareCamera(const CameraModel& camera);
  /// How fast the camera has moved to this pose since the last image; at rest if that was long ago.
  CameraMotion motionTo(const Eigen::Isometry3d& T_map_camera, double stamp_s) const;
  /// Lets the frame allow for its misalignment with the map, unless that lasts: then the map is wrong.
  void allowForMisalignment(Frame* frame);
  /// Remembers which pixels can measure a depth.
  void learnView(const ClassifiedFrame& pixels);
  /// Cells with points of which the image may show a part, sorted by place.
  std::vector<CellMap::value_type*> cellsInView(const Frame& frame);
  /// `pixels`: the frame's; holes in which a surface has vanished become wall.
  void fuseAndDelete(const Frame& frame, ClassifiedFrame* pixels, UpdateStatistics* statistics);
  void rememberRemoved(const std::vector<CellUpdate>& jobs);
  /// Decides which points in holes of the depth image are gone.
  void judgeHoles(const Frame& frame, ClassifiedFrame* pixels, std::vector<CellUpdate>* jobs);
  /// Doubtful points lie within a few pixels of a depth edge, where one image cannot decide. The face they belong to
  /// can: a point goes when more of its face was removed lately than is confirmed by this frame.
  void decideDoubtful(std::vector<CellUpdate>* jobs);
  /// Of points that lie nearer than insertion would have let them, the less known one goes. Such points come from
  /// objects that come and go. A point measured at the foot of an object is fused with the ground below it.
  void thinOut(const std::vector<CellUpdate>& jobs);
  void insertNew(const Frame& frame, UpdateStatistics* statistics);
  void train(UpdateStatistics* statistics);
  void publish();
  /// Is there a point of the same face within the spacing, or of any face within half of it? Along the normal the noise
  /// of both counts, if that is more.
  bool hasNeighbour(const Eigen::Vector3d& p_map, const Eigen::Vector3f& normal_map, double variance_m2) const;
  void markTouched(const LatticeKey& key, std::uint32_t neighbour_mask);
  std::uint32_t neighbourMask(const LatticeKey& key, const Eigen::Vector3d& p_map) const;

  GpisConfig config_;
  CellMap cells_;
  std::vector<LatticeKey> to_train_;  // cells that became dirty or changed since they were last looked at for training
  CellPages trained_;                 // the cells of the next snapshot
  ObservedLayer observed_;
  double epoch_s_{0.0};
  std::uint64_t num_updates_{0};
  std::unordered_map<LatticeKey, std::vector<RemovedPoint>, LatticeKeyHash> recently_removed_;

  /// What is remembered of a camera, and tables of its size.
  struct Eye {
    CameraView view;
    CameraModel camera;
    std::unique_ptr<DepthClassifier> classifier;
    std::shared_ptr<const FrameRegressor> regressor;
  };
  std::size_t camera_index_{0};
  Eye eye_;  // of the selected camera; those of the others are kept aside
  std::unordered_map<std::size_t, Eye> other_eyes_;

  mutable std::mutex snapshot_mutex_;  // guards snapshot_
  std::shared_ptr<const MapSnapshot> snapshot_;
};

}  // namespace gpis_mapping

#endif  // GPIS_MAPPING_GPIS_MAP_H
