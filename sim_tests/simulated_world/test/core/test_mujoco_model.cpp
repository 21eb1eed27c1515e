// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/mujoco_model.h"

#include <stdexcept>

#include <gmock/gmock.h>
#include <interactive_mapping_common/testing/temporary_folder.h>

namespace simulated_world {
namespace {

using test_support::messageOf;
using ::testing::HasSubstr;

constexpr const char* kTwoBodies = R"(
<mujoco>
  <worldbody>
    <body name="turned" pos="1 2 3" quat="0.7071067811865476 0 0 0.7071067811865476">
      <freejoint/>
      <geom type="box" size="0.1 0.1 0.1"/>
    </body>
  </worldbody>
</mujoco>)";

TEST(MujocoModel, ReportsPoseOfBody) {
  const ModelPtr model = compileModel(kTwoBodies);
  const DataPtr data = makeData(*model);
  mj_forward(model.get(), data.get());
  const Eigen::Isometry3d pose = bodyPose(*data, requireId(*model, mjOBJ_BODY, "turned"));
  // Rounding of the printed quaternion.
  EXPECT_TRUE(pose.translation().isApprox(Eigen::Vector3d(1, 2, 3), 1e-12));
  EXPECT_TRUE((pose.linear() * Eigen::Vector3d::UnitX()).isApprox(Eigen::Vector3d::UnitY(), 1e-12));
}

TEST(MujocoModel, QuaternionsGoThereAndBack) {
  const Eigen::Quaterniond q = Eigen::Quaterniond(0.1, -0.4, 0.3, 0.8).normalized();
  mjtNum wxyz[4];
  quaternionTo(q, wxyz);
  EXPECT_EQ(wxyz[0], q.w());
  EXPECT_TRUE(quaternionFrom(wxyz).isApprox(q, 1e-15));
}

TEST(MujocoModel, RefusesWhatIsNoModel) {
  EXPECT_THAT(
      messageOf<std::runtime_error>([&] { compileModel("<mujoco><worldbody><geom size='-1'/></worldbody></mujoco>"); }),
      HasSubstr("size"));
  EXPECT_THROW(compileModel(""), std::runtime_error);
}

TEST(MujocoModel, NamesTheMissingObject) {
  const ModelPtr model = compileModel(kTwoBodies);
  EXPECT_THAT(messageOf<std::invalid_argument>([&] { requireId(*model, mjOBJ_BODY, "brick_7"); }),
              HasSubstr("body \"brick_7\""));
}

}  // namespace
}  // namespace simulated_world
