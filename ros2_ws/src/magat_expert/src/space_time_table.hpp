// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory_resource>
#include <utility>
#include <vector>

namespace magat_expert {

/// Numbers by cell and time step. It grows with what is entered, not with the map and the time.
///
/// A hash table with open addressing and linear probing, whose entries are blocks of `kBlock` successive cells, a power
/// of two, at one time. A search enters neighbouring cells; then blocks of several cells take less memory and time.
template <int kBlock>
class SpaceTimeTable {
 public:
  static constexpr std::int32_t kNone = -1;

  explicit SpaceTimeTable(std::pmr::memory_resource* memory)
      : keys_(kSmallest, kEmpty, memory), numbers_(kSmallest * kBlock, memory) {}

  /// The number entered for `cell` at `time`, kNone if there is none.
  std::int32_t find(int cell, int time) const {
    const std::uint64_t key = key_of(cell, time);
    std::size_t i = place(key);
    while (keys_[i] != key) {
      if (keys_[i] == kEmpty) {
        return kNone;
      }
      i = (i + 1) & mask();
    }
    return numbers_[i * kBlock + cell % kBlock];
  }

  /// The place of the number for `cell` at `time`, which is kNone unless entered before. Writing kNone removes it.
  /// Valid until the next call.
  std::int32_t& at(int cell, int time) {
    const std::uint64_t key = key_of(cell, time);
    if (key == keys_[last_]) {
      return numbers_[last_ * kBlock + cell % kBlock];
    }
    std::size_t i = place(key);
    while (keys_[i] != key) {
      if (keys_[i] == kEmpty) {
        if (2 * used_ >= keys_.size()) {
          rebuild();
          return at(cell, time);
        }
        ++used_;
        keys_[i] = key;
        std::fill_n(&numbers_[i * kBlock], kBlock, kNone);
        break;
      }
      i = (i + 1) & mask();
    }
    last_ = i;
    return numbers_[i * kBlock + cell % kBlock];
  }

  /// Removes all numbers. A table that was much too large shrinks, so that it fits into the caches again.
  void clear() {
    if (keys_.size() > kSmallest && 16 * used_ < keys_.size()) {
      SpaceTimeTable(keys_.size() / 2, *this).swap(*this);
    } else {
      std::fill(keys_.begin(), keys_.end(), kEmpty);
      used_ = 0;
    }
  }

 private:
  using Keys = std::pmr::vector<std::uint64_t>;
  using Numbers = std::pmr::vector<std::int32_t>;
  static constexpr std::uint64_t kEmpty = ~std::uint64_t{0};
  static constexpr std::size_t kSmallest = 256;

  // An empty table of `size` blocks in the memory of `other`.
  SpaceTimeTable(std::size_t size, const SpaceTimeTable& other)
      : keys_(size, kEmpty, other.keys_.get_allocator()), numbers_(size * kBlock, other.numbers_.get_allocator()) {}

  void swap(SpaceTimeTable& other) {
    keys_.swap(other.keys_);
    numbers_.swap(other.numbers_);
    std::swap(used_, other.used_);
    std::swap(last_, other.last_);
  }

  static std::uint64_t key_of(int cell, int time) {
    return static_cast<std::uint64_t>(cell / kBlock) << 32 | static_cast<std::uint32_t>(time);
  }
  std::size_t mask() const { return keys_.size() - 1; }
  std::size_t place(std::uint64_t key) const {
    // The golden ratio spreads keys that differ little (Knuth: The Art of Computer Programming 3, 6.4).
    return static_cast<std::size_t>((key * 0x9E3779B97F4A7C15u) >> 32) & mask();
  }

  // Doubles the table, unless most of its numbers are removed ones.
  void rebuild() {
    const auto entered = [this](std::size_t i) {
      const auto first = numbers_.begin() + i * kBlock;
      return keys_[i] != kEmpty && std::any_of(first, first + kBlock, [](std::int32_t n) { return n != kNone; });
    };
    std::size_t kept = 0;
    for (std::size_t i = 0; i < keys_.size(); ++i) {
      kept += entered(i) ? 1 : 0;
    }
    SpaceTimeTable larger(4 * kept > keys_.size() ? 2 * keys_.size() : keys_.size(), *this);
    for (std::size_t i = 0; i < keys_.size(); ++i) {
      if (entered(i)) {
        const auto cell = static_cast<int>(keys_[i] >> 32) * kBlock;
        const auto time = static_cast<int>(keys_[i] & 0xFFFFFFFFu);
        std::copy_n(&numbers_[i * kBlock], kBlock, &larger.at(cell, time));
      }
    }
    larger.swap(*this);
  }

  Keys keys_;        // [block]: its cells and time; as many as a power of two
  Numbers numbers_;  // [block][cell]
  std::size_t used_ = 0;
  std::size_t last_ = 0;  // the block of the last `at`: the next is often the same one
};

}  // namespace magat_expert
