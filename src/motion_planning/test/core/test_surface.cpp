// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning/surface.h"

#include <gpis_mapping/gpis_map.h>
#include <gtest/gtest.h>

namespace motion_planning {
namespace {

TEST(SnapshotView, AnswersUnknownInAnEmptyMap) {
  const gpis_mapping::GpisMap map{gpis_mapping::GpisConfig()};
  const SnapshotView view(map.snapshot());
  gpis_mapping::Points3d points(3, 2);
  points << 0.0, 1.0, 0.0, 1.0, 0.0, 1.0;
  const MapAnswers answers = view.query(points);
  ASSERT_EQ(answers.state.size(), 2u);
  EXPECT_EQ(answers.state[0], gpis_mapping::SpaceState::kUnknown);
  EXPECT_TRUE(std::isnan(answers.distance_m[1]));
  EXPECT_TRUE(std::isnan(answers.surface_std_m[1]));
}

}  // namespace
}  // namespace motion_planning
