#!/bin/sh
# SPDX-License-Identifier: GPL-3.0-or-later
# Runs every fuzz target for a while; stops at the first finding and leaves it in BUILD_FOLDER/tests/fuzz/findings.
#   cmake --preset fuzz && cmake --build --preset fuzz && FUZZ_JOBS=2 tests/fuzz/run.sh build/fuzz SECONDS [TARGET...]
# Every run tries other bytes and goes on from what earlier runs found, unless FUZZ_SEED is set: then it begins anew, and the same
# seed tries the same bytes (a change is judged by its own merits, not by luck).
set -eu
if [ $# -lt 2 ]; then
  echo "usage: $0 BUILD_FOLDER SECONDS_PER_TARGET [TARGET...]" >&2
  exit 2
fi
here=$(dirname "$0")
bin=$1/tests/fuzz
seconds=$2
shift 2
corpus=$bin/corpus
seed=${FUZZ_SEED:-0}
if [ "$seed" != 0 ]; then
  corpus=$bin/corpus-$seed
  rm -rf "$corpus"
fi
mkdir -p "$bin/findings" "$corpus"
# Each make_*_seeds.py writes CORPUS/TARGET/NAME.
for script in "$here"/make_*_seeds.py; do
  python3 "$script" "$corpus"
done
if [ $# -eq 0 ]; then
  set -- $(cd "$bin" && find . -maxdepth 1 -name 'fuzz_*' -type f -perm -u+x | sed 's|^\./||' | sort)
fi
if [ $# -eq 0 ]; then
  echo "$0: no fuzz targets in $bin; build the target fuzz first" >&2
  exit 2
fi
# As many at a time as FUZZ_JOBS says; all of a batch take as long, and say what they have to say one after the other.
fuzz() {
  mkdir -p "$corpus/$1"
  echo "== $1, $seconds s"
  UBSAN_OPTIONS=print_stacktrace=1 "$bin/$1" -seed="$seed" -max_total_time="$seconds" -timeout=10 -rss_limit_mb=2048 -max_len=4096 \
    -print_final_stats=1 -verbosity=0 -artifact_prefix="$bin/findings/$1-" "$corpus/$1"
}
said=$(mktemp -d)
trap 'rm -rf "$said"' EXIT
while [ $# -gt 0 ]; do
  batch=
  while [ $# -gt 0 ] && [ "$(echo $batch | wc -w)" -lt "${FUZZ_JOBS:-1}" ]; do
    fuzz "$1" >"$said/$1" 2>&1 &
    batch="$batch $1=$!"
    shift
  done
  failed=
  for each in $batch; do
    wait "${each#*=}" || failed="$failed ${each%=*}"
    cat "$said/${each%=*}"
  done
  if [ -n "$failed" ]; then
    echo "$0: findings of$failed" >&2
    exit 1
  fi
done
