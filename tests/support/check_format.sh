#!/bin/sh
# SPDX-License-Identifier: GPL-3.0-or-later
# Fails when clang-format would change a C++ file. In a clone: the tracked files; in a plain copy: all of them.
#   tests/support/check_format.sh          clang-format-14 -i FILE mends a file
set -eu
cd "$(dirname "$0")/../.."
if git rev-parse --git-dir >/dev/null 2>&1; then
  list() { git ls-files -z -- '*.h' '*.cpp'; }
else
  list() { find core server client tests \( -name '*.h' -o -name '*.cpp' \) -print0; }
fi
list | xargs -0 -r -n 20 -P 2 clang-format-14 --dry-run --Werror
