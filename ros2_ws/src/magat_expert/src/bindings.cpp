// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <memory_resource>
#include <vector>

#include "ecbs.hpp"
#include "feasibility.hpp"
#include "grid.hpp"
#include "hca.hpp"
#include "lacam.hpp"
#include "memory.hpp"
#include "replan.hpp"
#include "solution.hpp"
#include "types.hpp"

namespace py = pybind11;
using magat_expert::Ecbs;
using magat_expert::Grid;
using magat_expert::Hca;
using magat_expert::Lacam;
using magat_expert::Memory;
using magat_expert::MemoryLimitReached;
using magat_expert::Replan;
using magat_expert::Solution;
using magat_expert::Watch;

namespace {

using Mask = py::array_t<std::uint8_t, py::array::c_style>;
using Cells = py::array_t<std::int32_t, py::array::c_style>;

struct StopFlag {
  std::atomic<bool> value{false};
};

Grid grid_of(const Mask& obstacles, std::pmr::memory_resource* memory) {
  return Grid(obstacles.data(), static_cast<int>(obstacles.shape(1)), static_cast<int>(obstacles.shape(0)), memory);
}

std::vector<int> cells_of(const Grid& grid, const Cells& cells) {
  std::vector<int> result;
  const auto view = cells.unchecked<2>();
  for (py::ssize_t i = 0; i < view.shape(0); ++i) {
    result.push_back(grid.cell(view(i, 0), view(i, 1)));
  }
  return result;
}

using Paths = std::pmr::vector<std::pmr::vector<std::int32_t>>;

// The time steps of `paths`, the start included.
py::ssize_t steps_of(const Paths& paths) {
  std::size_t steps = 1;
  for (const auto& path : paths) {
    steps = std::max(steps, path.size());
  }
  return static_cast<py::ssize_t>(steps);
}

py::object paths_array(const Grid& grid, const Paths& paths) {
  const py::ssize_t steps = steps_of(paths);
  const auto robots = static_cast<py::ssize_t>(paths.size());
  py::array_t<std::int16_t> array({steps, robots, static_cast<py::ssize_t>(2)});
  auto out = array.mutable_unchecked<3>();
  for (py::ssize_t robot = 0; robot < robots; ++robot) {
    const auto& path = paths[robot];
    for (py::ssize_t time = 0; time < steps; ++time) {
      const int cell = time < static_cast<py::ssize_t>(path.size()) ? path[time] : path.back();
      out(time, robot, 0) = static_cast<std::int16_t>(grid.x(cell));
      out(time, robot, 1) = static_cast<std::int16_t>(grid.y(cell));
    }
  }
  return std::move(array);
}

// Lets Ctrl-C end a search that runs in the main thread; in any other there is nothing to check.
bool signal_raised() {
  py::gil_scoped_acquire acquire;
  return PyErr_CheckSignals() != 0;
}

// Runs `search(grid, starts, goals, watch)` without Python's lock, with at most `memory_limit` bytes.
template <typename Search>
py::tuple run(const Mask& obstacles, const Cells& starts, const Cells& goals, double time_limit,
              std::size_t memory_limit, const std::shared_ptr<StopFlag>& stop, Search search) {
  Watch watch(time_limit, stop ? &stop->value : nullptr, signal_raised);
  Memory memory(memory_limit);
  Solution solution(&memory);
  py::object paths = py::none();
  double seconds = 0.0;
  try {
    const Grid grid = grid_of(obstacles, &memory);
    const std::vector<int> start_cells = cells_of(grid, starts);
    const std::vector<int> goal_cells = cells_of(grid, goals);
    {
      py::gil_scoped_release release;
      if (magat_expert::proven_unsolvable(grid, start_cells, goal_cells)) {
        solution.status = Solution::Status::kNoSolution;
      } else {
        solution = search(grid, start_cells, goal_cells, watch);
      }
      seconds = watch.elapsed();
    }
    if (!solution.paths.empty()) {
      memory.require(2 * sizeof(std::int16_t) * solution.paths.size() * steps_of(solution.paths));
      paths = paths_array(grid, solution.paths);
    }
  } catch (const MemoryLimitReached&) {
    solution.status = Solution::Status::kMemoryLimit;
    solution.cost = 0;
    seconds = watch.elapsed();
  }
  if (PyErr_Occurred() != nullptr) {
    throw py::error_already_set();
  }
  return py::make_tuple(static_cast<int>(solution.status), paths, solution.cost, solution.lower_bound, seconds,
                        solution.high_level_expansions, solution.low_level_expansions);
}

py::tuple solve(const Mask& obstacles, const Cells& starts, const Cells& goals, double w, double time_limit,
                std::int64_t node_limit, std::size_t memory_limit,
                const std::shared_ptr<StopFlag>& stop) {
  return run(obstacles, starts, goals, time_limit, memory_limit, stop,
             [&](const Grid& grid, const std::vector<int>& from, const std::vector<int>& to, Watch& watch) {
               Ecbs ecbs(grid, from, to, w, watch);
               return ecbs.solve(node_limit);
             });
}

py::tuple solve_hca(const Mask& obstacles, const Cells& starts, const Cells& goals, double time_limit,
                    std::int64_t orders, std::uint64_t seed, std::size_t memory_limit,
                    const std::shared_ptr<StopFlag>& stop) {
  return run(obstacles, starts, goals, time_limit, memory_limit, stop,
             [&](const Grid& grid, const std::vector<int>& from, const std::vector<int>& to, Watch& watch) {
               Hca hca(grid, from, to, watch);
               return hca.solve(orders, seed);
             });
}

py::tuple solve_replan(const Mask& obstacles, const Cells& starts, const Cells& goals, double time_limit,
                       std::int64_t max_steps, std::uint64_t seed, std::size_t memory_limit,
                    const std::shared_ptr<StopFlag>& stop) {
  return run(obstacles, starts, goals, time_limit, memory_limit, stop,
             [&](const Grid& grid, const std::vector<int>& from, const std::vector<int>& to, Watch& watch) {
               Replan replan(grid, from, to, watch);
               return replan.solve(max_steps, seed);
             });
}

py::tuple solve_lacam(const Mask& obstacles, const Cells& starts, const Cells& goals, double time_limit,
                      std::int64_t node_limit, std::uint64_t seed, std::size_t memory_limit,
                      const std::shared_ptr<StopFlag>& stop) {
  return run(obstacles, starts, goals, time_limit, memory_limit, stop,
             [&](const Grid& grid, const std::vector<int>& from, const std::vector<int>& to, Watch& watch) {
               Lacam lacam(grid, from, to, watch);
               return lacam.solve(node_limit, seed);
             });
}

py::array_t<std::int32_t> components(const Mask& obstacles) {
  const Grid grid = grid_of(obstacles, std::pmr::get_default_resource());
  const std::pmr::vector<std::int32_t> labels = grid.components();
  py::array_t<std::int32_t> array({obstacles.shape(0), obstacles.shape(1)});
  auto out = array.mutable_unchecked<2>();
  for (py::ssize_t y = 0; y < out.shape(0); ++y) {
    for (py::ssize_t x = 0; x < out.shape(1); ++x) {
      out(y, x) = labels[grid.cell(static_cast<int>(x), static_cast<int>(y))];
    }
  }
  return array;
}

}  // namespace

