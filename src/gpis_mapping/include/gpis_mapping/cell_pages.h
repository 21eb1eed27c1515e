// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_CELL_PAGES_H
#define GPIS_MAPPING_CELL_PAGES_H

#include <array>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <memory>
#include <utility>
#include <vector>

#include "gpis_mapping/cell_gp.h"
#include "gpis_mapping/types.h"

namespace gpis_mapping {

/// The trained cells of a map by their place. A copy shares everything with the original; replace() then copies only
/// the pages that it changes. So the cost of a new state of the map depends on its changes and not on its size.
/// Iteration is in the same order whatever the history.
class CellPages {
 public:
  using value_type = std::pair<LatticeKey, std::shared_ptr<const CellGp>>;

  CellPages() = default;
  explicit CellPages(std::vector<value_type> cells) { replace(std::move(cells)); }

  /// Puts each cell in its place; null: takes out what is there. Of several for one place the last one counts. Returns
  /// how many cells the changed pages hold.
  std::size_t replace(std::vector<value_type> changes);

  /// Null if there is none.
  const CellGp* get(const LatticeKey& key) const;
  /// The same for the 27 cells about and at `key`, that at key + (dx, dy, dz) in
  /// (*cells)[(dx + 1) * 9 + (dy + 1) * 3 + dz + 1].
  void getAround(const LatticeKey& key, std::array<const CellGp*, 27>* cells) const;

  class const_iterator;
  const_iterator begin() const;
  const_iterator end() const;
  std::size_t size() const { return num_cells_; }
  bool empty() const { return num_cells_ == 0; }
  std::size_t numPoints() const { return num_points_; }  // each counted in the cell that owns it

 private:
  // 4 x 4 x 4 cells make a page, 8 x 8 x 8 pages a book.
  static constexpr int kPageShift = 2;
  static constexpr int kBookShift = 5;

  struct Page {
    std::array<std::uint8_t, 1 << (3 * kPageShift)> place{};  // of a cell in `cells`, plus 1; 0: none
    std::vector<value_type> cells;                            // sorted
  };
  template <typename Part>
  using Sorted = std::vector<std::pair<LatticeKey, std::shared_ptr<const Part>>>;
  using Book = Sorted<Page>;

  static LatticeKey shifted(const LatticeKey& key, int bits) { return {key.x >> bits, key.y >> bits, key.z >> bits}; }
  static std::size_t placeIn(const LatticeKey& key) {
    constexpr int kMask = (1 << kPageShift) - 1;
    return static_cast<std::size_t>(((key.x & kMask) << kPageShift | (key.y & kMask)) << kPageShift | (key.z & kMask));
  }
  const Page* pageAt(const LatticeKey& page_key) const;
  void change(Page* page, const value_type& cell);

  Sorted<Book> books_;
  std::size_t num_cells_{0};
  std::size_t num_points_{0};
};

class CellPages::const_iterator {
 public:
  using iterator_category = std::forward_iterator_tag;
  using value_type = CellPages::value_type;
  using difference_type = std::ptrdiff_t;
  using pointer = const value_type*;
  using reference = const value_type&;

  const_iterator(const CellPages& cells, std::size_t book) : books_(&cells.books_), book_(book) {}

  reference operator*() const { return page().cells[cell_]; }
  pointer operator->() const { return &**this; }
  const_iterator& operator++() {
    if (++cell_ < page().cells.size()) return *this;
    cell_ = 0;
    if (++page_ < (*books_)[book_].second->size()) return *this;
    page_ = 0;
    ++book_;
    return *this;
  }
  const_iterator operator++(int) {
    const const_iterator before = *this;
    ++*this;
    return before;
  }
  bool operator==(const const_iterator& other) const {
    return book_ == other.book_ && page_ == other.page_ && cell_ == other.cell_;
  }
  bool operator!=(const const_iterator& other) const { return !(*this == other); }

 private:
  const Page& page() const { return *(*(*books_)[book_].second)[page_].second; }

  const Sorted<Book>* books_;
  std::size_t book_;
  std::size_t page_{0};
  std::size_t cell_{0};
};

inline CellPages::const_iterator CellPages::begin() const {
  return {*this, 0};
}
inline CellPages::const_iterator CellPages::end() const {
  return {*this, books_.size()};
}

}  // namespace gpis_mapping

#endif  // GPIS_MAPPING_CELL_PAGES_H
