# Two commands do everything on a fresh machine: `make demo` and `make test`.  Both set up .venv first.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
READY  := $(VENV)/.ready
# Compiled modules are kept, whatever the environment says: else each worker compiles all tests anew at every run (11 s of
# processor time instead of 5 to collect them).
export PYTHONDONTWRITEBYTECODE :=

.PHONY: help demo test test-vm check format bench bench-soak bench-faults fuzz bench-detector table1 bench-hidden bench-real figures screenshots clean
help:
	@grep -E '^[a-z0-9-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

# --no-compile: of 12 000 modules of others a fifth is used, and each is compiled when it is; pip takes 48 s of processor
# time otherwise instead of 29, while the other core waits.
$(READY): pyproject.toml
	@echo 'Installing into $(VENV); this takes a minute or two.'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --no-compile --disable-pip-version-check --editable '.[dev]'
	@touch $@

demo: $(READY)  ## the main job on the simulated robot: a year of wear in a minute
	@BIN=$(BIN) sh examples/demo.sh

# Collected once before: in a fresh clone each of the six workers would compile all tests (55 s of processor time, not 36).
test: $(READY)  ## everything: format, lint, types, all tests
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy -p lostmotion & types=$$!; $(BIN)/python -m pytest --collect-only -qq >/dev/null; \
	$(BIN)/python -m pytest -n 6 --dist worksteal -rsR && wait $$types

check: $(READY)  ## the same with the fast tests only, in under two minutes
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy -p lostmotion & types=$$!; $(BIN)/python -m pytest -q -n 6 --dist worksteal -m "not slow" && wait $$types

test-vm: $(READY)  ## a real CAN interface, in a virtual machine (qemu; some minutes, root, x86_64)
	LOSTMOTION_VM=1 $(BIN)/python -m pytest -n 0 tests/system/test_can_bus.py

format: $(READY)  ## puts the source into the one form
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

bench: $(READY)  ## speed and memory as ratios, side by side in one run
	$(BIN)/python -m bench

bench-soak: $(READY)  ## whether the service's memory grows: twenty minutes at 20 times real speed, all sinks on
	$(BIN)/python -m bench.soak

bench-faults: $(READY)  ## random faults against the service, 200 campaigns: what holds, and how soon each is told (half an hour)
	$(BIN)/python -m bench.faults

fuzz: $(READY)  ## broken bytes, lines and files at random, COUNT (100000) of each kind: taken or refused in one line (four minutes)
	$(BIN)/python -m bench.fuzz --inputs $(or $(COUNT),100000) --seed $(or $(SEED),0)

bench-hidden: $(READY)  ## recordings with a hidden effect: what lab explain makes of them (table and figure, takes long)
	$(BIN)/python -m bench.hidden_effects run --seed $(or $(SEED),0) --figures docs/figures
	$(BIN)/python -m bench.driven_motions --seed $(or $(SEED),400)
	$(BIN)/python -m bench.free_motions --seed $(or $(SEED),400)

bench-real: $(READY)  ## real measurements of others: what lab explain says of each, cold, through the command line
	$(BIN)/python -m bench.real

bench-detector: $(READY)  ## the detector against its rivals and the bounds: table, ROC pictures, size of the play, which joint, promises kept
	$(BIN)/python -m bench.roc --figures docs/figures
	$(BIN)/python -m bench.play_size
	$(BIN)/python -m bench.severity
	$(BIN)/python -m bench.severity --rate 200
	$(BIN)/python -m bench.severity --found
	$(BIN)/python -m bench.outside
	$(BIN)/python -m bench.forecasts
	$(BIN)/python -m bench.following
	$(BIN)/python -m bench.attribution
	$(BIN)/python -m bench.promises
	$(BIN)/python -m bench.detector

table1: $(READY)  ## the paper's section 4 again: table 1 over noise, rates and small plays, figures 4 and 5
	$(BIN)/python -m bench.table1 --figures docs/figures

figures: $(READY)  ## the paper's figures 1, 2, 4 and 5 from the model, into docs/figures
	$(BIN)/python -m bench.figures

screenshots: $(READY)  ## the pages in a browser, wide and on a phone, into docs/figures (needs Chromium)
	$(BIN)/python -m bench.screenshots

clean:  ## removes what the targets made
	rm -rf $(VENV) build dist *.egg-info src/*.egg-info .mypy_cache .pytest_cache .ruff_cache
