#!/bin/sh
# Compares files and the Python module with programs of others: the library of USD, Blender, Open
# Job Description, Ray. Each is installed into a virtual environment; what cannot be installed is
# skipped with a word.
#
# tools/check_outside.sh [FOLDER]      the folder is for the environment and the files; default
#                                      target/outside
set -eu
here=$(cd "$(dirname "$0")/.." && pwd)
folder=${1:-$here/target/outside}
mkdir -p "$folder"
cargo build --release --manifest-path "$here/Cargo.toml"
forelock=$here/target/release/forelock
python3 -m venv "$folder/venv"
python=$folder/venv/bin/python
install() { "$python" -m pip install --quiet "$@" || { echo "skipped: $* cannot be installed"; return 1; }; }

cd "$folder"
"$forelock" demo --out demo --frames 12 --set groom.strands=300 --set output.film=false \
    --set output.cache_every=1 --set 'output.exports=["hair.abc", "hair.usdc", "hair.glb"]'
if install usd-core numpy; then
    "$python" "$here/tools/check_usd.py" demo/hair.usdc demo/hair.npz
fi
if install "bpy==5.0.1" numpy; then
    "$python" "$here/tools/check_alembic.py" demo/hair.abc demo/hair.npz --fps 60
    "$python" "$here/tools/check_gltf.py" demo/hair.glb demo/hair.npz --fps 60
    "$python" "$here/tools/blender_round_trip.py" --forelock "$forelock" --out blender
fi
printf '[set]\n"time.frames" = 6\n"groom.strands" = 50\n"output.film" = false\n[[shot]]\nname = "turn"\nvary.seed = [1, 2]\n' \
    > shots.toml
"$forelock" shots shots.toml --openjd job.yaml --chunk 3
if install openjd-cli; then
    "$folder/venv/bin/openjd" check job.yaml
    "$folder/venv/bin/openjd" run job.yaml --step "2 to frame 6" --run-dependencies -p "Forelock=$forelock"
fi
if install "maturin>=1.9,<2" pytest; then
    "$python" -m maturin build --release --manifest-path "$here/bindings/forelock-py/Cargo.toml" --out wheels
    "$python" -m pip install --quiet --force-reinstall wheels/*.whl
    install ray || true
    FORELOCK=$forelock "$python" -m pytest -q "$here/bindings/forelock-py/tests"
fi
echo "all that could be installed agrees"
