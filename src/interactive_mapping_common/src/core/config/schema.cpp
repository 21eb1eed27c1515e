// SPDX-License-Identifier: BSD-3-Clause
#include "interactive_mapping_common/config/schema.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <sstream>
#include <stdexcept>

#include <yaml-cpp/yaml.h>

namespace interactive_mapping {
namespace {

template <class... Cases>
struct Overloaded : Cases... {
  using Cases::operator()...;
};
template <class... Cases>
Overloaded(Cases...) -> Overloaded<Cases...>;

std::string join(const std::vector<std::string>& words, const char* between) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : between) + word;
  return text;
}

/// The shortest decimal that reads back as the same double, also for PyYAML, to which 1e-05 is a text.
std::string shortest(double value) {
  std::ostringstream number;
  for (int digits = 6; digits <= 17; ++digits) {
    number.str("");
    number.precision(digits);
    number << value;
    if (std::strtod(number.str().c_str(), nullptr) == value) break;  // stod throws for denormals
  }
  std::string text = number.str();
  const std::size_t exponent = text.find('e');
  if (exponent != std::string::npos && text.find('.') == std::string::npos) text.insert(exponent, ".0");
  return text;
}

std::string rangeOf(const Field& field) {
  const std::string range = "[" + shortest(field.lo) + ", " + shortest(field.hi) + "]";
  return *field.unit == '\0' ? range : range + " " + field.unit;
}

/// YAML allows whole lists and maps as keys.
std::string nameOf(const YAML::Node& key) {
  return key.IsScalar() ? key.Scalar() : key.IsNull() ? "null" : "(not a name)";
}

YAML::Node parseYaml(const std::string& text, const std::string& origin) {
  YAML::Node root;
  try {
    root = YAML::Load(text);
  } catch (const YAML::Exception& error) {
    throw std::invalid_argument(origin + ": not YAML: " + error.what());
  }
  if (!root.IsMap() && !root.IsNull()) throw std::invalid_argument(origin + ": must be a map of keys");
  return root;
}

enum class Type { kText, kBool, kInt, kDouble, kAny };

/// What a scalar is: told by the tags that a ROS parameter gets, or open. Quoted scalars are texts, whatever they spell.
Type typeOf(const YAML::Node& node) {
  static const std::map<std::string, Type> kTags = {
      {"!", Type::kText}, {"!!bool", Type::kBool}, {"!!int", Type::kInt}, {"!!float", Type::kDouble}};
  const auto found = kTags.find(node.Tag());
  return found == kTags.end() ? Type::kAny : found->second;
}

/// For a message: texts in quotes; of a list or map the first entries, for an alias may contain itself.
std::string shown(const YAML::Node& node, int depth = 0) {
  constexpr std::size_t kMaxEntries = 6;
  if (node.IsScalar()) return typeOf(node) == Type::kText ? "'" + node.Scalar() + "'" : node.Scalar();
  if (!node.IsSequence() && !node.IsMap()) return "null";
  std::vector<std::string> parts;
  for (const auto& entry : node) {
    if (depth == 2 || parts.size() == kMaxEntries) {
      parts.emplace_back("...");
      break;
    }
    parts.push_back(node.IsMap() ? nameOf(entry.first) + ": " + shown(entry.second, depth + 1)
                                 : shown(entry, depth + 1));
  }
  return node.IsMap() ? "{" + join(parts, ", ") + "}" : "[" + join(parts, ", ") + "]";
}

template <typename Value>
bool decode(const YAML::Node& node, std::initializer_list<Type> types, Value* value) {
  if (!node.IsScalar()) return false;
  const Type type = typeOf(node);
  if (type != Type::kAny && std::find(types.begin(), types.end(), type) == types.end()) return false;
  return YAML::convert<Value>::decode(node, *value);
}
bool read(const YAML::Node& node, double* value) {
  return decode(node, {Type::kInt, Type::kDouble}, value);
}
bool read(const YAML::Node& node, int* value) {
  return decode(node, {Type::kInt}, value);
}
bool read(const YAML::Node& node, bool* value) {
  return decode(node, {Type::kBool}, value);
}
bool read(const YAML::Node& node, std::string* value) {
  return decode(node, {Type::kText}, value);
}
template <typename Value>
bool read(const YAML::Node& node, std::vector<Value>* values) {
  if (!node.IsSequence()) return false;
  std::vector<Value> all(node.size());
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (!read(node[i], &all[i])) return false;
  }
  *values = all;
  return true;
}
bool read(const YAML::Node& node, Eigen::Vector3d* value) {
  std::vector<double> numbers;
  if (!read(node, &numbers) || numbers.size() != 3) return false;
  *value = Eigen::Vector3d(numbers[0], numbers[1], numbers[2]);
  return true;
}

