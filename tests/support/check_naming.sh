#!/bin/sh
# clang-tidy's naming rules (.clang-tidy) on the sources of core and on every header of server and client. A source that includes
# gRPC takes ten seconds to parse, so their headers are read in one go; with "all" every source is checked.
#   tests/support/check_naming.sh BUILD_FOLDER [all]
set -eu
if [ $# -lt 1 ]; then
  echo "usage: $0 BUILD_FOLDER [all]" >&2
  exit 2
fi
cd "$(dirname "$0")/../.."
build=$1
program=clang-tidy-14
command -v $program >/dev/null || program=clang-tidy
command -v $program >/dev/null || { echo "$0: clang-tidy-14 is not installed" >&2; exit 1; }
checks='-*,readability-identifier-naming,modernize-use-override'
# The headers that protoc makes.
cmake --build "$build" --target deform_proto deform_proto_grpc >/dev/null

if [ "${2:-}" = all ]; then
  find core server client -name '*.cpp' -print0 | xargs -0 -n 1 -P 2 $program --quiet -p "$build" --checks="$checks"
  exit
fi
find core -name '*.cpp' -print0 | xargs -0 -n 4 -P 2 $program --quiet -p "$build" --checks="$checks"
headers=$(mktemp -d)
trap 'rm -rf "$headers"' EXIT
find server client -name '*.h' | sort | sed 's/.*/#include "&"/' >"$headers/headers.cpp"
$program --quiet --checks="$checks" "$headers/headers.cpp" -- -std=c++20 -I. -isystem "$build/proto"
