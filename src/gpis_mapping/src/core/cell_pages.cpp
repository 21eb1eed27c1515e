// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/cell_pages.h"

#include <algorithm>

namespace gpis_mapping {
namespace {

const auto kBefore = [](const auto& entry, const LatticeKey& key) { return entry.first < key; };

/// The part of that key, or where it would be.
template <typename Parts>
auto partAt(Parts& parts, const LatticeKey& key) {
  return std::lower_bound(parts.begin(), parts.end(), key, kBefore);
}

template <typename Parts>
bool isAt(const Parts& parts, typename Parts::const_iterator at, const LatticeKey& key) {
  return at != parts.end() && at->first == key;
}

/// Puts a changed copy of the part at `key` in its place; changeCopy(part) says whether anything is left in it.
template <typename Part, typename Parts, typename Function>
void changePart(Parts* parts, const LatticeKey& key, const Function& changeCopy) {
  const auto at = partAt(*parts, key);
  const bool is_there = isAt(*parts, at, key);
  auto copy = is_there ? std::make_shared<Part>(*at->second) : std::make_shared<Part>();
  const bool is_filled = changeCopy(copy.get());
  if (!is_there) {
    if (is_filled) parts->insert(at, {key, std::move(copy)});
  } else if (is_filled) {
    at->second = std::move(copy);
  } else {
    parts->erase(at);
  }
}

}  // namespace

void CellPages::change(Page* page, const value_type& cell) {
  const auto& [key, gp] = cell;
  const auto at = partAt(page->cells, key);
  const bool is_there = isAt(page->cells, at, key);
  if (is_there) num_points_ -= at->second->numOwn();
  if (gp) num_points_ += gp->numOwn();
  num_cells_ += static_cast<std::size_t>(gp != nullptr);
  num_cells_ -= static_cast<std::size_t>(is_there);
  if (is_there && gp) {
    at->second = gp;
  } else if (is_there) {
    page->cells.erase(at);
  } else if (gp) {
    page->cells.insert(at, cell);
  }
}

std::size_t CellPages::replace(std::vector<value_type> changes) {
  std::stable_sort(changes.begin(), changes.end(), [](const value_type& a, const value_type& b) {
    for (const int bits : {kBookShift, kPageShift}) {
      const LatticeKey of_a = shifted(a.first, bits), of_b = shifted(b.first, bits);
      if (of_a != of_b) return of_a < of_b;
    }
    return a.first < b.first;
  });
  std::size_t num_copied = 0;
  auto change_at = changes.begin();
  const auto isIn = [&](const LatticeKey& key, int bits) {
    return change_at != changes.end() && shifted(change_at->first, bits) == key;
  };
  while (change_at != changes.end()) {
    const LatticeKey book_key = shifted(change_at->first, kBookShift);
    changePart<Book>(&books_, book_key, [&](Book* book) {
      while (isIn(book_key, kBookShift)) {
        const LatticeKey page_key = shifted(change_at->first, kPageShift);
        changePart<Page>(book, page_key, [&](Page* page) {
          for (; isIn(page_key, kPageShift); ++change_at) change(page, *change_at);
          page->place.fill(0);
          for (std::size_t i = 0; i < page->cells.size(); ++i) {
            page->place[placeIn(page->cells[i].first)] = static_cast<std::uint8_t>(i + 1);
          }
          num_copied += page->cells.size();
          return !page->cells.empty();
        });
      }
      return !book->empty();
    });
  }
  return num_copied;
}

const CellPages::Page* CellPages::pageAt(const LatticeKey& page_key) const {
  const LatticeKey book_key = shifted(page_key, kBookShift - kPageShift);
  const auto book = partAt(books_, book_key);
  if (!isAt(books_, book, book_key)) return nullptr;
  const auto page = partAt(*book->second, page_key);
  return isAt(*book->second, page, page_key) ? page->second.get() : nullptr;
}

const CellGp* CellPages::get(const LatticeKey& key) const {
  const Page* const page = pageAt(shifted(key, kPageShift));
  const std::uint8_t place = page == nullptr ? 0 : page->place[placeIn(key)];
  return place == 0 ? nullptr : page->cells[place - 1u].second.get();
}

void CellPages::getAround(const LatticeKey& key, std::array<const CellGp*, 27>* cells) const {
  // One to eight pages hold them all.
  const LatticeKey first = shifted(key.offset(-1, -1, -1), kPageShift);
  std::array<const Page*, 8> pages{};
  std::array<bool, 8> is_known{};
  std::size_t i = 0;
  for (int dx = -1; dx <= 1; ++dx) {
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dz = -1; dz <= 1; ++dz) {
        const LatticeKey at = key.offset(dx, dy, dz);
        const LatticeKey page_key = shifted(at, kPageShift);
        const auto which =
            static_cast<std::size_t>((page_key.x - first.x) * 4 + (page_key.y - first.y) * 2 + (page_key.z - first.z));
        if (!is_known[which]) pages[which] = pageAt(page_key);
        is_known[which] = true;
        const Page* const page = pages[which];
        const std::uint8_t place = page == nullptr ? 0 : page->place[placeIn(at)];
        (*cells)[i++] = place == 0 ? nullptr : page->cells[place - 1u].second.get();
      }
    }
  }
}

}  // namespace gpis_mapping
