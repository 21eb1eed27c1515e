// SPDX-License-Identifier: BSD-3-Clause
#include "nbv_selection/octomap_scene.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <tuple>
#include <unordered_map>
#include <utility>

#include <interactive_mapping_common/config/range_check.h>

namespace nbv_selection {
namespace {

using gpis_mapping::LatticeKey;
using gpis_mapping::LatticeKeyHash;
using gpis_mapping::Points3d;
using gpis_mapping::SpaceState;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr int kKeyOffset = 1 << 15;  // of an octree key against the lattice, whose voxel 0 begins at the origin
constexpr unsigned kTreeDepth = 16;  // of every octomap::OcTree
constexpr int kBlockLevel = 3;
constexpr int kBlockSide = 1 << kBlockLevel;  // [voxels]
constexpr double kMaxColumn_m = 3.0;          // what is farther above a voxel does not hide it; higher than any pile
constexpr double kMaxSideVoxels = 16.0;       // of a gradient cell or a band: what a point costs grows with its cube

// Of a normal [voxels]. One voxel sees the steps of a tilted floor (29 degrees off); a ball of three takes that down to
// 10 degrees, and on a level top only the outer two voxels lean by more than that.
constexpr int kNormalRadius = 3;

// Up first: who has free space on two opposite sides counts as a top.
constexpr std::array<std::array<int, 3>, 6> kFaces{
    {{0, 0, 1}, {1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, -1}}};

/// A cube of the lattice: what is known of each of its voxels, row by row along z.
struct Window {
  LatticeKey low;
  int side{0};  // [voxels]
  bool has_known{false};
  std::vector<float> entropy;  // [bit]
  std::vector<SpaceState> state;

  int index(int x, int y, int z) const { return (x * side + y) * side + z; }
};

struct Block {
  std::array<float, kBlockSide * kBlockSide * kBlockSide> entropy;
  std::array<SpaceState, kBlockSide * kBlockSide * kBlockSide> state;

  Block() {
    entropy.fill(1.0f);
    state.fill(SpaceState::kUnknown);
  }
  static std::size_t index(int x, int y, int z) {
    return static_cast<std::size_t>((x * kBlockSide + y) * kBlockSide + z);
  }
};

LatticeKey blockOf(const LatticeKey& voxel) {
  return {voxel.x >> kBlockLevel, voxel.y >> kBlockLevel, voxel.z >> kBlockLevel};
}
LatticeKey firstVoxelOf(const LatticeKey& block) {
  return {block.x * kBlockSide, block.y * kBlockSide, block.z * kBlockSide};
}

/// Nearest border between voxels.
int nearestBorder(double position_voxels) {
  return LatticeKey::of(Eigen::Vector3d::Constant(position_voxels + 0.5), 1.0).x;  // stays in the range of integers
}

std::string outOfRange(const char* key, double value, double low, double high, double resolution_m) {
  interactive_mapping::RangeCheck check;
  check(key, value, low, high, "m");
  if (check.problems().empty()) return "";
  std::ostringstream text;
  text << check.problems().front() << " for voxels of " << resolution_m << " m";
  return text.str();
}

}  // namespace

double voxelEntropy(double probability) {
  if (!(probability >= 0.0 && probability <= 1.0)) {
    throw std::invalid_argument("probability = " + std::to_string(probability) + ", must be in [0, 1]");
  }
  if (probability == 0.0 || probability == 1.0) return 0.0;
  return -probability * std::log2(probability) - (1.0 - probability) * std::log2(1.0 - probability);
}

struct OctomapScene::State {
  using Range = std::pair<std::size_t, std::size_t>;

  State(std::shared_ptr<const octomap::OcTree> octree, const Config& settings)
      : tree(std::move(octree)),
        config(settings),
        resolution_m(tree->getResolution()),
        cell_side(static_cast<int>(std::lround(settings.gradient_step_m / resolution_m))) {
    hashLeaves();
    findSurface();
  }

  void hashLeaves();
  void findSurface();
  void addSurfaceOf(const LatticeKey& block, const std::vector<LatticeKey>& offsets, Window* window);
  std::pair<SpaceState, float> stateOfUniform(const LatticeKey& block) const;
  void gather(const LatticeKey& low, int side, Window* window) const;
  void findInside(const Window& window, std::vector<std::uint8_t>* is_inside) const;
  SpaceState firstKnownAbove(LatticeKey voxel) const;
  Eigen::Vector3d middleOf(const LatticeKey& voxel) const { return voxel.center(resolution_m); }

