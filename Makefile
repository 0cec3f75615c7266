# Two commands do everything on a fresh machine with Python >= 3.10, a C++ compiler and make:
#   make demo    train ringlight and 3dgs on the bundled chrome toaster, print the table, write a page to open
#   make test    run the tests
# Both set up .venv first; a second call sets nothing up again.
SHELL := /bin/sh
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.ringlight-installed
BUILT_FROM := pyproject.toml constraints.txt CMakeLists.txt cmake/write_convention.py \
	src/ringlight/rasterize/convention.py $(wildcard kernels/*/*.*pp) \
	$(addprefix src/ringlight/core/,kernel_limits.py directions.py sh_basis.py)
WORKERS ?= 2

.PHONY: setup demo test lint bench unplug kills lenses threads fuzz sanitize valgrind clean

setup: $(STAMP)

$(STAMP): $(BUILT_FROM) scripts/setup.sh
	@PYTHON="$(PYTHON)" VENV="$(VENV)" STAMP="$(STAMP)" sh scripts/setup.sh

demo: setup
	@$(BIN)/ringlight demo

test: setup
	@$(BIN)/python -m pytest -n $(WORKERS) --dist worksteal

lint: setup
	@$(BIN)/ruff check . && $(BIN)/ruff format --check . && $(BIN)/mypy && $(BIN)/lint-imports

bench: setup
	@$(BIN)/ringlight bench raster && $(BIN)/ringlight bench parts && $(BIN)/ringlight bench step

# The long tests of docs/reliability.md. Minutes to an hour each.
KILLS ?= 200
TIMES ?= 5
FILES ?= 1000000
FUZZ_SECONDS ?= 600

unplug: setup
	@$(BIN)/python tests/unplugging.py --kills $(KILLS)

kills: setup
	@$(BIN)/python tests/kill_matrix.py --times $(TIMES)

# SCENES: folders of NeRF-Synthetic's kind or COLMAP's, photographed with a pinhole.
lenses: setup
	@$(BIN)/python tests/lens_matrix.py $(SCENES)

threads: setup
	@$(BIN)/python tests/thread_hashes.py

fuzz: setup
	@$(BIN)/python tests/fuzzing/run.py --count $(FILES)
	@if $(BIN)/python -m pip --disable-pip-version-check --quiet install atheris 2>/dev/null; \
	then $(BIN)/python tests/fuzzing/run.py --guided --count $(FILES) --seconds $(FUZZ_SECONDS); \
	else echo "atheris cannot be installed here: no coverage-guided run"; fi

sanitize: setup
	@PATH="$(CURDIR)/$(BIN):$$PATH" PYTHON="$(BIN)/python" sh scripts/sanitize.sh

valgrind: setup
	@PYTHON="$(BIN)/python" sh scripts/valgrind.sh

clean:
	rm -rf $(VENV) build src/ringlight/_kernels.pyi
