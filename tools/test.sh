#!/usr/bin/env bash
# Everything that is checked, in the order in which it fails fastest. `tools/test.sh lint` stops before the tests.
set -euo pipefail
cd "$(dirname "$0")/.."

step() { printf '\n== %s\n' "$*"; }

for tool in fmt clippy; do
    if ! cargo "$tool" --version >/dev/null 2>&1; then
        component=${tool/fmt/rustfmt}
        rustup component add "$component" || {
            echo "test: cargo $tool is missing; run: rustup component add $component" >&2
            exit 1
        }
    fi
done

step "formatting"
cargo fmt --all --check
step "lints"
cargo clippy --workspace --all-targets --locked --quiet -- -D warnings
# What `make demo` builds: without PostgreSQL and OpenTelemetry.
cargo clippy --package treewright-server --no-default-features --locked --quiet -- -D warnings
step "documentation"
RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps --locked --quiet
[ "${1:-all}" = lint ] && exit 0

step "unit, property and end-to-end tests"
# The audit of what is linked in reads all of it, also what only other systems need.
cargo fetch --locked --quiet
# The end-to-end tests start the real programs and load the real libraries, which this puts beside them.
cargo build --workspace --bins --lib --locked --quiet
# What cannot be had here is written down by those who do without, and said at the end, where somebody sees it.
TREEWRIGHT_SKIPPED=$(mktemp)
export TREEWRIGHT_SKIPPED
trap 'rm -f "$TREEWRIGHT_SKIPPED"' EXIT
# Examples are left out: the lints have checked that they compile, and no test runs one.
cargo test --workspace --lib --bins --tests --locked
cargo test --workspace --doc --locked
skipped=$(sed 's/^skipped: //' "$TREEWRIGHT_SKIPPED" | sort -u | paste -sd ';' | sed 's/;/; /g')
step "${skipped:+all passed, but skipped was: }${skipped:-all passed, and nothing was skipped}"
