# Everything goes through `make`: `make setup` once, and the rest from any state of the checkout.

SHELL := /bin/bash
# The Python to make .venv with; once that is there, the one that it was made with.
PYTHON ?= $(or $(realpath .venv/bin/python),python3)
BIN := .venv/bin
SOURCE_WORKSPACE := source ros2_ws/install/setup.bash

.DEFAULT_GOAL := help

.PHONY: help
help: ## Show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-12s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

.PHONY: setup
setup: ## Install what is needed into .venv and build the workspace; does nothing where that is done
	@$(PYTHON) tools/setup.py

.PHONY: demo
demo: setup ## Run ten episodes with a team of robot processes (ARGS="--robots 20" changes it)
	@$(BIN)/magat run --episodes 10 --require 8 $(ARGS)
	@echo "To watch a team in a browser: make demo ARGS='--view --episodes 1000'. To pause it and go back and forth: record"
	@echo "one by make demo ARGS='--record --output runs/watched', and then .venv/bin/magat view runs/watched/bag"

.PHONY: test
test: setup ## Run the tests (ARGS="-k shield" passes options on to pytest)
	@$(SOURCE_WORKSPACE) && $(BIN)/python -m pytest $(ARGS)

.PHONY: test-system
test-system: setup ## Run all tests with real processes, those that inject faults or take long, too
	@$(SOURCE_WORKSPACE) && $(BIN)/python -m pytest -m "system or faults" $(ARGS)

.PHONY: bench-expert
bench-expert: setup ## Time the expert on the scenario sets (ARGS="--large" adds the large ones)
	@$(BIN)/magat bench-expert $(ARGS)

.PHONY: frontier
frontier: setup ## Success against flowtime over temperatures, into docs/ (ARGS="--policy NAME" chooses one)
	@$(BIN)/magat frontier --output docs $(ARGS)

.PHONY: results
results: setup ## Measure what docs/results.md is missing, and write it with its pictures (ARGS="--policy NAME" chooses)
	@$(BIN)/magat results $(ARGS)

.PHONY: bench-sim
bench-sim: setup ## Steps a second of the batched simulator, and what takes how long (ARGS="--policy NAME" chooses)
	@$(BIN)/magat bench-sim $(ARGS)

.PHONY: bench-training
bench-training: setup ## Observations a second in training, and what takes how long
	@$(BIN)/magat bench-training $(ARGS)

.PHONY: bench-runtime
bench-runtime: setup ## How fast a team ticks, by radio and processes (ARGS="--teams 10x1" chooses)
	@$(BIN)/magat bench-runtime $(ARGS)

.PHONY: bench-view
bench-view: setup ## Frames a second of the page, and what its server takes, at 10, 200 and 1,000 robots
	@$(BIN)/magat bench-view $(ARGS)

.PHONY: lint
lint: setup ## Check style, format and types
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy

.PHONY: format
format: setup ## Put the Python code into the common format
	@$(BIN)/ruff check --fix-only .
	@$(BIN)/ruff format .

.PHONY: clean
clean: ## Remove what the build and the tools leave behind, but not .venv
	rm -rf ros2_ws/build ros2_ws/install ros2_ws/log .mypy_cache .pytest_cache .ruff_cache .hypothesis
