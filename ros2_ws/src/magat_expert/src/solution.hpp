// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include <cstdint>
#include <vector>

namespace magat_expert {

struct Solution {
  enum class Status { kSolved, kNoSolution, kTimedOut, kNodeLimit, kStopped, kIncomplete };
  Status status = Status::kNoSolution;
  std::vector<std::vector<std::int32_t>> paths;  // [robot][time], up to the arrival; empty if there are none
  std::int64_t cost = 0;                         // 0 unless solved
  std::int64_t lower_bound = 0;
  std::int64_t high_level_expansions = 0;
  std::int64_t low_level_expansions = 0;
};

}  // namespace magat_expert
