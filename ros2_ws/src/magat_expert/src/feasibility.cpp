// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

#include "feasibility.hpp"

#include <algorithm>
#include <cstddef>
#include <cstdint>

namespace magat_expert {

namespace {

struct Component {
  int cells = 0;
  int degrees = 0;  // sum over the cells: twice the number of neighbouring pairs
  int largest_degree = 0;
  int loose_end = -1;  // a cell with at most one neighbour
  std::pmr::vector<int> robots;

  explicit Component(std::pmr::memory_resource* memory) : robots(memory) {}
  bool acyclic() const { return degrees == 2 * (cells - 1); }
  bool corridor() const { return acyclic() && largest_degree <= 2; }
};

std::pmr::vector<Component> components_of(const Grid& grid, const std::vector<int>& starts) {
  const std::pmr::vector<std::int32_t> labels = grid.components();
  std::pmr::vector<Component> components(grid.memory());
  for (int cell = 0; cell < grid.cells(); ++cell) {
    if (grid.blocked(cell)) {
      continue;
    }
    if (labels[cell] >= static_cast<int>(components.size())) {
      components.emplace_back(grid.memory());
    }
    const auto free = [&](int move) { return !grid.blocked(cell + move); };
    const int degree = static_cast<int>(std::count_if(grid.moves().begin(), grid.moves().end(), free));
    Component& component = components[labels[cell]];
    ++component.cells;
    component.degrees += degree;
    component.largest_degree = std::max(component.largest_degree, degree);
    if (degree <= 1) {
      component.loose_end = cell;
    }
  }
  for (std::size_t robot = 0; robot < starts.size(); ++robot) {
    components[labels[starts[robot]]].robots.push_back(static_cast<int>(robot));
  }
  return components;
}

bool would_pass_each_other(const Grid& grid, const Component& corridor, const std::vector<int>& starts,
                           const std::vector<int>& goals) {
  const std::pmr::vector<std::int32_t> place = grid.distances_to(corridor.loose_end);
  std::pmr::vector<int> order(corridor.robots, grid.memory());
  std::sort(order.begin(), order.end(), [&](int a, int b) { return place[starts[a]] < place[starts[b]]; });
  return !std::is_sorted(order.begin(), order.end(), [&](int a, int b) { return place[goals[a]] < place[goals[b]]; });
}

}  // namespace

bool proven_unsolvable(const Grid& grid, const std::vector<int>& starts, const std::vector<int>& goals) {
  for (const Component& component : components_of(grid, starts)) {
    const auto has_to_move = [&](int robot) { return starts[robot] != goals[robot]; };
    const bool full = static_cast<int>(component.robots.size()) == component.cells;
    if (full && component.acyclic() &&
        std::any_of(component.robots.begin(), component.robots.end(), has_to_move)) {
      return true;
    }
    if (component.robots.size() > 1 && component.corridor() &&
        would_pass_each_other(grid, component, starts, goals)) {
      return true;
    }
  }
  return false;
}

}  // namespace magat_expert
