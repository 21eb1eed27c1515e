// SPDX-License-Identifier: BSD-3-Clause
// How well picks are planned in simulated piles, judged by the exact scene: success, time, way, clearance, collisions; by
// margin policy and by how well the pile was seen; beside plain RRTConnect. A CSV row for each problem, a JSON summary.
#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <iostream>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

#include <boost/program_options.hpp>
#include <nlohmann/json.hpp>
#include <ompl/util/RandomNumbers.h>

#include "plain_rrt_connect.h"
#include "planning_problems/exact_checker.h"
#include "planning_problems/plan_judge.h"
#include "planning_problems/problem_planner.h"
#include "synthetic_depth/seeded_random.h"

namespace experiments {
namespace {

using nlohmann::json;

/// How a surface's uncertainty becomes distance.
struct Margin {
  std::string name;
  double sigmas;
  double margin_m;
  bool is_fixed;
};

struct Condition {
  std::string name;
  std::string text;
  SurveyConfig survey;
};

std::vector<Margin> margins() {
  std::vector<Margin> result;
  // The first is both: no sigma and 5 mm.
  for (const double mm : {5.0, 10.0, 15.0, 20.0, 30.0}) {
    result.push_back({"fixed_" + std::to_string(static_cast<int>(mm)) + "mm", 0.0, 1e-3 * mm, true});
  }
  for (const int sigmas : {1, 2, 3}) result.push_back({"sigma_" + std::to_string(sigmas), 1.0 * sigmas, 0.005, false});
  return result;
}

std::vector<Condition> conditions() {
  SurveyConfig good;
  SurveyConfig noisy = good;
  noisy.depth_noise_per_m = 0.006;
  SurveyConfig few = good;
  few.approach_looks = 1;
  few.arc_looks = 0;
  few.stand_looks = 1;
  SurveyConfig few_noisy = few;
  few_noisy.depth_noise_per_m = 0.006;
  SurveyConfig poor_poses = good;
  poor_poses.pose_error_m = 0.005;
  poor_poses.pose_error_rad = 0.005;
  return {{"good", "12 looks or more, 1.5 mm at 1 m", good},
          {"noisy", "the same looks, 6 mm at 1 m", noisy},
          {"few", "2 looks for the first standing place, 1 more for each other, 1.5 mm at 1 m", few},
          {"few_noisy", "as few looks, 6 mm at 1 m", few_noisy},
          {"poor_poses", "12 looks or more, 1.5 mm at 1 m, camera poses off by 5 mm and 5 mrad (sigma)", poor_poses}};
}

double quantile(std::vector<double> values, double share) {
  if (values.empty()) return std::nan("");
  const auto rank = static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1) + 0.5);
  std::nth_element(values.begin(), values.begin() + rank, values.end());
  return values[static_cast<std::size_t>(rank)];
}

struct Row {
  std::string group;  // standard, margins, plain
  std::string condition;
  std::string margin;
  std::string problem;
  bool is_touchable{false};
  std::string status;
  double plan_ms{0.0};
  double wall_ms{0.0};
  double scene_ms{0.0};
  PlanVerdict verdict;

  bool isSolved() const { return status == "success"; }
};

std::string safe(std::string text) {
  std::replace(text.begin(), text.end(), ',', ';');
  std::replace(text.begin(), text.end(), '\n', '|');
  return text;
}

void writeHeader(std::ostream& out) {
  out << "group,condition,margin,problem,touchable,status,plan_ms,wall_ms,scene_ms,clearance_mm,collisions,faults,"
         "deepest_mm,lift_overlap_mm,path_rad,duration_s,complaints\n";
}

