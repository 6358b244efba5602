# The commands a newcomer needs. Each installs what is missing.
export PATH := $(HOME)/.cargo/bin:$(PATH)

.PHONY: demo test test-deploy lint build page fuzz load soak end-to-end results bench bench-instructions dependencies

# A server, a capture rig and the address to watch. `make demo SEQ=folder` publishes the frames in
# a folder instead of an animated figure.
demo: build
	STEADYMESH=$${CARGO_TARGET_DIR:-target}/release/steadymesh scripts/demo $(SEQ)

# Installs what is missing, then runs every test.
test:
	scripts/install-dependencies test
	$(MAKE) page
	npm --prefix web test
	npm --prefix clients/js ci
	npm --prefix clients/js run build
	npm --prefix clients/js test
	cargo test --workspace
	cargo build
	STEADYMESH_BIN=$$(realpath $${CARGO_TARGET_DIR:-target}/debug/steadymesh) npm --prefix web run test:browser
	scripts/test-python-client

# Compose file, Kubernetes manifests, systemd unit, alerts and dashboard, as far as they can be
# tested without a Docker engine.
test-deploy:
	scripts/install-dependencies deploy
	cargo build
	STEADYMESH=$${CARGO_TARGET_DIR:-target}/debug/steadymesh scripts/test-deploy

# The linters, as the CI runs them.
lint:
	scripts/install-dependencies build
	cargo fmt --all --check
	cargo clippy --workspace --all-targets -- -D warnings
	CARGO_TARGET_DIR=$${CARGO_TARGET_DIR:-$(CURDIR)/target}/fuzz cargo check --manifest-path fuzz/Cargo.toml
	npm --prefix web ci
	npm --prefix web run check
	npm --prefix clients/js ci
	npm --prefix clients/js run check

# The binary as it is meant to run, with the page in it.
build:
	scripts/install-dependencies build
	$(MAKE) page
	cargo build --release

page:
	npm --prefix web ci
	npm --prefix web run build

# Every parser of outside bytes, SECONDS each (60).
fuzz:
	scripts/install-dependencies build
	scripts/fuzz $(SECONDS)

# Faults: killed processes, clocks that jump, full disks, slow and stuck clients, floods. With
# MINUTES=20, memory over that time instead.
soak:
	scripts/install-dependencies build
	cargo build --release
	STEADYMESH=$${CARGO_TARGET_DIR:-target}/release/steadymesh tests/soak/run $(if $(MINUTES),--minutes $(MINUTES)) $(SCENARIOS)

# 500 players on one stream, 40 of them slow or stuck.
load:
	scripts/install-dependencies build
	cargo run --release --example load

# docs/REALTIME.md: a rig, the server and a player together, SECONDS (60) a scenario.
end-to-end: build
	STEADYMESH=$${CARGO_TARGET_DIR:-target}/release/steadymesh scripts/end-to-end $(or $(SECONDS),60) > docs/REALTIME.md.new
	mv docs/REALTIME.md.new docs/REALTIME.md

# docs/RESULTS.md from the captures in the folder DATA, which are not part of the project.
results: build
	STEADYMESH=$${CARGO_TARGET_DIR:-target}/release/steadymesh scripts/results $(DATA)

# docs/PERFORMANCE.md: how long each stage takes from 5,000 to a million faces, beside meshopt, and
# on the captures in STEADYMESH_DATA where they are. Below ten minutes once it is built.
bench: export CARGO_TARGET_DIR := $(or $(CARGO_TARGET_DIR),$(CURDIR)/target)
bench:
	scripts/install-dependencies build
	rm -rf "$$CARGO_TARGET_DIR/criterion"
	cargo bench --bench stages
	cargo run --release --example performance -- "$$CARGO_TARGET_DIR/criterion" > docs/PERFORMANCE.md.new
	mv docs/PERFORMANCE.md.new docs/PERFORMANCE.md

# docs/DEPENDENCIES.md: what each dependency costs in build time and size. Some minutes.
dependencies: page
	scripts/install-dependencies build
	scripts/dependency-costs > docs/DEPENDENCIES.md.new
	mv docs/DEPENDENCIES.md.new docs/DEPENDENCIES.md

# Instructions of each stage, by Valgrind, against benches/instructions.txt: fails over 10 % more.
# With ACCEPT=1 that file is written anew.
bench-instructions:
	scripts/install-dependencies bench
	scripts/bench-instructions $(if $(ACCEPT),--accept)
