// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <memory>
#include <vector>

#include "ecbs.hpp"
#include "feasibility.hpp"
#include "grid.hpp"
#include "hca.hpp"
#include "replan.hpp"
#include "solution.hpp"
#include "types.hpp"

namespace py = pybind11;
using magat_expert::Ecbs;
using magat_expert::Grid;
using magat_expert::Hca;
using magat_expert::Replan;
using magat_expert::Solution;
using magat_expert::Watch;

namespace {

using Mask = py::array_t<std::uint8_t, py::array::c_style>;
using Cells = py::array_t<std::int32_t, py::array::c_style>;

struct StopFlag {
  std::atomic<bool> value{false};
};

Grid grid_of(const Mask& obstacles) {
  return Grid(obstacles.data(), static_cast<int>(obstacles.shape(1)), static_cast<int>(obstacles.shape(0)));
}

std::vector<int> cells_of(const Grid& grid, const Cells& cells) {
  std::vector<int> result;
  const auto view = cells.unchecked<2>();
  for (py::ssize_t i = 0; i < view.shape(0); ++i) {
    result.push_back(grid.cell(view(i, 0), view(i, 1)));
  }
  return result;
}

py::object paths_array(const Grid& grid, const std::vector<std::vector<std::int32_t>>& paths) {
  py::ssize_t steps = 1;
  for (const auto& path : paths) {
    steps = std::max(steps, static_cast<py::ssize_t>(path.size()));
  }
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

// Runs `search(grid, starts, goals, watch)` without Python's lock.
template <typename Search>
py::tuple run(const Mask& obstacles, const Cells& starts, const Cells& goals, double time_limit,
              const std::shared_ptr<StopFlag>& stop, Search search) {
  const Grid grid = grid_of(obstacles);
  const std::vector<int> start_cells = cells_of(grid, starts);
  const std::vector<int> goal_cells = cells_of(grid, goals);
  Watch watch(time_limit, stop ? &stop->value : nullptr, signal_raised);
  Solution solution;
  double seconds = 0.0;
  {
    py::gil_scoped_release release;
    if (magat_expert::proven_unsolvable(grid, start_cells, goal_cells)) {
      solution.status = Solution::Status::kNoSolution;
    } else {
      solution = search(grid, start_cells, goal_cells, watch);
    }
    seconds = watch.elapsed();
  }
  if (PyErr_Occurred() != nullptr) {
    throw py::error_already_set();
  }
  py::object paths = py::none();
  if (!solution.paths.empty()) {
    paths = paths_array(grid, solution.paths);
  }
  return py::make_tuple(static_cast<int>(solution.status), paths, solution.cost, solution.lower_bound, seconds,
                        solution.high_level_expansions, solution.low_level_expansions);
}

py::tuple solve(const Mask& obstacles, const Cells& starts, const Cells& goals, double w, double time_limit,
                std::int64_t node_limit, const std::shared_ptr<StopFlag>& stop) {
  return run(obstacles, starts, goals, time_limit, stop,
             [&](const Grid& grid, const std::vector<int>& from, const std::vector<int>& to, Watch& watch) {
               Ecbs ecbs(grid, from, to, w, watch);
               return ecbs.solve(node_limit);
             });
}

py::tuple solve_hca(const Mask& obstacles, const Cells& starts, const Cells& goals, double time_limit,
                    std::int64_t orders, std::uint64_t seed, const std::shared_ptr<StopFlag>& stop) {
  return run(obstacles, starts, goals, time_limit, stop,
             [&](const Grid& grid, const std::vector<int>& from, const std::vector<int>& to, Watch& watch) {
               Hca hca(grid, from, to, watch);
               return hca.solve(orders, seed);
             });
}

py::tuple solve_replan(const Mask& obstacles, const Cells& starts, const Cells& goals, double time_limit,
                       std::int64_t max_steps, std::uint64_t seed, const std::shared_ptr<StopFlag>& stop) {
  return run(obstacles, starts, goals, time_limit, stop,
             [&](const Grid& grid, const std::vector<int>& from, const std::vector<int>& to, Watch& watch) {
               Replan replan(grid, from, to, watch);
               return replan.solve(max_steps, seed);
             });
}

py::array_t<std::int32_t> components(const Mask& obstacles) {
  const Grid grid = grid_of(obstacles);
  const std::vector<std::int32_t> labels = grid.components();
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
        py::arg("time_limit"), py::arg("node_limit"), py::arg("stop"),
        "(status, paths or None, cost, lower_bound, seconds, high-level, low-level expansions); status is the place in "
        "SolveStatus.");
  m.def("solve_hca", &solve_hca, py::arg("obstacles"), py::arg("starts"), py::arg("goals"), py::arg("time_limit"),
        py::arg("orders"), py::arg("seed"), py::arg("stop"), "As solve; expansions: orders tried, space-time nodes.");
  m.def("solve_replan", &solve_replan, py::arg("obstacles"), py::arg("starts"), py::arg("goals"),
        py::arg("time_limit"), py::arg("max_steps"), py::arg("seed"), py::arg("stop"),
        "As solve, with paths even if not solved; expansions: plans made anew, nodes of A*.");
  m.def("components", &components, py::arg("obstacles"),
        "int32 [H, W]: the connected component of each free cell, from 0; -1 on obstacles.");
}
