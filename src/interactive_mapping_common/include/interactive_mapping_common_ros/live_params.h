// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include <interactive_mapping_common/config/schema.h>
#include <ros/node_handle.h>

namespace interactive_mapping_ros {

/// A server of dynamic_reconfigure, whatever the configuration; LiveParams knows that.
class LiveServer {
 public:
  /// `show`: the fields with the values in use. `take`: reads new ones and uses them, or throws and leaves everything as
  /// it was. Throws std::logic_error for a live field that dynamic_reconfigure has no type for, or two of one name.
  LiveServer(const ros::NodeHandle& private_nh, std::function<void(interactive_mapping::Fields&)> show,
             std::function<void(interactive_mapping::FieldReader&)> take);
  ~LiveServer();

  /// Calls `work` while no client changes anything; `tell`: clients get the values in use after it.
  void exclusively(const std::function<void()>& work, bool tell) const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// The live fields of a configuration, offered by `~tune` to the clients of dynamic_reconfigure (rqt_reconfigure,
/// dynparam): change them while the node runs. The schema describes them, no .cfg file is needed. A client's request is
/// used as a whole. If it breaks a range or rule it is not used at all: the reason is logged, and the client gets the
/// values in use. They begin as the parameters say and are forgotten at the end of the node.
template <typename Params>
class LiveParams {
 public:
  /// Gets a configuration without problems, one at a time, on a thread that serves the queue of the node handle. May
  /// refuse it by an exception, and then uses nothing of it.
  using Apply = std::function<void(const Params&)>;

  LiveParams(const ros::NodeHandle& private_nh, const Params& params, Apply apply)
      : params_(params),
        apply_(std::move(apply)),
        server_(
            private_nh, [this](interactive_mapping::Fields& fields) { Params::fields(params_, fields); },
            [this](interactive_mapping::FieldReader& reader) { take(reader); }) {}
  LiveParams(const LiveParams&) = delete;
  LiveParams& operator=(const LiveParams&) = delete;

  /// The values in use.
  Params get() const {
    Params params;
    server_.exclusively([&] { params = params_; }, false);
    return params;
  }

  /// For what the node itself changes: clients are told, `apply` is not called. An impossible change is ignored. Not from
  /// within `apply`.
  void edit(const std::function<void(Params&)>& change) {
    const auto work = [&] {
      Params next = params_;
      change(next);
      if (interactive_mapping::problemsOf(next).empty()) params_ = next;
    };
    server_.exclusively(work, true);
  }

 private:
  void take(interactive_mapping::FieldReader& reader) {
    Params next = params_;
    Params::fields(next, reader);
    std::vector<std::string> problems = reader.finish();
    for (std::string& problem : interactive_mapping::problemsOf(next)) problems.push_back(std::move(problem));
    interactive_mapping::refuseIfAny("impossible:", problems);
    apply_(next);
    params_ = next;
  }

  Params params_;  // changed by the server alone
  Apply apply_;
  LiveServer server_;  // last: uses the rest
};

}  // namespace interactive_mapping_ros
