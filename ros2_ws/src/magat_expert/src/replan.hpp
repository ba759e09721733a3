// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include <cstdint>
#include <memory_resource>
#include <vector>

#include "grid.hpp"
#include "solution.hpp"
#include "types.hpp"

namespace magat_expert {

/// The baseline "Replan" (global re-planning, Wang et al. 2020): robots ignore the plans of others.
///
/// Each robot follows a shortest path. In each time step, robots decide one after another, in a random order. If a step
/// is in conflict, the robot re-plans around the cells of all other robots, and waits if there is no such path. Robots
/// never leave their goals. Goals are unique, starts are unique.
class Replan {
 public:
  Replan(const Grid& grid, std::vector<int> starts, std::vector<int> goals, Watch& watch);

  /// Ends when all robots are on their goals, when no robot can move, or after `max_steps` (< 0: 3 times the longest of
  /// the shortest paths). The solution holds the paths up to then, unless the memory limit was reached.
  Solution solve(std::int64_t max_steps, std::uint64_t seed);

 private:
  enum class Outcome { kFound, kNoPath, kHalted };
  struct Entry {
    std::int32_t f;
    std::int32_t steps;
    std::int32_t cell;
    // std::push_heap keeps the largest on top: the smallest f, then the deepest, then the lowest cell.
    bool operator<(const Entry& other) const {
      if (f != other.f) {
        return f > other.f;
      }
      return steps != other.steps ? steps < other.steps : cell > other.cell;
    }
  };

  bool step(const std::vector<int>& order, bool& moved);
  bool decide(int robot, int& next);
  bool taken(int cell) const;
  bool in_the_way(int robot, int cell) const;
  Outcome search(int robot);
  bool all_arrived() const { return at_ == goals_; }
  void walk(std::int64_t max_steps, std::uint64_t seed, Solution& solution);
  void finish(Solution& solution);

  const Grid& grid_;
  std::vector<int> starts_;
  std::vector<int> goals_;
  Watch& watch_;
  std::pmr::vector<std::pmr::vector<std::int32_t>> distances_;  // [robot][cell]
  std::pmr::vector<std::pmr::vector<std::int32_t>> plans_;      // [robot]: the cells to come, the next one last
  std::pmr::vector<std::pmr::vector<std::int32_t>> walked_;     // [robot][time]
  std::vector<int> at_;                                         // [robot]: its cell
  std::pmr::vector<std::int32_t> robot_at_;                     // [cell], -1: no robot
  std::int64_t replans_ = 0;
  std::int64_t expansions_ = 0;

  // Of the current time step. An entry is valid if it equals step_.
  int step_ = 0;
  std::vector<int> decided_;       // [robot]
  std::pmr::vector<int> claimed_;  // [cell]: a robot will be here after the step

  // Of A*. An entry is valid if seen_in_ equals search_.
  int search_ = 0;
  std::pmr::vector<int> seen_in_;
  std::pmr::vector<std::int32_t> steps_to_;
  std::pmr::vector<std::int32_t> came_from_;
  std::pmr::vector<Entry> open_;
};

}  // namespace magat_expert
