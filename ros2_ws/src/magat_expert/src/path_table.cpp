// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

#include "path_table.hpp"

#include <algorithm>

namespace magat_expert {

PathTable::PathTable(int cells, int robots)
    : cells_(cells), next_(robots), paths_(robots), rest_from_(cells, kNever), rest_robot_(cells, -1) {}

void PathTable::add(int robot, Path path) {
  while (layers() < path.length) {
    layers_.emplace_back(cells_, static_cast<std::int16_t>(-1));
  }
  auto& next = next_[robot];
  if (static_cast<int>(next.size()) < path.length) {
    next.resize(path.length);
  }
  for (int time = 0; time < path.length; ++time) {
    std::int16_t& head = layers_[time][path[time]];
    next[time] = head;
    head = static_cast<std::int16_t>(robot);
  }
  rest_from_[path.back()] = path.arrival();
  rest_robot_[path.back()] = static_cast<std::int16_t>(robot);
  paths_[robot] = path;
}

void PathTable::remove(int robot) {
  const Path path = paths_[robot];
  for (int time = 0; time < path.length; ++time) {
    std::int16_t* link = &layers_[time][path[time]];
    while (*link != robot) {
      link = &next_[*link][time];
    }
    *link = next_[robot][time];
  }
  rest_from_[path.back()] = kNever;
  paths_[robot] = {};
}

int PathTable::visitors(int cell, int time) const {
  int count = 0;
  if (time < layers()) {
    for (int robot = layers_[time][cell]; robot >= 0; robot = next_[robot][time]) {
      ++count;
    }
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
  for (int time = path.arrival() + 1; time < layers(); ++time) {
    note(visitors(path.back(), time), time);
  }
  return result;
}

Conflict PathTable::first_conflict(int from_time) const {
  const int robots = static_cast<int>(paths_.size());
  for (int time = std::max(from_time, 1); time < layers(); ++time) {
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
  for (int other = layers_[time][to]; other >= 0; other = next_[other][time]) {
    if (other != robot) {
      return {time, robot, other, false};
    }
  }
  if (time > rest_from_[to] && rest_robot_[to] != robot) {
    return {time, robot, rest_robot_[to], false};
  }
  if (from != to) {
    for (int other = layers_[time - 1][to]; other >= 0; other = next_[other][time - 1]) {
      if (moves_to(other, time, from)) {
        return {time, robot, other, true};
      }
    }
  }
  return {};
}

}  // namespace magat_expert
