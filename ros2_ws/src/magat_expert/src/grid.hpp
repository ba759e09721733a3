// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include <array>
#include <cstdint>
#include <memory_resource>
#include <vector>

namespace magat_expert {

/// A 4-connected grid with a wall of one cell around it, so that a neighbour of a free cell is always a valid index
/// and no search has to test for the border. A cell is an index into the padded map.
class Grid {
 public:
  /// `obstacles` holds width * height bytes, row y first; anything but 0 is an obstacle. All that a search stores comes
  /// from `memory`.
  Grid(const std::uint8_t* obstacles, int width, int height, std::pmr::memory_resource* memory);

  std::pmr::memory_resource* memory() const { return blocked_.get_allocator().resource(); }

  int cells() const { return static_cast<int>(blocked_.size()); }
  int free_cells() const { return free_cells_; }
  int cell(int x, int y) const { return (y + 1) * stride_ + x + 1; }
  int x(int cell) const { return cell % stride_ - 1; }
  int y(int cell) const { return cell / stride_ - 1; }
  bool blocked(int cell) const { return blocked_[cell] != 0; }

  /// Index offsets of the moves UP, DOWN, LEFT, RIGHT.
  const std::array<int, 4>& moves() const { return moves_; }

  /// Steps from every cell to `goal`, robots ignored; negative where there is no way, and on obstacles.
  std::pmr::vector<std::int32_t> distances_to(int goal) const;

  /// Connected components of the free cells: a label from 0 for each free cell, -1 for an obstacle.
  std::pmr::vector<std::int32_t> components() const;

 private:
  int stride_;
  int free_cells_ = 0;
  std::pmr::vector<std::uint8_t> blocked_;
  std::array<int, 4> moves_;
};

}  // namespace magat_expert
