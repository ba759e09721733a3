// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <utility>
#include <vector>

namespace magat_expert {

constexpr int kNever = std::numeric_limits<int>::max();

/// Cells by time step, from the start at time 0 to the arrival; the robot rests on the last one for ever. A view: a
/// PathStore owns the cells.
struct Path {
  const std::int32_t* cells = nullptr;
  int length = 0;

  std::int32_t operator[](int time) const { return cells[time]; }
  std::int32_t back() const { return cells[length - 1]; }
  int arrival() const { return length - 1; }
  bool empty() const { return length == 0; }
};

/// A position or move that one robot must avoid. `from` < 0: stand on `to` at `time`. Otherwise: move from `from` to
/// `to`, arriving at `time`.
struct Constraint {
  int time = 0;
  int from = -1;
  int to = -1;
};

/// Two robots in one cell at `time` (`swap` false), or exchanging their cells on the step that ends at `time`.
struct Conflict {
  int time = 0;
  int first = -1;
  int second = -1;
  bool swap = false;
  bool found() const { return first >= 0; }
};

/// floor(w * cost), exact. Both levels of the search compare integers with it. A rounded product could accept each
/// robot's path but not their sum, and then the focal list of the constraint tree would be empty.
class Bound {
 public:
  explicit Bound(double w) : numerator_(static_cast<std::uint64_t>(std::ldexp(w, kShift))) {}
  std::int64_t operator()(std::int64_t cost) const {
    return static_cast<std::int64_t>((static_cast<Wide>(numerator_) * static_cast<Wide>(cost)) >> kShift);
  }

 private:
  // A double in [1, 2) has 52 fractional bits, a larger one fewer, so the conversion is exact.
  static constexpr int kShift = 52;
  __extension__ using Wide = unsigned __int128;
  std::uint64_t numerator_;
};

enum class Halt { kNone, kTimeLimit, kStopped };

/// Tells the search when to end. `poll` is called about ten times a second and ends the search by returning true.
class Watch {
 public:
  Watch(double seconds, const std::atomic<bool>* stop, std::function<bool()> poll)
      : start_(Clock::now()), seconds_(seconds), stop_(stop), poll_(std::move(poll)) {}

  double elapsed() const { return std::chrono::duration<double>(Clock::now() - start_).count(); }

  /// True from the moment the search has to end. It reads the clock, so do not call it in every expansion.
  bool expired() {
    if (halt_ != Halt::kNone) {
      return true;
    }
    const double now = elapsed();
    if (now >= seconds_) {
      halt_ = Halt::kTimeLimit;
    } else if (stop_ != nullptr && stop_->load(std::memory_order_relaxed)) {
      halt_ = Halt::kStopped;
    } else if (poll_ && now >= next_poll_) {
      next_poll_ = now + 0.1;
      if (poll_()) {
        halt_ = Halt::kStopped;
      }
    }
    return halt_ != Halt::kNone;
  }

  Halt halt() const { return halt_; }

 private:
  using Clock = std::chrono::steady_clock;
  Clock::time_point start_;
  double seconds_;
  double next_poll_ = 0.1;
  const std::atomic<bool>* stop_;
  std::function<bool()> poll_;
  Halt halt_ = Halt::kNone;
};

}  // namespace magat_expert
