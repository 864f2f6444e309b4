# `make install` sets up .venv for use, `make demo` draws with it, `make test` sets it up for work and tests everything.

# Three parts at a time: libraries and tools are loaded from the network while the kernels are compiled, and mypy checks
# beside the tests.
MAKEFLAGS += --jobs=3
unexport MAKEFLAGS MFLAGS  # or ninja would compile on three cores of however many
ifneq ($(filter clean,$(MAKECMDGOALS)),)
.NOTPARALLEL:  # what is made anew comes after
endif

PYTHON ?= python3
TORCH_INDEX ?= https://download.pytorch.org/whl/cpu
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check
# pip would compile modules on one core, and those that nothing here loads as well: the libraries' own tests, what torch
# compiles models with, and mypy's sources beside what they were compiled to. Some are for other Pythons, and fail.
export PIP_COMPILE := 0
NEVER_LOADED := /(tests?|sympy|mpmath|mypyc?|torch/(_dynamo|_inductor|onnx))/
COMPILE := @$(BIN)/python -m compileall -qq -j 0 -x '$(NEVER_LOADED)' $(VENV)/lib || true
INSTALLED := $(VENV)/.installed
READY := $(VENV)/.ready
SHARED_NUMBERS := $(addprefix protocol/rules/,closed_tiles.py image_tiles.py index_rules.py packet_layout.py rounding.py)
BUILD_INPUTS := pyproject.toml constraints.txt CMakeLists.txt $(SHARED_NUMBERS) \
	$(wildcard kernels/* kernels/channels/* kernels/tables/* */kernels/*.cpp */kernels/*.h */kernels/*/*)

.DEFAULT_GOAL := help
.PHONY: help install demo test docs clang sanitize aarch64 bench clean

help: ## list the targets
	@grep -E '^[a-z0-9]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

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
	$(PIP) install -c constraints.txt '.[torch,ui,formats,pdf]'
	$(COMPILE)
	@touch $@

# With build tools that stay where they are, only what has changed is compiled again: pip would load them into a new
# folder each time.
BUILD_TOOLS := $(VENV)/.build_tools
$(BUILD_TOOLS): pyproject.toml | $(VENV)/bin/python
	$(PIP) install $$($(BIN)/python -c "import tomllib; \
		print(*tomllib.load(open('pyproject.toml', 'rb'))['project']['optional-dependencies']['build'])")
	@touch $@

# To compile takes a minute or two and none of the libraries, which are loaded and unpacked meanwhile. They need the build
# tools as well: two runs of pip must not put the same ones in place at once.
COMPILED := $(VENV)/.compiled
$(COMPILED): $(BUILD_INPUTS) $(BUILD_TOOLS)
	@echo "beside it: volsplat; compiling its kernels takes a minute or two"
	$(PIP) install --no-build-isolation --no-deps --editable .
	@touch $@

LIBRARIES := $(VENV)/.libraries
$(LIBRARIES): pyproject.toml constraints.txt packaging/libraries.py $(TORCH) | $(BUILD_TOOLS)
	@echo "3 of 3: what volsplat and its tests need"
	$(BIN)/python packaging/libraries.py dev > $@.txt
	$(PIP) install -c constraints.txt -r $@.txt
	@touch $@

$(READY): $(COMPILED) $(LIBRARIES)
	$(COMPILE)
	@touch $@

# A .venv that is set up for work serves for use as well.
USABLE := $(if $(wildcard $(READY)),$(READY),$(INSTALLED))

install: $(USABLE) ## set up .venv for use: the commands, the page, every file format

demo: $(USABLE) ## render the head phantom with two map/shade servers and a splat server, six steps
	$(BIN)/volsplat demo --output demo

# What holds of every image; any machine of a lab may be without AVX, so all of it must hold on the baseline path.
PROPERTIES := $(addprefix tests/,$(addprefix exactness/test_,order_independence.py reference.py closed_forms.py \
	visibility.py handedness.py known_light.py) mapshade_server/test_classified_rows.py \
	$(addprefix splat_server/test_,volume_edges.py closed_tiles.py splat_server.py) \
	session/test_session.py::test_every_step_is_the_same_distributed_and_single)
# Of the reference alone, to which all paths are one.
NO_PATH := $(addprefix --deselect tests/exactness/test_reference.py::test_,both_orders_of_the_reference_agree \
	what_is_quantised_on_the_wire_hardly_shows)

# The page is tested in a real Chromium (Debian's shell of it does a page for half the work) and a real Firefox, movies
# with ffmpeg, machines of a lab with sshd, which package openssh-server brings, their networks with nft of nftables, and
# clusters with Slurm; where they cannot be installed, those tests say so.
TOOLS := ffmpeg sshd nft
ENGINES := munged slurmctld slurmd
# Of the programs that are its argument, those that are missing.
INSTALL = for tool in $(1); do PATH="$$PATH:/usr/sbin" command -v $$tool > /dev/null || missing="$$missing $$tool"; done; \
	if [ -z "$$missing" ]; then exit 0; fi; \
	if [ "$$(id -u)" = 0 ] && command -v apt-get > /dev/null; then \
		apt-get update -qq && apt-get install -qq -y --no-install-recommends \
			$$(echo "$$missing" | sed 's/\bsshd\b/openssh-server/; s/\bnft\b/nftables/; s/\bmunged\b/munge/') > /dev/null; \
	else echo "not found:$$missing; tests that need them will be skipped"; fi
.PHONY: tools
tools:
	@$(call INSTALL,$(TOOLS))
	@{ [ "$$(id -u)" != 0 ] && command -v chromium > /dev/null; } || ($(call INSTALL,chromium-headless-shell)) || \
		($(call INSTALL,chromium))
	@{ [ "$$(id -u)" != 0 ] && command -v firefox > /dev/null; } || ($(call INSTALL,firefox-esr)) || \
		echo "no Firefox could be installed; tests that need it will be skipped"
	@($(call INSTALL,$(ENGINES))) || echo "no Slurm could be installed; tests that need it will be skipped"

CPP := $(foreach room,kernels kernels/channels kernels/tables */kernels */kernels/*,$(wildcard $(room)/*.cpp $(room)/*.h))

# Lint comes first, whose seconds need not wait for a quarter of an hour; mypy takes a core for half a minute.
test: lint types tried ## lint, type-check and test, the properties on the baseline CPU path as well
.PHONY: lint types tried
lint: $(READY)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/clang-format --dry-run -Werror $(CPP)

types: $(READY)
	$(BIN)/mypy

# Thousands of tests with processes, sockets and browsers: one that the machine was too slow for must not cost the run,
# nor may it pass unseen. Three at most are tried again, and what they failed by at first is printed.
SECOND_TRY := --reruns 1 --max-suite-reruns 3 --rerun-show-tracebacks

# Where Python is told to write no bytecode, each program that tests start would compile what it imports, for a third of
# a second.
PROGRAMS := bench client deploy front mapshade_server program protocol splat_server tests/support

tried: lint tools
	@$(BIN)/python -m compileall -q $(PROGRAMS)
	$(BIN)/pytest -n auto --dist worksteal $(SECOND_TRY)
	VOLSPLAT_CPU_PATH=baseline $(BIN)/pytest -n auto --dist worksteal $(SECOND_TRY) $(PROPERTIES) $(NO_PATH)

# What each compiler must give: the kernels' own tests, and that all instruction sets agree.
KERNEL_TESTS := $(addprefix tests/,mapshade_server/test_kernel_map_shade.py mapshade_server/test_kernel_voxel_packets.py \
	$(addprefix splat_server/test_,merge_order.py owners.py kernel_splat.py tile_maps.py) \
	protocol/test_kernel_constants.py bench/test_bench_floors.py exactness/test_order_independence.py)
# A virtual environment of its own, which borrows the libraries of .venv.
BESIDE = $(PYTHON) -m venv $(1); \
	$(BIN)/python -c "import sysconfig; print(sysconfig.get_path('purelib'))" > $(1)/borrowed; \
	cp $(1)/borrowed $$($(1)/bin/python -c "import sysconfig; print(sysconfig.get_path('purelib'))")/borrowed.pth
INTO = $(1)/bin/python -m pip --disable-pip-version-check install --no-build-isolation --no-deps -C build-dir=$(1)/objects

CLANG := build/clang
CLANG_CC ?= clang
CLANG_CXX ?= clang++

clang: $(READY) ## compile the kernels with Clang, beside .venv, and test them
	$(call BESIDE,$(CLANG))
	CC=$(CLANG_CC) CXX=$(CLANG_CXX) $(call INTO,$(CLANG)) -C cmake.define.VOLSPLAT_STRICT=ON .
	$(CLANG)/bin/python -m pytest -n auto $(KERNEL_TESTS)

SANITIZED := build/asan
SANITIZERS := -fsanitize=address,undefined,float-cast-overflow -fsanitize-recover=all -fno-omit-frame-pointer \
	-D_GLIBCXX_ASSERTIONS
PRELOADED = $(foreach library,asan ubsan stdc++,$$(g++ -print-file-name=lib$(library).so))

sanitize: $(READY) ## compile the kernels with GCC's sanitizers, beside .venv, and test them
	$(call BESIDE,$(SANITIZED))
	CC=gcc CXX=g++ CXXFLAGS="$(SANITIZERS)" $(call INTO,$(SANITIZED)) -C cmake.build-type=RelWithDebInfo \
		-C cmake.define.CMAKE_CXX_FLAGS_RELWITHDEBINFO="-O2 -g1 -DNDEBUG" -C install.strip=false .
	LD_PRELOAD="$(PRELOADED)" ASAN_OPTIONS=detect_leaks=0 UBSAN_OPTIONS=halt_on_error=1:print_stacktrace=1 \
		PYTHONMALLOC=malloc $(SANITIZED)/bin/python -m pytest -n auto $(KERNEL_TESTS)

# Needs g++-aarch64-linux-gnu and qemu-user, as Debian calls them.
SAME_BITS := build/same_bits
aarch64: ## compile the baseline kernels for another processor, and run them there: the bits must be the same
	mkdir -p $(SAME_BITS)
	$(PYTHON) kernels/write_constants.py $(SAME_BITS)/kernels/constants.h $(SHARED_NUMBERS)
	for machine in $$(uname -m) aarch64; do \
		$$machine-linux-gnu-g++ -std=c++20 -O2 -static -ffp-contract=off -Wno-psabi -DVOLSPLAT_PATH=baseline -I. -I$(SAME_BITS) \
			-o $(SAME_BITS)/$$machine kernels/tests/same_bits.cpp mapshade_server/kernels/paths/*.cpp \
			splat_server/kernels/paths/*.cpp || exit 1; \
	done
	$(SAME_BITS)/$$(uname -m) > $(SAME_BITS)/here
	qemu-aarch64 $(SAME_BITS)/aarch64 > $(SAME_BITS)/there
	cat $(SAME_BITS)/there
	cmp $(SAME_BITS)/here $(SAME_BITS)/there

bench: $(READY) ## print the kernels' speeds beside their floors, the paper's table and the peers' times
	$(BIN)/volsplat bench kernels
	$(BIN)/volsplat bench paper --phantom head:96x128x113
	$(BIN)/volsplat bench scaling --phantom shells:256
	$(BIN)/volsplat bench peers --phantom shells:256
	$(BIN)/volsplat bench aborts

docs: $(READY) ## build the site of docs/ into build/site, with pictures by the commands that it prints
	$(BIN)/python -m sphinx --fail-on-warning --keep-going --quiet --builder html docs build/site

clean: ## remove the virtual environment, builds, and demo and docs images
	rm -rf $(VENV) build demo docs/made