void write(const Row& row, std::ostream& out) {
  double deepest_m = 0.0;
  for (const Collision& collision : row.verdict.collisions) deepest_m = std::max(deepest_m, collision.depth_m);
  out << row.group << ',' << row.condition << ',' << row.margin << ',' << row.problem << ',' << row.is_touchable << ','
      << row.status << ',' << row.plan_ms << ',' << row.wall_ms << ',' << row.scene_ms << ','
      << 1e3 * row.verdict.clearance_m << ',' << row.verdict.collisions.size() << ',' << row.verdict.faults.size()
      << ',' << 1e3 * deepest_m << ',' << 1e3 * row.verdict.lift_overlap_m << ',' << row.verdict.path_rad << ','
      << row.verdict.duration_s << ',' << safe(row.verdict.describe()) << std::endl;
}

json summary(const std::vector<Row>& rows) {
  int touchable = 0;
  int solved = 0;
  int solved_touchable = 0;
  int colliding = 0;
  int faulty = 0;
  double deepest_m = 0.0;
  std::vector<double> plan_ms;
  std::vector<double> solved_ms;
  std::vector<double> clearance_mm;
  std::vector<double> path_rad;
  std::vector<double> duration_s;
  std::map<std::string, int> reasons;
  for (const Row& row : rows) {
    touchable += row.is_touchable;
    plan_ms.push_back(row.plan_ms);
    if (!row.isSolved()) {
      ++reasons[row.status];
      continue;
    }
    ++solved;
    solved_touchable += row.is_touchable;
    colliding += !row.verdict.collisions.empty();
    faulty += !row.verdict.faults.empty();
    for (const Collision& collision : row.verdict.collisions) deepest_m = std::max(deepest_m, collision.depth_m);
    solved_ms.push_back(row.plan_ms);
    clearance_mm.push_back(1e3 * row.verdict.clearance_m);
    path_rad.push_back(row.verdict.path_rad);
    duration_s.push_back(row.verdict.duration_s);
  }
  const auto number = [](double value) { return std::isfinite(value) ? json(value) : json(nullptr); };
  return {{"problems", rows.size()},
          {"touchable", touchable},
          {"solved", solved},
          {"solved_touchable", solved_touchable},
          {"colliding", colliding},
          {"faulty", faulty},
          {"deepest_mm", 1e3 * deepest_m},
          {"plan_ms_median", number(quantile(plan_ms, 0.5))},
          {"plan_ms_p95", number(quantile(plan_ms, 0.95))},
          {"plan_ms_max", number(quantile(plan_ms, 1.0))},
          {"solved_ms_median", number(quantile(solved_ms, 0.5))},
          {"solved_ms_p95", number(quantile(solved_ms, 0.95))},
          {"clearance_mm_min", number(quantile(clearance_mm, 0.0))},
          {"clearance_mm_p05", number(quantile(clearance_mm, 0.05))},
          {"clearance_mm_median", number(quantile(clearance_mm, 0.5))},
          {"path_rad_median", number(quantile(path_rad, 0.5))},
          {"duration_s_median", number(quantile(duration_s, 0.5))},
          {"failures", reasons}};
}

class Evaluation {
 public:
  Evaluation(ProblemFiles files, std::string sectors, std::ostream* csv)
      : files_(std::move(files)), sectors_(std::move(sectors)), csv_(csv) {
    writeHeader(*csv);
  }

  /// Default settings, default survey; plain RRTConnect on the same problems.
  void standard(int piles) {
    const ProblemMaker maker(files_, SurveyConfig{});
    ProblemPlanner planner(maker, sectors_);
    std::vector<Row> rows;
    std::vector<Row> plain_rows;
    for (int seed = 1; seed <= piles; ++seed) {
      for (const PlanningProblem& problem : maker.problemsOfPile(static_cast<std::uint64_t>(seed))) {
        const bool is_touchable = isTouchable(maker, *planner.arm(), problem);
        rows.push_back(pick("standard", "good", "default", maker, &planner, problem, is_touchable));
        Row plain;
        plain.group = "plain";
        plain.condition = "good";
        plain.margin = "default";
        plain.problem = problem.name;
        plain.is_touchable = is_touchable;
        const auto scene = planner.scene(problem);
        const PlainReach reach =
            planPlainReach(problem, maker.stowed(), planner.arm(), scene, planner.planner().config());
        plain.status = reach.reason;
        plain.plan_ms = reach.plan_ms;
        if (reach.is_solved) plain.verdict = judgeReach(maker, problem, reach.path);
        write(plain, *csv_);
        plain_rows.push_back(plain);
      }
      std::cerr << "standard: pile " << seed << " of " << piles << ", " << rows.size() << " problems" << std::endl;
    }
    json_["standard"] = summary(rows);
    json_["plain"] = summary(plain_rows);
  }

