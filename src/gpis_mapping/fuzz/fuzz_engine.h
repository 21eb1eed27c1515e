// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_FUZZ_ENGINE_H
#define GPIS_MAPPING_FUZZ_ENGINE_H

#include <cstdint>
#include <functional>
#include <initializer_list>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

namespace gpis_mapping_fuzz {

/// Fixed by its seed on every machine (the standard library's distributions are not).
class Random {
 public:
  /// Independent stream for (seed, stream, index).
  Random(std::uint64_t seed, std::uint64_t stream, std::uint64_t index);

  std::uint64_t next();
  std::size_t below(std::size_t count) { return static_cast<std::size_t>(next() % count); }  // count > 0
  int between(int low, int high);                                                            // both included
  double uniform(double low = 0.0, double high = 1.0);
  bool chance(double probability) { return uniform() < probability; }
  template <typename Container>
  const typename Container::value_type& pick(const Container& from) {
    return *(from.begin() + static_cast<std::ptrdiff_t>(below(from.size())));
  }
  template <typename T>
  T pick(std::initializer_list<T> from) {
    return *(from.begin() + below(from.size()));
  }

  /// A number that programs stumble over: NaN, infinities, zeros, denormal, huge, borders of integers, random bits.
  double oddDouble();
  float oddFloat();
  int oddInt();

 private:
  std::uint64_t state_;
};

/// Flips bits, overwrites numbers, removes, repeats and moves pieces; 1 to 4 such changes. May return an empty string.
std::string mutateBytes(std::string bytes, Random* random);

/// The same for text: also lines, numbers and words from `dictionary`.
std::string mutateText(std::string text, const std::vector<std::string>& dictionary, Random* random);

/// What a program under test did that it must not do.
class Violation : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

inline void require(bool good, const std::string& what) {
  if (!good) throw Violation(what);
}

enum class Outcome { kAccepted, kRefused };

/// Makes inputs and feeds them to one part of the program. State may live as long as an episode.
class Target {
 public:
  virtual ~Target() = default;
  /// One input. Throws for whatever the part under test must not do: Violation, or the exception that escaped it.
  virtual Outcome feed(Random* random) = 0;
};

struct TargetInfo {
  std::string name;
  std::uint64_t inputs;   // share of a full run
  std::uint64_t episode;  // inputs for which one Target lives
  std::function<std::unique_ptr<Target>(Random*)> make;
};

/// All targets: maps, texts, messages.
std::vector<TargetInfo> allTargets();

struct Report {
  std::uint64_t inputs{0};
  std::uint64_t accepted{0};
  std::uint64_t refused{0};
  std::uint64_t digest{0};  // of all outcomes: the same seed must give the same
  std::string failure;      // empty: none; otherwise what happened
  std::uint64_t failed_at{0};
};

/// Called before each input with its number, so that a crash can be traced to it.
using Progress = std::function<void(std::uint64_t)>;

/// Feeds inputs [begin, end) and stops at the first failure. Input i is fixed by (seed, name, i) and by those before it
/// in its episode; a run that begins within an episode repeats these first without counting them.
Report runTarget(const TargetInfo& target, std::uint64_t seed, std::uint64_t begin, std::uint64_t end,
                 const Progress& progress = {});

}  // namespace gpis_mapping_fuzz

#endif  // GPIS_MAPPING_FUZZ_ENGINE_H
