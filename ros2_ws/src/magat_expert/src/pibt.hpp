// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include <cstdint>
#include <memory_resource>
#include <random>
#include <vector>

#include "grid.hpp"

namespace magat_expert {

/// The cells of all robots at one time, by robot.
using Configuration = std::pmr::vector<std::int32_t>;
/// [robot][cell], of `Grid::distances_to`.
using Distances = std::pmr::vector<std::pmr::vector<std::int32_t>>;

/// Priority inheritance with backtracking: one step of all robots, by their distances to their goals.
///
/// Okumura, Machida, Defago, Tamura, AIJ 2022, with the swap operation of Okumura, "Improving LaCAM for Scalable
/// Eventually Optimal Multi-Agent Pathfinding", IJCAI 2023, Sec. 4: two robots that block each other in a corridor move
/// on to a branch where they can pass.
class Pibt {
 public:
  /// `goals` and `distances` must outlive this object.
  Pibt(const Grid& grid, const std::vector<int>& goals, const Distances& distances);

  /// The next configuration after `from`; false if there is none that keeps to `fixed`.
  ///
  /// `order` holds all robots, the most important first. `fixed` holds the next cell of each robot that is not free to
  /// choose, kNoCell for the others; these cells are next to the robots' own.
  bool step(const Configuration& from, const std::pmr::vector<int>& order, const Configuration& fixed,
            std::mt19937_64& generator, Configuration& next);

  static constexpr std::int32_t kNoCell = -1;

 private:
  static constexpr int kNobody = -1;
  struct Choice {
    std::int32_t cells[5];
    int count;
  };

  bool plan(int robot);
  Choice choices_of(int robot);
  int partner_of(int robot, const Choice& choice) const;
  bool must_swap(int pusher, int puller, int pusher_cell, int puller_cell) const;
  bool can_swap(int pusher_cell, int puller_cell) const;
  int ways_on(int cell, int without, int& way) const;
  int degree(int cell) const;

  const Grid& grid_;
  const std::vector<int>& goals_;
  const Distances& distances_;
  std::pmr::vector<int> now_at_;   // [cell], robot or kNobody
  std::pmr::vector<int> next_at_;  // [cell]
  const Configuration* from_ = nullptr;
  Configuration* next_ = nullptr;
  std::mt19937_64* generator_ = nullptr;
};

}  // namespace magat_expert
