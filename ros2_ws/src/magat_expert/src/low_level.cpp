// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

#include "low_level.hpp"

#include <algorithm>

namespace magat_expert {

namespace {

// The focal list takes paths of at most this many steps over the lower bound, even if w would allow longer ones. A
// detour around other robots takes a few steps, however long the path is. Without this cap, a search on a large map
// with w = 5 expands all paths up to five times the shortest before it accepts a first conflict (measured on 200x200
// cells with 500 robots: 12 times slower, and costlier paths). A tighter focal list does not violate the bound.
constexpr int kFocalSlack = 10;

}  // namespace

LowLevel::LowLevel(const Grid& grid, Bound bound, Watch& watch)
    : grid_(grid),
      bound_(bound),
      watch_(watch),
      nodes_(grid.memory()),
      path_(grid.memory()),
      focal_(grid.memory()),
      open_by_f_(grid.memory()),
      waiting_(grid.memory()),
      visits_from_(grid.memory()),
      constraints_(grid.memory()),
      constraints_begin_(grid.memory()),
      node_at_(grid.memory()) {}

LowLevel::Result LowLevel::search(int start, int goal, const std::pmr::vector<std::int32_t>& distance,
                                  const std::pmr::vector<Constraint>& constraints, const PathTable& others) {
  Result result;
  distance_ = &distance;
  prepare(goal, constraints, others, distance[start]);
  generate(start, 0, -1, 0);
  while (open_nodes_ > 0) {
    raise_lower_bound();
    const FocalEntry best = focal_.front();
    std::pop_heap(focal_.begin(), focal_.end());
    focal_.pop_back();
    const Node& node = nodes_[best.node];
    if (node.closed || best.key != focal_key(node)) {
      continue;  // a better way to this node was found after the entry was made
    }
    if (arrived(node.cell, node.time)) {
      result.outcome = Outcome::kFound;
      result.path = path_to(best.node);
      result.lower_bound = lower_bound_;
      return result;
    }
    ++expansions_;
    if (expansions_ % 256 == 0 && watch_.expired()) {
      result.outcome = Outcome::kHalted;
      return result;
    }
    expand(best.node, others);
  }
  return result;
}

void LowLevel::prepare(int goal, const std::pmr::vector<Constraint>& constraints, const PathTable& others,
                       int start_distance) {
  goal_ = goal;
  nodes_.clear();
  node_at_.clear();
  focal_.clear();
  std::fill(open_by_f_.begin(), open_by_f_.end(), 0);
  for (auto& bucket : waiting_) {
    bucket.clear();
  }
  open_nodes_ = 0;

  constraints_ = constraints;
  std::sort(constraints_.begin(), constraints_.end(),
            [](const Constraint& a, const Constraint& b) { return a.time < b.time; });
  const int last_constraint = constraints_.empty() ? 0 : constraints_.back().time;
  earliest_arrival_ = 0;
  constraints_begin_.assign(last_constraint + 2, 0);
  for (const Constraint& constraint : constraints_) {
    ++constraints_begin_[constraint.time + 1];
    if (constraint.from < 0 && constraint.to == goal) {
      earliest_arrival_ = constraint.time + 1;
    }
  }
  for (int time = 1; time < last_constraint + 2; ++time) {
    constraints_begin_[time] += constraints_begin_[time - 1];
  }

  // After the last constraint, and once all others rest, nothing changes any more. From then on, a path that visits a
  // cell twice can be shortened without a new conflict, so one step for each free cell is enough.
  horizon_ = std::max(last_constraint, others.layers()) + grid_.free_cells();

  visits_from_.assign(others.layers() + 1, 0);
  for (int time = others.layers() - 1; time >= 0; --time) {
    visits_from_[time] = visits_from_[time + 1] + others.visitors(goal, time);
  }

  lower_bound_ = std::max(start_distance, earliest_arrival_);
  focal_limit_ = focal_limit(lower_bound_);
}

std::int64_t LowLevel::focal_limit(int lower_bound) const {
  return std::min<std::int64_t>(bound_(lower_bound), lower_bound + kFocalSlack);
}

bool LowLevel::allowed(int from, int to, int time) const {
  if (time + 1 >= static_cast<int>(constraints_begin_.size())) {
    return true;
  }
  for (int i = constraints_begin_[time]; i < constraints_begin_[time + 1]; ++i) {
    if (constraints_[i].to == to && (constraints_[i].from < 0 || constraints_[i].from == from)) {
      return false;
    }
  }
  return true;
}

void LowLevel::generate(int cell, int time, int parent, int conflicts) {
  if (arrived(cell, time) && time + 1 < static_cast<int>(visits_from_.size())) {
    conflicts += visits_from_[time + 1];  // later visitors collide with the robot at rest
  }
  std::int32_t& entry = node_at_.at(cell, time);
  if (entry != node_at_.kNone) {
    Node& known = nodes_[entry];
    if (!known.closed && conflicts < known.conflicts) {
      known.conflicts = conflicts;
      known.parent = parent;
      if (known.f <= focal_limit_) {
        push_focal(entry);
      }
    }
    return;
  }
  entry = static_cast<std::int32_t>(nodes_.size());
  const int f = std::max(time + (*distance_)[cell], earliest_arrival_);
  nodes_.push_back({cell, time, f, parent, conflicts, false});
  enqueue(entry);
}

void LowLevel::enqueue(int index) {
  const int f = nodes_[index].f;
  if (f >= static_cast<int>(open_by_f_.size())) {
    open_by_f_.resize(f + 1, 0);
    waiting_.resize(f + 1);
  }
  ++open_by_f_[f];
  ++open_nodes_;
  if (f <= focal_limit_) {
    push_focal(index);
  } else {
    waiting_[f].push_back(index);
  }
}

std::uint64_t LowLevel::focal_key(const Node& node) {
  // Fewest conflicts, then smallest f, then the deepest node. f and time stay far below 2^20.
  constexpr std::uint64_t kMask = (1u << 20) - 1;
  return static_cast<std::uint64_t>(node.conflicts) << 40 | static_cast<std::uint64_t>(node.f) << 20 |
         (kMask - static_cast<std::uint64_t>(node.time));
}

void LowLevel::push_focal(int index) {
  focal_.push_back({focal_key(nodes_[index]), index});
  std::push_heap(focal_.begin(), focal_.end());
}

// f never decreases along a path (the distance is consistent), so the smallest f in OPEN never decreases either.
void LowLevel::raise_lower_bound() {
  if (open_by_f_[lower_bound_] > 0) {
    return;
  }
  while (open_by_f_[lower_bound_] == 0) {
    ++lower_bound_;
  }
  const std::int64_t old_limit = focal_limit_;
  focal_limit_ = focal_limit(lower_bound_);
  const std::int64_t last = std::min<std::int64_t>(focal_limit_, static_cast<std::int64_t>(waiting_.size()) - 1);
  for (std::int64_t f = old_limit + 1; f <= last; ++f) {
    for (const std::int32_t index : waiting_[f]) {
      push_focal(index);
    }
    waiting_[f].clear();
  }
}

void LowLevel::expand(int index, const PathTable& others) {
  nodes_[index].closed = true;
  --open_by_f_[nodes_[index].f];
  --open_nodes_;
  const int here = nodes_[index].cell;
  const int conflicts = nodes_[index].conflicts;
  const int time = nodes_[index].time + 1;
  if (time > horizon_) {
    return;
  }
  const auto step = [&](int next) {
    if ((*distance_)[next] >= 0 && allowed(here, next, time)) {
      generate(next, time, index, conflicts + others.step_conflicts(here, next, time));
    }
  };
  for (const int move : grid_.moves()) {
    step(here + move);
  }
  step(here);
}

Path LowLevel::path_to(int index) {
  path_.resize(nodes_[index].time + 1);
  for (int node = index; node >= 0; node = nodes_[node].parent) {
    path_[nodes_[node].time] = nodes_[node].cell;
  }
  return {path_.data(), static_cast<int>(path_.size())};
}

}  // namespace magat_expert
