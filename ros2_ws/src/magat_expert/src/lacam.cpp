// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

#include "lacam.hpp"

#include <algorithm>
#include <numeric>
#include <utility>

#include "memory.hpp"
#include "shuffle.hpp"

namespace magat_expert {

namespace {

/// Every so many repeated configurations the search begins at the start again, so that it does not stay in one branch.
constexpr std::uint64_t kRestartEvery = 1000;
constexpr int kNone = -1;

std::size_t hash_of(const Configuration& cells) {
  std::uint64_t hash = 0xCBF29CE484222325U;  // FNV-1a
  for (const std::int32_t cell : cells) {
    hash = (hash ^ static_cast<std::uint64_t>(cell)) * 0x100000001B3U;
  }
  return static_cast<std::size_t>(hash ^ (hash >> 29));
}

}  // namespace

Lacam::Lacam(const Grid& grid, std::vector<int> starts, std::vector<int> goals, Watch& watch)
    : grid_(grid),
      starts_(std::move(starts)),
      goals_(std::move(goals)),
      watch_(watch),
      distances_(grid.memory()),
      nodes_(grid.memory()),
      known_(grid.memory()),
      open_(grid.memory()),
      pibt_(grid_, goals_, distances_) {}

Solution Lacam::solve(std::int64_t node_limit, std::uint64_t seed) {
  Solution solution(grid_.memory());
  generator_.seed(seed);
  try {
    search(node_limit, solution);
  } catch (const MemoryLimitReached&) {
    solution.status = Solution::Status::kMemoryLimit;
    known_.clear();  // room for the paths
  }
  if (goal_node_ >= 0) {
    finish(solution);
  } else if (watch_.halt() != Halt::kNone) {
    solution.status = watch_.halt() == Halt::kStopped ? Solution::Status::kStopped : Solution::Status::kTimedOut;
  }
  return solution;
}

void Lacam::search(std::int64_t node_limit, Solution& solution) {
  distances_.resize(starts_.size());
  for (std::size_t i = 0; i < starts_.size() && !watch_.expired(); ++i) {
    distances_[i] = grid_.distances_to(goals_[i]);
    solution.lower_bound += distances_[i][starts_[i]];
  }
  if (watch_.expired()) {
    return;
  }
  open_.push_back(add(Configuration(starts_.begin(), starts_.end()), -1, 0));
  while (!open_.empty()) {
    const int index = open_.back();
    const Node& node = nodes_[index];
    if (pruned(node) || node.tried == node.constraints.size()) {
      open_.pop_back();
      continue;
    }
    if (goal_node_ < 0 && std::equal(goals_.begin(), goals_.end(), node.cells.begin())) {
      goal_node_ = index;
      continue;
    }
    if (watch_.expired()) {
      return;
    }
    if (node_limit >= 0 && solution.high_level_expansions >= node_limit) {
      solution.status = Solution::Status::kNodeLimit;
      return;
    }
    ++solution.high_level_expansions;
    expand(index);
  }
}

int Lacam::add(const Configuration& cells, int parent, std::int64_t cost) {
  const int index = static_cast<int>(nodes_.size());
  Node& node = nodes_.emplace_back(grid_.memory());
  node.cells = cells;
  node.parent = parent;
  node.cost = cost;
  for (std::size_t robot = 0; robot < goals_.size(); ++robot) {
    node.bound += distances_[robot][node.cells[robot]];
  }
  give_priorities(node);
  node.constraints.emplace_back();
  known_.emplace(hash_of(cells), index);
  return index;
}

// The node of these cells, kNone if there is none.
int Lacam::find(const Configuration& cells) const {
  const auto [first, last] = known_.equal_range(hash_of(cells));
  const auto found = std::find_if(first, last, [&](const auto& entry) { return nodes_[entry.second].cells == cells; });
  return found == last ? kNone : found->second;
}

// A robot becomes more important with each step that it is away from its goal.
void Lacam::give_priorities(Node& node) const {
  const std::size_t robots = goals_.size();
  node.priorities.resize(robots);
  for (std::size_t robot = 0; robot < robots; ++robot) {
    const auto distance = distances_[robot][node.cells[robot]];
    if (node.parent < 0) {
      node.priorities[robot] = static_cast<float>(distance) / 10'000.0F;
    } else {
      const float before = nodes_[node.parent].priorities[robot];
      node.priorities[robot] = distance > 0 ? before + 1.0F : before - static_cast<float>(static_cast<int>(before));
    }
  }
  node.order.resize(robots);
  std::iota(node.order.begin(), node.order.end(), 0);
  std::stable_sort(node.order.begin(), node.order.end(),
                   [&](int a, int b) { return node.priorities[a] > node.priorities[b]; });
}

// The next constraint of `node`, as `Pibt::step` takes it. Its children are appended: breadth first, so that few robots
// are constrained at first.
Configuration Lacam::next_constraint(Node& node) {
  const std::size_t taken = node.tried++;
  const Constrained constraint = node.constraints[taken];
  if (constraint.depth < static_cast<int>(goals_.size())) {
    const int robot = node.order[constraint.depth];
    const std::int32_t here = node.cells[robot];
    std::vector<int> ways{here};
    for (const int move : grid_.moves()) {
      if (!grid_.blocked(here + move)) {
        ways.push_back(here + move);
      }
    }
    shuffle(ways, generator_);
    for (const int cell : ways) {
      node.constraints.push_back({static_cast<int>(taken), constraint.depth + 1, robot, cell});
    }
  }
  Configuration fixed(goals_.size(), Pibt::kNoCell);
  for (int i = static_cast<int>(taken); i > 0; i = node.constraints[i].parent) {
    fixed[node.constraints[i].robot] = node.constraints[i].cell;
  }
  return fixed;
}

void Lacam::expand(int index) {
  const Configuration fixed = next_constraint(nodes_[index]);
  Configuration next;
  if (!pibt_.step(nodes_[index].cells, nodes_[index].order, fixed, generator_, next)) {
    return;
  }
  const int known = find(next);
  if (known == kNone) {
    const int child = add(next, index, nodes_[index].cost + step_cost(nodes_[index].cells, next));
    nodes_[index].successors.push_back(child);
    open_.push_back(child);
    return;
  }
  auto& successors = nodes_[index].successors;
  if (std::find(successors.begin(), successors.end(), known) == successors.end()) {
    successors.push_back(known);
    relax(index);
  }
  if (!pruned(nodes_[known])) {
    open_.push_back(goal_node_ >= 0 && generator_() % kRestartEvery == 0 ? 0 : known);
  }
}

// Makes all ways that lead through `from` as short as they have become.
void Lacam::relax(int from) {
  std::deque<int> changed{from};
  while (!changed.empty()) {
    const int index = changed.front();
    changed.pop_front();
    for (const int next : nodes_[index].successors) {
      const std::int64_t cost = nodes_[index].cost + step_cost(nodes_[index].cells, nodes_[next].cells);
      if (cost < nodes_[next].cost) {
        nodes_[next].cost = cost;
        nodes_[next].parent = index;
        changed.push_back(next);
        if (goal_node_ >= 0 && next != goal_node_ && !pruned(nodes_[next])) {
          open_.push_back(next);
        }
      }
    }
  }
}

std::int64_t Lacam::step_cost(const Configuration& from, const Configuration& to) const {
  std::int64_t cost = 0;
  for (std::size_t robot = 0; robot < goals_.size(); ++robot) {
    cost += from[robot] != goals_[robot] || to[robot] != goals_[robot] ? 1 : 0;
  }
  return cost;
}

bool Lacam::pruned(const Node& node) const {
  return goal_node_ >= 0 && node.cost + node.bound >= nodes_[goal_node_].cost;
}

void Lacam::finish(Solution& solution) const {
  if (goal_node_ < 0) {
    return;
  }
  std::vector<int> way;
  for (int index = goal_node_; index >= 0; index = nodes_[index].parent) {
    way.push_back(index);
  }
  std::reverse(way.begin(), way.end());
  solution.status = Solution::Status::kSolved;
  for (std::size_t robot = 0; robot < goals_.size(); ++robot) {
    auto& path = solution.paths.emplace_back();
    for (const int index : way) {
      path.push_back(nodes_[index].cells[robot]);
    }
    while (path.size() > 1 && path[path.size() - 1] == path[path.size() - 2]) {
      path.pop_back();  // all end on their goals
    }
    solution.cost += static_cast<std::int64_t>(path.size()) - 1;
  }
}

}  // namespace magat_expert
