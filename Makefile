# Every target sets up what it needs; `make` alone lists them.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Stamps: what is installed in .venv. They are made again when pyproject.toml changes.
READY := $(VENV)/ready
READY_TEST := $(VENV)/ready-test
READY_DEV := $(VENV)/ready-dev
READY_BENCH := $(VENV)/ready-bench
READY_DOCS := $(VENV)/ready-docs
READY_CLUSTER := $(VENV)/ready-cluster
# The lowest supported Python with the lowest supported version of everything, in an environment of its own.
MINIMUM_PYTHON ?= python3.11
MINIMUM := .venv-minimum
# Interpreters in which the built package is installed and used; those that are not here are left out.
PACKAGE_PYTHONS ?= python3.11 python3.12 python3.13
# AUTO-07p, in an environment of its own: bifpy compiles it, which needs gfortran and GNU make.
AUTO := .venv-auto
READERS := tests/readers/node_modules
# Of what pip says, errors alone are shown.
PIP := $(BIN)/python -m pip -qq --disable-pip-version-check

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
FIGURES := $(addprefix figure-3.,1 2 3 4 5 6 7 8 9 10 11 12 13 14)
.PHONY: help setup table-3.1 paper $(FIGURES) gallery bifurcation checkerboard everted-cylinder everted-moebius contact-limits docs
.PHONY: test test-long test-docs test-minimum test-package test-browser test-readers test-peers test-large test-branches test-faults test-auto test-cluster test-slurm lint bench bench-sweep same-as clean

help: ## list the targets
	@sed -n 's/^\([a-z][a-z0-9.-]*\):.*## \(.*\)/make \1|\2/p' Makefile | awk -F'|' '{printf "%-23s %s\n", $$1, $$2}'
	@printf '%-23s %s\n' 'make figure-3.8' 'make one figure of chapter 3: 3.1 to 3.14'

setup: $(READY) ## make .venv with ribbon in it: .venv/bin/ribbon
	$(if $(filter setup,$(MAKECMDGOALS)),@echo "ribbon is installed; to use it in this shell: . $(BIN)/activate" >&2)

table-3.1: setup ## solve the pi-bands of Table 3.1 and print it beside the published numbers
	@$(BIN)/python -m paper $@

checkerboard: setup ## spectra of Figure 3.14 under both rules, and the physical ones that converge
	@$(BIN)/python -m paper $@

everted-cylinder: setup ## follow the branches of the everted cylinder: where it is stable, where not
	@$(BIN)/python -m paper $@

everted-moebius: setup ## follow the branches of everted Moebius bands, saddles all along
	@$(BIN)/python -m paper $@

contact-limits: setup ## bands that rest on themselves, towards the widest there can be
	@$(BIN)/python -m paper $@

paper: setup ## make every figure and table of chapter 3 and check its claims: runs/paper/index.html
	@$(BIN)/python -m paper

$(FIGURES): setup
	@$(BIN)/python -m paper $@

gallery: setup ## draw the pictures of the documentation: docs/gallery/
	@sh docs/gallery/draw.sh $(BIN)/ribbon

bifurcation: setup ## draw the bifurcation diagram of a sheared strip: docs/gallery/bifurcation.png
	@$(BIN)/ribbon -q solve configs/strips/shear-branches.yaml > /dev/null
	@$(BIN)/ribbon -q plot strip-shear-branches branch -o docs/gallery/bifurcation.png --overwrite

# Sphinx takes pages as they are, here and in findings; a warning, such as of a link that leads nowhere, is an error.
docs: $(READY_DOCS) ## build the documentation as a site: build/site/index.html
	@$(BIN)/python -m sphinx -q -W --keep-going -E -c docs/site . build/site
	@echo build/site/index.html

test: $(READY_TEST) ## run the test suite; its long forms have targets of their own
	@$(BIN)/python -m pytest -n auto --maxprocesses 4 --dist loadfile

test-long: $(READY_TEST) ## run further cases and longer ways of what the test suite tries
	@$(BIN)/python -m pytest -m "long and not peers" -n auto --maxprocesses 4

test-docs: $(READY_TEST) ## run the examples of the reference and background pages
	@$(BIN)/python -m pytest -m docs -n auto --maxprocesses 4

