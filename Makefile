# make run: the main job; make test: linters and the fast tests, in five minutes; make test-all: types and the other tests.
# All make .venv first.
PYTHON ?= python3
BIN := .venv/bin
# Python keeps what it has compiled. Packages are installed uncompiled, and the tests start some thousand processes: each would
# compile all that it imports again, in 4 s, where this variable is set, as in images of containers.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: run run-mpi test test-mpi types slow test-all test-again test-lowest clean

run: .venv/installed
	$(BIN)/fe-squeal run examples/disc_pad.toml -o results/disc_pad
	@echo "The mesh of this example is coarse. For onsets and growth within 2 %, about a minute: $(BIN)/fe-squeal run examples/disc_pad.toml --accuracy 0.02"
	@echo "Pictures: results/disc_pad/stability.png, results/disc_pad/root_locus.png, results/disc_pad/shapes/*.png"

# Most tests of a module stay in one process, and so do the fixtures that they share.
PYTEST_OPTIONS := -n 2 --dist worksteal --durations=20

# What shows the mathematics: closed forms, rates, invariants, onsets, doublets, exceptional points (tests/selection.py).
test: .venv/installed-test
	$(BIN)/ruff check .
	$(BIN)/lint-imports --no-logo
	$(BIN)/pytest $(PYTEST_OPTIONS) -m "not slow"

types: .venv/installed-test
	$(BIN)/mypy

# PART=K/N: only every N-th file of tests, from the K-th on.
PART ?= 1/1
slow: .venv/installed-test
	$(BIN)/pytest $(PYTEST_OPTIONS) -m slow --part $(PART) tests

# What is left: pages, decks, fuzzing, kills, full discs, processes, smallest rungs of the benchmarks, further parameters.
test-all: test
	@$(MAKE) --no-print-directory -j2 types slow

# Hard cases, closed forms and rates N times in each setting that must not change a verdict (threads, kernels of the BLAS,
# solver, start vectors, numbers of nodes, random examples): hours. More in: python tests/again.py --help
N ?= 20
test-again: .venv/installed-test
	$(BIN)/python tests/again.py --repeat $(N)

# With the lowest versions that pyproject.toml admits: the fast tests that call every part of the libraries. The mathematics,
# hard cases, fuzzing and the browser run with the newest alone, and so do those of tests/unit that take long and call
# nothing of a library that the others do not.
NEWEST_ALONE := band checkpoint counting effects_on_demand eigen eigen_complex estimate_run found_by_fuzz lumped_properties \
	lumped_studies marked mesh_bars reduced refining resume run_effects
# Pages, pictures, decks and files call most of the libraries, and take a second or more a test.
CALLING := report_* decks_* geometry* mesh_writing run_files study_command cli_commands measured difference summary
test-lowest: .venv-lowest/installed
	.venv-lowest/bin/pytest $(PYTEST_OPTIONS) -m "not slow" tests/unit tests/regression $(NEWEST_ALONE:%=--ignore=tests/unit/test_%.py)
	.venv-lowest/bin/pytest $(PYTEST_OPTIONS) -m "slow and not long" $(CALLING:%=tests/unit/test_%.py)

