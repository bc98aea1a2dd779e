# Two commands do everything: `make run` and `make test`.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --editable
C_SOURCES := $(wildcard csrc/*.c)
C_FILES := $(wildcard csrc/*.[ch] csrc/*.inc tests/c/*.[ch] bench/*/*.[ch] toolchain/*/*.c)
C_TESTS := $(patsubst tests/c/%.c,build/c/%,$(wildcard tests/c/test_*.c))
WARNINGS := -Wall -Wextra -Wpedantic -Wconversion -Werror -std=c11
SANITIZE := -fsanitize=address,undefined -fno-sanitize-recover=all -fno-omit-frame-pointer

.PHONY: run test board lint bench bench-accuracy clean install test-c goldens

run: $(VENV)/run  ## the live program on five simulated devices
	$(BIN)/tinyekf run --simulate

test: install lint test-c  ## everything
	$(BIN)/python -m pytest

board:  ## the packages for armhf and arm64, tried on emulated boards; as root
	toolchain/setup-host.sh
	toolchain/debian-package.sh armhf
	toolchain/debian-package.sh arm64
	toolchain/emulated-board.sh armhf
	toolchain/emulated-board.sh arm64 replay

install: $(VENV)/install

# What to run takes little; what to test takes all extras. The core is rebuilt whenever something in it has changed.
$(VENV)/run: EXTRAS := console,geomag,web
$(VENV)/install: EXTRAS := test,all
$(VENV)/run $(VENV)/install: pyproject.toml setup.py tinyekf_py/_core_build.py $(wildcard csrc/*)
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(PIP) ".[$(EXTRAS)]"
	touch $@

lint: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	clang-format --dry-run --Werror $(C_FILES)
	gcc $(WARNINGS) -O2 -Icsrc -fsyntax-only $(C_SOURCES)
	gcc $(WARNINGS) -O2 -Icsrc -fsyntax-only -DEKF_REAL=float $(C_SOURCES)

test-c: $(C_TESTS)
	@for test in $(C_TESTS); do ./$$test || exit 1; done

build/c/%: tests/c/%.c tests/c/expect.h $(wildcard csrc/*)
	@mkdir -p $(@D)
	gcc $(WARNINGS) $(SANITIZE) -O1 -g -ffp-contract=off -Icsrc $< $(C_SOURCES) -lm -o $@

bench: install
	$(PIP) ".[bench]"
	$(MAKE) --no-print-directory -C bench/ekf
	$(BIN)/python bench/python_filter.py
	$(BIN)/python bench/replay.py
	$(BIN)/python bench/live_load.py

goldens: install  ## the reference's outputs anew, by GNU Octave
	PYTHON=$(BIN)/python sh tests/reference/make_goldens.sh

bench-accuracy: install  ## methods against the truth over the named scenarios
	$(PIP) ".[bench]"
	$(BIN)/python bench/accuracy/run.py

clean:
	rm -rf build dist $(VENV) *.egg-info tinyekf_py/_core.c tinyekf_py/*.so .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