std::string typeNameOf(const Field& field) {
  static const char* const kNames[] = {"a number",        "a whole number",    "true or false",          "a text",
                                       "a list of texts", "a list of numbers", "a list of three numbers"};
  return field.words.empty() ? kNames[field.value.index()] : "one of " + join(field.words, ", ");
}

/// Quoted where it would not read back as the same text.
std::string quoted(const std::string& text) {
  YAML::Emitter emitter;
  emitter << text;
  const YAML::Node back = YAML::Load(std::string("[") + emitter.c_str() + "]");
  double number = 0.0;
  bool flag = false;
  const bool plain = back.size() == 1 && back[0].IsScalar() && back[0].Scalar() == text &&
                     (typeOf(back[0]) == Type::kText ||
                      (!YAML::convert<double>::decode(back[0], number) && !YAML::convert<bool>::decode(back[0], flag)));
  if (plain) return emitter.c_str();
  YAML::Emitter quoting;
  quoting << YAML::DoubleQuoted << text;
  return quoting.c_str();
}

/// As YAML, on one line.
std::string textOf(const Field& field) {
  const auto list = [](const auto* values) {
    std::vector<std::string> texts;
    for (Eigen::Index i = 0; i < static_cast<Eigen::Index>(values->size()); ++i) {
      texts.push_back(shortest(values->data()[i]));
    }
    return "[" + join(texts, ", ") + "]";
  };
  return std::visit(Overloaded{[](const double* value) { return shortest(*value); },
                               [](const int* value) { return std::to_string(*value); },
                               [](const bool* value) { return std::string(*value ? "true" : "false"); },
                               [](const std::string* value) { return quoted(*value); },
                               [](const std::vector<std::string>* value) {
                                 std::vector<std::string> texts;
                                 for (const std::string& text : *value) texts.push_back(quoted(text));
                                 return "[" + join(texts, ", ") + "]";
                               },
                               [&list](const std::vector<double>* value) { return list(value); },
                               [&list](const Eigen::Vector3d* value) { return list(value); }},
                    field.value);
}

}  // namespace

std::string Fields::pathOf(const std::string& key) const {
  return sections_.empty() ? key : join(sections_, "/") + "/" + key;
}

void FieldChecker::require(bool holds, const std::string& sentence) {
  if (!holds) problems.push_back(pathOf(sentence));
}

void FieldChecker::visit(const Field& field) {
  const auto is_in_range = [&field](double value) { return value >= field.lo && value <= field.hi; };  // not NaN
  const auto all = [&is_in_range](const auto* values) {
    return std::all_of(values->data(), values->data() + values->size(), is_in_range);
  };
  const bool good =
      std::visit(Overloaded{[&](const double* value) { return is_in_range(*value); },
                            [&](const int* value) { return is_in_range(*value); },
                            [&](const std::vector<double>* value) { return all(value); },
                            [&](const Eigen::Vector3d* value) { return all(value); }, [](const auto*) { return true; }},
                 field.value);
  if (good) return;
  const std::string unit = *field.unit == '\0' ? "" : std::string(" ") + field.unit;
  problems.push_back(pathOf(field.key) + " = " + textOf(field) + unit + ", must be in " + rangeOf(field));
}

struct FieldReader::State {
  YAML::Node root;
  std::vector<std::string> problems;
  std::set<std::string> known;

  /// The keys and sections directly below.
  std::string knownBelow(const std::string& prefix) const {
    std::set<std::string> names;
    for (auto path = known.lower_bound(prefix); path != known.end() && path->rfind(prefix, 0) == 0; ++path) {
      names.insert(path->substr(prefix.size(), path->find('/', prefix.size()) - prefix.size()));
    }
    return join({names.begin(), names.end()}, ", ");
  }

  void checkKeys(const YAML::Node& map, const std::string& prefix) {
    std::set<std::string> seen;
    for (const auto& entry : map) {
      const std::string name = nameOf(entry.first);
      const std::string path = prefix + name;
      if (!seen.insert(name).second) problems.push_back(path + " is given twice");  // yaml-cpp takes the first
      if (known.count(path) > 0) continue;
      const auto below = known.lower_bound(path + "/");
      if (below == known.end() || below->compare(0, path.size() + 1, path + "/") != 0) {
        problems.push_back(path + " is unknown; known here: " + knownBelow(prefix));
      } else if (entry.second.IsMap()) {
        checkKeys(entry.second, path + "/");
      } else if (!entry.second.IsNull()) {
        problems.push_back(path + " = " + shown(entry.second) + ", must be a section with keys");
      }
    }
  }
};

