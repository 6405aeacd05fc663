# make demo, make test: each one alone sets up .venv and runs.
PYTHON ?= python3
BIN := .venv/bin

# scripts in experiments/ that `make studies` runs, two at a time, and then the one that takes times
STUDIES := accession_curves bar_bank unsymmetric_bank cable_bank slack_regions fuzz to_failure saddle_net hard_cases accuracy_cable flat_net_path hypar_net

.PHONY: demo test test-all test-more lint studies docs notebooks notebooks-test clean

demo: .venv/installed
	$(BIN)/python -m jaxcable demo

# what one runs before a commit; `test-all` is everything
test: .venv/installed-test
	$(BIN)/python -m pytest -n 2 --dist loadfile

test-all: test test-more

# the second part once more where XLA fuses loops (jaxcable.fuse_loops)
MORE := slow
FUSED := fused transforms net_bank batches gradients_two_phases failures stages
test-more: .venv/installed-test
	$(BIN)/python -m pytest -m $(MORE) -n 2 --dist loadfile
	FUSED_LOOPS=1 $(BIN)/python -m pytest -n 2 --dist loadfile $(FUSED:%=tests/*/test_%.py)

studies: .venv/installed-test
	$(MAKE) -j 2 $(STUDIES:%=study-%)
	OPENBLAS_NUM_THREADS=1 $(BIN)/python experiments/benchmark.py work_precision

study-%: .venv/installed-test
	OPENBLAS_NUM_THREADS=1 $(BIN)/python experiments/$*.py

# write the notebooks, with their outputs, from their text sources
notebooks: .venv/installed-notebooks
	cd notebooks && JAXCABLE_PROGRESS=0 OPENBLAS_NUM_THREADS=1 ../$(BIN)/jupytext --to ipynb --execute *.py

notebooks-test: .venv/installed-test
	$(BIN)/python -m pytest -m "slow or not slow" tests/project/test_notebooks.py

# the reference, from the docstrings: build/docs/index.html
docs: .venv/installed-docs
	$(BIN)/python -m pdoc --docformat google -o build/docs \
		jaxcable jaxcable.loads jaxcable.sections jaxcable.elements '!jaxcable[.].+[.].+'

lint: .venv/installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

.venv/installed: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e .
	touch $@

.venv/installed-test: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[test]"
	touch $@

.venv/installed-docs: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[docs]"
	touch $@

.venv/installed-notebooks: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[notebooks]"
	touch $@

clean:
	rm -rf .venv build *.egg-info