test-minimum: $(MINIMUM)/ready ## run the quick tests on the lowest supported versions
	@$(MINIMUM)/bin/python -m pytest -m "not slow and not docs and not large and not faults and not browser and not branches and not package and not readers and not peers and not long and not auto and not cluster and not slurm" \
		--ignore=tests/test_resume.py --ignore=tests/test_study.py --ignore=tests/test_table_3_1.py \
		--ignore=tests/test_export_formats.py --ignore=tests/test_export_bands.py \
		--ignore=tests/test_hdf5_readers.py --ignore=tests/test_api_door.py --ignore=tests/test_notebook.py \
		--ignore=tests/test_contact_pictures.py --ignore=tests/test_export_gltf.py --ignore=tests/test_solid.py \
		--ignore=tests/test_table_of_states.py \
		--deselect tests/test_sweep_ends.py::test_a_cell_has_a_state_only_at_the_end_of_its_schedule \
		--deselect tests/test_sweep_ends.py::test_a_state_continued_to_another_width_leaves_its_point \
		--deselect tests/test_resting_store.py::test_frames_datasets_and_states_have_contacts \
		--deselect tests/test_store_strips.py::test_ls_has_a_column_for_what_varies \
		--deselect tests/test_store_strips.py::test_python_follows_and_finds_in_any_parameter \
		--deselect "tests/test_self_contact.py::test_every_export_warns_once[stl]" \
		--deselect "tests/test_self_contact.py::test_the_file_says_so_where_it_carries_notes[stl]" \
		--deselect "tests/test_docs.py::test_the_examples_run[docs/format.md]" \
		--deselect "tests/test_docs.py::test_the_examples_run[docs/python.md]" \
		--deselect "tests/test_docs.py::test_the_examples_run[docs/tutorial.md]"

test-package: $(READY_DEV) ## build wheel and sdist, install each in empty environments, solve there
	@PACKAGE_PYTHONS="$(PACKAGE_PYTHONS)" $(BIN)/python -m pytest -m package -rs --durations=0 \
		-o tmp_path_retention_policy=failed tests/package

test-browser: $(READY_TEST) docs ## open the HTML viewer and the site in headless Chromium (apt install chromium)
	@$(BIN)/python -m pytest -m browser tests/browser

test-readers: $(READY_TEST) $(READERS)/ready ## open files in other programs: h5dump, and readers of FOLD and glTF from npm (apt install hdf5-tools npm)
	@$(BIN)/python -m pytest -m readers

test-peers: $(READY_DEV) ## compare with VTK, netCDF4, SymPy and CasADi, which take a gigabyte
	@$(BIN)/python -m pytest -m peers tests/peers tests/test_hdf5_readers.py

test-large: $(READY_TEST) ## inertia, dense algebra and Lanczos at N = 400 and 800, a few minutes
	@$(BIN)/python -m pytest -m large

test-branches: $(READY_TEST) ## follow 300 random branches: none ends in an error, none certifies falsely
	@$(BIN)/python -m pytest -m branches -n auto --maxprocesses 4

test-faults: $(READY_TEST) ## run the long fault tests of the store: kills, failing calls, crash images, damage
	@$(BIN)/python -m pytest -m faults -n auto --maxprocesses 4 --durations=0

test-auto: $(READY_DEV) $(AUTO)/ready ## compare folds and branch points with AUTO-07p, a minute (apt install gfortran)
	@AUTO_PYTHON=$(CURDIR)/$(AUTO)/bin/python $(BIN)/python -m pytest -m auto -rs tests/auto

test-cluster: $(READY_CLUSTER) ## run sweeps on Dask: same bytes, workers and schedulers that are killed
	@$(BIN)/python -m pytest -m cluster tests/cluster

test-slurm: $(READY_CLUSTER) ## run sweeps on a Slurm of one node, as root (apt install munge slurmctld slurmd slurm-client)
	@$(BIN)/python -m pytest -m slurm -rs tests/cluster

lint: $(READY_DEV) ## check style, format and types
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy

