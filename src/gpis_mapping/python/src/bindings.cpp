// SPDX-License-Identifier: BSD-3-Clause
// The Python module gpis_mapping._core. What its functions take and give stands in gpis_mapping/_core.pyi.
#include <algorithm>
#include <cstdint>
#include <exception>
#include <memory>
#include <mutex>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <interactive_mapping_common/files/atomic_file.h>
#include "gpis_mapping/depth_sequence.h"
#include "gpis_mapping/gpis_map.h"
#include "gpis_mapping/map_io.h"
#include "gpis_mapping/mesh_extractor.h"
#include "gpis_mapping/ply.h"

namespace py = pybind11;

namespace {

using gpis_mapping::CameraModel;
using gpis_mapping::DepthFrame;
using gpis_mapping::DepthImage;
using gpis_mapping::DepthSequence;
using gpis_mapping::DepthSequenceError;
using gpis_mapping::GpisConfig;
using gpis_mapping::GpisMap;
using gpis_mapping::MapContents;
using gpis_mapping::MapFileError;
using gpis_mapping::MapSnapshot;
using gpis_mapping::MeshExtractor;
using gpis_mapping::Points3d;
using gpis_mapping::QueryOptions;
using gpis_mapping::QueryResult;
using gpis_mapping::SpaceState;
using gpis_mapping::TriangleMesh;
using gpis_mapping::UpdateStatistics;

// Images farther apart in time than 1 s do not tell the map how fast the camera moved.
constexpr double kStampStep_s = 2.0;

constexpr int kContiguous = py::array::c_style | py::array::forcecast;

std::string typeOf(const py::object& value) {
  return Py_TYPE(value.ptr())->tp_name;  // py::type needs pybind11 2.6
}

std::string shapeOf(const py::array& array) {
  return py::str(array.attr("shape"));
}

[[noreturn]] void refuse(const std::string& what, const std::string& seen, const std::string& allowed) {
  throw std::invalid_argument(what + ": " + seen + ", must be " + allowed);
}

/// `value` as numbers in a shape that the caller checks.
py::array_t<double, kContiguous> numbers(const char* what, const py::object& value, const char* allowed) {
  const py::array array = py::array::ensure(value);
  if (!array) refuse(what, "no array of numbers", allowed);
  const std::string kind = py::str(array.dtype().attr("kind"));
  if (kind != "f" && kind != "i" && kind != "u") {
    refuse(what, "dtype " + std::string(py::str(array.dtype())), "of real numbers");
  }
  return py::array_t<double, kContiguous>::ensure(array);
}

DepthImage depthImage(const py::object& depth, double units_per_metre) {
  const char* const what = "depth";
  if (!py::isinstance<py::array>(depth)) {
    refuse(what, "a " + typeOf(depth), "a numpy array (H, W)");
  }
  const auto array = py::reinterpret_borrow<py::array>(depth);
  if (array.ndim() != 2) refuse(what, "shape " + shapeOf(array), "(H, W)");
  constexpr Py_ssize_t kMaxSide = 1 << 16;  // the map allows less, and says so
  if (array.shape(0) > kMaxSide || array.shape(1) > kMaxSide) {
    refuse(what, "shape " + shapeOf(array), "at most " + std::to_string(kMaxSide) + " along a side");
  }
  const int height = static_cast<int>(array.shape(0));
  const int width = static_cast<int>(array.shape(1));
  if (py::isinstance<py::array_t<std::uint16_t>>(array)) {
    const auto raw = py::array_t<std::uint16_t, kContiguous>::ensure(array);
    return depth_camera::depthImageFromU16(raw.data(), width, height, units_per_metre);
  }
  if (!py::isinstance<py::array_t<float>>(array)) {
    refuse(what, "dtype " + std::string(py::str(array.dtype())), "float32 (metres) or uint16 (depth_units_per_metre)");
  }
  const auto metres = py::array_t<float, kContiguous>::ensure(array);
  return {width, height, std::vector<float>(metres.data(), metres.data() + metres.size())};
}

CameraModel cameraOf(const py::object& intrinsics, const DepthImage& image) {
  constexpr const char* kAllowed = "(fx, fy, cx, cy), or a (3, 3) camera matrix without skew";
  const auto values = numbers("intrinsics", intrinsics, kAllowed);
  const double* k = values.data();
  if (values.ndim() == 1 && values.shape(0) == 4) return {image.width, image.height, k[0], k[1], k[2], k[3]};
  if (values.ndim() != 2 || values.shape(0) != 3 || values.shape(1) != 3) {
    refuse("intrinsics", "shape " + shapeOf(values), kAllowed);
  }
  if (k[1] != 0.0 || k[3] != 0.0 || k[6] != 0.0 || k[7] != 0.0 || k[8] != 1.0) {
    refuse("intrinsics", std::string(py::str(values.attr("tolist")())), "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]");
  }
  return {image.width, image.height, k[0], k[4], k[2], k[5]};
}

Eigen::Isometry3d poseOf(const py::object& pose) {
  const auto values = numbers("pose", pose, "a (4, 4) matrix");
  if (values.ndim() != 2 || values.shape(0) != 4 || values.shape(1) != 4) {
    refuse("pose", "shape " + shapeOf(values), "(4, 4)");
  }
  const Eigen::Matrix4d matrix = Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(values.data());
  if (matrix.allFinite() && matrix.row(3) != Eigen::RowVector4d(0.0, 0.0, 0.0, 1.0)) {
    std::ostringstream row;
    row << "last row " << matrix.row(3);
    refuse("pose", row.str(), "0 0 0 1");
  }
  Eigen::Isometry3d T_map_camera;
  T_map_camera.matrix() = matrix;
  return T_map_camera;
}

Points3d pointsOf(const py::object& points) {
  const auto values = numbers("points", points, "(N, 3)");
  if (values.ndim() != 2 || values.shape(1) != 3) refuse("points", "shape " + shapeOf(values), "(N, 3)");
  return Eigen::Map<const Points3d>(values.data(), 3, values.shape(0));
}

/// Arrays that show the memory of `owner`, which they keep alive.
template <typename T>
py::array viewOf(const py::object& owner, std::vector<Py_ssize_t> shape, const T* data) {
  return py::array_t<T>(std::move(shape), data, owner);
}
py::array viewOf(const py::object& owner, const Eigen::VectorXd& values) {
  return viewOf(owner, {values.size()}, values.data());
}
py::array viewOf(const py::object& owner, const Points3d& points) {
  return viewOf(owner, {points.cols(), 3}, points.data());
}
py::array viewOf(const py::object& owner, const std::vector<float>& values) {
  return viewOf(owner, {static_cast<Py_ssize_t>(values.size())}, values.data());
}
py::array viewOf(const py::object& owner, const std::vector<SpaceState>& states) {
  return viewOf(owner, {static_cast<Py_ssize_t>(states.size())}, reinterpret_cast<const std::uint8_t*>(states.data()));
}
/// Rows of three: vertices, normals, triangles.
template <typename Row>
py::array viewOf(const py::object& owner, const std::vector<Row>& rows) {
  const auto* const first = rows.empty() ? nullptr : rows.front().data();
  return viewOf(owner, {static_cast<Py_ssize_t>(rows.size()), 3}, first);
}

template <typename Class, typename Member>
void defineArray(py::class_<Class>* type, const char* name, Member Class::*member, const char* doc) {
  type->def_property_readonly(
      name, [member](const py::object& self) { return viewOf(self, self.cast<const Class&>().*member); }, doc);
}

py::str toText(const py::object& path) {
  return py::module_::import("os").attr("fspath")(path);
}

GpisConfig configOf(const py::object& config) {
  if (config.is_none()) return {};
  if (!py::isinstance<py::dict>(config)) {
    if (!py::isinstance<py::str>(config) && !py::hasattr(config, "__fspath__")) {
      refuse("config", "a " + typeOf(config), "a dict, the path of a YAML file, or None");
    }
    return gpis_mapping::loadGpisConfig(toText(config));
  }
  // JSON is YAML. numpy's numbers and arrays have tolist().
  const py::cpp_function plain([](const py::object& value) -> py::object {
    if (py::hasattr(value, "tolist")) return value.attr("tolist")();
    refuse("config", "a value of type " + typeOf(value), "numbers, texts, lists and dicts");
  });
  const py::str text = py::module_::import("json").attr("dumps")(config, py::arg("default") = plain);
  return gpis_mapping::parseGpisConfig(text, "config");
}

/// The map with what Python expects of an object: any thread may call any function at any time.
class PythonMap {
 public:
  explicit PythonMap(const GpisConfig& config) : map_(config), extractor_(config) {}
  explicit PythonMap(MapContents contents)
      : next_stamp_s_(nextStamp(contents)), map_(std::move(contents)), extractor_(map_.config()) {}

