// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

#include "ecbs.hpp"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "memory.hpp"

namespace magat_expert {

Ecbs::Ecbs(const Grid& grid, std::vector<int> starts, std::vector<int> goals, double w, Watch& watch)
    : grid_(grid),
      starts_(std::move(starts)),
      goals_(std::move(goals)),
      bound_(w),
      watch_(watch),
      low_level_(grid, bound_, watch),
      table_(grid.cells(), static_cast<int>(starts_.size()), grid.memory()),
      distances_(grid.memory()),
      root_paths_(grid.memory()),
      store_(grid.memory()),
      nodes_(grid.memory()),
      by_lower_bound_(grid.memory()),
      waiting_(grid.memory()),
      focal_(grid.memory()) {}

Solution Ecbs::solve(std::int64_t node_limit) {
  Solution solution(grid_.memory());
  try {
    solution.status = search(node_limit, solution);
    solution.lower_bound = smallest_lower_bound();
  } catch (const MemoryLimitReached&) {
    solution.status = Solution::Status::kMemoryLimit;
    solution.lower_bound = lower_bound_;  // OPEN may lack a node whose insertion failed
    solution.paths.clear();
    solution.cost = 0;
  }
  solution.low_level_expansions = low_level_.expansions();
  return solution;
}

Solution::Status Ecbs::search(std::int64_t node_limit, Solution& solution) {
  const auto halted = [this] {
    return watch_.halt() == Halt::kStopped ? Solution::Status::kStopped : Solution::Status::kTimedOut;
  };
  if (!make_root()) {
    return halted();
  }
  int index = 0;
  while (pop(index)) {
    if (nodes_[index].conflicts == 0) {
      load(index);
      solution.cost = nodes_[index].cost;
      solution.paths.reserve(starts_.size());
      for (std::size_t robot = 0; robot < starts_.size(); ++robot) {
        const Path path = table_.path(static_cast<int>(robot));
        solution.paths.emplace_back(path.cells, path.cells + path.length);
      }
      return Solution::Status::kSolved;
    }
    if (node_limit >= 0 && solution.high_level_expansions >= node_limit) {
      return Solution::Status::kNodeLimit;
    }
    ++solution.high_level_expansions;
    if (watch_.expired() || !expand(index)) {
      return halted();
    }
  }
  return Solution::Status::kNoSolution;
}

// Robots plan one after another and avoid the paths of the earlier ones.
bool Ecbs::make_root() {
  const std::size_t robots = starts_.size();
  distances_.resize(robots);
  root_paths_.resize(robots);
  root_lower_bounds_.resize(robots);
  const std::pmr::vector<Constraint> unconstrained;
  Node root;
  for (std::size_t i = 0; i < robots; ++i) {
    if (watch_.expired()) {
      return false;
    }
    const int robot = static_cast<int>(i);
    distances_[i] = grid_.distances_to(goals_[i]);
    const LowLevel::Result result = low_level_.search(starts_[i], goals_[i], distances_[i], unconstrained, table_);
    if (result.outcome != LowLevel::Outcome::kFound) {
      return false;
    }
    root_paths_[i] = store_.store(result.path);
    root_lower_bounds_[i] = result.lower_bound;
    const PathTable::Count count = table_.count(root_paths_[i]);
    root.conflicts += count.conflicts;
    root.first_conflict = std::min(root.first_conflict, count.first_time);
    root.cost += root_paths_[i].arrival();
    root.lower_bound += result.lower_bound;
    table_.add(robot, root_paths_[i]);
  }
  lower_bounds_ = root_lower_bounds_;
  loaded_ = 0;
  push(root);
  return true;
}

void Ecbs::push(const Node& node) {
  const int index = static_cast<int>(nodes_.size());
  by_lower_bound_.push({node.lower_bound, 0, index});
  if (node.cost <= focal_limit_) {
    focal_.push({node.conflicts, node.cost, index});
  } else {
    waiting_.push({node.cost, 0, index});
  }
  nodes_.push_back(node);
}

// The smallest sum of lower bounds in OPEN. It never decreases, because a child's is never below its parent's.
std::int64_t Ecbs::smallest_lower_bound() {
  while (!by_lower_bound_.empty() && !nodes_[by_lower_bound_.top().node].open) {
    by_lower_bound_.pop();
  }
  return by_lower_bound_.empty() ? 0 : by_lower_bound_.top().key;
}

// The next node to expand. It stays in OPEN until it is expanded, so that a solution counts in its own lower bound.
bool Ecbs::pop(int& index) {
  const std::int64_t lower_bound = smallest_lower_bound();
  if (by_lower_bound_.empty()) {
    return false;
  }
  lower_bound_ = lower_bound;
  focal_limit_ = bound_(lower_bound);
  while (!waiting_.empty() && waiting_.top().key <= focal_limit_) {
    const int node = waiting_.top().node;
    waiting_.pop();
    focal_.push({nodes_[node].conflicts, nodes_[node].cost, node});
  }
  index = focal_.top().node;
  focal_.pop();
  return true;
}

// False: the search was halted.
bool Ecbs::expand(int index) {
  load(index);
  const Conflict conflict = table_.first_conflict(nodes_[index].first_conflict);
  nodes_[index].first_conflict = conflict.time;
  const Path first = table_.path(conflict.first);
  const int to = first[conflict.time];
  const int from = first[conflict.time - 1];
  const int robots[2] = {conflict.first, conflict.second};
  const Constraint constraints[2] = {
      {conflict.time, conflict.swap ? from : -1, to},
      conflict.swap ? Constraint{conflict.time, to, from} : Constraint{conflict.time, -1, to},
  };

  std::vector<Node> children;
  for (int side = 0; side < 2; ++side) {
    Node child;
    if (!replan(index, robots[side], constraints[side], child)) {
      return false;
    }
    if (child.path.empty()) {
      continue;  // no path satisfies these constraints
    }
    // A bypass (Boyarski et al. 2015, in the form of Li et al. 2021): a path with fewer conflicts, that this robot
    // could have taken in this node, replaces its path without a constraint and without a split.
    if (child.conflicts < nodes_[index].conflicts && child.path.arrival() <= bound_(lower_bounds_[child.robot])) {
      child.constrained = false;
      child.lower_bound = nodes_[index].lower_bound;
      child.robot_lower_bound = lower_bounds_[child.robot];
      children.clear();
      children.push_back(child);
      break;
    }
    children.push_back(child);
  }
  nodes_[index].open = false;
  for (const Node& child : children) {
    push(child);
  }
  return true;
}

// Re-plans for one robot of the loaded node. The child's path is empty if there is none; false: halted.
bool Ecbs::replan(int parent, int robot, const Constraint& constraint, Node& child) {
  const Node& node = nodes_[parent];
  std::pmr::vector<Constraint> constraints = constraints_of(parent, robot);
  constraints.push_back(constraint);
  const Path old_path = table_.path(robot);
  table_.remove(robot);
  const int old_conflicts = table_.count(old_path).conflicts;
  const LowLevel::Result result =
      low_level_.search(starts_[robot], goals_[robot], distances_[robot], constraints, table_);
  if (result.outcome == LowLevel::Outcome::kFound) {
    child.path = store_.store(result.path);
    const PathTable::Count count = table_.count(child.path);
    child.parent = parent;
    child.robot = robot;
    child.constraint = constraint;
    child.constrained = true;
    child.robot_lower_bound = std::max(result.lower_bound, lower_bounds_[robot]);
    child.lower_bound = node.lower_bound + child.robot_lower_bound - lower_bounds_[robot];
    child.cost = node.cost + child.path.arrival() - old_path.arrival();
    child.conflicts = node.conflicts + count.conflicts - old_conflicts;
    child.first_conflict = std::min(node.first_conflict, count.first_time);
  }
  table_.add(robot, old_path);
  return result.outcome != LowLevel::Outcome::kHalted;
}

// Sets the table to the paths of a node. Each path is that of the nearest ancestor that changed it.
void Ecbs::load(int index) {
  const auto put = [this](int robot, Path path, int lower_bound) {
    lower_bounds_[robot] = lower_bound;
    if (table_.path(robot).cells != path.cells) {
      table_.remove(robot);
      table_.add(robot, path);
    }
  };
  if (index == loaded_) {
    return;
  }
  if (nodes_[index].parent == loaded_) {
    put(nodes_[index].robot, nodes_[index].path, nodes_[index].robot_lower_bound);
  } else {
    std::vector<char> done(starts_.size(), 0);
    for (int node = index; nodes_[node].parent >= 0; node = nodes_[node].parent) {
      const int robot = nodes_[node].robot;
      if (done[robot] == 0) {
        done[robot] = 1;
        put(robot, nodes_[node].path, nodes_[node].robot_lower_bound);
      }
    }
    for (std::size_t robot = 0; robot < starts_.size(); ++robot) {
      if (done[robot] == 0) {
        put(static_cast<int>(robot), root_paths_[robot], root_lower_bounds_[robot]);
      }
    }
  }
  loaded_ = index;
}

std::pmr::vector<Constraint> Ecbs::constraints_of(int index, int robot) const {
  std::pmr::vector<Constraint> constraints(grid_.memory());
  for (int node = index; node >= 0; node = nodes_[node].parent) {
    if (nodes_[node].constrained && nodes_[node].robot == robot) {
      constraints.push_back(nodes_[node].constraint);
    }
  }
  return constraints;
}

}  // namespace magat_expert
