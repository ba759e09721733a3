// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

#include "hca.hpp"

#include <algorithm>
#include <cstddef>
#include <numeric>
#include <random>
#include <utility>

#include "memory.hpp"
#include "shuffle.hpp"

namespace magat_expert {

namespace {

constexpr int kNobody = -1;

}  // namespace

Hca::Hca(const Grid& grid, std::vector<int> starts, std::vector<int> goals, Watch& watch)
    : grid_(grid),
      starts_(std::move(starts)),
      goals_(std::move(goals)),
      watch_(watch),
      table_(grid.cells(), static_cast<int>(starts_.size()), grid.memory()),
      store_(grid.memory()),
      distances_(grid.memory()),
      nodes_(grid.memory()),
      open_(grid.memory()),
      node_at_(grid.memory()) {}

Solution Hca::solve(std::int64_t orders, std::uint64_t seed) {
  Solution solution(grid_.memory());
  solution.status = Solution::Status::kIncomplete;
  try {
    search_all(orders, seed, solution);
  } catch (const MemoryLimitReached&) {
    solution.status = Solution::Status::kMemoryLimit;
    solution.paths.clear();
    solution.cost = 0;
  }
  solution.low_level_expansions = expansions_;
  if (solution.status == Solution::Status::kIncomplete && watch_.halt() != Halt::kNone) {
    solution.status =
        watch_.halt() == Halt::kStopped ? Solution::Status::kStopped : Solution::Status::kTimedOut;
  }
  return solution;
}

void Hca::search_all(std::int64_t orders, std::uint64_t seed, Solution& solution) {
  distances_.resize(starts_.size());
  for (std::size_t i = 0; i < starts_.size() && !watch_.expired(); ++i) {
    distances_[i] = grid_.distances_to(goals_[i]);
    solution.lower_bound += distances_[i][starts_[i]];
  }
  std::mt19937_64 generator(seed);
  std::vector<int> order(starts_.size());
  std::iota(order.begin(), order.end(), 0);
  int failed = kNobody;
  while (solution.high_level_expansions < orders && !watch_.expired()) {
    if (failed != kNobody) {
      shuffle(order, generator);
      std::iter_swap(order.begin(), std::find(order.begin(), order.end(), failed));
    }
    ++solution.high_level_expansions;
    failed = plan_all(order);
    if (failed == kNobody) {
      solution.status = Solution::Status::kSolved;
      for (std::size_t robot = 0; robot < starts_.size(); ++robot) {
        const Path path = table_.path(static_cast<int>(robot));
        solution.cost += path.arrival();
        solution.paths.emplace_back(path.cells, path.cells + path.length);
      }
      return;
    }
  }
}

// The first robot that found no path (or was halted on its search), kNobody if all found theirs.
int Hca::plan_all(const std::vector<int>& order) {
  for (const int robot : order) {
    if (!table_.path(robot).empty()) {
      table_.remove(robot);
    }
  }
  for (const int robot : order) {
    if (watch_.expired() || search(robot) != Outcome::kFound) {
      return robot;
    }
  }
  return kNobody;
}

Hca::Outcome Hca::search(int robot) {
  nodes_.clear();
  open_.clear();
  node_at_.clear();
  earliest_arrival_ = earliest_arrival(goals_[robot]);
  generate(robot, starts_[robot], 0, -1);
  while (!open_.empty()) {
    const Entry best = open_.front();
    std::pop_heap(open_.begin(), open_.end());
    open_.pop_back();
    const Node node = nodes_[best.node];
    if (node_at_.find(node.cell, std::min(node.time, table_.layers())) != best.node) {
      continue;  // an earlier way to this cell was found after the entry was made
    }
    if (node.cell == goals_[robot] && node.time >= earliest_arrival_) {
      store_path(robot, best.node);
      return Outcome::kFound;
    }
    ++expansions_;
    if (expansions_ % 256 == 0 && watch_.expired()) {
      return Outcome::kHalted;
    }
    for (const int move : grid_.moves()) {
      const int next = node.cell + move;
      if (!grid_.blocked(next) && table_.step_conflicts(node.cell, next, node.time + 1) == 0) {
        generate(robot, next, node.time + 1, best.node);
      }
    }
    if (table_.step_conflicts(node.cell, node.cell, node.time + 1) == 0) {
      generate(robot, node.cell, node.time + 1, best.node);
    }
  }
  return Outcome::kNoPath;
}

void Hca::generate(int robot, int cell, int time, int parent) {
  std::int32_t& entry = node_at_.at(cell, std::min(time, table_.layers()));
  if (entry != node_at_.kNone && nodes_[entry].time <= time) {
    return;
  }
  entry = static_cast<std::int32_t>(nodes_.size());
  nodes_.push_back({cell, time, parent});
  open_.push_back({std::max(time + distances_[robot][cell], earliest_arrival_), time, entry});
  std::push_heap(open_.begin(), open_.end());
}

// One step after the last visit of the goal by a robot with a path.
int Hca::earliest_arrival(int goal) const {
  int time = table_.layers();
  while (time > 0 && table_.visitors(goal, time - 1) == 0) {
    --time;
  }
  return time;
}

void Hca::store_path(int robot, int node) {
  std::vector<std::int32_t> cells(nodes_[node].time + 1);
  for (; node >= 0; node = nodes_[node].parent) {
    cells[nodes_[node].time] = nodes_[node].cell;
  }
  table_.add(robot, store_.store({cells.data(), static_cast<int>(cells.size())}));
}

}  // namespace magat_expert
