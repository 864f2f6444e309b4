# `make install` sets up .venv for use, `make demo` draws with it, `make test` sets it up for work and tests everything.

PYTHON ?= python3
TORCH_INDEX ?= https://download.pytorch.org/whl/cpu
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check
INSTALLED := $(VENV)/.installed
READY := $(VENV)/.ready
BUILD_INPUTS := pyproject.toml constraints.txt CMakeLists.txt $(wildcard kernels/* */kernels/*.cpp */kernels/*.h */kernels/*/*)

.DEFAULT_GOAL := help
.PHONY: help install demo test bench clean

help: ## list the targets
	@grep -E '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

# torch comes first: packaging/cpu_torch.py finds its CPU build, where pip alone would load gigabytes of CUDA.
$(VENV)/bin/python:
	@echo "1 of 3: a virtual environment in $(VENV)"
	$(PYTHON) -m venv $(VENV)

TORCH := $(VENV)/.torch
$(TORCH): constraints.txt packaging/cpu_torch.py | $(VENV)/bin/python
	@echo "2 of 3: torch, about 200 MB"
	$(BIN)/python packaging/cpu_torch.py --index $(TORCH_INDEX)
	@touch $@

COMPILING := 3 of 3: volsplat and what it needs; compiling its kernels takes a minute or two

$(INSTALLED): $(BUILD_INPUTS) $(TORCH)
	@echo "$(COMPILING)"
	$(PIP) install -c constraints.txt '.[torch,ui,formats]'
	@touch $@

$(READY): $(BUILD_INPUTS) $(TORCH)
	@echo "$(COMPILING)"
	$(PIP) install -c constraints.txt --editable '.[dev]'
	@touch $@

# A .venv that is set up for work serves for use as well.
USABLE := $(if $(wildcard $(READY)),$(READY),$(INSTALLED))

install: $(USABLE) ## set up .venv for use: the commands, the page, every file format

demo: $(USABLE) ## render the head phantom with two map/shade servers and a splat server, six steps
	$(BIN)/volsplat demo --output demo

# What holds of every image; any machine of a lab may be without AVX, so all of it must hold on the baseline path.
PROPERTIES := $(addprefix tests/,$(addprefix exactness/test_,order_independence.py reference.py closed_forms.py \
	visibility.py handedness.py known_light.py) mapshade_server/test_classified_rows.py \
	$(addprefix splat_server/test_,volume_edges.py closed_tiles.py splat_server.py) session/test_session.py)

# The page is tested in a real browser, and movies with ffmpeg; where they cannot be installed, those tests say so.
TOOLS := chromium ffmpeg
.PHONY: tools
tools:
	@for tool in $(TOOLS); do command -v $$tool > /dev/null || missing="$$missing $$tool"; done; \
	if [ -z "$$missing" ]; then exit 0; fi; \
	if [ "$$(id -u)" = 0 ] && command -v apt-get > /dev/null; then \
		apt-get update -qq && apt-get install -qq -y --no-install-recommends $$missing > /dev/null; \
	else echo "not found:$$missing; tests that need them will be skipped"; fi

test: $(READY) tools ## lint, type-check and test, the properties on the baseline CPU path as well
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/pytest -n auto --dist worksteal
	VOLSPLAT_CPU_PATH=baseline $(BIN)/pytest -n auto --dist worksteal $(PROPERTIES)

bench: $(READY) ## print the kernels' speeds beside their floors, the paper's table and the peers' times
	$(BIN)/volsplat bench kernels
	$(BIN)/volsplat bench paper --phantom head:96x128x113
	$(BIN)/volsplat bench scaling --phantom shells:256
	$(BIN)/volsplat bench peers --phantom shells:256
	$(BIN)/volsplat bench aborts

clean: ## remove the virtual environment, builds and demo images
	rm -rf $(VENV) build demo