  UpdateStatistics integrate(const DepthImage& image, const CameraModel& camera, const Eigen::Isometry3d& T_map_camera,
                             std::optional<double> stamp_s) {
    const std::lock_guard<std::mutex> lock(update_mutex_);
    const double at_s = stamp_s.value_or(next_stamp_s_);
    UpdateStatistics statistics = map_.update(image, camera, T_map_camera, at_s);
    next_stamp_s_ = at_s + kStampStep_s;
    return statistics;
  }

  TriangleMesh mesh() {
    const std::lock_guard<std::mutex> lock(mesh_mutex_);
    extractor_.update(*map_.snapshot());
    return extractor_.mesh();
  }

  void save(const std::string& path) {
    std::unique_lock<std::mutex> lock(update_mutex_);
    const MapContents contents = map_.contents();
    lock.unlock();
    gpis_mapping::saveMap(contents, path);
  }

  std::shared_ptr<const MapSnapshot> snapshot() const { return map_.snapshot(); }

 private:
  static double nextStamp(const MapContents& contents) {
    double last_s = 0.0;
    for (const auto& point : contents.points) last_s = std::max(last_s, static_cast<double>(point.last_seen_s));
    return contents.epoch_s + last_s + kStampStep_s;
  }

  std::mutex update_mutex_;  // guards next_stamp_s_, and map_ against a second updating thread
  double next_stamp_s_{0.0};
  GpisMap map_;
  std::mutex mesh_mutex_;  // guards extractor_
  MeshExtractor extractor_;
};

/// A recording as Python sees it: one thread reads at a time.
class PythonSequence {
 public:
  PythonSequence(const std::string& path, std::optional<double> units_per_metre)
      : sequence_(gpis_mapping::openDepthSequence(path, units_per_metre)) {}

