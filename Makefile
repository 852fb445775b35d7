# Each target makes the virtual environment that it needs; run them from the checkout.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt
THREADS := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1 NUMBA_NUM_THREADS=1

.PHONY: demo test test-slow lint bench pictures mutants uncache clean

demo: $(VENV)/installed
	$(BIN)/lfd-gym demo --out report

test: $(VENV)/installed-dev
	$(THREADS) $(BIN)/python -m pytest -n 2 -m "not slow"

test-slow: $(VENV)/installed-dev
	$(THREADS) $(BIN)/python -m pytest -n 2 -m slow

lint: $(VENV)/installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: $(VENV)/installed
	$(THREADS) $(BIN)/lfd-gym bench

pictures: $(VENV)/installed
	$(BIN)/lfd-gym render teacher light-bulb --noise 0 --seed 100003 --at 8 --out results/pictures/light-bulb.png --set camera=close
	$(BIN)/lfd-gym render teacher move-object --noise 0 --seed 100003 --at 6.5 --out results/pictures/move-object.png
	$(BIN)/lfd-gym render teacher box-stacking --noise 0 --seed 100003 --at 32 --out results/pictures/box-stacking.png
	$(BIN)/lfd-gym render teacher box-flipping --noise 0 --seed 100003 --at 6 --out results/pictures/box-flipping.png
	$(BIN)/lfd-gym render teacher whiteboard --noise 0 --seed 100003 --at 20 --out results/pictures/whiteboard.png
	$(BIN)/lfd-gym render teacher cylinder-grasp --noise 0 --seed 100003 --at 6 --out results/pictures/cylinder-grasp.png

mutants: $(VENV)/installed-dev
	$(THREADS) $(BIN)/python tests/mutants.py

$(VENV)/installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(INSTALL) -e .
	touch $@

$(VENV)/installed-dev: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(INSTALL) -e '.[data,dev,rl]'
	touch $@ $(VENV)/installed

clean: uncache
	rm -rf $(VENV) build dist .mypy_cache .pytest_cache .ruff_cache

uncache:
	find lfd_gym policies scripted_teachers tests -name __pycache__ -type d -prune -exec rm -rf {} +
