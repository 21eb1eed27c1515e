// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <utility>
#include <variant>

namespace interactive_mapping {

/// A value, or why there is none. Reading the one that it does not hold throws std::bad_variant_access.
template <class T, class Failure>
class Result {
 public:
  Result(T value) : content_(std::in_place_index<0>, std::move(value)) {}
  Result(Failure failure) : content_(std::in_place_index<1>, std::move(failure)) {}

  explicit operator bool() const { return content_.index() == 0; }
  T& operator*() { return std::get<0>(content_); }
  const T& operator*() const { return std::get<0>(content_); }
  T* operator->() { return &**this; }
  const T* operator->() const { return &**this; }
  const Failure& failure() const { return std::get<1>(content_); }

 private:
  std::variant<T, Failure> content_;
};

}  // namespace interactive_mapping
