// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/mujoco_model.h"

#include <cstring>
#include <mutex>
#include <new>
#include <stdexcept>

namespace simulated_world {
namespace {

std::mutex warning_mutex;  // guards warnings
WarningCount warnings;

void throwError(const char* message) {
  throw std::runtime_error(std::string("MuJoCo: ") + message);
}

void countWarning(const char* message) {
  const std::lock_guard<std::mutex> lock(warning_mutex);
  ++warnings.count;
  warnings.last = message;
}

}  // namespace

void installErrorHandlers() {
  static std::once_flag once;
  std::call_once(once, [] {
    mju_user_error = throwError;
    mju_user_warning = countWarning;
  });
}

WarningCount mujocoWarnings() {
  const std::lock_guard<std::mutex> lock(warning_mutex);
  return warnings;
}

ModelPtr compileModel(const std::string& mjcf) {
  installErrorHandlers();
  // The compiler reads files only; a virtual file keeps the document in memory.
  constexpr const char* kName = "world.xml";
  auto files = std::make_unique<mjVFS>();
  mj_defaultVFS(files.get());
  if (mj_makeEmptyFileVFS(files.get(), kName, static_cast<int>(mjcf.size())) != 0) {
    throw std::runtime_error("MuJoCo: no room for a model of " + std::to_string(mjcf.size()) + " bytes");
  }
  std::memcpy(files->filedata[files->nfile - 1], mjcf.data(), mjcf.size());
  char error[1000] = "";
  ModelPtr model(mj_loadXML(kName, files.get(), error, sizeof error));
  mj_deleteVFS(files.get());
  if (!model) {
    throw std::runtime_error(std::string("MuJoCo: ") + error);
  }
  return model;
}

DataPtr makeData(const mjModel& model) {
  DataPtr data(mj_makeData(&model));
  if (!data) {
    throw std::bad_alloc();
  }
  return data;
}

int requireId(const mjModel& model, mjtObj type, const std::string& name) {
  const int id = mj_name2id(&model, type, name.c_str());
  if (id < 0) {
    throw std::invalid_argument(std::string("the model has no ") + mju_type2Str(type) + " \"" + name + "\"");
  }
  return id;
}

Eigen::Isometry3d bodyPose(const mjData& data, int body) {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.translation() = Eigen::Map<const Eigen::Vector3d>(data.xpos + 3 * body);
  pose.linear() = quaternionFrom(data.xquat + 4 * body).toRotationMatrix();
  return pose;
}

Eigen::Quaterniond quaternionFrom(const mjtNum* wxyz) {
  return {wxyz[0], wxyz[1], wxyz[2], wxyz[3]};
}

void quaternionTo(const Eigen::Quaterniond& q, mjtNum* wxyz) {
  wxyz[0] = q.w();
  wxyz[1] = q.x();
  wxyz[2] = q.y();
  wxyz[3] = q.z();
}

unsigned char* texturePixels(mjModel& model, int texture) {
#if mjVERSION_HEADER >= 320
  return model.tex_data + model.tex_adr[texture];
#else
  return model.tex_rgb + model.tex_adr[texture];
#endif
}

}  // namespace simulated_world