  /// All margins under all conditions.
  void marginPolicies(int piles) {
    for (const Condition& condition : conditions()) {
      const ProblemMaker maker(files_, condition.survey);
      std::map<std::string, std::vector<Row>> rows;
      std::vector<std::unique_ptr<ProblemPlanner>> planners;
      for (const Margin& margin : margins()) {
        motion_planning::CollisionSceneConfig scene;
        scene.sigmas = margin.sigmas;
        scene.margin_m = margin.margin_m;
        planners.push_back(std::make_unique<ProblemPlanner>(maker, sectors_, scene));
      }
      std::vector<double> sigma_mm;
      for (int seed = 1; seed <= piles; ++seed) {
        std::shared_ptr<const Stand> stand;
        for (const PlanningProblem& problem : maker.problemsOfPile(static_cast<std::uint64_t>(seed))) {
          if (stand != problem.stand) addSigmas(problem, &sigma_mm);
          stand = problem.stand;
          const bool is_touchable = isTouchable(maker, *planners.front()->arm(), problem);
          for (std::size_t i = 0; i < planners.size(); ++i) {
            const std::string name = margins()[i].name;
            rows[name].push_back(
                pick("margins", condition.name, name, maker, planners[i].get(), problem, is_touchable));
          }
        }
        std::cerr << "margins, " << condition.name << ": pile " << seed << " of " << piles << std::endl;
      }
      json& out = json_["margins"][condition.name];
      out["text"] = condition.text;
      out["sigma_mm_median"] = quantile(sigma_mm, 0.5);
      out["sigma_mm_p95"] = quantile(sigma_mm, 0.95);
      for (const Margin& margin : margins()) {
        json entry = summary(rows[margin.name]);
        entry["sigmas"] = margin.sigmas;
        entry["margin_mm"] = 1e3 * margin.margin_m;
        entry["is_fixed"] = margin.is_fixed;
        out["policies"][margin.name] = entry;
      }
    }
  }

  /// The collision test alone: random postures close to the pile, judged by the exact scene. More of them than plans can
  /// be made, so that margins can be told apart.
  void postures(int piles, int per_stand) {
    for (const Condition& condition : conditions()) {
      const ProblemMaker maker(files_, condition.survey);
      std::vector<PostureCount> counts(margins().size());
      for (int seed = 1; seed <= piles; ++seed) {
        std::shared_ptr<const Stand> stand;
        for (const PlanningProblem& problem : maker.problemsOfPile(static_cast<std::uint64_t>(seed))) {
          if (stand == problem.stand) continue;
          stand = problem.stand;
          countPostures(maker, *stand, static_cast<std::uint64_t>(seed), per_stand, &counts);
        }
        std::cerr << "postures, " << condition.name << ": pile " << seed << " of " << piles << std::endl;
      }
      for (std::size_t i = 0; i < counts.size(); ++i) {
        const PostureCount& count = counts[i];
        const Margin margin = margins()[i];
        json entry = {{"sigmas", margin.sigmas},     {"margin_mm", 1e3 * margin.margin_m},
                      {"is_fixed", margin.is_fixed}, {"colliding", count.colliding},
                      {"missed", count.missed},      {"deepest_missed_mm", 1e3 * count.deepest_missed_m},
                      {"clear", count.clear},        {"blocked", count.blocked}};
        json_["postures"][condition.name]["policies"][margin.name] = entry;
      }
      json_["postures"][condition.name]["text"] = condition.text;
    }
  }

