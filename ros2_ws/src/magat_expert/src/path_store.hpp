// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "types.hpp"

namespace magat_expert {

/// Stores the cells of all paths of a solve in large blocks. A constraint tree grows by a hundred thousand paths per
/// second; freeing them one by one would delay the answer far beyond the time limit.
class PathStore {
 public:
  Path store(Path path) {
    const auto length = static_cast<std::size_t>(path.length);
    if (blocks_.empty() || used_ + length > size_) {
      size_ = std::max(length, kBlock);
      blocks_.emplace_back(new std::int32_t[size_]);
      used_ = 0;
    }
    std::int32_t* cells = blocks_.back().get() + used_;
    std::copy_n(path.cells, length, cells);
    used_ += length;
    return {cells, path.length};
  }

 private:
  static constexpr std::size_t kBlock = std::size_t{1} << 16;
  std::vector<std::unique_ptr<std::int32_t[]>> blocks_;
  std::size_t size_ = 0;  // of the last block
  std::size_t used_ = 0;  // of the last block
};

}  // namespace magat_expert
