#pragma once

#include <vector>

#include "grid.hpp"

namespace magat_expert {

/// True if a quick look proves that there are no valid paths. False proves nothing.
///
/// Seen are corridors (connected components in a line) whose robots would have to pass each other, and components
/// without a cycle that are full, where nobody can make the first move. The constraint tree of such an instance is
/// infinite: only the time limit would end it.
bool proven_unsolvable(const Grid& grid, const std::vector<int>& starts, const std::vector<int>& goals);

}  // namespace magat_expert
