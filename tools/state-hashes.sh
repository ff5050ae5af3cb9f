#!/usr/bin/env bash
# Prints the state hashes of twelve short scenes as a Markdown table: a row per scene, a column per
# backend. A change that does not affect results must leave the table unchanged on the same machine.
#
#   tools/state-hashes.sh [BINARY [BACKEND...]]     default: target/release/forelock, cpu and gpu
set -euo pipefail
cd "$(dirname "$0")/.."
binary=${1:-target/release/forelock}
shift || true
backends=("${@:-cpu}")
if [ "$#" = 0 ]; then backends=(cpu gpu); fi
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
common="time.frames=24 output.picture=false output.film=false output.contact_sheet=false output.report=false body.sdf_cells=48 groom.vertices_per_strand=16"
scenes=(
  "ams-free|crates/forelock/src/scene/default.toml|groom.strands=400 body.collide=false interaction.kind=none interaction.contacts=false"
  "ams-solids|scenes/bob-and-ball.toml|groom.strands=300 interaction.kind=none interaction.contacts=false"
  "ams-grid|crates/forelock/src/scene/default.toml|groom.strands=300 interaction.kind=grid interaction.contacts=false"
  "ams-grid-contacts|crates/forelock/src/scene/default.toml|groom.strands=300 interaction.kind=grid interaction.contacts=true body.motion=builtin:shake"
  "ams-wind|scenes/ams/wig-wind.toml|groom.strands=300"
  "mass-spring|crates/forelock/src/scene/default.toml|groom.strands=200 solver.kind=mass-spring interaction.kind=none interaction.contacts=false"
  "dftl|crates/forelock/src/scene/default.toml|groom.strands=300 solver.kind=dftl interaction.kind=none interaction.contacts=false"
  "dftl-sph|crates/forelock/src/scene/default.toml|groom.strands=300 solver.kind=dftl interaction.kind=sph interaction.contacts=false wind.turbulence=0.3"
  "dftl-grid-contacts|crates/forelock/src/scene/default.toml|groom.strands=300 solver.kind=dftl interaction.kind=grid interaction.contacts=true body.motion=builtin:shake"
  "edits|scenes/grooms/trim-in-motion.toml|groom.strands=200 time.fps=12 interaction.kind=none interaction.contacts=true"
  "guides|crates/forelock/src/scene/default.toml|groom.strands=600 groom.guides=100 interaction.kind=sph interaction.contacts=false"
  "damage|crates/forelock/src/scene/default.toml|groom.strands=200 body.motion=builtin:shake solver.ams.non_hookean=true interaction.kind=none interaction.contacts=true"
)
printf '| scene |'; printf ' %s |' "${backends[@]}"; printf '\n| --- |'; printf ' --- |%.0s' "${backends[@]}"; printf '\n'
for row in "${scenes[@]}"; do
  IFS='|' read -r name file keys <<<"$row"
  printf '| %s |' "$name"
  for backend in "${backends[@]}"; do
    sets=()
    for key in $common $keys; do sets+=(--set "$key"); done
    hash=$("$binary" simulate "$file" --backend "$backend" --out "$out/$name-$backend" --json "${sets[@]}" 2>"$out/error" | grep -o '"state_hash": *"[0-9a-f]*"' | grep -o '[0-9a-f]\{16\}') || hash="failed: $(tail -1 "$out/error")"
    printf ' %s |' "$hash"
  done
  printf '\n'
done
