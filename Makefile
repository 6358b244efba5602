# The commands a newcomer needs: `make test` and `make lint`.
export PATH := $(HOME)/.cargo/bin:$(PATH)

.PHONY: test lint

# Installs what is missing, then runs every test.
test:
	scripts/install-dependencies test
	cargo test --workspace
	npm --prefix web ci
	npm --prefix web test
	npm --prefix web run build

# The linters, as the CI runs them.
lint:
	scripts/install-dependencies build
	cargo fmt --all --check
	cargo clippy --workspace --all-targets -- -D warnings
	npm --prefix web ci
	npm --prefix web run check