  const json& result() const { return json_; }

 private:
  struct PostureCount {
    int colliding{0};  // arm in a brick by more than kTouch_m
    int missed{0};     // and called free
    double deepest_missed_m{0.0};
    std::array<int, 3> clear{};    // so far from all bricks: 10 to 20 mm, 20 to 40 mm, 40 to 60 mm
    std::array<int, 3> blocked{};  // and called in the way
  };

  /// Postures with the arm deeper than 30 mm in bricks or farther than 60 mm from them are no question.
  void countPostures(const ProblemMaker& maker, const Stand& stand, std::uint64_t seed, int wanted,
                     std::vector<PostureCount>* counts) {
    constexpr double kTouch_m = 0.0005;
    constexpr double kDeep_m = 0.03;
    constexpr double kFar_m = 0.06;
    const auto arm = std::make_shared<motion_planning::ArmKinematics>(maker.robot());
    ExactChecker exact(maker.robot(), stand.bricks, stand.T_map_base);
    std::vector<std::unique_ptr<motion_planning::CollisionChecker>> checkers;
    for (const Margin& margin : margins()) {
      motion_planning::CollisionSceneConfig config;
      config.sigmas = margin.sigmas;
      config.margin_m = margin.margin_m;
      motion_planning::CollisionSceneBuilder builder(config);
      builder.update(stand.surface, motion_planning::SnapshotView(stand.map), stand.T_map_base);
      checkers.push_back(std::make_unique<motion_planning::CollisionChecker>(arm, builder.scene(), stand.T_map_base));
      checkers.back()->freeUnknownAt(maker.stowed());
    }
    synthetic_depth::SeededRandom random(seed, 31, stand.looks);
    for (int found = 0, tried = 0; found < wanted && tried < 400 * wanted; ++tried) {
      const motion_planning::ArmVector q =
          motion_planning::ArmVector::NullaryExpr([&](Eigen::Index) { return random.uniform(-M_PI, M_PI); });
      const double clearance_m = exact.clearance(q, kFar_m);
      if (clearance_m >= kFar_m) continue;
      double depth_m = 0.0;
      bool is_question = true;
      for (const Overlap& overlap : exact.overlaps(q)) {
        if (overlap.brick_id < 0) is_question = false;  // in itself or in the ground: called so whatever the margin
        depth_m = std::max(depth_m, overlap.depth_m);
      }
      if (!is_question || depth_m > kDeep_m || (depth_m == 0.0 && clearance_m < 0.01)) continue;
      ++found;
      for (std::size_t i = 0; i < checkers.size(); ++i) {
        PostureCount& count = (*counts)[i];
        const motion_planning::Contact contact = checkers[i]->check(q);
        if (depth_m > kTouch_m) {
          ++count.colliding;
          if (contact) continue;
          ++count.missed;
          count.deepest_missed_m = std::max(count.deepest_missed_m, depth_m);
        } else if (depth_m == 0.0) {
          // What is unknown or near itself is in the way under all margins.
          if (contact && contact.kind != motion_planning::CollisionKind::kSurface &&
              contact.kind != motion_planning::CollisionKind::kInside) {
            continue;
          }
          const std::size_t bin = clearance_m < 0.02 ? 0 : (clearance_m < 0.04 ? 1 : 2);
          ++count.clear[bin];
          count.blocked[bin] += static_cast<bool>(contact);
        }
      }
    }
  }

  Row pick(const std::string& group, const std::string& condition, const std::string& margin, const ProblemMaker& maker,
           ProblemPlanner* planner, const PlanningProblem& problem, bool is_touchable) {
    Row row;
    row.group = group;
    row.condition = condition;
    row.margin = margin;
    row.problem = problem.name;
    row.is_touchable = is_touchable;
    const ProblemPlanner::Answer answer = planner->plan(problem);
    row.status = answer.status();
    row.plan_ms = answer.plan_ms;
    row.wall_ms = answer.plan_wall_ms;
    row.scene_ms = answer.scene.mesh_ms + answer.scene.lattice_ms;
    if (row.isSolved()) row.verdict = judgePick(maker, problem, *answer.plan, planner->planner().config());
    write(row, *csv_);
    return row;
  }

