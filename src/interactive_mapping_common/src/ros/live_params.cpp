// SPDX-License-Identifier: BSD-3-Clause
#include "interactive_mapping_common_ros/live_params.h"

#include <algorithm>
#include <cstdint>
#include <map>
#include <mutex>
#include <set>
#include <sstream>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <variant>

#include <dynamic_reconfigure/Config.h>
#include <dynamic_reconfigure/ConfigDescription.h>
#include <dynamic_reconfigure/Reconfigure.h>
#include <ros/console.h>

#include "interactive_mapping_common_ros/xmlrpc_yaml.h"

namespace interactive_mapping_ros {
namespace {

using dynamic_reconfigure::Config;
using dynamic_reconfigure::ConfigDescription;
using dynamic_reconfigure::Reconfigure;
using interactive_mapping::Field;
using interactive_mapping::Fields;
using Value = std::variant<double, int, bool, std::string>;

constexpr char kLog[] = "live_params";
constexpr const char* kTypes[] = {"double", "int", "bool", "str"};  // of Value

struct LiveField {
  Field field;  // its value may be gone
  std::string path, section, name;
  Value value;
};

class Collector : public Fields {
 public:
  std::vector<LiveField> found;

 private:
  void visit(const Field& field) override {
    if (!field.live.is_live) return;
    const std::string path = pathOf(field.key);
    const std::size_t slash = path.rfind('/');
    LiveField live{field, path, slash == std::string::npos ? "" : path.substr(0, slash), field.live.name, {}};
    std::visit(
        [&live](const auto* value) {
          using Type = std::remove_const_t<std::remove_pointer_t<decltype(value)>>;
          if constexpr (std::is_constructible_v<Value, std::in_place_type_t<Type>, Type>) {
            live.value.emplace<Type>(*value);
          } else {
            throw std::logic_error(live.path + " is live, but dynamic_reconfigure has no lists");
          }
        },
        field.value);
    found.push_back(std::move(live));
  }
};

std::vector<LiveField> liveFieldsOf(const std::function<void(Fields&)>& show) {
  Collector collector;
  show(collector);
  std::map<std::string, int> uses;
  for (const LiveField& live : collector.found) ++uses[live.name.empty() ? live.field.key : live.name];
  std::set<std::string> names;
  for (LiveField& live : collector.found) {
    if (live.name.empty()) {
      live.name = live.field.key;
      if (uses[live.name] > 1) {
        live.name = live.path;
        std::replace(live.name.begin(), live.name.end(), '/', '_');
      }
    }
    if (!names.insert(live.name).second) {
      throw std::logic_error(live.path + ": another live field is called " + live.name);
    }
  }
  return collector.found;
}

void add(const std::string& name, const Value& value, Config* config) {
  const auto append = [&name](auto* list, const auto& item) {
    list->emplace_back();
    list->back().name = name;
    list->back().value = item;
  };
  if (const auto* number = std::get_if<double>(&value)) append(&config->doubles, *number);
  if (const auto* whole = std::get_if<int>(&value)) append(&config->ints, *whole);
  if (const auto* flag = std::get_if<bool>(&value)) append(&config->bools, static_cast<std::uint8_t>(*flag));
  if (const auto* text = std::get_if<std::string>(&value)) append(&config->strs, *text);
}

/// One end of the allowed range, of the type of the value.
Value limit(const LiveField& live, bool is_upper) {
  const double end = is_upper ? live.field.hi : live.field.lo;
  if (std::holds_alternative<double>(live.value)) return end;
  if (std::holds_alternative<int>(live.value)) return static_cast<int>(end);
  if (std::holds_alternative<bool>(live.value)) return is_upper;
  return std::string();
}

/// dynamic_reconfigure's clients read this as Python.
std::string enumOf(const Field& field) {
  std::string items;
  for (const std::string& word : field.words) {
    items += (items.empty() ? "" : ", ") + ("{'name': '" + word) + "', 'type': 'str', 'value': '" + word +
             "', 'description': ''}";
  }
  return items.empty() ? "" : "{'enum': [" + items + "], 'enum_description': ''}";
}

/// A group for each section, the first for what is in none.
ConfigDescription describe(const std::vector<LiveField>& all) {
  ConfigDescription description;
  const auto group_of = [&description](const std::string& name) -> dynamic_reconfigure::Group& {
    for (dynamic_reconfigure::Group& group : description.groups) {
      if (group.name == name) return group;
    }
    description.groups.emplace_back();
    description.groups.back().name = name;
    description.groups.back().id = static_cast<int>(description.groups.size()) - 1;
    return description.groups.back();
  };
  group_of("Default");
  for (const LiveField& live : all) {
    dynamic_reconfigure::Group& group = group_of(live.section.empty() ? "Default" : live.section);
    if (live.field.live.is_together) group.type = "apply";  // rqt_reconfigure sends its values by a button
    group.parameters.emplace_back();
    dynamic_reconfigure::ParamDescription& parameter = group.parameters.back();
    parameter.name = live.name;
    parameter.type = kTypes[live.value.index()];
    parameter.description = live.field.text;
    if (*live.field.unit != '\0') parameter.description += std::string(" [") + live.field.unit + "]";
    parameter.edit_method = enumOf(live.field);
    add(live.name, limit(live, false), &description.min);
    add(live.name, limit(live, true), &description.max);
    add(live.name, live.value, &description.dflt);
  }
  return description;
}

/// The values that `next` has and `before` has not.
std::string difference(const std::vector<LiveField>& before, const std::vector<LiveField>& next) {
  std::ostringstream text;
  for (std::size_t i = 0; i < next.size(); ++i) {
    if (next[i].value == before[i].value) continue;
    text << (text.tellp() > 0 ? ", " : "") << next[i].path << " = ";
    std::visit([&text](const auto& value) { text << std::boolalpha << value; }, next[i].value);
  }
  return text.str();
}

}  // namespace

struct LiveServer::State {
  State(const ros::NodeHandle& private_nh, std::function<void(Fields&)> show_,
        std::function<void(interactive_mapping::FieldReader&)> take_)
      : nh(private_nh, "tune"), show(std::move(show_)), take(std::move(take_)) {
    const std::vector<LiveField> all = liveFieldsOf(show);
    for (const LiveField& live : all) paths[live.name] = live.path;
    const ConfigDescription description = describe(all);
    for (const dynamic_reconfigure::Group& group : description.groups) {
      groups.emplace_back();
      groups.back().name = group.name;
      groups.back().state = 1;
      groups.back().id = group.id;
      groups.back().parent = group.parent;
    }
    descriptions = nh.advertise<ConfigDescription>("parameter_descriptions", 1, true);
    descriptions.publish(description);
    updates = nh.advertise<Config>("parameter_updates", 1, true);
    updates.publish(configOf(all));
    service = nh.advertiseService("set_parameters", &State::onSet, this);
  }