PYBIND11_MODULE(_core, m) {
  m.doc() = "The compiled half of magat_expert. It trusts its arguments: call it through magat_expert.solver.";
  py::class_<StopFlag, std::shared_ptr<StopFlag>>(m, "StopFlag", "Ends, from any thread, the searches that hold it.")
      .def(py::init<>())
      .def("set", [](StopFlag& flag) { flag.value = true; }, "Ends them within a few milliseconds.")
      .def("is_set", [](const StopFlag& flag) { return flag.value.load(); });
  m.def("solve", &solve, py::arg("obstacles"), py::arg("starts"), py::arg("goals"), py::arg("w"),
        py::arg("time_limit"), py::arg("node_limit"), py::arg("memory_limit"), py::arg("stop"),
        "(status, paths or None, cost, lower_bound, seconds, high-level, low-level expansions); status is the place in "
        "SolveStatus.");
  m.def("solve_hca", &solve_hca, py::arg("obstacles"), py::arg("starts"), py::arg("goals"), py::arg("time_limit"),
        py::arg("orders"), py::arg("seed"), py::arg("memory_limit"), py::arg("stop"),
        "As solve; expansions: orders tried, space-time nodes.");
  m.def("solve_replan", &solve_replan, py::arg("obstacles"), py::arg("starts"), py::arg("goals"),
        py::arg("time_limit"), py::arg("max_steps"), py::arg("seed"), py::arg("memory_limit"), py::arg("stop"),
        "As solve, with paths even if not solved; expansions: plans made anew, nodes of A*.");
  m.def("solve_lacam", &solve_lacam, py::arg("obstacles"), py::arg("starts"), py::arg("goals"), py::arg("time_limit"),
        py::arg("node_limit"), py::arg("seed"), py::arg("memory_limit"), py::arg("stop"),
        "As solve; expansions: configurations expanded, 0.");
  m.def("components", &components, py::arg("obstacles"),
        "int32 [H, W]: the connected component of each free cell, from 0; -1 on obstacles.");
}
