// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory_resource>
#include <vector>

#include "types.hpp"

namespace magat_expert {

/// Stores the cells of all paths of a solve in large blocks. A constraint tree grows by a hundred thousand paths per
/// second; freeing them one by one would delay the answer far beyond the time limit.
class PathStore {
 public:
  explicit PathStore(std::pmr::memory_resource* memory) : blocks_(memory) {}

  Path store(Path path) {
    const auto length = static_cast<std::size_t>(path.length);
    if (blocks_.empty() || blocks_.back().capacity() - blocks_.back().size() < length) {
      blocks_.emplace_back().reserve(std::max(length, kBlock));
    }
    auto& block = blocks_.back();
    const auto cells = block.insert(block.end(), path.cells, path.cells + length);
    return {&*cells, path.length};
  }

 private:
  static constexpr std::size_t kBlock = std::size_t{1} << 16;
  std::pmr::vector<std::pmr::vector<std::int32_t>> blocks_;  // none grows beyond what it reserved
};

}  // namespace magat_expert
