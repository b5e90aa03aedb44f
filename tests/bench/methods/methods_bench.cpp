// SPDX-License-Identifier: GPL-3.0-or-later
// Every method on the cases of thesis chapter 4, and RBF beside direct manipulation in volume meshes (7.3), as JSON on standard
// output: what methods_page.py makes a page of.
//
// usage: methods_bench [--quick] [--data FOLDER]
//   --data   the folder of shared meshes, which has the car of 7.3.2; default: the one that was given to CMake
//   (DEFORM_SHARED_DATA)
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <iostream>

#include "core/base/error.h"
#include "core/numerics/dense/blas_kernels.h"
#include "tests/bench/methods/methods.h"

#ifndef DEFORM_SHARED_DATA
#define DEFORM_SHARED_DATA ""
#endif

int main(int argc, char** argv) {
  deform::lapack::use_kernels_of_processor(argv);
  using namespace deform::bench;
  bool quick = false;
  std::filesystem::path data = DEFORM_SHARED_DATA;
  for (int i = 1; i < argc; ++i) {
    if (std::strcmp(argv[i], "--quick") == 0) {
      quick = true;
    } else if (std::strcmp(argv[i], "--data") == 0 && i + 1 < argc) {
      data = argv[++i];
    } else {
      std::fprintf(stderr, "usage: methods_bench [--quick] [--data FOLDER]\n");
      return 2;
    }
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
    const auto add = [&](const char* name, const std::function<Json()>& measure) {
      Json section;
      const double seconds = seconds_of([&] { section = measure(); }, 1);
      std::fprintf(stderr, "%s: %.1f s\n", name, seconds);
      all[name] = std::move(section);
    };
    for (const auto& [name, measure] : sections) add(name, [&, run = measure] { return run(quick); });
    const std::filesystem::path fastback = data / "B_volume" / "openfoam" / "car_fastback";
    if (!data.empty() && std::filesystem::exists(fastback)) {
      add("car", [&] { return car(fastback, "methods_bench.work"); });
    } else {
      std::fprintf(stderr, "car: left out, no car_fastback in the folder of shared meshes\n");
    }
    std::cout << all.dump(1) << '\n';
  } catch (const deform::Error& error) {
    std::fprintf(stderr, "methods_bench: %s\n", error.what());
    return 1;
  }
  return 0;
}
