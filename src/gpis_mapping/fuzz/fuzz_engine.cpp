// SPDX-License-Identifier: BSD-3-Clause
#include "fuzz/fuzz_engine.h"

#include <algorithm>
#include <cstring>
#include <limits>
#include <typeinfo>

namespace gpis_mapping_fuzz {
namespace {

constexpr std::uint64_t kGamma = 0x9E3779B97F4A7C15ULL;

/// SplitMix64 (Steele, Lea, Flood 2014).
std::uint64_t mix(std::uint64_t z) {
  z = (z ^ (z >> 30U)) * 0xBF58476D1CE4E5B9ULL;
  z = (z ^ (z >> 27U)) * 0x94D049BB133111EBULL;
  return z ^ (z >> 31U);
}

std::uint64_t hashOf(const std::string& text) {
  std::uint64_t hash = 14695981039346656037ULL;  // FNV-1a
  for (const char c : text) hash = (hash ^ static_cast<unsigned char>(c)) * 1099511628211ULL;
  return hash;
}

/// A range [first, second) of the text.
std::pair<std::size_t, std::size_t> somePiece(const std::string& text, std::size_t longest, Random* random) {
  const std::size_t begin = random->below(text.size());
  const std::size_t length = 1 + random->below(std::min(longest, text.size() - begin));
  return {begin, begin + length};
}

void mutateOnce(std::string* bytes, Random* random) {
  if (bytes->empty()) {
    bytes->push_back(static_cast<char>(random->next()));
    return;
  }
  const std::size_t at = random->below(bytes->size());
  switch (random->below(9)) {
    case 0:
    case 1:
      (*bytes)[at] = static_cast<char>((*bytes)[at] ^ (1 << random->below(8)));
      return;
    case 2:
      (*bytes)[at] = static_cast<char>(random->next());
      return;
    case 3: {  // an integer: counts and lengths at their borders
      const std::uint64_t value =
          random->pick<std::uint64_t>({0, 1, 0x7F, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 1ULL << 40,
                                       1ULL << 62, ~0ULL, ~0ULL / 2, bytes->size(), random->next()});
      std::memcpy(&(*bytes)[at], &value, std::min<std::size_t>(random->pick({1, 2, 4, 8}), bytes->size() - at));
      return;
    }
    case 4: {
      const double value = random->oddDouble();
      std::memcpy(&(*bytes)[at], &value, std::min<std::size_t>(8, bytes->size() - at));
      return;
    }
    case 5: {
      const float value = random->oddFloat();
      std::memcpy(&(*bytes)[at], &value, std::min<std::size_t>(4, bytes->size() - at));
      return;
    }
    case 6: {
      const auto [begin, end] = somePiece(*bytes, 64, random);
      bytes->erase(begin, end - begin);
      return;
    }
    case 7: {
      const auto [begin, end] = somePiece(*bytes, 64, random);
      bytes->insert(random->below(bytes->size() + 1), bytes->substr(begin, end - begin));
      return;
    }
    default:
      bytes->resize(at);
      return;
  }
}

std::vector<std::string> linesOf(const std::string& text) {
  std::vector<std::string> lines;
  std::size_t begin = 0;
  while (begin < text.size()) {
    const std::size_t end = std::min(text.size(), text.find('\n', begin));
    lines.push_back(text.substr(begin, end - begin));
    begin = end + 1;
  }
  return lines;
}

/// Words and numbers: runs of what is neither a space nor punctuation of the usual text formats.
std::pair<std::size_t, std::size_t> someWord(const std::string& text, Random* random) {
  const std::string separators = " \t\n,:[]{}";
  const std::size_t at = random->below(text.size());
  const std::size_t begin = std::min(text.find_first_not_of(separators, at), text.size());
  const std::size_t end = std::min(text.find_first_of(separators, begin), text.size());
  return {begin, end};
}

void mutateTextOnce(std::string* text, const std::vector<std::string>& dictionary, Random* random) {
  if (text->empty()) {
    *text = random->pick(dictionary);
    return;
  }
  switch (random->below(7)) {
    case 0:
    case 1:
    case 2: {  // most often another value: structure intact
      const auto [begin, end] = someWord(*text, random);
      text->replace(begin, end - begin, random->pick(dictionary));
      return;
    }
    case 3:
      text->insert(random->below(text->size() + 1), random->pick(dictionary));
      return;
    case 4: {
      std::vector<std::string> lines = linesOf(*text);
      const std::size_t a = random->below(lines.size());
      const std::size_t b = random->below(lines.size());
      switch (random->below(3)) {
        case 0:
          std::swap(lines[a], lines[b]);
          break;
        case 1:
          lines.insert(lines.begin() + static_cast<std::ptrdiff_t>(a), std::string(lines[b]));
          break;
        default:
          lines.erase(lines.begin() + static_cast<std::ptrdiff_t>(a));
      }
      text->clear();
      for (const std::string& line : lines) *text += line + '\n';
      return;
    }
    default:
      mutateOnce(text, random);
  }
}

/// yaml-cpp 0.6 (Ubuntu 20.04, Debian 11) never returns from a flow sequence or mapping with ":" right before "]" or the
/// end of the text: it takes empty scalars until the memory is full. 0.7 does return. Keeps the length.
std::string withoutEndlessYaml(std::string text) {
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] == ':' && (i + 1 == text.size() || text[i + 1] == ']')) text[i] = ' ';
  }
  return text;
}

}  // namespace

