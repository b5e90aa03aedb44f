#!/bin/sh
# clang-tidy with the rules of .clang-tidy (names are errors, the rest are warnings).
#   tests/support/check_tidy.sh BUILD_FOLDER [FILE...]
# Without files: names only, in the core; headers are checked with the files that include them.
set -eu
if [ $# -eq 0 ]; then
  echo "usage: $0 BUILD_FOLDER [FILE...]" >&2
  exit 2
fi
cd "$(dirname "$0")/../.."
build=$1
shift
tidy() { xargs -0 -n 4 -P 2 clang-tidy-14 -p "$build" --quiet "$@"; }
if [ $# -eq 0 ]; then
  printf '%s\0' core/*/*.cpp | tidy '--checks=-*,readability-identifier-naming'
else
  printf '%s\0' "$@" | tidy
fi
