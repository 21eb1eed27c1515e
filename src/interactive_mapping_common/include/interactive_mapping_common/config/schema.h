// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include <Eigen/Core>

#include "interactive_mapping_common/enums/enum_names.h"

namespace YAML {
class Node;
}

/// Parameters declared once. A configuration is a struct that names its members beside them:
///
///   struct Example {
///     double reach_m{0.5};
///     bool enabled{true};
///     static void fields(Example& c, Fields& f) {
///       f("reach_m", c.reach_m, 0.1, 2.0, "m", "of the arm");
///       f("enabled", c.enabled, "false: does nothing");
///       f.require(!c.enabled || c.reach_m > 0.2, "reach_m must be above 0.2 m while enabled");
///     }
///   };
///
/// From that come reading YAML and ROS parameters, one refusal of all that is wrong, and the shipped YAML file. With
/// f.live()("reach_m", ...) the field can also change while a node runs: interactive_mapping_common_ros/live_params.h.
namespace interactive_mapping {

/// Whether a field can change while a node runs.
struct Live {
  bool is_live{false};
  std::string name{};       // for clients; empty: the key, or if several live fields have that, the path with _ for /
  bool is_together{false};  // a rule ties it to others of its section: clients change them in one go
};

/// A member of a configuration with what is known of it.
struct Field {
  using Value = std::variant<double*, int*, bool*, std::string*, std::vector<std::string>*, std::vector<double>*,
                             Eigen::Vector3d*>;
  const char* key;  // below the open sections
  Value value;
  const char* text;                  // becomes the YAML comment
  double lo{0.0}, hi{0.0};           // allowed numbers: [lo, hi] ...
  const char* unit{""};              // ... of this unit
  std::vector<std::string> words{};  // allowed texts; none: any
  Live live{};
};

/// What is done with the fields of a configuration: reading, checking, writing.
class Fields {
 public:
  virtual ~Fields() = default;
  Fields(const Fields&) = delete;
  Fields& operator=(const Fields&) = delete;

  /// The next field is a live one: a number, true or false, or a text. `name`: see Live.
  Fields& live(const std::string& name = "") {
    live_ = {true, name, false};
    return *this;
  }
  /// The same, tied by a rule to others of its section.
  Fields& liveTogether(const std::string& name = "") {
    live_ = {true, name, true};
    return *this;
  }

  void operator()(const char* key, double& value, double lo, double hi, const char* unit, const char* text) {
    add({key, &value, text, lo, hi, unit, {}});
  }
  void operator()(const char* key, int& value, int lo, int hi, const char* unit, const char* text) {
    add({key, &value, text, static_cast<double>(lo), static_cast<double>(hi), unit, {}});
  }
  void operator()(const char* key, Eigen::Vector3d& value, double lo, double hi, const char* unit, const char* text) {
    add({key, &value, text, lo, hi, unit, {}});
  }
  /// Each of the list.
  void operator()(const char* key, std::vector<double>& value, double lo, double hi, const char* unit,
                  const char* text) {
    add({key, &value, text, lo, hi, unit, {}});
  }
  void operator()(const char* key, bool& value, const char* text) { add({key, &value, text}); }
  void operator()(const char* key, std::string& value, const char* text) { add({key, &value, text}); }
  void operator()(const char* key, std::vector<std::string>& value, const char* text) { add({key, &value, text}); }
  /// One of the named values.
  template <typename Enum>
  void operator()(const char* key, Enum& value, Names<Enum> names, const char* text) {
    std::string word;
    std::vector<std::string> words;
    for (const auto& [name, named] : names) {
      words.emplace_back(name);
      if (named == value) word = name;
    }
    add({key, &word, text, 0.0, 0.0, "", words});
    for (const auto& [name, named] : names) {
      if (word == name) value = named;
    }
  }

  /// The fields of `config` below `key`; `text`: what they are about.
  template <typename Config>
  void section(const char* key, Config& config, const char* text = "") {
    sections_.emplace_back(key);
    section_text_ = text;
    Config::fields(config, *this);
    sections_.pop_back();
  }

