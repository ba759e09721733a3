#pragma once

#include <cstdint>
#include <vector>

#include "grid.hpp"
#include "solution.hpp"
#include "types.hpp"

namespace magat_expert {

/// The baseline "Replan" (global re-planning, Wang et al. 2020): nobody plans around the future of others.
///
/// Each robot follows a shortest path. Robots decide on their steps one after another, in a random order, anew in each
/// time step. Where a step meets a conflict, the robot plans anew around the cells of all other robots, and waits if
/// there is no such path. Nobody moves off a goal. Goals are unique, starts are unique.
class Replan {
 public:
  Replan(const Grid& grid, std::vector<int> starts, std::vector<int> goals, Watch& watch);

  /// Ends when all are on their goals, when nobody can move any more, or after `max_steps` (< 0: 3 times the longest of
  /// the shortest paths). What was walked until then is in the solution whatever its status.
  Solution solve(std::int64_t max_steps, std::uint64_t seed);

 private:
  enum class Outcome { kFound, kNoPath, kHalted };
  struct Entry {
    std::int32_t f;
    std::int32_t steps;
    std::int32_t cell;
    // std::push_heap keeps the largest on top: the smallest f, then the deepest, then the lowest cell.
    bool operator<(const Entry& other) const {
      if (f != other.f) {
        return f > other.f;
      }
      return steps != other.steps ? steps < other.steps : cell > other.cell;
    }
  };

  bool step(const std::vector<int>& order, bool& moved);
  bool decide(int robot, int& next);
  bool taken(int cell) const;
  bool in_the_way(int robot, int cell) const;
  Outcome search(int robot);
  bool all_arrived() const { return at_ == goals_; }
  void finish(Solution& solution) const;

  const Grid& grid_;
  std::vector<int> starts_;
  std::vector<int> goals_;
  Watch& watch_;
  std::vector<std::vector<std::int32_t>> distances_;  // [robot][cell]
  std::vector<std::vector<std::int32_t>> plans_;      // [robot]: the cells to come, the next one last
  std::vector<std::vector<std::int32_t>> walked_;     // [robot][time]
  std::vector<int> at_;                               // [robot]: its cell
  std::vector<std::int32_t> robot_at_;                // [cell], -1: nobody
  std::int64_t replans_ = 0;
  std::int64_t expansions_ = 0;

  // Of the time step under way: a number in these is the step that it is valid in.
  int step_ = 0;
  std::vector<int> decided_;  // [robot]
  std::vector<int> claimed_;  // [cell]: somebody will be here after the step

  // Of A*: entries of another search do not count.
  int search_ = 0;
  std::vector<int> seen_in_;
  std::vector<std::int32_t> steps_to_;
  std::vector<std::int32_t> came_from_;
  std::vector<Entry> open_;
};

}  // namespace magat_expert