bench: $(READY_BENCH) ## measure the solver against CasADi with IPOPT, and the store
	@$(BIN)/python -m bench.run; solver=$$?; $(BIN)/python -m bench.store && exit $$solver

bench-sweep: $(READY_CLUSTER) $(READY_BENCH) ## measure sweeps: two workers against one and against Dask, 1000 runs
	@$(BIN)/python -m bench.sweeps

# COMMIT: default where main was left. SAME: options, such as SAME="--quick --expect changes.yaml"; -h lists them.
same-as: setup ## compare results, exit codes, JSON and speed with those of COMMIT
	@$(BIN)/python -m bench.same $(COMMIT) $(SAME)

clean: ## remove .venv, .venv-minimum, .venv-auto, packages of tests and caches; runs stay
	rm -rf $(VENV) $(MINIMUM) $(AUTO) $(READERS) build *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis .coverage
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(READY): pyproject.toml
	@$(new-venv)
	@$(call install,.)
	@touch $@

$(READY_TEST): pyproject.toml
	@$(new-venv)
	@$(call install,'.[test]')
	@touch $@ $(READY)

$(READY_DEV): pyproject.toml
	@$(new-venv)
	@$(call install,'.[dev]')
	@touch $@ $(READY) $(READY_TEST) $(READY_BENCH)

$(READY_BENCH): pyproject.toml
	@$(new-venv)
	@$(call install,'.[bench]')
	@touch $@ $(READY)

$(READY_CLUSTER): pyproject.toml
	@$(new-venv)
	@$(call install,'.[test$(comma)cluster]')
	@touch $@ $(READY) $(READY_TEST)

$(READY_DOCS): pyproject.toml
	@$(new-venv)
	@$(call install,'.[docs$(comma)notebook]')
	@touch $@ $(READY)

$(MINIMUM)/ready: pyproject.toml constraints/minimum.txt
	@command -v $(MINIMUM_PYTHON) > /dev/null || { \
		echo "no '$(MINIMUM_PYTHON)' here: name the lowest supported one, as in 'make MINIMUM_PYTHON=/path/to/python3.11 test-minimum'" >&2; \
		exit 1; \
	}
	@echo "setting up $(MINIMUM), once" >&2
	@$(MINIMUM_PYTHON) -m venv --clear $(MINIMUM)
	@$(MINIMUM)/bin/python -m pip -qq --disable-pip-version-check install --only-binary :all: -r constraints/minimum.txt
	@$(MINIMUM)/bin/python -m pip -qq --disable-pip-version-check install --no-deps --editable .
	@$(MINIMUM)/bin/python -m pip --disable-pip-version-check check
	@touch $@

$(AUTO)/ready:
	@command -v gfortran > /dev/null || { echo "AUTO-07p is compiled by gfortran, which is not here: apt install gfortran" >&2; exit 1; }
	@echo "setting up $(AUTO), once" >&2
	@$(PYTHON) -m venv --clear $(AUTO)
	@$(AUTO)/bin/python -m pip -qq --disable-pip-version-check install 'bifpy==0.3.0'
	@touch $@

$(READERS)/ready: tests/readers/package.json
	@npm install --prefix tests/readers --no-package-lock --no-audit --no-fund --loglevel=error > /dev/null
	@touch $@

# Compiled here: on all cores, and with the package itself, which stays where it is and which pip would leave
# as it is, so that its commands would start later. What does not compile is no module that anyone imports, and
# nobody imports other packages' tests.
comma := ,
define install
$(PIP) install --no-compile --editable $(1) && \
	{ $(BIN)/python -m compileall -qq -j 0 -x '/tests/' $(VENV)/lib ribbon_cli > /dev/null || true; }
endef

# A virtual environment, unless a working one is there; the interpreter is checked before it is used.
define new-venv
$(BIN)/python -m pip --version > /dev/null 2>&1 || { \
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2> /dev/null || { \
		echo "ribbon needs Python 3.11 or later, and '$(PYTHON)' is none: name one, as in 'make PYTHON=python3.12 $(or $(MAKECMDGOALS),setup)'" >&2; \
		exit 1; \
	}; \
	echo "setting up $(VENV), once, in about a minute" >&2; \
	$(PYTHON) -m venv --clear $(VENV); \
}
endef
