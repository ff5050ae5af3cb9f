#!/usr/bin/env bash
# Measures all numbers of docs/PERFORMANCE.md that need a graphics card. Runs the tests of the
# kernels on its driver first.
#
#   tools/gpu-figures.sh FOLDER
#
# writes the results to FOLDER. Environment variables:
#
#   FORELOCK  the built `forelock` command, for machines without cargo
#   TESTS     the built tests, separated by spaces, for machines without cargo;
#             `cargo test --release -p forelock-gpu --no-run` lists them, and so does
#             `cargo test --release -p forelock-render --features gpu --test it --no-run`
#   MOST      the largest number of strands (default 1,000,000)
#   SHARE     the share of the strands of the paper's scenes (default 1)
set -uo pipefail
if [ $# != 1 ]; then
  echo "usage: tools/gpu-figures.sh FOLDER" >&2
  exit 2
fi
mkdir -p "$1"
out=$(cd "$1" && pwd)
cd "$(dirname "$0")/.."
most=${MOST:-1000000} share=${SHARE:-1}
export FORELOCK_REQUIRE_GPU=1
failed=0

# Runs a command, shows its output and writes it to a file. Continues after a failure.
step() {
  local name=$1
  shift
  echo "── $name: $*"
  "$@" 2>&1 | tee "$out/$name.txt" || failed=1
}

if [ -n "${FORELOCK:-}" ]; then
  forelock=("$FORELOCK")
  for test in ${TESTS:-}; do
    step "test-$(basename "$test" | sed 's/-[0-9a-f]*$//')" "$test" --nocapture
  done
else
  forelock=(cargo run --release --quiet --bin forelock --)
  step tests cargo test --release -p forelock-gpu -- --nocapture
  step tests-render cargo test --release -p forelock-render --features gpu --test it -- gpu:: --nocapture
fi
step scaling "${forelock[@]}" bench scaling --backend gpu --most "$most" --out "$out/scaling"
step scaling-apart "${forelock[@]}" bench scaling --backend gpu --most "$most" --apart --out "$out/scaling-apart"
step scaling-half "${forelock[@]}" bench scaling --backend gpu --most "$most" --half-factors --out "$out/scaling-half"
step scaling-contacts "${forelock[@]}" bench scaling --backend gpu --most "$most" --contacts --out "$out/scaling-contacts"
step render "${forelock[@]}" bench render --out "$out/render"
step paper "${forelock[@]}" bench paper --backend gpu --share "$share" --out "$out/paper"
step dftl "${forelock[@]}" bench paper --paper dftl --backend gpu --share "$share" --out "$out/dftl"
step neuralocks "${forelock[@]}" bench paper --paper neuralocks --backend gpu --share "$share" --out "$out/neuralocks"
exit $failed
