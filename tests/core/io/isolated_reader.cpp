// SPDX-License-Identifier: GPL-3.0-or-later
// A program that reads mesh files for another one, and does nothing else.
#include "core/io/mesh_file.h"

int main() { return deform::io::serve_isolated_reader(); }
