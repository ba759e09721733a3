// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include <cstdint>
#include <vector>

#include "types.hpp"

namespace magat_expert {

/// The paths of one node of the constraint tree, indexed by time and cell.
///
/// A layer per time step holds, for each cell, the first robot there; `next_` chains the others, since the paths of a
/// node may still conflict. Adding or removing a path takes time proportional to its length, so that changing from one
/// node to another costs only the paths in which they differ. Robots at rest are not entered in the layers: goals are
/// unique, so the time from which a robot rests on a cell is enough.
class PathTable {
 public:
  PathTable(int cells, int robots);

  /// Add the path of a robot that has none in the table. The cells must stay valid until `remove`.
  void add(int robot, Path path);
  void remove(int robot);

  /// The path in the table, empty if there is none.
  Path path(int robot) const { return paths_[robot]; }

  /// Conflicts with the paths in the table of a robot (not in the table) that goes from `from` to `to`, arriving at
  /// `time`.
  int step_conflicts(int from, int to, int time) const {
    int conflicts = time > rest_from_[to] ? 1 : 0;
    if (time >= layers()) {
      return conflicts;
    }
    for (int robot = layers_[time][to]; robot >= 0; robot = next_[robot][time]) {
      ++conflicts;
    }
    if (from != to) {
      for (int robot = layers_[time - 1][to]; robot >= 0; robot = next_[robot][time - 1]) {
        conflicts += moves_to(robot, time, from) ? 1 : 0;
      }
    }
    return conflicts;
  }

  /// How many robots are on `cell` at `time`, without those at rest.
  int visitors(int cell, int time) const;

  /// Time steps that have a layer: from this time on, every robot in the table rests.
  int layers() const { return static_cast<int>(layers_.size()); }

  struct Count {
    int conflicts = 0;
    int first_time = kNever;
  };
  /// Conflicts of a path whose robot is not in the table, and the time of the earliest; kNever if there is none.
  Count count(Path path) const;

  /// The earliest conflict at or after `from_time` between paths in the table.
  Conflict first_conflict(int from_time) const;

 private:
  bool moves_to(int robot, int time, int cell) const {
    const Path path = paths_[robot];
    return time < path.length && path[time] == cell;
  }
  Conflict conflict_of(int robot, int time) const;

  int cells_;
  std::vector<std::vector<std::int16_t>> layers_;  // [time][cell], -1: no robot
  std::vector<std::vector<std::int16_t>> next_;    // [robot][time]
  std::vector<Path> paths_;                        // [robot]
  std::vector<std::int32_t> rest_from_;            // [cell], kNever: no robot rests here
  std::vector<std::int16_t> rest_robot_;           // [cell], valid where rest_from_ is not kNever
};

}  // namespace magat_expert
