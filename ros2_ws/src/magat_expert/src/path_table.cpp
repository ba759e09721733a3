// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

#include "path_table.hpp"

#include <algorithm>

namespace magat_expert {

PathTable::PathTable(int cells, int robots, std::pmr::memory_resource* memory)
    : first_(memory),
      next_(robots, memory),
      paths_(robots, memory),
      places_(cells, Place{}, memory) {}

void PathTable::add(int robot, Path path) {
  layers_ = std::max(layers_, path.length);
  auto& next = next_[robot];
  if (static_cast<int>(next.size()) < path.length) {
    next.resize(path.length);
  }
  for (int time = 0; time < path.length; ++time) {
    std::int32_t& first = first_.at(path[time], time);
    next[time] = static_cast<std::int16_t>(first);
    first = robot;
    places_[path[time]].visited |= bit(time);
  }
  places_[path.back()].rest_from = path.arrival();
  places_[path.back()].rest_robot = robot;
  paths_[robot] = path;
}

void PathTable::remove(int robot) {
  const Path path = paths_[robot];
  for (int time = 0; time < path.length; ++time) {
    std::int32_t& first = first_.at(path[time], time);
    if (first == robot) {
      first = next_[robot][time];
      if (first < 0) {
        unmark(path[time], time);
      }
      continue;
    }
    int other = first;
    while (next_[other][time] != robot) {
      other = next_[other][time];
    }
    next_[other][time] = next_[robot][time];
  }
  places_[path.back()].rest_from = kNever;
  paths_[robot] = {};
}

// Clears the bit of a time at which nobody is on `cell`, unless it also stands for a time at which somebody is.
void PathTable::unmark(int cell, int time) {
  for (int other = time & 63; other < layers_; other += 64) {
    if (first_.find(cell, other) >= 0) {
      return;
    }
  }
  places_[cell].visited &= ~bit(time);
}

int PathTable::visitors(int cell, int time) const {
  int count = 0;
  for (int robot = first_.find(cell, time); robot >= 0; robot = next_[robot][time]) {
    ++count;
  }
  return count;
}

PathTable::Count PathTable::count(Path path) const {
  Count result;
  const auto note = [&result](int conflicts, int time) {
    if (conflicts > 0) {
      result.conflicts += conflicts;
      result.first_time = std::min(result.first_time, time);
    }
  };
  for (int time = 1; time <= path.arrival(); ++time) {
    note(step_conflicts(path[time - 1], path[time], time), time);
  }
  for (int time = path.arrival() + 1; time < layers_; ++time) {
    note(visitors(path.back(), time), time);
  }
  return result;
}

Conflict PathTable::first_conflict(int from_time) const {
  const int robots = static_cast<int>(paths_.size());
  for (int time = std::max(from_time, 1); time < layers_; ++time) {
    for (int robot = 0; robot < robots; ++robot) {
      const Conflict conflict = conflict_of(robot, time);
      if (conflict.found()) {
        return conflict;
      }
    }
  }
  return {};
}

// For a robot at rest it finds nothing: the conflict is found from the moving robot.
Conflict PathTable::conflict_of(int robot, int time) const {
  const Path path = paths_[robot];
  if (time > path.arrival()) {
    return {};
  }
  const int from = path[time - 1];
  const int to = path[time];
  for (int other = first_.find(to, time); other >= 0; other = next_[other][time]) {
    if (other != robot) {
      return {time, robot, other, false};
    }
  }
  if (time > places_[to].rest_from && places_[to].rest_robot != robot) {
    return {time, robot, places_[to].rest_robot, false};
  }
  if (from != to) {
    for (int other = first_.find(to, time - 1); other >= 0; other = next_[other][time - 1]) {
      if (moves_to(other, time, from)) {
        return {time, robot, other, true};
      }
    }
  }
  return {};
}

}  // namespace magat_expert
