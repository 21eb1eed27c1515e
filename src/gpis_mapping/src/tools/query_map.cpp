// SPDX-License-Identifier: BSD-3-Clause
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iostream>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include <boost/program_options.hpp>

#include <interactive_mapping_common/files/atomic_file.h>
#include <interactive_mapping_common/threads/parallel_for.h>
#include "gpis_mapping/gpis_map.h"
#include "gpis_mapping/map_io.h"
#include "tool_support.h"

namespace gpis_mapping {
namespace {

using interactive_mapping::AtomicFile;
using interactive_mapping::FileError;
using interactive_mapping::parallelFor;
using interactive_mapping::resolveThreadCount;

namespace po = boost::program_options;

constexpr std::size_t kBlockPoints = 100000;  // per query; keeps memory small whatever the number of points
constexpr char kOutHeader[] = "x,y,z,distance,variance,gx,gy,gz,occupancy,state,euclidean_distance\n";

struct Options {
  std::string map;
  std::string points;
  std::string out;
  bool is_quiet{false};
};

/// Nothing when only help was asked for.
std::optional<Options> parseCommandLine(int argc, char** argv) {
  Options options;
  po::options_description visible("Options");
  visible.add_options()                                                                          //
      ("help,h", "show this text")                                                               //
      ("points", po::value(&options.points), "points to ask for: CSV with columns x, y, z [m]")  //
      ("out", po::value(&options.out), "answers: CSV")                                           //
      ("quiet,q", po::bool_switch(&options.is_quiet), "no progress on stderr");
  po::options_description all;
  all.add(visible).add_options()("map", po::value(&options.map));
  po::positional_options_description positional;
  positional.add("map", 1);
  po::variables_map values;
  po::store(po::command_line_parser(argc, argv).options(all).positional(positional).run(), values);
  if (values.count("help") > 0) {
    std::cout << "Usage: query_map MAP.gpis --points IN.csv --out OUT.csv [options]\n"
                 "Asks a saved map at points of its frame. OUT.csv has the columns\n"
                 "  x,y,z               the point [m], as given\n"
                 "  distance            signed distance to the surface [m], negative inside\n"
                 "  variance            of the field [m^2]\n"
                 "  gx,gy,gz            gradient of the distance\n"
                 "  occupancy           probability of being inside\n"
                 "  state               free, occupied or unknown\n"
                 "  euclidean_distance  to the nearest mapped surface [m], without sign, far-reaching\n"
                 "A field is empty where there is no answer. Points with an empty or non-finite coordinate get none.\n"
                 "Exit code: 0 done, 1 failure, 2 wrong usage.\n\n"
              << visible;
    return std::nullopt;
  }
  po::notify(values);
  if (options.map.empty()) throw UsageError("MAP.gpis is missing");
  if (options.points.empty()) throw UsageError("--points IN.csv is missing");
  if (options.out.empty()) throw UsageError("--out OUT.csv is missing");
  return options;
}

struct Field {
  const char* begin;
  const char* end;

  std::size_t size() const { return static_cast<std::size_t>(end - begin); }
  std::string text() const { return {begin, size()}; }
};

/// Splits at commas; blanks and one pair of quotes around a field are dropped.
void split(const std::string& line, std::vector<Field>* fields) {
  fields->clear();
  const char* at = line.data();
  const char* const line_end = at + line.size();
  while (true) {
    const char* comma = std::find(at, line_end, ',');
    Field field{at, comma};
    const auto isBlank = [](char c) { return c == ' ' || c == '\t' || c == '\r'; };
    while (field.begin < field.end && isBlank(*field.begin)) ++field.begin;
    while (field.begin < field.end && isBlank(*(field.end - 1))) --field.end;
    if (field.size() >= 2 && *field.begin == '"' && *(field.end - 1) == '"') {
      ++field.begin;
      --field.end;
    }
    fields->push_back(field);
    if (comma == line_end) return;
    at = comma + 1;
  }
}

/// Reads points from a CSV file, block by block.
class PointReader {
 public:
  explicit PointReader(const std::string& path) : path_(path) {
    struct stat status {};
    if (::stat(path.c_str(), &status) == 0 && S_ISDIR(status.st_mode)) throw FileError(path + ": is a directory");
    errno = 0;
    in_.open(path, std::ios::binary);
    if (!in_) throw FileError(path + ": cannot be read: " + std::strerror(errno == 0 ? EIO : errno));
    readHeader();
  }

