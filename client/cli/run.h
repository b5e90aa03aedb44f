// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

namespace deform::cli {

/// The whole program without main: parses, runs, prints errors as one line on stderr. Returns the exit code.
int run(int argc, const char* const* argv);

}  // namespace deform::cli
