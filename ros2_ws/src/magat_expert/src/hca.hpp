// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include <cstdint>
#include <memory_resource>
#include <vector>

#include "grid.hpp"
#include "path_store.hpp"
#include "path_table.hpp"
#include "solution.hpp"
#include "space_time_table.hpp"
#include "types.hpp"

namespace magat_expert {

/// Hierarchical Cooperative A* (Silver: "Cooperative Pathfinding", AIIDE 2005).
///
/// Robots search space-time one after another, with their exact distances as heuristic, and avoid the paths of the
/// earlier ones. A robot rests on its goal for ever, so it may arrive only when no earlier robot passes there any more.
/// Starts are unique, goals are unique, and every goal is reachable from its start.
class Hca {
 public:
  Hca(const Grid& grid, std::vector<int> starts, std::vector<int> goals, Watch& watch);

  /// Tries up to `orders` orders of the robots: by index, then shuffled, with the robot that found no path first.
  Solution solve(std::int64_t orders, std::uint64_t seed);

 private:
  enum class Outcome { kFound, kNoPath, kHalted };
  struct Node {
    std::int32_t cell;
    std::int32_t time;
    std::int32_t parent;
  };
  struct Entry {
    std::int32_t f;
    std::int32_t time;
    std::int32_t node;
    // std::push_heap keeps the largest on top: the smallest f, then the deepest node, then the oldest.
    bool operator<(const Entry& other) const {
      if (f != other.f) {
        return f > other.f;
      }
      return time != other.time ? time < other.time : node > other.node;
    }
  };

  void search_all(std::int64_t orders, std::uint64_t seed, Solution& solution);
  int plan_all(const std::vector<int>& order);
  Outcome search(int robot);
  void generate(int robot, int cell, int time, int parent);
  int earliest_arrival(int goal) const;
  void store_path(int robot, int node);

  const Grid& grid_;
  std::vector<int> starts_;
  std::vector<int> goals_;
  Watch& watch_;
  PathTable table_;  // the reservations
  PathStore store_;
  std::pmr::vector<std::pmr::vector<std::int32_t>> distances_;  // [robot][cell]
  std::int64_t expansions_ = 0;

  // Of the current search.
  int earliest_arrival_ = 0;
  std::pmr::vector<Node> nodes_;
  std::pmr::vector<Entry> open_;
  SpaceTimeTable<8> node_at_;  // the best node for a cell and a time; once all others rest, one for all later times
};

}  // namespace magat_expert
