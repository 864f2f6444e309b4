# Two commands do everything: `make demo` and `make test`. Each sets up .venv by itself.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
BUILD_INPUTS := pyproject.toml constraints.txt CMakeLists.txt $(wildcard */kernels/*.cpp */kernels/*.h */kernels/paths/*)

.DEFAULT_GOAL := help
.PHONY: help demo test check bench clean

help: ## list the targets
	@grep -E '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

# torch comes first and through the constraints file: its newest build on PyPI pulls in gigabytes of CUDA.
$(READY): $(BUILD_INPUTS)
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt torch
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt --editable '.[dev]'
	@touch $@

demo: $(READY) ## render the head phantom with two map/shade servers and a splat server, six steps
	$(BIN)/volsplat demo --output demo

# What holds of every image; any machine of a lab may be without AVX, so all of it must hold on the baseline path.
PROPERTIES := $(addprefix tests/test_,order_independence.py reference.py closed_forms.py visibility.py handedness.py \
	known_light.py volume_edges.py classified_rows.py closed_tiles.py splat_server.py session.py)

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
	$(BIN)/pytest -n auto
	VOLSPLAT_CPU_PATH=baseline $(BIN)/pytest -n auto $(PROPERTIES)

bench: $(READY) ## print the kernels' speeds beside their floors, the paper's table and the peers' times
	$(BIN)/volsplat bench kernels
	$(BIN)/volsplat bench paper --phantom head:96x128x113
	$(BIN)/volsplat bench scaling --phantom shells:256
	$(BIN)/volsplat bench peers --phantom shells:256
	$(BIN)/volsplat bench aborts

clean: ## remove the virtual environment, builds and demo images
	rm -rf $(VENV) build demo
