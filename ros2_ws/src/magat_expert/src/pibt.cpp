// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

#include "pibt.hpp"

#include <algorithm>
#include <cstddef>
#include <utility>

namespace magat_expert {

Pibt::Pibt(const Grid& grid, const std::vector<int>& goals, const Distances& distances)
    : grid_(grid),
      goals_(goals),
      distances_(distances),
      now_at_(grid.cells(), kNobody, grid.memory()),
      next_at_(grid.cells(), kNobody, grid.memory()) {}

bool Pibt::step(const Configuration& from, const std::pmr::vector<int>& order, const Configuration& fixed,
                std::mt19937_64& generator, Configuration& next) {
  from_ = &from;
  next_ = &next;
  generator_ = &generator;
  next.assign(from.size(), kNoCell);
  bool valid = true;
  for (std::size_t robot = 0; robot < from.size(); ++robot) {
    now_at_[from[robot]] = static_cast<int>(robot);
  }
  for (std::size_t robot = 0; robot < from.size() && valid; ++robot) {
    const std::int32_t to = fixed[robot];
    if (to == kNoCell) {
      continue;
    }
    const int there = now_at_[to];
    valid = next_at_[to] == kNobody &&
            (there == kNobody || there == static_cast<int>(robot) || next[there] != from[robot]);
    if (valid) {
      next[robot] = to;
      next_at_[to] = static_cast<int>(robot);
    }
  }
  for (std::size_t i = 0; i < order.size() && valid; ++i) {
    valid = next[order[i]] != kNoCell || plan(order[i]);
  }
  for (std::size_t robot = 0; robot < from.size(); ++robot) {
    now_at_[from[robot]] = kNobody;
    if (next[robot] != kNoCell) {
      next_at_[next[robot]] = kNobody;
    }
  }
  return valid;
}

// Chooses the next cell of `robot`, and of those that it pushes away. False: it has to stay where it is.
bool Pibt::plan(int robot) {
  const std::int32_t here = (*from_)[robot];
  Choice choice = choices_of(robot);
  const int partner = partner_of(robot, choice);
  if (partner != kNobody) {
    std::reverse(choice.cells, choice.cells + choice.count);
  }
  for (int i = 0; i < choice.count; ++i) {
    const std::int32_t to = choice.cells[i];
    const int there = now_at_[to];
    if (next_at_[to] != kNobody || (there != kNobody && there != robot && (*next_)[there] == here)) {
      continue;
    }
    next_at_[to] = robot;
    (*next_)[robot] = to;
    if (there != kNobody && there != robot && (*next_)[there] == kNoCell && !plan(there)) {
      continue;  // `there` stays in `to`, and has taken it
    }
    if (i == 0 && partner != kNobody && (*next_)[partner] == kNoCell && next_at_[here] == kNobody) {
      (*next_)[partner] = here;
      next_at_[here] = partner;
    }
    return true;
  }
  next_at_[here] = robot;
  (*next_)[robot] = here;
  return false;
}

// The cells that `robot` can go to, the nearest to its goal first, in random order where they are equally near.
Pibt::Choice Pibt::choices_of(int robot) {
  const std::int32_t here = (*from_)[robot];
  Choice choice{};
  std::uint64_t keys[5];
  const auto add = [&](std::int32_t cell) {
    const std::uint64_t key =
        (static_cast<std::uint64_t>(distances_[robot][cell]) << 32) | ((*generator_)() & 0xFFFFFFFFU);
    int place = choice.count++;
    for (; place > 0 && keys[place - 1] > key; --place) {
      keys[place] = keys[place - 1];
      choice.cells[place] = choice.cells[place - 1];
    }
    keys[place] = key;
    choice.cells[place] = cell;
  };
  for (const int move : grid_.moves()) {
    if (!grid_.blocked(here + move)) {
      add(here + move);
    }
  }
  add(here);
  return choice;
}

// The robot with which `robot` has to change places, by way of a branch, and can; kNobody if there is none.
int Pibt::partner_of(int robot, const Choice& choice) const {
  const std::int32_t here = (*from_)[robot], ahead = choice.cells[0];
  if (ahead == here) {
    return kNobody;
  }
  const int other = now_at_[ahead];
  if (other != kNobody && (*next_)[other] == kNoCell && must_swap(robot, other, here, ahead) &&
      can_swap(ahead, here)) {
    return other;
  }
  // A robot behind that needs this one out of its way, when this one would enter a corridor before it.
  for (const int move : grid_.moves()) {
    const int behind = grid_.blocked(here + move) ? kNobody : now_at_[here + move];
    if (behind != kNobody && here + move != ahead && must_swap(behind, robot, here, ahead) &&
        can_swap(ahead, here)) {
      return behind;
    }
  }
  return kNobody;
}

// Whether `pusher`, on its way, pushes `puller` along a corridor until they would have to pass each other.
bool Pibt::must_swap(int pusher, int puller, int pusher_cell, int puller_cell) const {
  const auto& to_goal = distances_[pusher];
  while (to_goal[puller_cell] < to_goal[pusher_cell]) {
    int way = -1;
    const int ways = ways_on(puller_cell, pusher_cell, way);
    if (ways >= 2) {
      return false;
    }
    if (ways <= 0) {
      break;
    }
    pusher_cell = puller_cell;
    puller_cell = way;
  }
  const auto& other = distances_[puller];
  return other[pusher_cell] < other[puller_cell] &&
         (to_goal[pusher_cell] == 0 || to_goal[puller_cell] < to_goal[pusher_cell]);
}

// Whether pulling along the corridor leads to a branch.
bool Pibt::can_swap(int pusher_cell, int puller_cell) const {
  const int origin = pusher_cell;
  while (puller_cell != origin) {
    int way = -1;
    const int ways = ways_on(puller_cell, pusher_cell, way);
    if (ways >= 2) {
      return true;
    }
    if (ways <= 0) {
      return false;
    }
    pusher_cell = puller_cell;
    puller_cell = way;
  }
  return false;
}

// How many neighbours of `cell` lead on, other than `without`; dead ends where a robot is on its goal do not. `way` is
// one of them.
int Pibt::ways_on(int cell, int without, int& way) const {
  int ways = 0;
  for (const int move : grid_.moves()) {
    const int next = cell + move;
    if (grid_.blocked(next) || next == without) {
      continue;
    }
    const int robot = now_at_[next];
    if (robot != kNobody && goals_[robot] == next && degree(next) == 1) {
      continue;
    }
    ++ways;
    way = next;
  }
  return ways;
}

int Pibt::degree(int cell) const {
  int free = 0;
  for (const int move : grid_.moves()) {
    free += grid_.blocked(cell + move) ? 0 : 1;
  }
  return free;
}

}  // namespace magat_expert
