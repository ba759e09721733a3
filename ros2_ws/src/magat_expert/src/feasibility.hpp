// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include <vector>

#include "grid.hpp"

namespace magat_expert {

/// True if a quick check proves that there are no valid paths. False proves nothing.
///
/// It finds corridors (connected components in a line) whose robots would have to pass each other, and full components
/// without a cycle, where no robot can move. The constraint tree of such an instance is infinite: only the time limit
/// would end the search.
bool proven_unsolvable(const Grid& grid, const std::vector<int>& starts, const std::vector<int>& goals);

}  // namespace magat_expert