  /// Position uncertainty of the pile's surface, at every tenth vertex above the ground.
  static void addSigmas(const PlanningProblem& problem, std::vector<double>* sigma_mm) {
    std::vector<Eigen::Vector3d> asked;
    for (std::size_t i = 0; i < problem.stand->surface.vertices_map.size(); i += 10) {
      const Eigen::Vector3d& vertex = problem.stand->surface.vertices_map[i];
      if ((problem.stand->T_map_base.inverse() * vertex).z() > 0.05) asked.push_back(vertex);
    }
    gpis_mapping::Points3d points(3, static_cast<Eigen::Index>(asked.size()));
    for (std::size_t i = 0; i < asked.size(); ++i) points.col(static_cast<Eigen::Index>(i)) = asked[i];
    const motion_planning::MapAnswers answers = motion_planning::SnapshotView(problem.stand->map).query(points);
    for (const double std_m : answers.surface_std_m) {
      if (std::isfinite(std_m)) sigma_mm->push_back(1e3 * std_m);
    }
  }

  ProblemFiles files_;
  std::string sectors_;
  std::ostream* csv_;
  json json_;
};

}  // namespace
}  // namespace experiments

int main(int argc, char** argv) {
  namespace po = boost::program_options;
  using experiments::Evaluation;
  std::string root = WORKSPACE_ROOT;
  std::string out = ".";
  int piles = 17;
  int margin_piles = 5;
  int posture_piles = 10;
  int postures = 400;
  po::options_description description("Plans picks in simulated piles and judges them by the exact scene. Options");
  auto add = description.add_options();
  add("help", "this text");
  add("root", po::value(&root)->default_value(root), "folder of the workspace");
  add("piles", po::value(&piles)->default_value(piles), "of the standard part; 17 give 200 problems. 0: leave it out");
  add("margin-piles", po::value(&margin_piles)->default_value(margin_piles), "of each condition of the margins' part");
  add("posture-piles", po::value(&posture_piles)->default_value(posture_piles),
      "of each condition of the postures' part");
  add("postures", po::value(&postures)->default_value(postures), "from each standing place");
  add("out", po::value(&out)->default_value(out), "folder for evaluate_planning.csv and .json");
  try {
    po::variables_map values;
    po::store(po::parse_command_line(argc, argv, description), values);
    po::notify(values);
    if (values.count("help") > 0) {
      std::cout << description;
      return 0;
    }
    if (piles < 0 || margin_piles < 0 || posture_piles < 0 || postures < 0) throw po::error("numbers must be >= 0");
  } catch (const po::error& error) {
    std::cerr << "evaluate_planning: " << error.what() << '\n' << description;
    return 2;
  }
  try {
    ompl::RNG::setSeed(1);  // of plain RRTConnect; before anything draws
    std::ofstream csv(out + "/evaluate_planning.csv");
    Evaluation evaluation({root + "/sim_tests/simulated_world/worlds", root + "/src/mp700_ur5e_description"},
                          root + "/src/motion_planning/config/manipulability_sectors.yaml", &csv);
    if (posture_piles > 0) evaluation.postures(posture_piles, postures);
    if (piles > 0) evaluation.standard(piles);
    if (margin_piles > 0) evaluation.marginPolicies(margin_piles);
    std::ofstream summary(out + "/evaluate_planning.json");
    summary << evaluation.result().dump(2) << '\n';
    if (!csv.flush() || !summary.flush()) throw std::runtime_error("cannot write to " + out);
    std::cout << evaluation.result().dump() << std::endl;
  } catch (const std::exception& error) {
    std::cerr << "evaluate_planning: " << error.what() << '\n';
    return 1;
  }
  return 0;
}
