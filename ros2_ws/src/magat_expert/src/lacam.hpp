// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory_resource>
#include <random>
#include <unordered_map>
#include <vector>

#include "grid.hpp"
#include "pibt.hpp"
#include "solution.hpp"
#include "types.hpp"

namespace magat_expert {

/// LaCAM* (Okumura: "Improving LaCAM for Scalable Eventually Optimal Multi-Agent Pathfinding", IJCAI 2023).
///
/// A depth-first search over configurations, the cells of all robots at one time. `Pibt` makes the successors of a
/// configuration, under constraints that are enumerated lazily, so that in the end all successors are tried: the search
/// finds a solution if there is one. It then goes on and improves the sum of losses: steps, over all robots, that do not
/// start and end on the goal. Starts are unique, goals are unique, and every goal is reachable from its start.
class Lacam {
 public:
  Lacam(const Grid& grid, std::vector<int> starts, std::vector<int> goals, Watch& watch);

  /// The best solution within `node_limit` expansions (< 0: no limit) and the limits of time and memory.
  Solution solve(std::int64_t node_limit, std::uint64_t seed);

 private:
  // A constraint: `robot` goes to `cell` in the next step, and those of the parents hold, too.
  struct Constrained {
    int parent = -1;
    int depth = 0;
    int robot = -1;
    std::int32_t cell = Pibt::kNoCell;
  };
  struct Node {
    explicit Node(std::pmr::memory_resource* memory)
        : cells(memory), order(memory), priorities(memory), constraints(memory), successors(memory) {}

    Configuration cells;
    std::pmr::vector<int> order;         // robots, the most important first
    std::pmr::vector<float> priorities;  // [robot]
    int parent = -1;
    std::int64_t cost = 0;   // of the best way here
    std::int64_t bound = 0;  // sum of the distances to the goals
    std::pmr::vector<Constrained> constraints;
    std::size_t tried = 0;             // constraints that were taken, in their order
    std::pmr::vector<int> successors;  // nodes that a step leads to
  };

  void search(std::int64_t node_limit, Solution& solution);
  int add(const Configuration& cells, int parent, std::int64_t cost);
  int find(const Configuration& cells) const;
  void give_priorities(Node& node) const;
  Configuration next_constraint(Node& node);
  void expand(int index);
  void relax(int from);
  std::int64_t step_cost(const Configuration& from, const Configuration& to) const;
  bool pruned(const Node& node) const;
  void finish(Solution& solution) const;

  const Grid& grid_;
  std::vector<int> starts_;
  std::vector<int> goals_;
  Watch& watch_;
  Distances distances_;
  std::mt19937_64 generator_;
  std::pmr::deque<Node> nodes_;
  std::pmr::unordered_multimap<std::size_t, int> known_;  // nodes, by the hash of their cells
  std::pmr::vector<int> open_;                            // a stack
  int goal_node_ = -1;
  Pibt pibt_;
};

}  // namespace magat_expert
