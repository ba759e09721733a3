// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include <cstddef>
#include <random>
#include <utility>
#include <vector>

namespace magat_expert {

/// Shuffles in the same way on every platform, unlike std::shuffle.
inline void shuffle(std::vector<int>& order, std::mt19937_64& generator) {
  for (std::size_t i = order.size(); i > 1; --i) {
    std::swap(order[i - 1], order[generator() % i]);
  }
}

}  // namespace magat_expert
