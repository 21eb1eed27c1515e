// SPDX-License-Identifier: BSD-3-Clause
// The dynamic GPIS map of another node: its mesh, and its answers to queries.
#include "nbv_selection_ros/gpis_strategy.h"

#include <interactive_mapping_common_ros/params.h>
#include <interactive_mapping_common_ros/poses.h>
#include <interactive_mapping_common_ros/worker_action_server.h>
#include <interactive_mapping_msgs/GetMesh.h>
#include <interactive_mapping_msgs/QueryMap.h>

#include "nbv_selection_ros/service_call.h"

namespace nbv_selection_ros {
namespace {

using interactive_mapping_msgs::GetMesh;
using interactive_mapping_msgs::MapUpdate;
using interactive_mapping_msgs::QueryMap;
using interactive_mapping_msgs::SurfaceMesh;

nbv_selection::MappedSurface toSurface(const SurfaceMesh& mesh) {
  const std::size_t count = mesh.mesh.vertices.size();
  if (mesh.normals.size() != 3 * count || mesh.variance.size() != count) {
    throw MapUnavailable("the mesh has " + std::to_string(count) + " vertices, but " +
                         std::to_string(mesh.normals.size() / 3) + " normals and " +
                         std::to_string(mesh.variance.size()) + " variances");
  }
  nbv_selection::MappedSurface surface;
  surface.points_map.reserve(count);
  surface.normals_map.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    const geometry_msgs::Point& p = mesh.mesh.vertices[i];
    surface.points_map.emplace_back(p.x, p.y, p.z);
    surface.normals_map.emplace_back(mesh.normals[3 * i], mesh.normals[3 * i + 1], mesh.normals[3 * i + 2]);
  }
  surface.uncertainty = mesh.variance;
  surface.update = mesh.update;
  surface.stamp_s = mesh.header.stamp.toSec();
  return surface;
}

gpis_mapping::Points3d toColumns(const std::vector<geometry_msgs::Vector3>& vectors) {
  gpis_mapping::Points3d out(3, static_cast<Eigen::Index>(vectors.size()));
  for (std::size_t i = 0; i < vectors.size(); ++i) {
    out.col(static_cast<Eigen::Index>(i)) << vectors[i].x, vectors[i].y, vectors[i].z;
  }
  return out;
}

Eigen::VectorXd toVector(const std::vector<double>& numbers) {
  return Eigen::Map<const Eigen::VectorXd>(numbers.data(), static_cast<Eigen::Index>(numbers.size()));
}

/// Fills in the response. Throws MapUnavailable; SelectionCancelled.
template <typename Service>
void call(ros::ServiceClient client, Service* service, double timeout_s, const std::function<bool()>& is_cancelled) {
  if (!client.isValid()) throw MapUnavailable("no service " + client.getService());
  switch (callWithin(client, service, timeout_s, is_cancelled)) {
    case CallEnd::kAnswered:
      return;
    case CallEnd::kFailed:
      throw MapUnavailable("the call of " + client.getService() + " failed");
    case CallEnd::kTimedOut:
      throw MapUnavailable(client.getService() + " has not answered for " + std::to_string(timeout_s) +
                           " s (input/answer_timeout_s)");
    case CallEnd::kCancelled:
      throw SelectionCancelled("cancelled while " + client.getService() + " was asked");
  }
}

/// The map's answers through one connection.
class QueryClient {
 public:
  QueryClient(ros::NodeHandle nh, std::string map_frame, double timeout_s, std::function<bool()> is_cancelled)
      : client_(nh.serviceClient<QueryMap>("map/query", true)),
        map_frame_(std::move(map_frame)),
        timeout_s_(timeout_s),
        is_cancelled_(std::move(is_cancelled)) {}

  /// sigma_f squared.
  double priorVariance() {
    const QueryMap::Response response = ask({}, {});
    if (!(response.prior_variance > 0.0)) {
      throw MapUnavailable(client_.getService() + " says that the prior's variance is " +
                           std::to_string(response.prior_variance) + " m^2, must be above 0");
    }
    return response.prior_variance;
  }

  gpis_mapping::QueryResult operator()(const gpis_mapping::Points3d& points_map,
                                       const gpis_mapping::QueryOptions& options) {
    const QueryMap::Response response = ask(points_map, options);
    const auto count = static_cast<std::size_t>(points_map.cols());
    const auto require = [&](const char* what, std::size_t size) {
      if (size == count) return;
      throw std::runtime_error(client_.getService() + " gave " + std::to_string(size) + " of " + what + " for " +
                               std::to_string(count) + " points");
    };
    require("distance", response.distance.size());
    require("gradient", response.gradient.size());
    require("euclidean_distance", response.euclidean_distance.size());
    require("euclidean_gradient", response.euclidean_gradient.size());
    require("surface_std", response.surface_std.size());
    require("state", response.state.size());
    gpis_mapping::QueryResult result;
    result.distance = toVector(response.distance);
    result.gradient = toColumns(response.gradient);
    result.euclidean_distance = toVector(response.euclidean_distance);
    result.euclidean_gradient = toColumns(response.euclidean_gradient);
    result.surface_std = toVector(response.surface_std);
    for (const std::uint8_t state : response.state) {
      result.state.push_back(static_cast<gpis_mapping::SpaceState>(state));
    }
    if (options.variance) {
      require("variance", response.variance.size());
      require("occupancy", response.occupancy.size());
      result.variance = toVector(response.variance);
      result.occupancy = toVector(response.occupancy);
    }
    if (options.variance_gradient) {
      require("variance_gradient", response.variance_gradient.size());
      result.variance_gradient = toColumns(response.variance_gradient);
    }
    return result;
  }

