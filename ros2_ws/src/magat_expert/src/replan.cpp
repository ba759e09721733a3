// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

#include "replan.hpp"

#include <algorithm>
#include <cstddef>
#include <numeric>
#include <random>
#include <utility>

#include "memory.hpp"
#include "shuffle.hpp"

namespace magat_expert {

Replan::Replan(const Grid& grid, std::vector<int> starts, std::vector<int> goals, Watch& watch)
    : grid_(grid),
      starts_(std::move(starts)),
      goals_(std::move(goals)),
      watch_(watch),
      distances_(starts_.size(), grid.memory()),
      plans_(starts_.size(), grid.memory()),
      walked_(starts_.size(), grid.memory()),
      at_(starts_),
      robot_at_(grid.cells(), -1, grid.memory()),
      decided_(starts_.size(), 0),
      claimed_(grid.cells(), 0, grid.memory()),
      seen_in_(grid.cells(), 0, grid.memory()),
      steps_to_(grid.cells(), 0, grid.memory()),
      came_from_(grid.cells(), -1, grid.memory()),
      open_(grid.memory()) {}

Solution Replan::solve(std::int64_t max_steps, std::uint64_t seed) {
  Solution solution(grid_.memory());
  try {
    walk(max_steps, seed, solution);
    finish(solution);
  } catch (const MemoryLimitReached&) {
    solution.status = Solution::Status::kMemoryLimit;
  }
  solution.high_level_expansions = replans_;
  solution.low_level_expansions = expansions_;
  return solution;
}

void Replan::walk(std::int64_t max_steps, std::uint64_t seed, Solution& solution) {
  std::int64_t longest = 0;
  bool going = true;
  for (std::size_t i = 0; i < starts_.size(); ++i) {
    walked_[i].push_back(starts_[i]);
  }
  for (std::size_t i = 0; i < starts_.size() && going; ++i) {
    distances_[i] = grid_.distances_to(goals_[i]);
    const std::int64_t distance = distances_[i][starts_[i]];
    longest = std::max(longest, distance);
    solution.lower_bound += distance;
    // No robot is on the map yet, so this is the shortest path.
    going = search(static_cast<int>(i)) != Outcome::kHalted && !watch_.expired();
  }
  for (std::size_t i = 0; i < starts_.size(); ++i) {
    robot_at_[starts_[i]] = static_cast<std::int32_t>(i);
  }
  const std::int64_t last = max_steps < 0 ? 3 * longest : max_steps;
  std::mt19937_64 generator(seed);
  std::vector<int> order(starts_.size());
  std::iota(order.begin(), order.end(), 0);
  for (bool moved = true; going && moved && step_ < last && !all_arrived();) {
    shuffle(order, generator);
    going = step(order, moved);
  }
}

void Replan::finish(Solution& solution) {
  if (all_arrived()) {
    solution.status = Solution::Status::kSolved;
    for (std::size_t i = 0; i < starts_.size(); ++i) {
      // Robots do not leave their goals, so the first visit is the arrival.
      const auto arrival = std::find(walked_[i].begin(), walked_[i].end(), goals_[i]);
      solution.cost += arrival - walked_[i].begin();
    }
  } else if (watch_.halt() == Halt::kStopped) {
    solution.status = Solution::Status::kStopped;
  } else if (watch_.halt() == Halt::kTimeLimit) {
    solution.status = Solution::Status::kTimedOut;
  } else {
    solution.status = Solution::Status::kIncomplete;
  }
  solution.paths = std::move(walked_);
}

// One time step of all robots. False: halted, and no robot has moved.
bool Replan::step(const std::vector<int>& order, bool& moved) {
  ++step_;
  std::vector<int> next(at_);
  for (const int robot : order) {
    if (watch_.expired() || !decide(robot, next[robot])) {
      return false;
    }
    decided_[robot] = step_;
    claimed_[next[robot]] = step_;
  }
  moved = next != at_;
  for (const int cell : at_) {
    robot_at_[cell] = -1;
  }
  for (std::size_t i = 0; i < next.size(); ++i) {
    if (next[i] != at_[i]) {
      plans_[i].pop_back();
    }
    robot_at_[next[i]] = static_cast<std::int32_t>(i);
    walked_[i].push_back(next[i]);
  }
  at_ = std::move(next);
  return true;
}

// Where a robot goes in this step; false: halted.
bool Replan::decide(int robot, int& next) {
  next = at_[robot];
  if (next == goals_[robot]) {
    return true;
  }
  if (taken(plans_[robot].back())) {
    ++replans_;
    const Outcome outcome = search(robot);
    if (outcome != Outcome::kFound) {
      return outcome == Outcome::kNoPath;
    }
  }
  next = plans_[robot].back();
  return true;
}

// A robot that has not decided may stay, so its cell is taken; this also excludes swaps.
bool Replan::taken(int cell) const {
  const int other = robot_at_[cell];
  return claimed_[cell] == step_ || (other >= 0 && decided_[other] != step_);
}

bool Replan::in_the_way(int robot, int cell) const {
  const int other = robot_at_[cell];
  return (step_ > 0 && claimed_[cell] == step_) || (other >= 0 && other != robot);
}

// A* from the robot's cell to its goal around all others. A path that is found becomes the robot's plan.
Replan::Outcome Replan::search(int robot) {
  ++search_;
  open_.clear();
  const auto& distance = distances_[robot];
  const auto reach = [&](int cell, int steps, int from) {
    if (seen_in_[cell] == search_ && steps_to_[cell] <= steps) {
      return;
    }
    seen_in_[cell] = search_;
    steps_to_[cell] = steps;
    came_from_[cell] = from;
    open_.push_back({steps + distance[cell], steps, cell});
    std::push_heap(open_.begin(), open_.end());
  };
  reach(at_[robot], 0, -1);
  while (!open_.empty()) {
    const Entry best = open_.front();
    std::pop_heap(open_.begin(), open_.end());
    open_.pop_back();
    if (best.steps != steps_to_[best.cell]) {
      continue;  // a shorter way was found after the entry was made
    }
    if (best.cell == goals_[robot]) {
      plans_[robot].clear();
      for (int cell = best.cell; came_from_[cell] >= 0; cell = came_from_[cell]) {
        plans_[robot].push_back(cell);
      }
      return Outcome::kFound;
    }
    ++expansions_;
    if (expansions_ % 256 == 0 && watch_.expired()) {
      return Outcome::kHalted;
    }
    for (const int move : grid_.moves()) {
      const int next = best.cell + move;
      if (!grid_.blocked(next) && !in_the_way(robot, next)) {
        reach(next, best.steps + 1, best.cell);
      }
    }
  }
  return Outcome::kNoPath;
}

}  // namespace magat_expert
