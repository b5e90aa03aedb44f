// SPDX-License-Identifier: GPL-3.0-or-later
// Every method on the cases of thesis chapter 4, and RBF beside direct manipulation in a volume mesh (7.3.1), as JSON on standard
// output: what methods_page.py makes a page of.
//
// usage: methods_bench [--quick]
#include <cstdio>
#include <cstring>
#include <iostream>

#include "core/base/error.h"
#include "tests/bench/methods/methods.h"

int main(int argc, char** argv) {
  using namespace deform::bench;
  const bool quick = argc == 2 && std::strcmp(argv[1], "--quick") == 0;
  if (argc > 2 || (argc == 2 && !quick)) {
    std::fprintf(stderr, "usage: methods_bench [--quick]\n");
    return 2;
  }
  const std::pair<const char*, Json (*)(bool)> sections[] = {{"performance", performance},
                                                             {"robustness", robustness},
                                                             {"smoothness", smoothness},
                                                             {"resolution", lattice_resolution},
                                                             {"adaptivity", adaptivity},
                                                             {"precision", precision},
                                                             {"pipe", pipe}};
  try {
    Json all;
    all["quick"] = quick;
    for (const auto& [name, measure] : sections) {
      Json section;
      const double seconds = seconds_of([&] { section = measure(quick); }, 1);
      std::fprintf(stderr, "%s: %.1f s\n", name, seconds);
      all[name] = std::move(section);
    }
    std::cout << all.dump(1) << '\n';
  } catch (const deform::Error& error) {
    std::fprintf(stderr, "methods_bench: %s\n", error.what());
    return 1;
  }
  return 0;
}
