# Common tasks of this project. `make run` and `make test` work on a bare Debian 12 with Rust ≥ 1.95.

SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help

BUILD_PACKAGES := build-essential pkg-config clang libclang-dev libavcodec-dev libavformat-dev libavutil-dev \
                  libswscale-dev libswresample-dev
TEST_PACKAGES  := ffmpeg chromium nodejs curl jq openssl strace
TARGET := $(or $(CARGO_TARGET_DIR),target)
SUDO := $(shell [ "$$(id -u)" = 0 ] || echo sudo)

# Installs only missing packages; silent if none is missing.
define install
	missing=$$(for p in $(1); do dpkg-query -W -f='$${Status}' $$p 2>/dev/null | grep -q 'ok installed' || echo $$p; done); \
	if [ -n "$$missing" ]; then \
	    echo "installing" $$missing; \
	    $(SUDO) apt-get update -qq; \
	    DEBIAN_FRONTEND=noninteractive $(SUDO) apt-get install -y -qq --no-install-recommends $$missing >/dev/null; \
	fi
endef

.PHONY: help
help: ## print this list
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 18

DATA   ?= trocar-data
LISTEN ?= 127.0.0.1:8080

.PHONY: run
run: packages ## build, start the service with the demonstration centre, print how to sign in
	exec cargo run --release --locked -- serve --data $(DATA) --listen $(LISTEN) --demo

.PHONY: packages
packages: ## install the system packages that a build needs
	@$(call install,$(BUILD_PACKAGES))

.PHONY: test-packages
test-packages: packages
	@$(call install,$(TEST_PACKAGES))
	@command -v npm >/dev/null || { $(call install,npm); }

.PHONY: test
test: export TROCAR_SKIPS = $(abspath $(TARGET))/skipped.txt
test: test-packages ## run every check that a change must pass
	rm -f $(TROCAR_SKIPS)
	cargo fetch --locked # the packages of all platforms: the licence check reads them without the network
	cargo fmt --all --check
	cargo clippy --locked --workspace --all-targets -- -D warnings
	cargo test --locked --workspace
	RUSTDOCFLAGS='-D warnings' cargo doc --locked --workspace --no-deps --document-private-items
	$(MAKE) page-check
	$(MAKE) browser-test
	$(MAKE) fuzz-short
	@touch $(TROCAR_SKIPS); echo "tests skipped: $$(wc -l <$(TROCAR_SKIPS))"; cat $(TROCAR_SKIPS)

.PHONY: page-check
page-check: test-packages ## check the pages' code with tsc and ESLint, against the types of the service's OpenAPI document
	cargo test --locked --no-run --test integration # builds the program with the dependencies that the tests have built
	tests/pages/run $(abspath $(TARGET)/debug/trocar)

.PHONY: browser-test
browser-test: test-packages ## test the pages in a real Chromium: sign in, upload, wait for the score, play the overlay
	cargo test --locked --no-run --test integration # builds the program with the dependencies that the tests have built
	tests/browser/run $(abspath $(TARGET)/debug/trocar)

.PHONY: fuzz-short
fuzz-short: test-packages ## make requests from the OpenAPI document, as every role, for 8 seconds each
	@$(call install,python3-venv)
	cargo test --locked --no-run --test integration # builds the program with the dependencies that the tests have built
	tests/fuzz/run.py $(abspath $(TARGET)/debug/trocar) --seconds 8

.PHONY: golden
golden: test-packages ## replace the golden files after an intended change of numbers; explain it in the commit
	TROCAR_GOLDEN=write cargo test --locked --test integration golden

.PHONY: schema
schema: packages ## replace docs/schema.sql after a new migration
	TROCAR_GOLDEN=write cargo test --locked --test integration schema

.PHONY: browser-demo
browser-demo: release test-packages ## the same in the demonstration centre, after its recordings are scored
	TROCAR_CENTRE=demo tests/browser/run $(abspath $(RELEASE))

.PHONY: deny
deny: packages ## check licences, sources and banned crates with cargo-deny (installs it)
	command -v cargo-deny >/dev/null || cargo install --locked cargo-deny
	cargo deny check licenses bans sources # no advisories: deny.toml says why, and when to check them

# ── nightly: too slow for every change ──────────────────────────────────────────────────────────────────────────────

SHARED ?= ../shared
RELEASE := $(TARGET)/release/trocar

.PHONY: release
release: packages
	cargo build --release --locked

.PHONY: figures
figures: release test-packages ## measure all figures of docs/accuracy.md; FIGURES="--quick --only rest" to try one part
	@$(call install,python3-venv)
	python3 benches/figures $(RELEASE) $(SHARED) $(TARGET)/figures $(if $(MORE_WORLDS),--more-worlds $(MORE_WORLDS)) \
	    $(or $(FIGURES),--document docs/accuracy.md)

.PHONY: foreign-clients
foreign-clients: release test-packages ## upload 500 MB with tus-js-client and tus-py-client, with cuts; measure the server's memory
	@$(call install,python3-venv)
	tests/clients/run.py $(RELEASE)

