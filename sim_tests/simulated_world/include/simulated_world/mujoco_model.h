// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <string>

#include <Eigen/Geometry>
#include <mujoco/mujoco.h>

namespace simulated_world {

struct ModelDeleter {
  void operator()(mjModel* model) const { mj_deleteModel(model); }
};
struct DataDeleter {
  void operator()(mjData* data) const { mj_deleteData(data); }
};
using ModelPtr = std::unique_ptr<mjModel, ModelDeleter>;
using DataPtr = std::unique_ptr<mjData, DataDeleter>;

/// Compiles an MJCF document. Throws std::runtime_error with the compiler's message.
ModelPtr compileModel(const std::string& mjcf);

/// Fresh state of a model. Throws std::bad_alloc.
DataPtr makeData(const mjModel& model);

/// Id of a named object. Throws std::invalid_argument with the kind and name if there is none.
int requireId(const mjModel& model, mjtObj type, const std::string& name);

/// Pose of a body frame in the world frame, as of the last mj_kinematics (mj_step, mj_forward).
Eigen::Isometry3d bodyPose(const mjData& data, int body);

/// MuJoCo's quaternion order is w, x, y, z.
Eigen::Quaterniond quaternionFrom(const mjtNum* wxyz);
void quaternionTo(const Eigen::Quaterniond& q, mjtNum* wxyz);

/// Pixels of texture `texture`, `tex_height` rows of `tex_width` RGB triples; renamed in MuJoCo 3.2.
unsigned char* texturePixels(mjModel& model, int texture);

/// What MuJoCo reports as an error would end the process; from now on it is thrown as std::runtime_error. Warnings are
/// counted and dropped. Idempotent; called by compileModel().
void installErrorHandlers();

/// Warnings since the process started (full contact buffer, bad state, ...), with the last one's text.
struct WarningCount {
  int count{0};
  std::string last;
};
WarningCount mujocoWarnings();

}  // namespace simulated_world
