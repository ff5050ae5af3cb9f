#!/bin/sh
# Frame time of one build over that of another, on the CPU, in turns: the least of ROUNDS runs.
#
#   tools/frame-ratio.sh OLD NEW [ROUNDS]
#
# OLD and NEW are two builds of the example `frame_time` of forelock-core.
set -eu
old=$1
new=$2
rounds=${3:-5}
# arguments of frame_time after threads, frames and repeats
for case in "none free turn Auto ams" "64 free turn Auto ams" "none free turn Auto dftl"; do
  : >"/tmp/frame-ratio.$$"
  for _ in $(seq "$rounds"); do
    for name in old new; do
      program=$(eval "echo \$$name")
      # shellcheck disable=SC2086
      printf '%s %s\n' "$name" \
        "$("$program" 2 60 2 $case | sed -n 's/^frame: least \([0-9.]*\), median \([0-9.]*\).*/\1 \2/p')" \
        >>"/tmp/frame-ratio.$$"
    done
  done
  awk -v c="$case" '
    { if (!($1 in least) || $2 < least[$1]) least[$1] = $2; if (!($1 in mid) || $3 < mid[$1]) mid[$1] = $3 }
    END { printf "%-26s least %6.2f -> %6.2f ms, ratio %.3f; median %6.2f -> %6.2f ms, ratio %.3f\n",
          c, least["old"], least["new"], least["new"] / least["old"], mid["old"], mid["new"], mid["new"] / mid["old"] }
  ' "/tmp/frame-ratio.$$"
  rm "/tmp/frame-ratio.$$"
done