.PHONY: fuzz
fuzz: release test-packages ## make requests from the OpenAPI document, as every role, for two minutes each; FUZZ="--seconds 600" for longer
	@$(call install,python3-venv)
	tests/fuzz/run.py $(RELEASE) $(FUZZ)

.PHONY: kills
kills: test-packages ## kill the service and its child processes 50 times each, during uploads and jobs
	TROCAR_KILLS=50 cargo test --locked --test integration faults -- --nocapture

.PHONY: feed-faults
feed-faults: test-packages ## send 500 recordings frame by frame, each with ten faults on the way
	TROCAR_FEEDS=500 cargo test --locked --test integration no_acknowledged_frame -- --nocapture

.PHONY: long-absence
long-absence: test-packages ## stop the service for ten minutes while an agent records; TROCAR_AWAY_S=60 for one minute
	cargo test --locked --test integration away_for_long -- --ignored --nocapture

.PHONY: network-outage
network-outage: test-packages ## take a box's network away for an hour while it records; TROCAR_OUTAGE_MINUTES=2 for two minutes; needs 2 GB of disk
	cargo test --locked --test integration away_for_an_hour -- --ignored --nocapture

.PHONY: corrections
corrections: test-packages ## move and cut sessions, merge and separate records 1,000 times at random: every figure equals that of a new centre
	TROCAR_CORRECTIONS=1000 cargo test --locked --test integration random_corrections -- --nocapture

.PHONY: old-recordings
old-recordings: test-packages ## send 400 old recordings by `trocar upload`, killed at ten random moments: each arrives once
	cargo test --locked --test integration four_hundred_recordings -- --ignored --nocapture

.PHONY: live-load
live-load: release test-packages ## measure how many boxes this machine sustains, and the latency of positions, and what watchers cost; LOAD=tape, bare or watchers for one kind
	$(if $(LOAD),TROCAR_LOAD=$(LOAD)) TROCAR_PROGRAM=$(abspath $(RELEASE)) cargo test --locked --test integration this_machine_sustains -- --ignored --nocapture --test-threads 1

.PHONY: progress-load
progress-load: release test-packages ## measure the progress of a trainee with 500 sessions among 10,000, beside /healthz; check its queries
	cargo test --locked --lib progress_reads_no_table -- --nocapture
	TROCAR_PROGRAM=$(abspath $(RELEASE)) cargo test --locked --test integration what_progress_costs -- --ignored --nocapture

.PHONY: power-cuts
power-cuts: test-packages ## simulate 20 power cuts during uploads and jobs, on a separate file system; needs root
	@$(call install,e2fsprogs mount)
	TROCAR_KILLS=20 cargo test --locked --test integration power_is_cut -- --ignored --nocapture

.PHONY: slow-clients
slow-clients: test-packages ## connect a thousand slow clients and a quick one; measure its 99th percentile and the service's memory
	cargo test --locked --test integration slow_clients -- --ignored --nocapture

.PHONY: morning-load
morning-load: release test-packages ## a class signs in, 200 browsers show Live, 50 uploads and 1,000 slow clients: times of reading, memory
	TROCAR_PROGRAM=$(abspath $(RELEASE)) cargo test --locked --test integration a_busy_morning -- --ignored --nocapture

.PHONY: largest-table
largest-table: release test-packages ## import and score the largest table that the service accepts, within the default limits
	TROCAR_PROGRAM=$(abspath $(RELEASE)) cargo test --locked --test integration the_largest_table -- --ignored --nocapture

.PHONY: surroundings
surroundings: test-packages ## tell ten other boxes from ten nudged ones, on the clips that set the limit
	cargo test --locked --test integration on_the_even_clips -- --ignored --nocapture

.PHONY: mutations
mutations: test-packages ## decode 10,000 damaged recordings, each in a child process
	TROCAR_MUTATIONS=10000 cargo test --locked --test integration damaged_recordings -- --nocapture

.PHONY: long-queue
long-queue: packages ## run 10,000 jobs with random crashes and pauses; measure the cost of 10,000 waiting jobs
	TMPDIR=/dev/shm cargo test --locked --lib ten_thousand -- --ignored --nocapture

.PHONY: proxies
proxies: release test-packages ## sign in, upload 200 MiB, watch and send through nginx and Caddy, with the examples of docs/proxy/
	@$(call install,nginx-light caddy python3)
	TROCAR_MUST_NOT_SKIP=1 tests/proxies/run.py $(RELEASE)

# ── the Debian package ──────────────────────────────────────────────────────────────────────────────────────────────

.PHONY: deb
deb: release ## build the Debian package, into target/debian/ (installs cargo-deb)
	@$(call install,dpkg-dev)
	command -v cargo-deb >/dev/null || cargo install --locked cargo-deb
	cargo deb --no-build --locked

.PHONY: deb-test
deb-test: deb ## install the Debian package under a clean Debian 12: start, check of the unit, removal; needs root
	@$(call install,mmdebstrap systemd curl)
	$(SUDO) tests/package/run $(TARGET)/debian/trocar_*.deb