# On several processes, by MPI and MUMPS: Debian's packages, and NumPy 1.26, for which these were built. make run needs none.
MPI := OMP_NUM_THREADS=1 mpiexec -q --oversubscribe --mca mpi_yield_when_idle 1 $(if $(filter 0,$(shell id -u)),--allow-run-as-root)
PETSC ?= $(firstword $(wildcard /usr/lib/petscdir/petsc*/*-real/lib/python3/dist-packages))

run-mpi: .venv-mpi/installed
	$(MPI) -n 2 .venv-mpi/bin/fe-squeal run examples/disc_pad.toml -o results/disc_pad_mpi

# The solver on one, two and three processes, sweeps on one and two, then whole commands under mpiexec. Sweeps on three are
# among these commands; what takes a process of its own is skipped on several.
test-mpi: .venv-mpi/installed
	for count in 1 2 3; do $(MPI) -n $$count .venv-mpi/bin/python tests/pytest_mpi.py -q tests/unit/test_mumps.py tests/unit/test_mumps_options.py tests/unit/test_spread_columns.py tests/unit/test_spread_matrix.py $$(test $$count -lt 3 || echo '-k not(sweep)') || exit 1; done
	.venv-mpi/bin/python -m pytest tests/mpi

# Where both are of one minor version, the packages of .venv serve here as well, behind NumPy 1.26 and a pandas for it.
VERSION := import sys; print(*sys.version_info[:2])
SITE := import site; print(site.getsitepackages()[0])
.venv-mpi/installed: pyproject.toml .venv/installed-test
	@test -d "$(PETSC)/petsc4py" || { echo "no petsc4py: apt-get install python3-petsc4py python3-mpi4py libopenblas0-pthread"; exit 1; }
	rm -rf .venv-mpi
	/usr/bin/python3 -m venv --without-pip .venv-mpi
	site=$$(.venv-mpi/bin/python -c "$(SITE)") && what='-e .[test]' && shared= && \
	if test "$$($(BIN)/python -c "$(VERSION)")" = "$$(.venv-mpi/bin/python -c "$(VERSION)")"; then \
	    what='-e . --no-deps pandas<3 pytz' && shared=$$($(BIN)/python -c "$(SITE)"); fi && \
	$(BIN)/pip --python .venv-mpi/bin/python install --quiet --no-compile --disable-pip-version-check $$what "numpy<2" && \
	printf '%s\n' "$(PETSC)" $$shared > $$site/petsc4py.pth && ln -sfn /usr/lib/python3/dist-packages/mpi4py $$site/mpi4py
	@touch $@

.venv/installed: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --no-compile --disable-pip-version-check -e .
	@touch $@

.venv/installed-test: .venv/installed
	$(BIN)/pip install --quiet --no-compile --disable-pip-version-check -e ".[test]"
	@touch $@

.venv-lowest/installed: pyproject.toml tests/lowest.txt
	$(PYTHON) -m venv .venv-lowest
	.venv-lowest/bin/pip install --quiet --no-compile --disable-pip-version-check -c tests/lowest.txt -e ".[measured]" pytest pytest-xdist pytest-timeout hypothesis
	@touch $@

clean:
	rm -rf .venv .venv-lowest .venv-mpi results build *.egg-info

# Every page of docs/ but architecture.md is made, or has its numbers made, by `make docs/PAGE.md`: by the file of benchmarks/
# of that name, scene.md and lumped.md by the package. Their pictures come with them.
PAGES := $(filter-out docs/architecture.md,$(wildcard docs/*.md))
MEASURED := accuracy_and_cost effects_cost mesh_targets near_incompressible onsets performance studies sweep_cost
.PHONY: docs benchmarks hard-cases trust $(PAGES)

# What follows from the program alone: keys of the scene, lumped models, pictures of README.md.
docs: docs/scene.md docs/lumped.md run
	mkdir -p docs/images
	cp results/disc_pad/stability.png docs/images/stability.png
	cp results/disc_pad/shapes/branch_16_*.png docs/images/shape.png
	$(BIN)/fe-squeal run examples/disc_pad.toml -o results/disc_pad_estimate --estimate
	cp results/disc_pad_estimate/mesh_error.png docs/images/mesh_error.png

docs/scene.md: .venv/installed
	$(BIN)/python -m fe_squeal.scene.reference > $@

docs/lumped.md: .venv/installed
	$(BIN)/python -m lumped.document docs

# What accuracy, effects and sweeps cost, with the times of this machine, meshes for targets, onsets of random sweeps, and
# nearly incompressible linings: hours.
benchmarks: $(MEASURED:%=docs/%.md)

# The searches for broken promises in full, half an hour on two free cores: spoilt inputs, signals, commands at once.
trust: docs/trust.md

# The hard cases, from the tests' own results.
hard-cases: docs/hard_cases.md

# Each of these pages has sections by files of their own, which leave the rest of it as it is.
SECTIONED := docs/accuracy_and_cost.md docs/cluster.md docs/performance.md

docs/accuracy_and_cost.md: .venv/installed-test
	$(BIN)/python benchmarks/accuracy_and_cost.py --write
	$(BIN)/python benchmarks/mesh_bars.py --write
	$(BIN)/python benchmarks/onset_bars.py --write

docs/cluster.md: .venv/installed-test .venv-mpi/installed  # and python3-slepc4py, see benchmarks/direct_solves.py
	$(BIN)/python benchmarks/cluster.py --write
	$(BIN)/python benchmarks/direct_solves.py --write

docs/performance.md: .venv/installed-test
	$(BIN)/python benchmarks/performance.py --write
	$(BIN)/python benchmarks/gallery/compare.py --write
	$(BIN)/python benchmarks/memory.py --write
	$(BIN)/python benchmarks/gallery/profiles.py --write

$(filter-out docs/scene.md docs/lumped.md $(SECTIONED),$(PAGES)): docs/%.md: benchmarks/%.py .venv/installed-test
	$(BIN)/python $< --write