FieldReader::FieldReader(const YAML::Node& root) : state_(std::make_unique<State>()) {
  state_->root = root;
}
FieldReader::FieldReader(const std::string& text, const std::string& origin) : FieldReader(parseYaml(text, origin)) {}
FieldReader::~FieldReader() = default;

void FieldReader::ignore(const std::string& path) {
  state_->known.insert(path);
}

void FieldReader::visit(const Field& field) {
  state_->known.insert(pathOf(field.key));
  // Of a const node: operator[] of another one adds what is missing.
  YAML::Node node = state_->root;
  std::vector<std::string> path = sections_;
  path.emplace_back(field.key);
  for (const std::string& part : path) {
    if (!node.IsMap()) return;
    const YAML::Node& parent = node;
    const YAML::Node child = parent[part];
    if (!child.IsDefined()) return;
    node.reset(child);
  }
  std::string word;
  bool good = std::visit([&node](auto* value) { return read(node, value); }, field.value);
  if (good && !field.words.empty()) {
    word = *std::get<std::string*>(field.value);
    good = std::find(field.words.begin(), field.words.end(), word) != field.words.end();
  }
  if (!good) state_->problems.push_back(pathOf(field.key) + " = " + shown(node) + ", must be " + typeNameOf(field));
}

void FieldReader::shorthand(const char* key, const std::function<void(const std::string&)>& apply,
                            const std::vector<std::string>& words, const char* text) {
  std::string word;
  const std::size_t before = state_->problems.size();
  visit({key, &word, text, 0.0, 0.0, "", words});
  if (!word.empty() && state_->problems.size() == before) apply(word);
}

std::vector<std::string> FieldReader::finish() {
  if (state_->root.IsMap()) state_->checkKeys(state_->root, "");
  return state_->problems;
}

void FieldWriter::write(const std::string& line, const std::string& comment) {
  std::size_t same = 0;
  while (same < std::min(sections_.size(), written_sections_.size()) && sections_[same] == written_sections_[same]) {
    ++same;
  }
  if (commented_ && same == 0 && sections_ != written_sections_) lines_.emplace_back("", "");
  for (std::size_t i = same; i < sections_.size(); ++i) {
    const bool has_text = commented_ && i + 1 == sections_.size();
    lines_.emplace_back(std::string(2 * i, ' ') + sections_[i] + ":", has_text ? section_text_ : "");
  }
  written_sections_ = sections_;
  lines_.emplace_back(std::string(2 * sections_.size(), ' ') + line, comment);
}

void FieldWriter::visit(const Field& field) {
  const void* member = std::visit([](const auto* value) -> const void* { return value; }, field.value);
  // A choice is passed on as a text of the moment.
  if (!paths_.insert(pathOf(field.key)).second || (field.words.empty() && !members_.insert(member).second)) {
    throw std::logic_error(pathOf(field.key) + " is declared twice");
  }
  std::string comment;
  if (commented_) {
    comment = !field.words.empty() ? join(field.words, ", ") : field.hi > field.lo ? rangeOf(field) : "";
    if (*field.text != '\0') comment += (comment.empty() ? "" : ": ") + std::string(field.text);
  }
  write(field.key + (": " + textOf(field)), comment);
}

void FieldWriter::shorthand(const char* key, const std::function<void(const std::string&)>& /*apply*/,
                            const std::vector<std::string>& words, const char* text) {
  if (commented_) write(std::string("# ") + key + ": " + words.front(), join(words, ", ") + ": " + text);
}

std::string FieldWriter::text() const {
  constexpr std::size_t kComments = 34, kWidth = 120;  // columns
  std::string all;
  for (const auto& [line, comment] : lines_) {
    all += line;
    std::size_t column = line.size();
    std::istringstream words(comment);
    for (std::string word; words >> word;) {
      const bool begins = column == line.size();
      if (!begins && column + 1 + word.size() > kWidth) {
        all += '\n';
        column = 0;
      }
      const std::string mark =
          begins || column == 0 ? std::string(std::max(column + 2, kComments) - column, ' ') + "# " : " ";
      all += mark + word;
      column += mark.size() + word.size();
    }
    all += '\n';
  }
  return all;
}

void refuseIfAny(const std::string& head, const std::vector<std::string>& problems) {
  if (!problems.empty()) throw std::invalid_argument(head + "\n  " + join(problems, "\n  "));
}

std::string readTextFile(const std::string& path) {
  if (std::filesystem::is_directory(path)) throw std::invalid_argument(path + ": cannot be read: is a folder");
  std::ifstream file(path);
  std::ostringstream text;
  text << file.rdbuf();
  if (!file) throw std::invalid_argument(path + ": cannot be read");
  if (text.str().empty()) throw std::invalid_argument(path + ": is empty");
  return text.str();
}

}  // namespace interactive_mapping