  Config configOf(const std::vector<LiveField>& all) const {
    Config config;
    for (const LiveField& live : all) add(live.name, live.value, &config);
    config.groups = groups;
    return config;
  }

  /// As a document with the fields in their sections. Throws std::invalid_argument for names that are none.
  XmlRpc::XmlRpcValue documentOf(const Config& request) const {
    XmlRpc::XmlRpcValue document;
    document.begin();  // makes it a map
    std::vector<std::string> problems;
    const auto enter = [&](const std::string& name, const auto& value) {
      const auto found = paths.find(name);
      if (found == paths.end()) {
        problems.push_back(name + " is no live parameter");
        return;
      }
      XmlRpc::XmlRpcValue* at = &document;
      std::istringstream path(found->second);
      for (std::string part; std::getline(path, part, '/');) at = &(*at)[part];
      *at = value;
    };
    for (const auto& item : request.doubles) enter(item.name, XmlRpc::XmlRpcValue(item.value));
    for (const auto& item : request.ints) enter(item.name, XmlRpc::XmlRpcValue(static_cast<int>(item.value)));
    for (const auto& item : request.bools) enter(item.name, XmlRpc::XmlRpcValue(item.value != 0));
    for (const auto& item : request.strs) enter(item.name, XmlRpc::XmlRpcValue(item.value));
    interactive_mapping::refuseIfAny("impossible:", problems);
    return document;
  }

  bool onSet(Reconfigure::Request& request, Reconfigure::Response& response) {
    const std::lock_guard<std::mutex> lock(mutex);
    const std::vector<LiveField> before = liveFieldsOf(show);
    try {
      interactive_mapping::FieldReader reader(toYaml(documentOf(request.config)));
      take(reader);
      const std::string changes = difference(before, liveFieldsOf(show));
      if (!changes.empty()) ROS_INFO_STREAM_NAMED(kLog, nh.getNamespace() << ": " << changes);
    } catch (const std::exception& error) {
      ROS_ERROR_STREAM_NAMED(kLog, nh.getNamespace()
                                       << ": tuning refused, everything stays as it was: " << error.what());
    }
    response.config = configOf(liveFieldsOf(show));
    updates.publish(response.config);
    return true;
  }

  ros::NodeHandle nh;
  std::function<void(Fields&)> show;
  std::function<void(interactive_mapping::FieldReader&)> take;
  std::map<std::string, std::string> paths;  // by name
  std::vector<dynamic_reconfigure::GroupState> groups;
  std::mutex mutex;  // held while the values in use are read or changed
  ros::Publisher descriptions, updates;
  ros::ServiceServer service;  // last: its callback uses the rest
};

LiveServer::LiveServer(const ros::NodeHandle& private_nh, std::function<void(Fields&)> show,
                       std::function<void(interactive_mapping::FieldReader&)> take)
    : state_(std::make_unique<State>(private_nh, std::move(show), std::move(take))) {}

LiveServer::~LiveServer() = default;

void LiveServer::exclusively(const std::function<void()>& work, bool tell) const {
  const std::lock_guard<std::mutex> lock(state_->mutex);
  work();
  if (tell) state_->updates.publish(state_->configOf(liveFieldsOf(state_->show)));
}

}  // namespace interactive_mapping_ros
