// SPDX-License-Identifier: BSD-3-Clause
// How large the simulated piles are to the choice of views: the ground they cover and the segments of their outlines.
#include <cmath>
#include <cstdio>
#include <string>

#include <gmock/gmock.h>
#include <mp700_ur5e_description/base_profile.h>
#include <mp700_ur5e_description/brick_types.h>

#include "nbv_selection/outline.h"
#include "nbv_selection/segment.h"
#include "simulated_world/pickable.h"
#include "simulated_world/pile_surface.h"
#include "simulated_world/settle.h"

namespace simulated_world {
namespace {

struct Extent {
  int bricks{0};
  int decoys{0};
  int unpickable{0};
  double area_m2{0.0};  ///< of the ground that the pile covers, gaps up to the outline's closing among it
  int outlines{0};
  int segments{0};
};

/// By the true surface, as if all of it had been mapped, with the selection's own defaults.
Extent extentOf(const std::string& name) {
  const mp700_ur5e_description::BrickCatalogue catalogue = mp700_ur5e_description::loadBrickTypes(BRICKS_YAML);
  const auto profile = mp700_ur5e_description::loadBaseProfile(MP700_UR5E_DESCRIPTION_DIR "/config/base_profile.yaml");
  const PileScene scene =
      settlePile(loadPileScene(SIMULATED_WORLDS "/" + name + ".yaml", catalogue.types, catalogue.maxBricks()), 1).scene;
  PileSurface pile{PileSurfaceConfig()};
  std::vector<PileBrick> bricks;
  Extent extent;
  for (const BrickPlacement& brick : scene.bricks) {
    bricks.push_back({brick.id, brick.T_map_brick, brick.type.size_m, true});
    extent.decoys += brick.decoy == Decoy::kNone ? 0 : 1;
  }
  pile.update(bricks);
  nbv_selection::MappedSurface surface;
  for (const PileTruth::Sample& sample : pile.truth()->exposed) {
    surface.points_map.push_back(sample.p_map);
    surface.normals_map.emplace_back(sample.normal_map.cast<float>());
  }
  surface.uncertainty.assign(surface.points_map.size(), 0.0F);
  const nbv_selection::PileOutline outline =
      nbv_selection::outlinePile(surface, gpis_mapping::GroundPlane(), nbv_selection::OutlineConfig());
  extent.bricks = static_cast<int>(bricks.size());
  extent.unpickable = static_cast<int>(unpickable(scene.bricks, 90.0).size());
  for (const std::uint8_t is_pile : outline.grid.is_pile) {
    extent.area_m2 += is_pile != 0 ? outline.grid.cell_size_m * outline.grid.cell_size_m : 0.0;
  }
  extent.outlines = static_cast<int>(outline.polygons.size());
  base_navigation::Polygon footprint(profile.body.footprint_m.begin(), profile.body.footprint_m.end());
  extent.segments =
      static_cast<int>(nbv_selection::cutSegments(outline, footprint, nbv_selection::SegmentConfig()).size());
  return extent;
}

/// For `worlds/README.md`.
Extent printed(const char* name) {
  const Extent extent = extentOf(name);
  std::printf("| `%s` | %d | %d | %d | %.1f m2 | %d | %d |\n", name, extent.bricks, extent.decoys, extent.unpickable,
              extent.area_m2, extent.outlines, extent.segments);
  return extent;
}

TEST(OutlinesOfWorlds, LargeTippedPileHasFiftySegments) {
  EXPECT_GE(printed("tipped_40").segments, 50);
}

TEST(OutlinesOfWorlds, ATenthToAFifthAreDecoys) {
  const Extent extent = printed("decoys");
  EXPECT_GE(extent.decoys, 0.1 * extent.bricks);
  EXPECT_LE(extent.decoys, 0.2 * extent.bricks);
  EXPECT_GT(extent.unpickable, 2);
}

}  // namespace
}  // namespace simulated_world