  /// The next points, NaN where there is no coordinate, and their coordinates as written. False at the end.
  bool next(std::size_t max_points, Points3d* points, std::vector<std::array<std::string, 3>>* written) {
    points->resize(3, static_cast<Eigen::Index>(max_points));
    written->clear();
    while (written->size() < max_points && nextLine()) {
      split(line_, &fields_);
      if (fields_.size() != num_columns_) {
        throw FileError(where() + "has " + std::to_string(fields_.size()) + " columns, must have " +
                        std::to_string(num_columns_) + " as the header");
      }
      const auto row = static_cast<Eigen::Index>(written->size());
      written->emplace_back();
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const Field& field = fields_[columns_[axis]];
        const double value = parse(field);
        (*points)(static_cast<Eigen::Index>(axis), row) = value;
        if (std::isfinite(value)) written->back()[axis].assign(field.begin, field.end);
      }
    }
    points->conservativeResize(3, static_cast<Eigen::Index>(written->size()));
    return !written->empty();
  }

 private:
  std::string where() const { return path_ + ":" + std::to_string(line_number_) + ": "; }

  /// The next line that is not blank.
  bool nextLine() {
    while (std::getline(in_, line_)) {
      ++line_number_;
      if (line_.find_first_not_of(" \t\r") != std::string::npos) return true;
    }
    if (in_.bad()) throw FileError(path_ + ": cannot be read to its end");
    return false;
  }

  void readHeader() {
    if (!nextLine()) throw FileError(path_ + ": is empty, must begin with a header that names x, y and z");
    if (line_.compare(0, 3, "\xEF\xBB\xBF") == 0) line_.erase(0, 3);  // byte order mark of spreadsheets
    split(line_, &fields_);
    num_columns_ = fields_.size();
    const char* const names[3] = {"x", "y", "z"};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto is_axis = [&](const Field& field) { return field.text() == names[axis]; };
      const auto count = std::count_if(fields_.begin(), fields_.end(), is_axis);
      if (count != 1) {
        throw FileError(where() + "header has " + std::to_string(count) + " columns named " + names[axis] +
                        ", must have one each of x, y, z");
      }
      columns_[axis] =
          static_cast<std::size_t>(std::find_if(fields_.begin(), fields_.end(), is_axis) - fields_.begin());
    }
  }

  /// NaN for an empty field; anything that is not a number is refused.
  double parse(const Field& field) const {
    if (field.size() == 0) return std::numeric_limits<double>::quiet_NaN();
    // line_ ends in a zero and no comma, quote or blank is part of a number: strtod stops in time.
    char* end = nullptr;
    const double value = std::strtod(field.begin, &end);
    if (end != field.end) throw FileError(where() + "'" + field.text() + "' is not a number");
    return value;
  }

  std::string path_;
  std::ifstream in_;
  std::string line_;
  std::size_t line_number_{0};
  std::size_t num_columns_{0};
  std::array<std::size_t, 3> columns_{};
  std::vector<Field> fields_;
};

void appendNumber(double value, std::string* text) {
  if (std::isnan(value)) return;
  char number[32];
  text->append(number, static_cast<std::size_t>(std::snprintf(number, sizeof(number), "%.9g", value)));
}

std::string answerRow(const std::array<std::string, 3>& written, const QueryResult& result, Eigen::Index i) {
  std::string row;
  row.reserve(160);
  for (const std::string& coordinate : written) row += coordinate + ',';
  const double numbers[] = {result.distance[i],    result.variance[i],    result.gradient(0, i),
                            result.gradient(1, i), result.gradient(2, i), result.occupancy[i]};
  for (const double number : numbers) {
    appendNumber(number, &row);
    row += ',';
  }
  row += toString(result.state[static_cast<std::size_t>(i)]);
  row += ',';
  appendNumber(result.euclidean_distance[i], &row);
  row += '\n';
  return row;
}

int queryMap(int argc, char** argv) {
  const std::optional<Options> options = parseCommandLine(argc, argv);
  if (!options) return kExitOk;
  PointReader reader(options->points);
  const GpisMap map(loadMap(options->map));
  const auto snapshot = map.snapshot();
  AtomicFile out(options->out);
  out.write(kOutHeader);
  Points3d points_map;
  std::vector<std::array<std::string, 3>> written;
  std::vector<std::string> rows;
  std::size_t num_points = 0;
  while (reader.next(kBlockPoints, &points_map, &written)) {
    const QueryResult result = snapshot->query(points_map);
    rows.resize(written.size());
    parallelFor(rows.size(), resolveThreadCount(map.config().threads), 1000, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) rows[i] = answerRow(written[i], result, static_cast<Eigen::Index>(i));
    });
    for (const std::string& row : rows) out.write(row);
    num_points += rows.size();
    if (!options->is_quiet && rows.size() == kBlockPoints) {
      std::fprintf(stderr, "query_map: %zu points\n", num_points);
    }
  }
  out.commit();
  return kExitOk;
}

}  // namespace
}  // namespace gpis_mapping

int main(int argc, char** argv) {
  return gpis_mapping::runTool("query_map", argc, argv, gpis_mapping::queryMap);
}
