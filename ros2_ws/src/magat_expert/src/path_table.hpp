// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include <cstdint>
#include <memory_resource>
#include <vector>

#include "space_time_table.hpp"
#include "types.hpp"

namespace magat_expert {

/// The paths of one node of the constraint tree, indexed by time and cell.
///
/// A table holds the first robot at each cell and time; `next_` chains the others, since the paths of a node may still
/// conflict. Adding or removing a path takes time proportional to its length, so that changing from one node to another
/// costs only the paths in which they differ. Robots at rest are not entered in the table: goals are unique, so the
/// time from which a robot rests on a cell is enough.
class PathTable {
 public:
  PathTable(int cells, int robots, std::pmr::memory_resource* memory);

  /// Add the path of a robot that has none in the table. The cells must stay valid until `remove`.
  void add(int robot, Path path);
  void remove(int robot);

  /// The path in the table, empty if there is none.
  Path path(int robot) const { return paths_[robot]; }

  /// Conflicts with the paths in the table of a robot (not in the table) that goes from `from` to `to`, arriving at
  /// `time`.
  int step_conflicts(int from, int to, int time) const {
    const Place& place = places_[to];
    int conflicts = time > place.rest_from ? 1 : 0;
    if ((place.visited & bit(time)) != 0) {
      conflicts += visitors(to, time);
    }
    if (from != to && (place.visited & bit(time - 1)) != 0) {
      for (int robot = first_.find(to, time - 1); robot >= 0; robot = next_[robot][time - 1]) {
        conflicts += moves_to(robot, time, from) ? 1 : 0;
      }
    }
    return conflicts;
  }

  /// How many robots are on `cell` at `time`, without those at rest.
  int visitors(int cell, int time) const;

  /// From this time on, every robot that has been in the table rests.
  int layers() const { return layers_; }

  struct Count {
    int conflicts = 0;
    int first_time = kNever;
  };
  /// Conflicts of a path whose robot is not in the table, and the time of the earliest; kNever if there is none.
  Count count(Path path) const;

  /// The earliest conflict at or after `from_time` between paths in the table.
  Conflict first_conflict(int from_time) const;

 private:
  struct Place {
    std::uint64_t visited = 0;  // bit t % 64 is set if a robot is here at time t; most looks end here
    std::int32_t rest_from = kNever;
    std::int32_t rest_robot = -1;
  };
  static std::uint64_t bit(int time) { return std::uint64_t{1} << (time & 63); }

  void unmark(int cell, int time);
  bool moves_to(int robot, int time, int cell) const {
    const Path path = paths_[robot];
    return time < path.length && path[time] == cell;
  }
  Conflict conflict_of(int robot, int time) const;

  int layers_ = 0;
  SpaceTimeTable<1> first_;                                // the robot that was added last
  std::pmr::vector<std::pmr::vector<std::int16_t>> next_;  // [robot][time]: the one before it, -1: none
  std::pmr::vector<Path> paths_;                           // [robot]
  std::pmr::vector<Place> places_;                         // [cell]
};

}  // namespace magat_expert
