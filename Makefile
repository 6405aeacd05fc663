# make demo, make test: each one alone sets up .venv and runs.
PYTHON ?= python3
BIN := .venv/bin

# scripts in experiments/ that `make studies` runs, in this order
STUDIES := accuracy_cable accession_curves flat_net_path hypar_net saddle_net

.PHONY: demo test lint slow studies clean

demo: .venv/installed
	$(BIN)/python -m jaxcable demo

test: .venv/installed-test
	$(BIN)/python -m pytest -n 2 --dist loadfile

slow: .venv/installed-test
	$(BIN)/python -m pytest -m slow

studies: $(STUDIES:%=study-%)

study-%: .venv/installed-test
	OPENBLAS_NUM_THREADS=1 $(BIN)/python experiments/$*.py

lint: .venv/installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

.venv/installed: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e .
	touch $@

.venv/installed-test: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[test]"
	touch $@

clean:
	rm -rf .venv build *.egg-info
