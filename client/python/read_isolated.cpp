// SPDX-License-Identifier: Apache-2.0
#include "core/io/mesh_file.h"

int main() { return deform::io::serve_isolated_reader(); }
