# All common tasks are make targets. Those that need the set-up run `make setup` first.

SHELL := /bin/bash
# The Python that creates .venv; once .venv exists, the Python that created it.
PYTHON ?= $(or $(realpath .venv/bin/python),python3)
BIN := .venv/bin
SOURCE_WORKSPACE := source ros2_ws/install/setup.bash

.DEFAULT_GOAL := help

.PHONY: help
help: ## Show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-14s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

.PHONY: setup
setup: ## Install what teams need into .venv, and build the workspace; does nothing if both are up to date
	@$(PYTHON) tools/set_up.py team

.PHONY: setup-train
setup-train: ## The same, and what training needs
	@$(PYTHON) tools/set_up.py train

.PHONY: setup-dev
setup-dev: ## The same, and what tests, lint and documentation need
	@$(PYTHON) tools/set_up.py dev

.PHONY: demo
demo: setup ## Run ten episodes with a team of robot processes (ARGS="--robots 20" changes the team)
	@$(BIN)/magat run --episodes 10 --require 8 $(ARGS)
	@echo "To watch a team in a browser: make demo ARGS='--view --episodes 1000'. To pause and rewind, record a team by"
	@echo "make demo ARGS='--record --output runs/watched', and show it by .venv/bin/magat view runs/watched/bag"

.PHONY: test
test: setup-dev ## Run the tests (ARGS="-k shield" passes options to pytest)
	@$(SOURCE_WORKSPACE) && $(BIN)/python -m pytest $(ARGS)

.PHONY: test-system
test-system: setup-dev ## Run all tests with real processes, including the slow ones and those that inject faults
	@$(SOURCE_WORKSPACE) && $(BIN)/python -m pytest -m "system or faults" $(ARGS)

.PHONY: test-sanitizers
test-sanitizers: setup-dev ## Run the tests of the expert with its C++ checked by AddressSanitizer and UBSan
	@$(SOURCE_WORKSPACE) && tests/expert/sanitized.sh $(ARGS)

.PHONY: bench-expert
bench-expert: setup ## Time the expert on the scenario sets (ARGS="--large" adds the large ones)
	@$(BIN)/magat bench-expert $(ARGS)

.PHONY: frontier
frontier: setup ## Measure success against flowtime over temperatures, into docs/ (ARGS="--policy NAME" selects one)
	@$(BIN)/magat frontier --output docs $(ARGS)

.PHONY: results
results: setup ## Measure what docs/results.md lacks, and write it with its pictures (ARGS="--policy NAME" selects)
	@$(BIN)/magat results $(ARGS)

.PHONY: bench-sim
bench-sim: setup-train ## Measure the speed of the batched simulator, part by part (ARGS="--policy NAME" selects)
	@$(BIN)/magat bench-sim $(ARGS)

.PHONY: bench-training
bench-training: setup-train ## Measure the speed of training, part by part
	@$(BIN)/magat bench-training $(ARGS)

.PHONY: bench-runtime
bench-runtime: setup-train ## Measure the speed of teams, by radio and processes (ARGS="--teams 10x1" selects)
	@$(BIN)/magat bench-runtime $(ARGS)

.PHONY: bench-view
bench-view: setup ## Measure the speed of the page and the load of its server, at 10, 200 and 1,000 robots
	@$(BIN)/magat bench-view $(ARGS)

.PHONY: lint
lint: setup-dev ## Check style, format and types
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy

.PHONY: format
format: setup-dev ## Format the Python code
	@$(BIN)/ruff check --fix-only .
	@$(BIN)/ruff format .

.PHONY: docs
docs: setup-dev ## Build the documentation as a site, into site/; warnings are errors
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

.PHONY: clean
clean: ## Remove the output of the build and of the tools, but not .venv
	rm -rf ros2_ws/build ros2_ws/install ros2_ws/log site .mypy_cache .pytest_cache .ruff_cache .hypothesis