  std::size_t size() const { return sequence_->size(); }
  const CameraModel& camera() const { return sequence_->camera(); }
  const std::vector<std::string>& notes() const { return sequence_->notes(); }

  DepthFrame frame(std::size_t index) {
    const std::lock_guard<std::mutex> lock(mutex_);
    gpis_mapping::SkipReason reason;
    std::optional<DepthFrame> frame = sequence_->frame(index, &reason);
    if (!frame) throw DepthSequenceError("frame " + std::to_string(index) + ": " + reason.kind + ": " + reason.detail);
    return std::move(*frame);
  }

 private:
  std::mutex mutex_;  // guards sequence_
  std::unique_ptr<DepthSequence> sequence_;
};

/// SpaceState as an IntEnum, with the names of the message's constants.
py::object spaceStates() {
  py::dict members;
  for (const auto& [name, value] : interactive_mapping::kSpaceStateNames) {
    members[py::str(name).attr("upper")()] = static_cast<int>(value);
  }
  return py::module_::import("enum").attr("IntEnum")("SpaceState", members, py::arg("module") = "gpis_mapping");
}

void bindMap(py::module_* module) {
  py::class_<PythonMap>(*module, "Map",
                        R"(The map: surfaces that depth images show, as a Gaussian-process implicit surface.

config: dict or path of a YAML file with the sections of gpis_mapping.yaml; missing keys keep their default. Unknown keys
and impossible values raise one ValueError that lists them all. Any thread may call any method; a query never waits for
integrate().)")
      .def(py::init([](const py::object& config) { return std::make_unique<PythonMap>(configOf(config)); }),
           py::arg("config") = py::none())
      .def_static(
          "load",
          [](const py::object& path) {
            const std::string text = toText(path);
            const py::gil_scoped_release release;
            return std::make_unique<PythonMap>(gpis_mapping::loadMap(text));
          },
          py::arg("path"), "The map in a file of save(), map_sequence or the node. Raises MapFileError.")
      .def(
          "save",
          [](PythonMap& map, const py::object& path) {
            const std::string text = toText(path);
            const py::gil_scoped_release release;
            map.save(text);
          },
          py::arg("path"), "Writes the map to a file, which appears complete or not at all. Raises MapFileError.")
      .def(
          "integrate",
          [](PythonMap& map, const py::object& depth, const py::object& intrinsics, const py::object& pose,
             std::optional<double> stamp_s, double depth_units_per_metre) {
            const DepthImage image = depthImage(depth, depth_units_per_metre);
            const CameraModel camera = cameraOf(intrinsics, image);
            const Eigen::Isometry3d T_map_camera = poseOf(pose);
            const py::gil_scoped_release release;
            return map.integrate(image, camera, T_map_camera, stamp_s);
          },
          py::arg("depth"), py::arg("intrinsics"), py::arg("pose"), py::arg("stamp_s") = py::none(),
          py::arg("depth_units_per_metre") = 1000.0, R"(Takes in one depth image; returns what that changed.

depth: (H, W), along the optical axis. float32 in metres: NaN is no information, +Inf nothing within reach, -Inf too near.
    uint16 in 1 / depth_units_per_metre metres: 0 and 65535 are holes.
intrinsics: (fx, fy, cx, cy) [px] or the 3 x 3 camera matrix of an ideal pinhole; pixel centres are at integers.
pose: (4, 4), T_map_camera: optical frame (z forward, x right, y down) to map [m].
stamp_s: when the image was taken [s]. From it the map knows how fast the camera moved. None: it stood still.
Raises ValueError, and leaves the map as it was, for a wrong shape, dtype, camera or pose.)")
      .def(
          "query",
          [](const PythonMap& map, const py::object& points, bool variance, bool variance_gradient) {
            const Points3d points_map = pointsOf(points);
            if (variance_gradient && !variance) {
              throw std::invalid_argument("query: variance_gradient = True, must be False without variance");
            }
            QueryOptions options;
            options.variance = variance;
            options.variance_gradient = variance_gradient;
            const py::gil_scoped_release release;
            return map.snapshot()->query(points_map, options);
          },
          py::arg("points"), py::arg("variance") = true, py::arg("variance_gradient") = false,
          R"(The map's answers at points (N, 3) [m, map frame], of the last finished integrate().

An answer that the map does not have is NaN. A point that is not finite gets no answer.)")
      .def("mesh", &PythonMap::mesh, py::call_guard<py::gil_scoped_release>(),
           "The surface as triangles. Extracts again only what has changed since the last call.")
      .def_property_readonly(
          "num_points", [](const PythonMap& map) { return map.snapshot()->numPoints(); }, "Training points.")
      .def_property_readonly(
          "num_images", [](const PythonMap& map) { return map.snapshot()->numUpdates(); }, "Images taken in.")
      .def_property_readonly(
          "memory_bytes", [](const PythonMap& map) { return map.snapshot()->memoryBytes(); },
          "Memory of what answers queries.")
      .def_property_readonly(
          "config_yaml", [](const PythonMap& map) { return gpis_mapping::toYaml(map.snapshot()->config()); },
          "Every setting with its value, as YAML.");
}

void bindAnswers(py::module_* module) {
  py::class_<QueryResult> answers(*module, "QueryResult",
                                  "Answers at N points; NaN where the map has none, or was not asked.");
  defineArray(&answers, "distance", &QueryResult::distance,
              "(N,) signed [m]: positive outside. Near surfaces the field, farther away the nearest surface.");
  defineArray(&answers, "gradient", &QueryResult::gradient, "(N, 3) of the distance.");
  defineArray(&answers, "variance", &QueryResult::variance, "(N,) of the field [m^2].");
  defineArray(&answers, "variance_gradient", &QueryResult::variance_gradient,
              "(N, 3) d variance / dx [m]; empty unless asked for.");
  defineArray(&answers, "occupancy", &QueryResult::occupancy, "(N,) P(field < 0); NaN in unknown space.");
  defineArray(&answers, "euclidean_distance", &QueryResult::euclidean_distance,
              "(N,) unsigned, to the nearest mapped surface [m].");
  defineArray(&answers, "euclidean_gradient", &QueryResult::euclidean_gradient, "(N, 3) away from that surface.");
  defineArray(&answers, "surface_std", &QueryResult::surface_std,
              "(N,) position uncertainty of the nearest surface along its normal [m].");
  defineArray(&answers, "state", &QueryResult::state, "(N,) uint8: the values of SpaceState.");

  py::class_<TriangleMesh> mesh(*module, "Mesh", "V vertices and F triangles in the map frame.");
  defineArray(&mesh, "vertices", &TriangleMesh::vertices_map, "(V, 3) [m].");
  defineArray(&mesh, "normals", &TriangleMesh::normals_map, "(V, 3), to free space.");
  defineArray(&mesh, "variance", &TriangleMesh::variance_m2, "(V,) of the field at the vertex [m^2].");
  defineArray(&mesh, "faces", &TriangleMesh::triangles, "(F, 3) vertices, counter-clockwise seen from free space.");
  mesh.def(
      "save_ply",
      [](const TriangleMesh& self, const py::object& path) {
        const std::string text = toText(path);
        const py::gil_scoped_release release;
        gpis_mapping::writePly(self, text);
      },
      py::arg("path"), "Writes a binary PLY with normals and variance. Raises OSError.");

  using S = UpdateStatistics;
  py::class_<S> statistics(*module, "UpdateStatistics", "What one image changed, and how long each stage took [ms].");
  for (const auto& [name, member] :
       {std::pair("total_ms", &S::total_ms), std::pair("classify_ms", &S::classify_ms),
        std::pair("regress_ms", &S::regress_ms), std::pair("fuse_ms", &S::fuse_ms),
        std::pair("insert_ms", &S::insert_ms), std::pair("train_ms", &S::train_ms),
        std::pair("observe_ms", &S::observe_ms), std::pair("publish_ms", &S::publish_ms)}) {
    statistics.def_readonly(name, member);
  }
  for (const auto& [name, member] :
       {std::pair("points_in", &S::points_in), std::pair("inserted", &S::inserted), std::pair("fused", &S::fused),
        std::pair("deleted", &S::deleted), std::pair("occluded", &S::occluded), std::pair("map_points", &S::map_points),
        std::pair("cells_retrained", &S::cells_retrained)}) {
    statistics.def_readonly(name, member);
  }
  defineArray(&statistics, "removed_points", &S::removed_points_map,
              "(N, 3) where points were deleted [m, map frame].");
}

void bindSequence(py::module_* module) {
  py::class_<DepthFrame>(*module, "DepthFrame", "One depth image with the pose it was taken from.")
      .def_property_readonly(
          "depth",
          [](const py::object& self) {
            const DepthImage& image = self.cast<const DepthFrame&>().image;
            return viewOf(self, {image.height, image.width}, image.depth_m.data());
          },
          "(H, W) float32 [m]; 0 is a hole.")
      .def_property_readonly(
          "pose",
          [](const DepthFrame& self) {
            const Eigen::Matrix<double, 4, 4, Eigen::RowMajor> matrix = self.T_map_camera.matrix();
            return py::array_t<double>({4, 4}, matrix.data());
          },
          "(4, 4), T_map_camera.")
      .def_readonly("stamp_s", &DepthFrame::stamp_s)
      .def_readonly("name", &DepthFrame::name);

  py::class_<PythonSequence>(*module, "DepthSequence", R"(A folder of depth images with poses, TUM RGB-D or 7-Scenes.

units_per_metre counts instead of the folder's. Lens distortion is taken out. Raises DepthSequenceError.)")
      .def(py::init([](const py::object& path, std::optional<double> units_per_metre) {
             return std::make_unique<PythonSequence>(toText(path), units_per_metre);
           }),
           py::arg("path"), py::arg("units_per_metre") = py::none())
      .def("__len__", &PythonSequence::size)
      .def_property_readonly(
          "intrinsics",
          [](const PythonSequence& self) {
            const CameraModel& camera = self.camera();
            return py::make_tuple(camera.fx, camera.fy, camera.cx, camera.cy);
          },
          "(fx, fy, cx, cy) [px] of all images.")
      .def_property_readonly(
          "notes", [](const PythonSequence& self) { return self.notes(); },
          "What the user should know, a sentence each.")
      .def("frame", &PythonSequence::frame, py::arg("index"), py::call_guard<py::gil_scoped_release>(),
           "Frame `index` from 0. Raises DepthSequenceError with the reason if it has no pose or no readable image.");
}

}  // namespace

PYBIND11_MODULE(_core, module) {
  py::register_exception<MapFileError>(module, "MapFileError", PyExc_ValueError);
  py::register_exception<DepthSequenceError>(module, "DepthSequenceError", PyExc_ValueError);
  py::register_exception_translator([](std::exception_ptr error) {
    try {
      if (error) std::rethrow_exception(error);
    } catch (const interactive_mapping::FileError& refusal) {
      PyErr_SetString(PyExc_OSError, refusal.what());
    }
  });
  module.attr("SpaceState") = spaceStates();
  bindAnswers(&module);
  bindMap(&module);
  bindSequence(&module);
}
