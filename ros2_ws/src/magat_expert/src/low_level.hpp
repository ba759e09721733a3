// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include <cstdint>
#include <memory_resource>
#include <vector>

#include "grid.hpp"
#include "path_table.hpp"
#include "space_time_table.hpp"
#include "types.hpp"

namespace magat_expert {

/// The low level of ECBS: focal A* for one robot in space-time (Barer et al. 2014, section "Enhanced CBS").
///
/// Among the nodes whose f is at most w times the smallest f in OPEN (and not too far above it), it expands the one
/// with the fewest conflicts with the paths of the other robots. One object serves all searches of a solve, and keeps
/// its memory between them.
class LowLevel {
 public:
  enum class Outcome { kFound, kNoPath, kHalted };
  struct Result {
    Outcome outcome = Outcome::kNoPath;
    Path path;            // valid until the next search
    int lower_bound = 0;  // the smallest f in OPEN at the end: no path under these constraints arrives earlier
  };

  LowLevel(const Grid& grid, Bound bound, Watch& watch);

  /// A path from `start` to `goal` that satisfies `constraints`. `distance` is Grid::distances_to(goal); `others` holds
  /// the paths of the other robots only.
  Result search(int start, int goal, const std::pmr::vector<std::int32_t>& distance,
                const std::pmr::vector<Constraint>& constraints, const PathTable& others);

  std::int64_t expansions() const { return expansions_; }

 private:
  struct Node {
    std::int32_t cell;
    std::int32_t time;
    std::int32_t f;
    std::int32_t parent;
    std::int32_t conflicts;
    bool closed;
  };
  struct FocalEntry {
    std::uint64_t key;
    std::int32_t node;
    // std::push_heap keeps the largest on top. Ties go to the older node, so that a solve is repeatable.
    bool operator<(const FocalEntry& other) const {
      return key != other.key ? key > other.key : node > other.node;
    }
  };

  void prepare(int goal, const std::pmr::vector<Constraint>& constraints, const PathTable& others, int start_distance);
  std::int64_t focal_limit(int lower_bound) const;
  bool allowed(int from, int to, int time) const;
  bool arrived(int cell, int time) const { return cell == goal_ && time >= earliest_arrival_; }
  void generate(int cell, int time, int parent, int conflicts);
  void enqueue(int index);
  void push_focal(int index);
  void raise_lower_bound();
  void expand(int index, const PathTable& others);
  Path path_to(int index);
  static std::uint64_t focal_key(const Node& node);

  const Grid& grid_;
  Bound bound_;
  Watch& watch_;
  std::int64_t expansions_ = 0;

  // Of the current search.
  int goal_ = -1;
  const std::pmr::vector<std::int32_t>* distance_ = nullptr;
  int earliest_arrival_ = 0;  // one step after the last constraint that keeps the robot off its goal
  int horizon_ = 0;
  int lower_bound_ = 0;
  std::int64_t focal_limit_ = 0;
  std::int64_t open_nodes_ = 0;
  std::pmr::vector<Node> nodes_;
  std::pmr::vector<std::int32_t> path_;
  std::pmr::vector<FocalEntry> focal_;
  std::pmr::vector<std::int32_t> open_by_f_;                  // [f]: how many nodes of OPEN have it
  std::pmr::vector<std::pmr::vector<std::int32_t>> waiting_;  // [f]: nodes that are not in the focal list yet
  std::pmr::vector<int> visits_from_;                         // [time]: visits of the goal by others from then on
  std::pmr::vector<Constraint> constraints_;                  // sorted by time
  std::pmr::vector<std::int32_t> constraints_begin_;          // [time]: the first one at this time or later
  SpaceTimeTable<8> node_at_;                                    // the node made for a cell and a time
};

}  // namespace magat_expert
