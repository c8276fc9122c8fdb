#!/usr/bin/env bash
# Runs the tests that take too long for every day, half an hour on two cores: a hundred thousand random cuts, and the lattice beside the meshless model on finer and finer cells, which
# prints the table of docs/efg.md. Real lungs are pressed where PALPATE_DATA names their folder.
set -euo pipefail
cd "$(dirname "$0")/.."
cargo test --locked --lib -- --ignored --nocapture
cargo test --locked --release --test truth -- --ignored --nocapture