  /// A text that stands for several of the fields after it, which may still override it; it is read and not written.
  /// `apply` throws std::invalid_argument for what is not one of `words`.
  virtual void shorthand(const char* /*key*/, const std::function<void(const std::string&)>& /*apply*/,
                         const std::vector<std::string>& /*words*/, const char* /*text*/) {}

  /// A rule that ties several fields together. `sentence` names the keys below the open sections.
  virtual void require(bool /*holds*/, const std::string& /*sentence*/) {}

 protected:
  Fields() = default;
  virtual void visit(const Field& field) = 0;
  std::string pathOf(const std::string& key) const;

  std::vector<std::string> sections_;
  std::string section_text_;  // of the last one opened

 private:
  void add(Field field) {
    field.live = std::exchange(live_, Live());
    visit(field);
  }

  Live live_;  // of the next field
};

/// Ranges, finite numbers and the rules.
class FieldChecker : public Fields {
 public:
  void require(bool holds, const std::string& sentence) override;
  std::vector<std::string> problems;

 private:
  void visit(const Field& field) override;
};

/// Takes the fields out of a YAML document: a missing key keeps its value.
class FieldReader : public Fields {
 public:
  /// An empty document is one without keys.
  explicit FieldReader(const YAML::Node& root);
  /// Throws std::invalid_argument, `origin` first, for what is no YAML or no map of keys.
  FieldReader(const std::string& text, const std::string& origin);
  ~FieldReader() override;
  void shorthand(const char* key, const std::function<void(const std::string&)>& apply,
                 const std::vector<std::string>& words, const char* text) override;

  /// A key, or a whole section, that somebody else reads.
  void ignore(const std::string& path);

  /// Wrong types so far, and keys that nobody asked for or that are given twice.
  std::vector<std::string> finish();

 private:
  void visit(const Field& field) override;

  struct State;
  std::unique_ptr<State> state_;
};

/// Writes the fields as YAML; `commented`: each with its unit, range and text. Throws std::logic_error for a key or a
/// member that is declared twice.
class FieldWriter : public Fields {
 public:
  explicit FieldWriter(bool commented) : commented_(commented) {}
  void shorthand(const char* key, const std::function<void(const std::string&)>& apply,
                 const std::vector<std::string>& words, const char* text) override;
  std::string text() const;

 private:
  void visit(const Field& field) override;
  void write(const std::string& line, const std::string& comment);

  bool commented_;
  std::vector<std::string> written_sections_;
  std::vector<std::pair<std::string, std::string>> lines_;  // and their comments
  std::set<const void*> members_;
  std::set<std::string> paths_;
};

/// Every problem as "key = value unit, must be in [lo, hi] unit"; empty when the configuration can be used.
template <typename Config>
std::vector<std::string> problemsOf(Config config) {
  FieldChecker checker;
  Config::fields(config, checker);
  return checker.problems;
}

/// Every key with its value, fit to be read again; `commented`: the shipped file.
template <typename Config>
std::string toYaml(Config config, bool commented = false) {
  FieldWriter writer(commented);
  Config::fields(config, writer);
  return writer.text();
}

/// Throws std::invalid_argument with `head` and a line for each problem, if there is any.
void refuseIfAny(const std::string& head, const std::vector<std::string>& problems);

/// `config` if it can be used; else as refuseIfAny.
template <typename Config>
const Config& requireValid(const std::string& head, const Config& config) {
  refuseIfAny(head, problemsOf(config));
  return config;
}

/// A configuration from YAML. Throws std::invalid_argument, `origin` first, that lists everything wrong.
template <typename Config>
Config parse(const std::string& text, const std::string& origin) {
  Config config;
  FieldReader reader(text, origin);
  Config::fields(config, reader);
  std::vector<std::string> problems = reader.finish();
  for (std::string& problem : problemsOf(config)) problems.push_back(std::move(problem));
  refuseIfAny(origin + ": refused:", problems);
  return config;
}

/// Throws std::invalid_argument for a file that cannot be read or is empty.
std::string readTextFile(const std::string& path);

}  // namespace interactive_mapping