  std::shared_ptr<const octomap::OcTree> tree;
  Config config;
  double resolution_m;
  int cell_side;  // of a cell of the gradient [voxels]

  // Only where voxels of a block differ or one of them has not been seen; the tree itself knows the uniform ones.
  std::unordered_map<LatticeKey, Block, LatticeKeyHash> blocks;
  std::vector<LatticeKey> occupied_blocks;  // with an occupied voxel, each once
  MappedSurface surface;                    // block by block
  std::unordered_map<LatticeKey, Range, LatticeKeyHash> surface_of_block;
};

void OctomapScene::State::hashLeaves() {
  LatticeKey last_key;
  Block* last = nullptr;
  float last_log_odds = std::numeric_limits<float>::quiet_NaN();
  float entropy = 1.0f;
  for (auto leaf = tree->begin_leafs(); leaf != tree->end_leafs(); ++leaf) {
    const bool is_occupied = tree->isNodeOccupied(*leaf);
    const octomap::OcTreeKey corner = leaf.getIndexKey();
    const LatticeKey voxel{corner[0] - kKeyOffset, corner[1] - kKeyOffset, corner[2] - kKeyOffset};
    const int side = 1 << (kTreeDepth - leaf.getDepth());
    const LatticeKey key = blockOf(voxel);
    if (side >= kBlockSide) {
      if (!is_occupied) continue;
      const int num = side / kBlockSide;
      for (int x = 0; x < num; ++x) {
        for (int y = 0; y < num; ++y) {
          // Free voxels are beside the leaf, not in it: its inner blocks have no surface.
          const bool is_inside = x > 0 && y > 0 && x < num - 1 && y < num - 1;
          for (int z = 0; z < num; z += is_inside && num > 1 ? num - 1 : 1) {
            occupied_blocks.push_back(key.offset(x, y, z));
          }
        }
      }
      continue;
    }
    if (last == nullptr || key != last_key) {  // leaves come block by block
      last_key = key;
      last = &blocks[key];
    }
    if (leaf->getLogOdds() != last_log_odds) {  // most are clamped: the same for many
      last_log_odds = leaf->getLogOdds();
      entropy = static_cast<float>(voxelEntropy(leaf->getOccupancy()));
    }
    if (is_occupied && (occupied_blocks.empty() || occupied_blocks.back() != key)) occupied_blocks.push_back(key);
    const LatticeKey first = firstVoxelOf(key);
    for (int x = 0; x < side; ++x) {
      for (int y = 0; y < side; ++y) {
        const std::size_t row = Block::index(voxel.x - first.x + x, voxel.y - first.y + y, voxel.z - first.z);
        std::fill_n(last->entropy.begin() + static_cast<std::ptrdiff_t>(row), side, entropy);
        std::fill_n(last->state.begin() + static_cast<std::ptrdiff_t>(row), side,
                    is_occupied ? SpaceState::kOccupied : SpaceState::kFree);
      }
    }
  }
}

/// Of a block that is not in `blocks`: all its voxels are the same.
std::pair<SpaceState, float> OctomapScene::State::stateOfUniform(const LatticeKey& block) const {
  constexpr int kMaxBlock = kKeyOffset / kBlockSide;
  for (const int i : {block.x, block.y, block.z}) {
    if (i < -kMaxBlock || i >= kMaxBlock) return {SpaceState::kUnknown, 1.0f};  // beyond what an octree can hold
  }
  const LatticeKey voxel = firstVoxelOf(block);
  const auto to_key = [](int i) { return static_cast<octomap::key_type>(i + kKeyOffset); };
  const octomap::OcTreeNode* node =
      tree->search(octomap::OcTreeKey(to_key(voxel.x), to_key(voxel.y), to_key(voxel.z)), kTreeDepth - kBlockLevel);
  if (node == nullptr) return {SpaceState::kUnknown, 1.0f};
  return {tree->isNodeOccupied(node) ? SpaceState::kOccupied : SpaceState::kFree,
          static_cast<float>(voxelEntropy(node->getOccupancy()))};
}

void OctomapScene::State::gather(const LatticeKey& low, int side, Window* window) const {
  window->low = low;
  window->side = side;
  window->has_known = false;
  window->entropy.assign(static_cast<std::size_t>(side * side * side), 1.0f);
  window->state.assign(window->entropy.size(), SpaceState::kUnknown);
  const LatticeKey first = blockOf(low);
  const LatticeKey last = blockOf(low.offset(side - 1, side - 1, side - 1));
  for (int bx = first.x; bx <= last.x; ++bx) {
    for (int by = first.y; by <= last.y; ++by) {
      for (int bz = first.z; bz <= last.z; ++bz) {
        const LatticeKey corner = firstVoxelOf({bx, by, bz});
        const auto block = blocks.find({bx, by, bz});
        SpaceState state = SpaceState::kUnknown;
        float entropy = 1.0f;
        if (block == blocks.end()) {
          std::tie(state, entropy) = stateOfUniform({bx, by, bz});
          if (state == SpaceState::kUnknown) continue;
        }
        window->has_known = true;
        const int z_begin = std::max(low.z, corner.z);
        const int num_z = std::min(low.z + side, corner.z + kBlockSide) - z_begin;
        for (int x = std::max(low.x, corner.x); x < std::min(low.x + side, corner.x + kBlockSide); ++x) {
          for (int y = std::max(low.y, corner.y); y < std::min(low.y + side, corner.y + kBlockSide); ++y) {
            const auto to = static_cast<std::ptrdiff_t>(window->index(x - low.x, y - low.y, z_begin - low.z));
            if (block == blocks.end()) {
              std::fill_n(window->state.begin() + to, num_z, state);
              std::fill_n(window->entropy.begin() + to, num_z, entropy);
            } else {
              const auto from =
                  static_cast<std::ptrdiff_t>(Block::index(x - corner.x, y - corner.y, z_begin - corner.z));
              std::copy_n(block->second.state.begin() + from, num_z, window->state.begin() + to);
              std::copy_n(block->second.entropy.begin() + from, num_z, window->entropy.begin() + to);
            }
          }
        }
      }
    }
  }
}

/// State of the lowest known voxel over `voxel`; unknown if there is none.
SpaceState OctomapScene::State::firstKnownAbove(LatticeKey voxel) const {
  const int last = voxel.z + static_cast<int>(std::min(kMaxColumn_m / resolution_m, 1e4));
  for (++voxel.z; voxel.z <= last;) {
    const LatticeKey key = blockOf(voxel);
    const LatticeKey corner = firstVoxelOf(key);
    const auto block = blocks.find(key);
    if (block == blocks.end()) {
      const SpaceState state = stateOfUniform(key).first;
      if (state != SpaceState::kUnknown) return state;
    } else {
      for (int z = voxel.z - corner.z; z < kBlockSide; ++z) {
        const SpaceState state = block->second.state[Block::index(voxel.x - corner.x, voxel.y - corner.y, z)];
        if (state != SpaceState::kUnknown) return state;
      }
    }
    voxel.z = corner.z + kBlockSide;
  }
  return SpaceState::kUnknown;
}

/// An unknown voxel is inside of something if the first known one above it is occupied.
void OctomapScene::State::findInside(const Window& window, std::vector<std::uint8_t>* is_inside) const {
  is_inside->assign(window.state.size(), 0);
  for (int x = 0; x < window.side; ++x) {
    for (int y = 0; y < window.side; ++y) {
      const auto bottom = static_cast<std::size_t>(window.index(x, y, 0));
      std::size_t at = bottom + static_cast<std::size_t>(window.side);
      SpaceState above = window.state[at - 1];
      if (above == SpaceState::kUnknown) above = firstKnownAbove(window.low.offset(x, y, window.side - 1));
      while (at-- > bottom) {
        if (window.state[at] != SpaceState::kUnknown) above = window.state[at];
        (*is_inside)[at] = window.state[at] == SpaceState::kUnknown && above == SpaceState::kOccupied ? 1 : 0;
      }
    }
  }
}

void OctomapScene::State::findSurface() {
  std::vector<LatticeKey> offsets;  // a ball
  for (int x = -kNormalRadius; x <= kNormalRadius; ++x) {
    for (int y = -kNormalRadius; y <= kNormalRadius; ++y) {
      for (int z = -kNormalRadius; z <= kNormalRadius; ++z) {
        const int square = x * x + y * y + z * z;
        if (square > 0 && square <= kNormalRadius * (kNormalRadius + 1)) offsets.push_back({x, y, z});
      }
    }
  }
  // The answer must not depend on how the tree was pruned. No block is there twice: leaves come block by block.
  std::sort(occupied_blocks.begin(), occupied_blocks.end());
  Window window;
  for (const LatticeKey& block : occupied_blocks) addSurfaceOf(block, offsets, &window);
}

void OctomapScene::State::addSurfaceOf(const LatticeKey& block, const std::vector<LatticeKey>& offsets,
                                       Window* window) {
  const LatticeKey corner = firstVoxelOf(block);
  gather(corner.offset(-kNormalRadius, -kNormalRadius, -kNormalRadius), kBlockSide + 2 * kNormalRadius, window);
  struct Step {
    int index;
    Eigen::Vector3f direction;
  };
  std::vector<Step> ball;
  for (const LatticeKey& o : offsets) {
    ball.push_back({window->index(o.x, o.y, o.z), Eigen::Vector3i(o.x, o.y, o.z).cast<float>().normalized()});
  }
  const std::size_t begin = surface.points_map.size();
  for (int x = 0; x < kBlockSide; ++x) {
    for (int y = 0; y < kBlockSide; ++y) {
      for (int z = 0; z < kBlockSide; ++z) {
        const int at = window->index(x + kNormalRadius, y + kNormalRadius, z + kNormalRadius);
        const auto is_free = [window, at](int step) {
          return window->state[static_cast<std::size_t>(at + step)] == SpaceState::kFree;
        };
        if (window->state[static_cast<std::size_t>(at)] != SpaceState::kOccupied) continue;
        // Faces alone: a ray enters a voxel through one. What has free space only beyond an edge or a corner is the
        // second layer, or a nook where two surfaces meet.
        const auto face = std::find_if(kFaces.begin(), kFaces.end(), [&](const std::array<int, 3>& step) {
          return is_free(window->index(step[0], step[1], step[2]));
        });
        if (face == kFaces.end()) continue;
        Eigen::Vector3f sum = Eigen::Vector3f::Zero();
        for (const Step& step : ball) {
          if (is_free(step.index)) sum += step.direction;
        }
        // Free on opposite sides alike, as a sheet of one voxel: the sum says nothing but rounding.
        const bool has_direction = sum.norm() > 1e-3f;
        surface.points_map.push_back(middleOf(corner.offset(x, y, z)));
        surface.normals_map.push_back(
            has_direction ? sum.normalized() : Eigen::Vector3i((*face)[0], (*face)[1], (*face)[2]).cast<float>());
        surface.uncertainty.push_back(window->entropy[static_cast<std::size_t>(at)]);
      }
    }
  }
  if (surface.points_map.size() > begin) surface_of_block[block] = {begin, surface.points_map.size()};
}

OctomapScene::OctomapScene(std::shared_ptr<const octomap::OcTree> tree, std::uint64_t update, double stamp_s,
                           const Config& config) {
  std::vector<std::string> problems = interactive_mapping::problemsOf(config);
  if (tree == nullptr) problems.emplace_back("tree = null, must be an octree");
  if (problems.empty()) {
    const double resolution_m = tree->getResolution();
    const double half_diagonal_m = 0.5 * std::sqrt(3.0) * resolution_m;  // nearer no point of a voxel need be
    problems.push_back(outOfRange("gradient_step_m", config.gradient_step_m, resolution_m,
                                  kMaxSideVoxels * resolution_m, resolution_m));
    problems.push_back(outOfRange("surface_band_m", config.surface_band_m, half_diagonal_m,
                                  kMaxSideVoxels * resolution_m, resolution_m));
    problems.erase(std::remove(problems.begin(), problems.end(), ""), problems.end());
  }
  interactive_mapping::refuseIfAny("impossible scene:", problems);
  auto state = std::make_unique<State>(std::move(tree), config);
  state->surface.update = update;
  state->surface.stamp_s = stamp_s;
  state_ = std::move(state);
}

OctomapScene::~OctomapScene() = default;

MappedSurface OctomapScene::surface() const {
  return state_->surface;
}

UncertaintyField OctomapScene::uncertainty(const Points3d& points_map) const {
  UncertaintyField field;
  field.value = Eigen::VectorXd::Constant(points_map.cols(), kNan);
  field.gradient = Points3d::Constant(3, points_map.cols(), kNan);
  const int n = state_->cell_side;
  Window window;
  std::vector<std::uint8_t> is_inside;  // of the window's voxels
  for (Eigen::Index i = 0; i < points_map.cols(); ++i) {
    if (!points_map.col(i).allFinite()) continue;
    const Eigen::Vector3d p_voxels = points_map.col(i) / state_->resolution_m;
    // The cells on either side of the border between voxels that is nearest to the point.
    const std::array<int, 3> border{nearestBorder(p_voxels.x()), nearestBorder(p_voxels.y()),
                                    nearestBorder(p_voxels.z())};
    state_->gather({border[0] - n, border[1] - n, border[2] - n}, 2 * n, &window);
    if (!window.has_known) {
      field.value[i] = 1.0;
      field.gradient.col(i).setZero();
      continue;
    }
    state_->findInside(window, &is_inside);
    const auto mean_over = [&](const std::array<int, 3>& low) -> std::optional<double> {  // `low` in the window
      double sum = 0.0;
      int num = 0;
      for (int x = low[0]; x < low[0] + n; ++x) {
        for (int y = low[1]; y < low[1] + n; ++y) {
          for (int z = low[2]; z < low[2] + n; ++z) {
            const auto at = static_cast<std::size_t>(window.index(x, y, z));
            if (is_inside[at] != 0) continue;
            sum += static_cast<double>(window.entropy[at]);
            ++num;
          }
        }
      }
      return num == 0 ? std::nullopt : std::optional<double>(sum / num);
    };
    std::array<int, 3> about{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      about[axis] = nearestBorder(p_voxels[static_cast<Eigen::Index>(axis)] - 0.5 * n) - (border[axis] - n);
    }
    field.value[i] = mean_over(about).value_or(1.0);  // inside of something: not seen, though nothing to look at
    for (std::size_t axis = 0; axis < 3; ++axis) {
      std::array<int, 3> low = about;
      low[axis] = 0;
      const std::optional<double> below = mean_over(low);
      low[axis] = n;
      const std::optional<double> above = mean_over(low);
      field.gradient(static_cast<Eigen::Index>(axis), i) =
          above && below ? (*above - *below) / (n * state_->resolution_m) : 0.0;
    }
  }
  return field;
}

OccupancyField OctomapScene::occupancy(const Points3d& points_map) const {
  OccupancyField field;
  field.probability = Eigen::VectorXd::Zero(points_map.cols());
  field.normal = Points3d::Zero(3, points_map.cols());
  field.is_supported.assign(static_cast<std::size_t>(points_map.cols()), false);
  const double band_m = state_->config.surface_band_m;
  const double block_m = kBlockSide * state_->resolution_m;
  const MappedSurface& surface = state_->surface;
  for (Eigen::Index i = 0; i < points_map.cols(); ++i) {
    const Eigen::Vector3d p = points_map.col(i);
    if (!p.allFinite()) continue;
    const LatticeKey low = LatticeKey::of(p - Eigen::Vector3d::Constant(band_m), block_m);
    const LatticeKey high = LatticeKey::of(p + Eigen::Vector3d::Constant(band_m), block_m);
    double nearest2 = band_m * band_m;
    std::size_t nearest = surface.points_map.size();
    for (int x = low.x; x <= high.x; ++x) {
      for (int y = low.y; y <= high.y; ++y) {
        for (int z = low.z; z <= high.z; ++z) {
          const auto range = state_->surface_of_block.find({x, y, z});
          if (range == state_->surface_of_block.end()) continue;
          for (std::size_t j = range->second.first; j < range->second.second; ++j) {
            const double distance2 = (surface.points_map[j] - p).squaredNorm();
            // Equally near: the first, as blocks come in the surface's order.
            if (distance2 < nearest2) {
              nearest2 = distance2;
              nearest = j;
            }
          }
        }
      }
    }
    if (nearest == surface.points_map.size()) continue;
    const octomap::OcTreeNode* node = state_->tree->search(p.x(), p.y(), p.z());
    if (node == nullptr) continue;
    field.probability[i] = node->getOccupancy();
    field.normal.col(i) = surface.normals_map[nearest].cast<double>();
    field.is_supported[static_cast<std::size_t>(i)] = true;
  }
  return field;
}

}  // namespace nbv_selection