 private:
  QueryMap::Response ask(const gpis_mapping::Points3d& points_map, const gpis_mapping::QueryOptions& options) {
    QueryMap query;
    query.request.frame_id = map_frame_;
    query.request.with_variance = options.variance ? 1 : 0;
    query.request.with_variance_gradient = options.variance_gradient ? 1 : 0;
    query.request.points.resize(static_cast<std::size_t>(points_map.cols()));
    for (std::size_t i = 0; i < query.request.points.size(); ++i) {
      const auto column = static_cast<Eigen::Index>(i);
      query.request.points[i].x = points_map(0, column);
      query.request.points[i].y = points_map(1, column);
      query.request.points[i].z = points_map(2, column);
    }
    call(client_, &query, timeout_s_, is_cancelled_);
    if (!query.response.success) throw MapUnavailable(client_.getService() + ": " + query.response.message);
    return query.response;
  }

  ros::ServiceClient client_;
  std::string map_frame_;
  double timeout_s_;
  std::function<bool()> is_cancelled_;
};

}  // namespace

void GpisStrategy::initialize(const StrategyContext& context) {
  context_ = context;
  params_ = interactive_mapping_ros::loadParams<GpisStrategyParams>(context.private_nh, {"own"});
  selector_ = std::make_unique<LiveSelector<GpisStrategyParams>>(
      context, params_, nbv_selection::Extension{extraFactors(), [this](const nbv_selection::Selection& selection) {
                                                   return choose(selection);
                                                 }});
  update_subscriber_ = context_.nh.subscribe<MapUpdate>("map/update", 10, [this](const MapUpdate::ConstPtr& update) {
    if (update->status != MapUpdate::ACCEPTED) return;
    const std::lock_guard<std::mutex> lock(mutex_);
    image_stamp_ = update->header.stamp;
  });
}

nbv_selection::Selection GpisStrategy::select(const nbv_selection::SelectionRequest& request,
                                              const nbv_selection::FailureMemory& failures,
                                              const ros::Time& min_map_stamp, const Tell& tell,
                                              const IsCancelled& is_cancelled) {
  const auto selector = selector_->get();
  const SurfaceMesh mesh = awaitMesh(min_map_stamp, is_cancelled);
  if (interactive_mapping_ros::withoutSlash(mesh.header.frame_id) != context_.map_frame) {
    throw MapUnusable("the mesh's frame is '" + mesh.header.frame_id + "', must be '" + context_.map_frame +
                      "' (map_frame)");
  }
  auto query = std::make_shared<QueryClient>(context_.nh, context_.map_frame, context_.answer_timeout_s, is_cancelled);
  const double prior_std_m = std::sqrt(query->priorVariance());
  const nbv_selection::GpisScene scene(
      toSurface(mesh), prior_std_m,
      [query](const gpis_mapping::Points3d& points, const gpis_mapping::QueryOptions& options) {
        return (*query)(points, options);
      },
      params_.scene);
  return selector->select(scene, failures, request, tell, is_cancelled);
}

void GpisStrategy::diagnose(diagnostic_updater::DiagnosticStatusWrapper& status) const {
  const ros::Time newest = imageStamp();
  if (newest.isZero()) {
    status.summary(diagnostic_msgs::DiagnosticStatus::WARN, noImage());
    return;
  }
  status.summary(diagnostic_msgs::DiagnosticStatus::OK, "ready");
  status.add("age of the map's newest image [s]", (ros::Time::now() - newest).toSec());
}

std::string GpisStrategy::configuration() const {
  return interactive_mapping::toYaml(params_);
}

std::vector<nbv_selection::ExtraFactor> GpisStrategy::extraFactors() {
  return {};
}

std::optional<std::size_t> GpisStrategy::choose(const nbv_selection::Selection& selection) {
  if (selection.status != nbv_selection::SelectionStatus::kSelected) return std::nullopt;
  return selection.best;
}

ros::Time GpisStrategy::imageStamp() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return image_stamp_;
}

std::string GpisStrategy::noImage() const {
  return "the map has taken in no image (" + update_subscriber_.getTopic() + ")";
}

SurfaceMesh GpisStrategy::awaitMesh(const ros::Time& min_stamp, const IsCancelled& is_cancelled) const {
  // May be asked once only: a goal that another replaces goes on if that is withdrawn.
  bool has_been_cancelled = false;
  interactive_mapping_ros::waitUntil(ros::Time::now() + ros::Duration(context_.map_wait_s), context_.stall_s, [&] {
    has_been_cancelled = is_cancelled && is_cancelled();
    return has_been_cancelled || imageStamp() >= min_stamp;
  });
  if (has_been_cancelled) throw SelectionCancelled("cancelled while waiting for the map");
  GetMesh map;
  ros::NodeHandle nh = context_.nh;  // a client is made by one that may change
  call(nh.serviceClient<GetMesh>("map/get_mesh", true), &map, context_.answer_timeout_s, is_cancelled);
  const ros::Time& stamp = map.response.mesh.header.stamp;
  if (stamp >= min_stamp) return std::move(map.response.mesh);
  if (stamp.isZero()) throw MapUnavailable(noImage());
  throw MapUnavailable("the map's newest image is of " + std::to_string(stamp.toSec()) + " s, asked for is one of " +
                       std::to_string(min_stamp.toSec()) + " s or later (waited " +
                       std::to_string(context_.map_wait_s) + " s, input/map_wait_s)");
}

}  // namespace nbv_selection_ros
