// SPDX-License-Identifier: BSD-3-Clause
// Ten thousand picks planned in piles that nobody has seen before, each answer judged by the exact scene. A line of JSON
// for each pile: what came out, how long the longest took, and every plan that was not good. Goes on where it was
// interrupted.
#include <algorithm>
#include <fstream>
#include <iostream>
#include <map>
#include <stdexcept>
#include <string>

#include <boost/program_options.hpp>
#include <nlohmann/json.hpp>

#include "planning_problems/plan_judge.h"
#include "planning_problems/problem_planner.h"
#include "synthetic_depth/seeded_random.h"

namespace experiments {
namespace {

using nlohmann::json;

constexpr std::uint64_t kFirstPile = 1000;  // the tests' piles are below
constexpr int kStands = 8;
constexpr int kTargets = 5;

struct Options {
  std::uint64_t plans{10000};
  std::string root{WORKSPACE_ROOT};
  std::string out{"."};
  std::string label;  // of the tree: another one starts anew
};

struct Totals {
  std::uint64_t piles{0};
  std::uint64_t plans{0};
  std::uint64_t bad{0};
  double worst_ms{0.0};
  std::string worst;
  double worst_overlap_mm{0.0};
  std::map<std::string, std::uint64_t> statuses;

  void add(const json& line) {
    ++piles;
    for (const auto& [status, count] : line.at("statuses").items()) {
      statuses[status] += count.get<std::uint64_t>();
      plans += count.get<std::uint64_t>();
    }
    bad += line.at("bad").size();
    if (line.at("worst_ms").get<double>() > worst_ms) {
      worst_ms = line.at("worst_ms");
      worst = line.at("worst");
    }
    worst_overlap_mm = std::max(worst_overlap_mm, line.at("lift_overlap_mm").get<double>());
  }
};

/// One way of having looked at a pile, drawn for each: from well to badly.
SurveyConfig surveyOf(std::uint64_t seed) {
  synthetic_depth::SeededRandom random(seed, 23, 0);
  SurveyConfig survey;
  survey.approach_looks = 1 + static_cast<int>(random.next() % 4);
  survey.arc_looks = static_cast<int>(random.next() % 9);
  survey.stand_looks = 1 + static_cast<int>(random.next() % 2);
  survey.depth_noise_per_m = random.uniform(0.001, 0.003);
  return survey;
}

json plansOfPile(std::uint64_t seed, const Options& options) {
  const ProblemMaker maker(
      {options.root + "/sim_tests/simulated_world/worlds", options.root + "/src/mp700_ur5e_description"},
      surveyOf(seed));
  motion_planning::MotionPlannerConfig config;
  config.planner.seed = seed;
  ProblemPlanner planner(maker, options.root + "/src/motion_planning/config/manipulability_sectors.yaml", {}, config);
  json line = {{"pile", seed}, {"statuses", json::object()}, {"bad", json::array()}, {"worst_ms", 0.0},
               {"worst", ""},  {"lift_overlap_mm", 0.0}};
  for (const PlanningProblem& problem : maker.problemsOfPile(seed, kStands, kTargets)) {
    const ProblemPlanner::Answer answer = planner.plan(problem);
    const std::string status = answer.status();
    line["statuses"][status] = line["statuses"].value(status, 0) + 1;
    if (answer.plan_ms > line["worst_ms"].get<double>()) {
      line["worst_ms"] = answer.plan_ms;
      line["worst"] = problem.name + ": " + status;
    }
    if (!answer.plan) {
      if (answer.plan.failure().message.empty())
        line["bad"].push_back({{"problem", problem.name}, {"why", "no reason given"}});
      continue;
    }
    const PlanVerdict verdict = judgePick(maker, problem, *answer.plan, planner.planner().config());
    line["lift_overlap_mm"] = std::max(line["lift_overlap_mm"].get<double>(), 1e3 * verdict.lift_overlap_m);
    if (!verdict.isGood()) line["bad"].push_back({{"problem", problem.name}, {"why", verdict.describe()}});
  }
  return line;
}

int run(const Options& options) {
  const std::string path = options.out + "/planning.jsonl";
  Totals totals;
  std::uint64_t seed = kFirstPile;
  {
    std::ifstream in(path);
    std::string text;
    if (std::getline(in, text) && json::parse(text).value("label", "") == options.label) {
      // The last line of an interrupted run may be half a line.
      while (std::getline(in, text) && !in.eof()) {
        const json line = json::parse(text);
        totals.add(line);
        seed = line.at("pile").get<std::uint64_t>() + 1;
      }
      std::cout << totals.plans << " plans of " << totals.piles << " piles were made before" << std::endl;
    }
  }
  {  // Anew, or without the half line.
    std::ifstream in(path);
    std::string kept;
    std::string text;
    for (std::uint64_t i = 0; i < totals.piles + 1 && std::getline(in, text); ++i) kept += text + '\n';
    in.close();
    std::ofstream out(path);
    out << (totals.piles > 0 ? kept : json{{"label", options.label}}.dump() + '\n');
  }
  std::ofstream out(path, std::ios::app);
  for (; totals.plans < options.plans; ++seed) {
    const json line = plansOfPile(seed, options);
    out << line.dump() << std::endl;
    if (!out) throw std::runtime_error(path + ": cannot be written");
    totals.add(line);
    for (const json& bad : line["bad"]) std::cout << "BAD " << bad.dump() << std::endl;
    if (totals.piles % 10 == 0) std::cout << totals.plans << " plans of " << totals.piles << " piles" << std::endl;
  }
  const json summary = {{"plans", totals.plans},
                        {"piles", totals.piles},
                        {"bad", totals.bad},
                        {"statuses", totals.statuses},
                        {"worst_ms", totals.worst_ms},
                        {"worst", totals.worst},
                        {"lift_overlap_mm", totals.worst_overlap_mm}};
  std::cout << summary.dump() << std::endl;
  return totals.bad == 0 ? 0 : 1;
}

}  // namespace
}  // namespace experiments

int main(int argc, char** argv) {
  namespace po = boost::program_options;
  experiments::Options options;
  po::options_description description("Plans picks in random piles and judges them by the exact scene. Options");
  auto add = description.add_options();
  add("help", "this text");
  add("plans", po::value(&options.plans)->default_value(options.plans), "how many, those made before included");
  add("root", po::value(&options.root)->default_value(options.root), "folder of the workspace");
  add("out", po::value(&options.out)->default_value(options.out), "folder for planning.jsonl");
  add("label", po::value(&options.label)->default_value(options.label),
      "of the tree's state: what another one left is not gone on with");
  try {
    po::variables_map values;
    po::store(po::parse_command_line(argc, argv, description), values);
    po::notify(values);
    if (values.count("help") > 0) {
      std::cout << description;
      return 0;
    }
  } catch (const po::error& error) {
    std::cerr << "soak_planning: " << error.what() << '\n' << description;
    return 2;
  }
  try {
    return experiments::run(options);
  } catch (const std::exception& error) {
    std::cerr << "soak_planning: " << error.what() << '\n';
    return 1;
  }
}
