# make run   set up, then close the loop on the simulated bench
# make rehearse  set up, then run the real bench's code in real time on monitors that exist only in memory
# make test  set up, then run the tests
# make test-quick  set up, then run the tests of closed forms and refusals, for every save: under a minute on two cores
# make mutants  plant twenty faults, one at a time, and say which test fails with each: under 30 minutes on two cores
# make test-long  calibrations of whole benches and a run, in real time and pixel by pixel, some seven minutes
# make lint  format, lint, types, import layers, docstrings of the public API, size of the rooms
# make size  tokens, fixed numbers and compiled functions of every room
# make golden  play the golden scenarios and print what differs from the baseline, bit for bit: under ten minutes on two cores
# make golden-baseline  make that baseline on this machine, once per baseline commit: up to 25 minutes
# make bench speed and accuracy against peers (ratios of the same run), sigma, steps, long holds, gains,
#            faults, live path, calibration, decoding, still images, contacts, every pixel, the page: ~2 hours
# make bars  SALT=...: what a change of method must hold, over scenes drawn from a salt: an hour on two idle cores
# Everything lives in .venv; system packages that are missing (EGL, Mesa; Xorg for the tests) are installed first.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check

.PHONY: run rehearse test test-quick test-long mutants lint size golden golden-baseline bench bars clean
.DEFAULT_GOAL := run

run: $(VENV)/.run-ready
	@mkdir -p out
	@echo "3 of 3: the default scenario on the simulated bench, 2.65 s of its time (drawn by software about a minute)"
	@$(BIN)/zeromethod run --figure out/run.png --summary out/run.json
	@echo "The picture is out/run.png, every figure is in out/run.json. Next, for instance:"
	@echo "  $(BIN)/zeromethod run --scenario ball      # something round touches"
	@echo "  $(BIN)/zeromethod run --view               # watch it in a browser"
	@echo "  make rehearse                           # the real bench's code, in real time, without a bench"

rehearse: $(VENV)/.test-ready
	@BIN=$(BIN) sh tools/rehearse.sh $(ARGS)

test: $(VENV)/.test-ready
	$(BIN)/python -m pytest -n 4 -m 'not long' $(PYTEST_ARGS)

# closed forms, conventions and refusals, chosen by their processor time: what takes seconds is left to `make test`
QUICK := tests/test_sign_conventions.py $(addprefix tests/, optics mechanics warp rig sensing exposure control tools) \
	tests/surface/test_integrate.py tests/surface/test_lever.py tests/surface/test_gaps.py tests/loop/test_state.py \
	tests/contact/test_force.py tests/contact/test_moments_and_track.py tests/decoding/test_decoding.py tests/decoding/test_periods.py \
	tests/calibration/test_measurements.py tests/pattern/test_strips.py tests/export/test_tiff.py tests/publishing/test_message.py

test-quick: $(VENV)/.test-ready
	$(BIN)/python -m pytest -n 2 -m 'not long' $(QUICK) $(PYTEST_ARGS)

mutants: $(VENV)/.test-ready
	@$(BIN)/python -m tools.mutants $(ARGS)

test-long: $(VENV)/.test-ready
	$(BIN)/python -m pytest -m long

lint: $(VENV)/.dev-ready
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python tools/check_api_docs.py
	$(BIN)/python tools/size.py --check

size: $(VENV)/.run-ready
	@$(BIN)/python tools/size.py

golden: $(VENV)/.run-ready
	@$(BIN)/python -m tools.golden $(ARGS)

golden-baseline: $(VENV)/.run-ready
	@$(BIN)/python -m tools.golden --baseline

bench: $(VENV)/.run-ready
	@mkdir -p out
	$(BIN)/python -m benchmarks.against_peers --figure out/bench.png --summary out/bench.json
	@for name in sigma press_suite peaks step_response wavelength_gain contacts contact_image curved_faces acquisition folds nuisances lightings touches scenarios every_pixel still_errors page_cost page_memory long_hold fault_tour live_cost honesty calibration_benches force calibration_study decoding passive_textures contactless leds interactive rubbing touch_faults thin; do \
		case $$name in live_cost|honesty|calibration_benches|force|lightings|contactless|interactive|touch_faults|touches|scenarios|every_pixel|page_memory|thin) quick=--quick;; *) quick=;; esac; \
		echo "$(BIN)/python -m benchmarks.$$name $$quick"; \
		$(BIN)/python -m benchmarks.$$name $$quick --summary out/$$name.json || exit; \
	done

bars: $(VENV)/.run-ready
	$(BIN)/python -m benchmarks.bars --salt "$(SALT)" $(ARGS)

$(BIN)/python:
	@echo "1 of 3: system packages, and an empty environment in $(VENV) (up to a minute)"
	@PYTHON=$(PYTHON) sh tools/system-packages.sh
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "zeromethod needs Python 3.11 or newer; $(PYTHON) is $$($(PYTHON) --version). Try: make PYTHON=python3.11" >&2; exit 2; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/.run-ready: pyproject.toml | $(BIN)/python
	@PYTHON=$(PYTHON) sh tools/system-packages.sh
	@echo "2 of 3: Python packages into $(VENV) (up to a minute)"
	@$(PIP) --editable .
	@touch $@

$(VENV)/.test-ready: pyproject.toml | $(BIN)/python
	@PYTHON=$(PYTHON) sh tools/system-packages.sh test
	@echo "Python packages for the tests into $(VENV)"
	@$(PIP) --editable '.[test]'
	@touch $@ $(VENV)/.run-ready

$(VENV)/.dev-ready: pyproject.toml | $(BIN)/python
	@echo "Python packages for developing into $(VENV)"
	@$(PIP) --editable '.[test,dev]'
	@touch $@ $(VENV)/.run-ready

clean:
	rm -rf $(VENV) out dist build
