// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

#include "grid.hpp"

namespace magat_expert {

Grid::Grid(const std::uint8_t* obstacles, int width, int height)
    : stride_(width + 2),
      blocked_(static_cast<std::size_t>(width + 2) * (height + 2), 1),
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

std::vector<std::int32_t> Grid::distances_to(int goal) const {
  std::vector<std::int32_t> distance(blocked_.size(), -1);
  std::vector<int> queue;
  queue.reserve(free_cells_);
  distance[goal] = 0;
  queue.push_back(goal);
  for (std::size_t head = 0; head < queue.size(); ++head) {
    const int here = queue[head];
    for (const int move : moves_) {
      const int next = here + move;
      if (blocked_[next] == 0 && distance[next] < 0) {
        distance[next] = distance[here] + 1;
        queue.push_back(next);
      }
    }
  }
  return distance;
}

std::vector<std::int32_t> Grid::components() const {
  std::vector<std::int32_t> label(blocked_.size(), -1);
  std::vector<int> stack;
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
