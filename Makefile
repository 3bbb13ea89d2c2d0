# islandgp: `make run` and `make test` set up everything they need.
.DEFAULT_GOAL := help
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.ready
# Python keeps what it has compiled: without it each process of the tests takes seconds longer.
unexport PYTHONDONTWRITEBYTECODE

help:            ## list the targets
	@sed -nE 's/^([a-z-]+):.*## *(.*)/\1|\2/p' $(MAKEFILE_LIST) | awk -F'|' '{printf "  make %-14s %s\n", $$1, $$2}'

PLUGINS := $(patsubst %/pyproject.toml,%,$(wildcard plugins/*/pyproject.toml))

$(STAMP): pyproject.toml constraints.txt $(PLUGINS:%=%/pyproject.toml)
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev]' $(PLUGINS:%=-e ./%) \
	  -c constraints.txt
	@$(BIN)/islandgp play grammar/examples/poor.bt --seeds 1 >$(VENV)/first_episode # compiles the island, once
	@touch $@

setup: $(STAMP)  ## make the virtual environment in .venv

run: $(STAMP)    ## evolve trees with the default experiment: offline, no key
	$(BIN)/python -m islandgp $(ARGS)

lint: $(STAMP)   ## ruff and mypy
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

UNIT := 'not slow and not process and not packaging'
# worksteal keeps the tests of a module in one process, which makes their fixtures once. One process
# more than there are cores, as some tests wait.
PYTEST := $(BIN)/python -m pytest -n $$(( $$(nproc) + 1 )) --dist worksteal

test: lint      ## lint, types and the tests of a change
	$(PYTEST) -m 'not slow' --durations 10

test-unit: $(STAMP) ## the tests that start no process
	$(PYTEST) -m $(UNIT)

test-process: $(STAMP) ## the tests with processes, a browser, MLflow
	$(PYTEST) -m 'process and not slow and not packaging'

test-packaging: $(STAMP) ## the tests of the wheel
	$(PYTEST) -m 'packaging and not slow'

test-slow: $(STAMP) ## nightly: long and exhaustive tests, and more examples for all others
	$(PYTEST) --timeout 3600 -m slow
	$(PYTEST) --timeout 3600 --hypothesis-profile nightly -m $(UNIT)

lines: $(STAMP)  ## lines of code by folder, without comments and docstrings
	$(BIN)/python -m tests.architecture.code_lines

coverage: $(STAMP) ## lines and branches that the unit tests reach
	$(PYTEST) -m $(UNIT) --cov

mutants: $(STAMP) ## which changes of the package the unit tests notice
	$(BIN)/python -m tests.mutants $(ARGS)

INPUTS := 50000
fuzz: $(STAMP)   ## hostile input for all readers: INPUTS=50000 SEED=0
	$(BIN)/python -m tests.fuzz --inputs $(INPUTS) --seed $(or $(SEED),0)

btcpp: $(STAMP)  ## build BehaviorTree.CPP in build/, for the tests of exports
	$(BIN)/python tests/trees/btcpp/build_btcpp.py

axe:             ## axe-core in build/axe, for a slow test of the replay page
	npm install --silent --no-audit --no-fund --prefix build/axe axe-core@4.14.1

vscode:          ## pack the extension for VS Code: build/islandgp-bt.vsix
	$(PYTHON) plugins/editor/pack.py

vscode-tools:    ## VS Code's packer and its engine for grammars in build/vscode, for slow tests
	npm install --silent --no-audit --no-fund --prefix build/vscode @vscode/vsce@3.9.2 \
	  vscode-textmate@9.3.2 vscode-oniguruma@2.0.1

bench: $(STAMP)  ## the benchmarks, with goals beside figures
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[bench]' -c constraints.txt
	$(BIN)/python -m benchmarks

torture: $(STAMP) ## faults, determinism and long load, into docs/reliability.md; half an hour
	$(BIN)/python -m tests.torture $(ARGS)

demo-llm: $(STAMP) ## supervision by a language model, with a mock in its place: no key
	$(BIN)/python -m tests.llm.demo

study: $(STAMP)  ## baseline against expert, 30 paired seeds, into studies/paper/results; resumable
	sh studies/paper/run.sh $(BIN)

ablations: $(STAMP) ## what of the expert helps: its rate, its trees, their choice; takes the study's runs
	sh studies/controls/run.sh $(BIN)

study-editors: $(STAMP) ## the editor and its controls (the seventh study), into studies/editors/results; resumable
	sh studies/editors/run.sh $(BIN)

study-worlds: $(STAMP) ## MiniGrid, LunarLander and CartPole: expert, baseline, random search; resumable
	$(BIN)/python studies/worlds/study.py

comparators: $(STAMP) ## all searches at equal episodes in five worlds, into studies/comparison/results; resumable
	$(BIN)/python -m studies.comparison.compare_searches $(ARGS)

docs: $(STAMP)   ## the documentation's site, in build/site
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[docs]' -c constraints.txt
	$(BIN)/python docs/pages.py
	$(BIN)/zensical build --clean --strict

ui: $(STAMP)     ## start the MLflow UI on this folder's runs
	$(BIN)/islandgp ui

clean:           ## remove the virtual environment and caches
	rm -rf $(VENV) build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis

.PHONY: help setup run lint lines test test-unit test-process test-packaging test-slow coverage mutants btcpp fuzz torture axe vscode vscode-tools bench demo-llm study ablations study-editors study-worlds comparators docs ui clean
