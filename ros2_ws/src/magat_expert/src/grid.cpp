// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

#include "grid.hpp"

#include <algorithm>
#include <cstddef>

namespace magat_expert {

Grid::Grid(const std::uint8_t* obstacles, int width, int height, std::pmr::memory_resource* memory)
    : stride_(width + 2),
      blocked_(static_cast<std::size_t>(width + 2) * (height + 2), 1, memory),
      moves_{stride_, -stride_, -1, 1} {
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      if (obstacles[static_cast<std::size_t>(y) * width + x] == 0) {
        blocked_[cell(x, y)] = 0;
        ++free_cells_;
      }
    }
  }
}

std::pmr::vector<std::int32_t> Grid::distances_to(int goal) const {
  constexpr std::int32_t kUnseen = -1;
  constexpr std::int32_t kObstacle = -2;
  std::pmr::vector<std::int32_t> distance(blocked_.size(), memory());
  std::transform(blocked_.begin(), blocked_.end(), distance.begin(),
                 [](std::uint8_t blocked) { return blocked != 0 ? kObstacle : kUnseen; });
  // Every neighbour is written to the end of the queue, and the end moves only behind those that are new: without
  // branches, since whether a neighbour is new cannot be predicted.
  std::pmr::vector<std::int32_t> queue(static_cast<std::size_t>(free_cells_) + 1, memory());
  const auto moves = moves_;  // a copy, which no write below can change
  std::int32_t* const distances = distance.data();
  const std::int32_t* head = queue.data();
  std::int32_t* end = queue.data();
  distances[goal] = 0;
  *end++ = goal;
  while (head < end) {
    const std::int32_t here = *head++;
    const std::int32_t steps = distances[here] + 1;
    for (const int move : moves) {
      const std::int32_t next = here + move;
      const std::int32_t known = distances[next];
      *end = next;
      end += known == kUnseen ? 1 : 0;
      distances[next] = known == kUnseen ? steps : known;
    }
  }
  return distance;
}

std::pmr::vector<std::int32_t> Grid::components() const {
  std::pmr::vector<std::int32_t> label(blocked_.size(), -1, memory());
  std::pmr::vector<int> stack(memory());
  std::int32_t labels = 0;
  for (int seed = 0; seed < cells(); ++seed) {
    if (blocked_[seed] != 0 || label[seed] >= 0) {
      continue;
    }
    label[seed] = labels;
    stack.push_back(seed);
    while (!stack.empty()) {
      const int here = stack.back();
      stack.pop_back();
      for (const int move : moves_) {
        const int next = here + move;
        if (blocked_[next] == 0 && label[next] < 0) {
          label[next] = labels;
          stack.push_back(next);
        }
      }
    }
    ++labels;
  }
  return label;
}

}  // namespace magat_expert
