// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include <cstdint>
#include <memory_resource>
#include <vector>

namespace magat_expert {

/// The outcome of a search. The order of the statuses is that of SolveStatus in magat_expert/solver.py.
struct Solution {
  enum class Status { kSolved, kNoSolution, kTimedOut, kNodeLimit, kStopped, kIncomplete, kMemoryLimit };

  explicit Solution(std::pmr::memory_resource* memory = std::pmr::get_default_resource()) : paths(memory) {}

  Status status = Status::kNoSolution;
  std::pmr::vector<std::pmr::vector<std::int32_t>> paths;  // [robot][time], up to the arrival; empty if none
  std::int64_t cost = 0;                                   // 0 unless solved
  std::int64_t lower_bound = 0;
  std::int64_t high_level_expansions = 0;
  std::int64_t low_level_expansions = 0;
};

}  // namespace magat_expert
