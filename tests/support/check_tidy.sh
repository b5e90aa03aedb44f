#!/bin/sh
# SPDX-License-Identifier: GPL-3.0-or-later
# clang-tidy with the rules of .clang-tidy (names are errors, the rest are warnings).
#   tests/support/check_tidy.sh BUILD_FOLDER            names only, of every header
#   tests/support/check_tidy.sh BUILD_FOLDER --sources  names only, of every header and every source of the core: minutes
#   tests/support/check_tidy.sh BUILD_FOLDER FILE...    all rules
set -eu
if [ $# -eq 0 ]; then
  echo "usage: $0 BUILD_FOLDER [FILE...]" >&2
  exit 2
fi
cd "$(dirname "$0")/../.."
# Precompiled headers are those of another compiler.
build=$(mktemp -d)
trap 'rm -rf "$build"' EXIT
sed -E 's# -Winvalid-pch| -fpch-preprocess| -include [^ "]*cmake_pch\.hxx##g' "$1/compile_commands.json" >"$build/compile_commands.json"
proto=$1/proto
shift
if [ $# -gt 0 ] && [ "$1" != --sources ]; then
  clang-tidy-14 -p "$build" --quiet "$@"
  exit 0
fi
names='--checks=-*,readability-identifier-naming'
if [ $# -gt 0 ]; then
  printf '%s\0' core/*/*.cpp core/*/*/*.cpp | xargs -0 -n 4 -P 2 clang-tidy-14 -p "$build" --quiet "$names"
fi
python=$(/usr/bin/python3 -c 'import sysconfig; print(sysconfig.get_path("include"))')  # of Debian's python3-dev
# What includes gRPC or Eigen takes seconds to parse, so the headers of some folders are read in one go.
export build proto python names
# shellcheck disable=SC2016  # for the other shell
printf '%s\0' "core/constraints core/deformers" "proto/convert server client" "core/base core/codec core/compiled core/numerics core/mesh" core/io "core/quality core/measures core/report" |
  xargs -0 -n 1 -P 2 sh -c '
    own=$(mktemp -d "$build/XXXXXX")
    find $1 -name "*.h" | sort | sed "s/.*/#include \"&\"/" >"$own/headers.cpp"
    exec clang-tidy-14 --config-file=.clang-tidy --quiet "$names" "$own/headers.cpp" -- -std=c++20 -I. -isystem "$proto" -isystem /usr/include/eigen3 -isystem /usr/include/postgresql -isystem "$python"
  ' sh
