# What people do with this project. `make run` and `make test` work on a bare Debian 12 with Rust ≥ 1.95.

SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help

BUILD_PACKAGES := build-essential pkg-config clang libclang-dev libavcodec-dev libavformat-dev libavutil-dev \
                  libswscale-dev libswresample-dev
TEST_PACKAGES  := ffmpeg chromium nodejs curl jq openssl strace
TARGET := $(or $(CARGO_TARGET_DIR),target)
SUDO := $(shell [ "$$(id -u)" = 0 ] || echo sudo)

# Installs what is missing and nothing else; silent when all is there.
define install
	missing=$$(for p in $(1); do dpkg-query -W -f='$${Status}' $$p 2>/dev/null | grep -q 'ok installed' || echo $$p; done); \
	if [ -n "$$missing" ]; then \
	    echo "installing" $$missing; \
	    $(SUDO) apt-get update -qq; \
	    DEBIAN_FRONTEND=noninteractive $(SUDO) apt-get install -y -qq --no-install-recommends $$missing >/dev/null; \
	fi
endef

.PHONY: help
help: ## this list
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 18

DATA   ?= trocar-data
LISTEN ?= 127.0.0.1:8080

.PHONY: run
run: packages ## build, start the service with its demonstration centre, print how to sign in
	exec cargo run --release --locked -- serve --data $(DATA) --listen $(LISTEN) --demo

.PHONY: packages
packages: ## install the system packages that a build needs
	@$(call install,$(BUILD_PACKAGES))

.PHONY: test-packages
test-packages: packages
	@$(call install,$(TEST_PACKAGES))
	@command -v npm >/dev/null || { $(call install,npm); }

.PHONY: test
test: test-packages ## everything that decides whether a change may land
	cargo fetch --locked # all platforms' packages: the licence check reads them without the network
	cargo fmt --check
	cargo clippy --locked --all-targets -- -D warnings
	cargo test --locked
	RUSTDOCFLAGS='-D warnings' cargo doc --locked --no-deps --document-private-items
	$(MAKE) browser-test

.PHONY: browser-test
browser-test: test-packages ## a real Chromium signs in, uploads, waits for the score and plays the overlay
	cargo test --locked --no-run --test integration # builds the program, with the dependencies that the tests have built
	tests/browser/run $(abspath $(TARGET)/debug/trocar)

.PHONY: browser-demo
browser-demo: release test-packages ## the same in the demonstration centre, once its recordings are scored
	TROCAR_CENTRE=demo tests/browser/run $(abspath $(RELEASE))

.PHONY: deny
deny: packages ## licences, sources and banned crates with cargo-deny (installs it)
	command -v cargo-deny >/dev/null || cargo install --locked cargo-deny
	cargo deny check licenses bans sources

# ── nightly: too slow for every change ──────────────────────────────────────────────────────────────────────────────

SHARED ?= ../shared
RELEASE := $(TARGET)/release/trocar

.PHONY: release
release: packages
	cargo build --release --locked

.PHONY: figures
figures: release test-packages ## every figure of the README, beside the OpenCV peer and the limits; FIGURES="--quick --only rest" to try one
	@$(call install,python3-venv)
	python3 benches/figures $(RELEASE) $(SHARED) $(TARGET)/figures $(or $(FIGURES),--readme README.md)

.PHONY: foreign-clients
foreign-clients: release test-packages ## 500 MB by tus-js-client and tus-py-client, with cuts; memory of the server
	@$(call install,python3-venv)
	tests/clients/run.py $(RELEASE)

.PHONY: kills
kills: test-packages ## the service and its children killed 50 times each, during uploads and jobs
	TROCAR_KILLS=50 cargo test --locked --test integration faults -- --nocapture

.PHONY: feed-faults
feed-faults: test-packages ## 500 recordings sent frame by frame, each through ten faults on the way
	TROCAR_FEEDS=500 cargo test --locked --test integration no_acknowledged_frame -- --nocapture

.PHONY: long-absence
long-absence: test-packages ## the service is away for ten minutes while an agent records; TROCAR_AWAY_S=60 to try one
	cargo test --locked --test integration away_for_long -- --ignored --nocapture

.PHONY: live-load
live-load: release test-packages ## boxes that this machine sustains live, against bare decoding, and the latency of positions
	TROCAR_PROGRAM=$(abspath $(RELEASE)) cargo test --locked --test integration this_machine_sustains -- --ignored --nocapture

.PHONY: progress-load
progress-load: release test-packages ## a trainee's progress over 500 sessions among 10,000, beside /healthz; the queries behind it
	cargo test --locked --lib progress_reads_no_table -- --nocapture
	TROCAR_PROGRAM=$(abspath $(RELEASE)) cargo test --locked --test integration what_progress_costs -- --ignored --nocapture

.PHONY: power-cuts
power-cuts: test-packages ## 20 power cuts during uploads and jobs, on a file system of its own; needs root
	@$(call install,e2fsprogs mount)
	TROCAR_KILLS=20 cargo test --locked --test integration power_is_cut -- --ignored --nocapture

.PHONY: slow-clients
slow-clients: test-packages ## a thousand slow clients beside a quick one: its 99th percentile, the service's memory
	cargo test --locked --test integration slow_clients -- --ignored --nocapture

.PHONY: mutations
mutations: test-packages ## 10,000 damaged recordings, each decoded in a child
	TROCAR_MUTATIONS=10000 cargo test --locked --test integration damaged_recordings -- --nocapture

.PHONY: long-queue
long-queue: packages ## 10,000 jobs with random deaths and pauses, and what 10,000 waiting ones cost
	TMPDIR=/dev/shm cargo test --locked --lib ten_thousand -- --ignored --nocapture
