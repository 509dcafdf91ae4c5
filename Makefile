# make run: the main job; make test: linters, types, tests. Both make .venv first.
PYTHON ?= python3
BIN := .venv/bin

.PHONY: run test test-lowest benchmarks clean

run: .venv/installed
	$(BIN)/fe-squeal run examples/disc_pad.toml -o results/disc_pad
	@echo "Pictures: results/disc_pad/stability.png, results/disc_pad/root_locus.png, results/disc_pad/shapes/*.png"

test: .venv/installed-test
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo
	$(BIN)/pytest -n 2 --dist worksteal

# The fast tests with the lowest versions that pyproject.toml admits; hard cases and fuzzing run with the newest alone.
test-lowest: .venv-lowest/installed
	.venv-lowest/bin/pytest -n 2 --dist worksteal -m "not slow" --ignore=tests/hard --ignore=tests/fuzz

.venv/installed: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --disable-pip-version-check -e .
	@touch $@

.venv/installed-test: .venv/installed
	$(BIN)/pip install --quiet --disable-pip-version-check -e ".[test]"
	@touch $@

.venv-lowest/installed: pyproject.toml tests/lowest.txt
	$(PYTHON) -m venv .venv-lowest
	.venv-lowest/bin/pip install --quiet --disable-pip-version-check -c tests/lowest.txt -e . pytest pytest-xdist hypothesis
	@touch $@

clean:
	rm -rf .venv .venv-lowest results build *.egg-info

# The pictures of README.md.
.PHONY: docs
docs: run
	mkdir -p docs/images
	cp results/disc_pad/stability.png docs/images/stability.png
	cp results/disc_pad/shapes/branch_16_*.png docs/images/shape.png
	$(BIN)/python -m fe_squeal.scene.reference > docs/scene.md

# The pages of what effects and sweeps cost, with the times of this machine, and of nearly incompressible linings.
benchmarks: .venv/installed
	$(BIN)/python benchmarks/effects_cost.py --write
	$(BIN)/python benchmarks/sweep_cost.py --write
	$(BIN)/python benchmarks/accuracy_and_cost.py --write
	$(BIN)/python benchmarks/near_incompressible.py --write

# The page of the hard cases, from the tests' own results.
.PHONY: hard-cases
hard-cases: .venv/installed-test
	$(BIN)/python benchmarks/hard_cases.py --write
