// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include <cstdint>
#include <deque>
#include <memory_resource>
#include <queue>
#include <vector>

#include "grid.hpp"
#include "low_level.hpp"
#include "path_store.hpp"
#include "path_table.hpp"
#include "solution.hpp"
#include "types.hpp"

namespace magat_expert {

/// Enhanced Conflict-Based Search (Barer, Sharon, Stern, Felner 2014): the constraint tree.
///
/// Among the open nodes whose cost is at most w times the smallest sum of lower bounds in OPEN, it expands the one with
/// the fewest conflicts. Starts are unique, goals are unique, and every goal is reachable from its start.
class Ecbs {
 public:
  Ecbs(const Grid& grid, std::vector<int> starts, std::vector<int> goals, double w, Watch& watch);

  /// `node_limit` < 0: none.
  Solution solve(std::int64_t node_limit);

 private:
  // A node stores only its difference from its parent: one robot's path, and the constraint that changed it.
  struct Node {
    int parent = -1;
    int robot = -1;
    bool constrained = false;  // false below the root: a bypass, which has no constraint
    Constraint constraint;
    Path path;
    int robot_lower_bound = 0;
    std::int64_t lower_bound = 0;  // sum over robots of the low level's lower bounds
    std::int64_t cost = 0;         // sum over robots of the arrival times
    int conflicts = 0;
    int first_conflict = kNever;  // no conflict is earlier than this
    bool open = true;
  };
  struct Entry {
    std::int64_t key;
    std::int64_t second;
    int node;
    bool operator>(const Entry& other) const {
      if (key != other.key) {
        return key > other.key;
      }
      // The newest first: it is the deepest, and its paths are still in the table.
      return second != other.second ? second > other.second : node < other.node;
    }
  };
  using Queue = std::priority_queue<Entry, std::pmr::vector<Entry>, std::greater<Entry>>;

  Solution::Status search(std::int64_t node_limit, Solution& solution);
  bool make_root();
  void push(const Node& node);
  bool pop(int& index);
  bool expand(int index);
  bool replan(int parent, int robot, const Constraint& constraint, Node& child);
  void load(int index);
  std::pmr::vector<Constraint> constraints_of(int index, int robot) const;
  std::int64_t smallest_lower_bound();

  const Grid& grid_;
  std::vector<int> starts_;
  std::vector<int> goals_;
  Bound bound_;
  Watch& watch_;
  LowLevel low_level_;
  PathTable table_;
  std::pmr::vector<std::pmr::vector<std::int32_t>> distances_;  // [robot][cell]
  std::pmr::vector<Path> root_paths_;
  std::vector<int> root_lower_bounds_;
  std::vector<int> lower_bounds_;  // [robot], of the node that is loaded
  int loaded_ = -1;
  PathStore store_;
  std::pmr::deque<Node> nodes_;
  Queue by_lower_bound_;  // OPEN, with closed nodes still to be dropped from the top
  Queue waiting_;         // OPEN without the focal list, by cost
  Queue focal_;           // by conflicts
  std::int64_t focal_limit_ = -1;
  std::int64_t lower_bound_ = 0;  // when a node was last popped
};

}  // namespace magat_expert