Random::Random(std::uint64_t seed, std::uint64_t stream, std::uint64_t index)
    : state_(mix(mix(mix(seed + kGamma) ^ (stream + kGamma)) ^ (index + kGamma))) {}

std::uint64_t Random::next() {
  state_ += kGamma;
  return mix(state_);
}

int Random::between(int low, int high) {
  return low + static_cast<int>(below(static_cast<std::size_t>(high - low) + 1));
}

double Random::uniform(double low, double high) {
  return low + (high - low) * (static_cast<double>(next() >> 11U) * 0x1.0p-53);
}

double Random::oddDouble() {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  switch (below(18)) {
    case 0:
      return std::numeric_limits<double>::quiet_NaN();
    case 1:
      return kInfinity;
    case 2:
      return -kInfinity;
    case 3:
      return 0.0;
    case 4:
      return -0.0;
    case 5:
      return std::numeric_limits<double>::denorm_min();
    case 6:
      return std::numeric_limits<double>::min();
    case 7:
      return chance(0.5) ? 1e300 : -1e300;
    case 8:
      return chance(0.5) ? std::numeric_limits<double>::max() : std::numeric_limits<double>::lowest();
    case 9:
      return chance(0.5) ? 1e9 : -1e9;
    case 10:
      return pick({2147483647.0, -2147483648.0, 2147483648.0, 4294967296.0, 9.3e18});
    case 11:
      return chance(0.5) ? 3.5e38 : -3.5e38;  // just beyond float
    case 12:
      return uniform(-1e-3, 1e-3);
    case 13:
      return uniform(-1e6, 1e6);
    case 14: {  // any bit pattern: any order of magnitude
      const std::uint64_t bits = next();
      double value;
      std::memcpy(&value, &bits, sizeof(value));
      return value;
    }
    default:
      return uniform(-10.0, 10.0);
  }
}

float Random::oddFloat() {
  switch (below(12)) {
    case 0:
      return std::numeric_limits<float>::quiet_NaN();
    case 1:
      return std::numeric_limits<float>::infinity();
    case 2:
      return -std::numeric_limits<float>::infinity();
    case 3:
      return 0.0f;
    case 4:
      return -0.0f;
    case 5:
      return std::numeric_limits<float>::denorm_min();
    case 6:
      return chance(0.5) ? std::numeric_limits<float>::max() : std::numeric_limits<float>::lowest();
    case 7:
      return pick({1e30f, 1e-30f, 65535.0f, 65.535f, -1.0f, -1e30f});
    case 8: {
      const auto bits = static_cast<std::uint32_t>(next());
      float value;
      std::memcpy(&value, &bits, sizeof(value));
      return value;
    }
    default:
      return static_cast<float>(uniform(-1.0, 10.0));
  }
}

int Random::oddInt() {
  switch (below(6)) {
    case 0:
      return pick({0, -1, 1, 2, 15, 16, 8192, 8193});
    case 1:
      return pick({std::numeric_limits<int>::max(), std::numeric_limits<int>::min(), 46341, 65536, -65536});
    case 2:
      return static_cast<int>(static_cast<std::uint32_t>(next()));
    default:
      return between(-8, 64);
  }
}

std::string mutateBytes(std::string bytes, Random* random) {
  const int changes = random->between(1, 4);
  for (int i = 0; i < changes; ++i) mutateOnce(&bytes, random);
  return bytes;
}

std::string mutateText(std::string text, const std::vector<std::string>& dictionary, Random* random) {
  const int changes = random->between(1, 4);
  for (int i = 0; i < changes; ++i) mutateTextOnce(&text, dictionary, random);
  return withoutEndlessYaml(std::move(text));
}

Report runTarget(const TargetInfo& target, std::uint64_t seed, std::uint64_t begin, std::uint64_t end,
                 const Progress& progress) {
  const std::uint64_t name = hashOf(target.name);
  Report report;
  std::unique_ptr<Target> alive;
  for (std::uint64_t i = begin - begin % target.episode; i < end; ++i) {
    if (progress) progress(i);
    try {
      if (i % target.episode == 0) {
        Random random(seed, name + 1, i / target.episode);
        alive = target.make(&random);
      }
      Random random(seed, name, i);
      const Outcome outcome = alive->feed(&random);
      if (i < begin) continue;
      ++report.inputs;
      ++(outcome == Outcome::kAccepted ? report.accepted : report.refused);
      report.digest = mix(report.digest + kGamma * (1 + static_cast<std::uint64_t>(outcome)));
      continue;
    } catch (const Violation& violation) {
      report.failure = violation.what();
    } catch (const std::exception& error) {
      report.failure = std::string("escaped exception ") + typeid(error).name() + ": " + error.what();
    } catch (...) {
      report.failure = "escaped exception of unknown type";
    }
    report.failed_at = i;
    return report;
  }
  return report;
}

}  // namespace gpis_mapping_fuzz
