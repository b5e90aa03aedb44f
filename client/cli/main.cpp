// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/run.h"

int main(int argc, char** argv) { return deform::cli::run(argc, argv); }
