# make demo, make test: each one alone sets up the environment $(VENV) and runs.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/$(if $(filter Windows_NT,$(OS)),Scripts,bin)
INSTALL = $(BIN)/python -m pip install --quiet --disable-pip-version-check $(CONSTRAINTS:%=-c %)
NIGHTLY := https://us-python.pkg.dev/ml-oss-artifacts-published/jax/simple/

# scripts in experiments/ that `make studies` runs, two at a time, and then the one that takes times
STUDIES := accession_curves bar_bank unsymmetric_bank contact_bank cable_bank slack_regions fuzz to_failure saddle_net hard_cases accuracy_cable flat_net_path hypar_net

.PHONY: demo check test test-all test-more test-lowest test-nightly lint studies site site-test \
	notebooks notebooks-test dist test-dist check-tag clean

demo: $(VENV)/installed
	$(BIN)/python -m jaxcable demo

# tests that changes since a commit are likely to affect: make check [SINCE=main]
SINCE ?= HEAD
check: $(VENV)/installed-test
	$(BIN)/python tests/affected.py $(SINCE)

# what one runs before a commit; `test-all` is everything
test: $(VENV)/installed-test
	$(BIN)/python -m pytest -n 2 --dist loadfile

test-all: test test-more

# the second part once more where XLA fuses loops (jaxcable.fuse_loops); with TEST_PART=1/32 only a
# thirty-second of the slow tests, and an eighth of those with fused loops
MORE := slow
FUSED := fused transforms net_bank batches gradients_two_phases failures stages
test-more: $(VENV)/installed-test
	$(BIN)/python -m pytest -m $(MORE) -n 2 --dist loadfile
	FUSED_LOOPS=1 $(BIN)/python -m pytest -n 2 --dist loadfile $(FUSED:%=tests/*/test_%.py)

# the tests with the lowest versions of all dependencies, and with the jax of last night
test-lowest: build/lowest.txt
	$(MAKE) test VENV=.venv-lowest CONSTRAINTS=$<

test-nightly: VENV = .venv-nightly
test-nightly:
	$(MAKE) $(VENV)/installed-test VENV=$(VENV)
	$(INSTALL) --upgrade --pre --index-url $(NIGHTLY) jax jaxlib
	$(MAKE) test VENV=$(VENV)

build/lowest.txt: pyproject.toml $(VENV)/installed-release
	$(BIN)/uv pip compile --quiet --resolution lowest-direct --output-file $@ pyproject.toml

# what an index gets: dist/*.whl, dist/*.tar.gz
dist: $(VENV)/installed-release
	rm -rf dist
	$(BIN)/python -m build --outdir dist .
	$(BIN)/python -m twine check --strict dist/*

# whether a tag is that of the version
check-tag:
	test "$(TAG)" = "v$$(sed -n 's/^__version__ = "\(.*\)"/\1/p' jaxcable/__init__.py)"

# the wheel in an empty environment: demo, commands and tests, outside of the checkout
test-dist: dist
	$(BIN)/python experiments/installed_wheel.py dist/*.whl

studies: $(VENV)/installed-test
	$(MAKE) -j 2 $(STUDIES:%=study-%)
	OPENBLAS_NUM_THREADS=1 $(BIN)/python experiments/benchmark.py work_precision

study-%: $(VENV)/installed-test
	OPENBLAS_NUM_THREADS=1 $(BIN)/python experiments/$*.py

# write the notebooks, with their outputs, from their text sources
notebooks: $(VENV)/installed-notebooks
	cd notebooks && OPENBLAS_NUM_THREADS=1 ../$(BIN)/jupytext --to ipynb --execute *.py

notebooks-test: $(VENV)/installed-test
	$(BIN)/python -m pytest -m "slow or not slow" tests/project/test_notebooks.py

# the site: build/site/index.html
site: $(VENV)/installed-site
	$(BIN)/python docs/sources.py build/site-sources
	$(BIN)/python -m sphinx --fail-on-warning --keep-going --quiet build/site-sources build/site

# every page of it in a browser
site-test: site
	$(BIN)/python docs/check_site.py build/site

lint: $(VENV)/installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

$(VENV)/installed: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(INSTALL) -e .
	touch $@

$(VENV)/installed-%: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(INSTALL) -e ".[$*]"
	touch $@

clean:
	rm -rf .venv .venv-* build dist *.egg-info
