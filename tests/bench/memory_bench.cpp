// SPDX-License-Identifier: GPL-3.0-or-later
// memory_bench [CASE...]: what is estimated before preparing, against what a process grows by while it prepares and, where there
// are constraints, solves one design; every case in a process of its own. The estimate is to be between 1 and 2 times the growth.
#include <malloc.h>
#include <unistd.h>

#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <fstream>
#include <stdexcept>
#include <string>

#include "core/base/error.h"
#include "core/deformers/system.h"
#include "core/mesh/ahmed.h"
#include "core/numerics/dense/blas_kernels.h"
#include "tests/bench/peak_cases.h"

namespace {

struct Measured {
  std::size_t estimated_peak = 0, grown = 0, estimated_resident = 0, reported = 0;
};

std::size_t status_bytes(const char* field) {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.rfind(field, 0) == 0) return std::stoul(line.substr(std::strlen(field))) * 1024;
  }
  throw std::runtime_error("/proc/self/status does not say how large the process is");
}

std::shared_ptr<const deform::System> prepare_and_solve(const std::shared_ptr<const deform::Mesh>& mesh,
                                                        const deform::Setup& setup) {
  auto system = deform::prepare(mesh, setup);
  if (!setup.constraints.empty()) {
    const deform::Design design{std::vector<double>(setup.variables.size(), 0.05), {}};
    system->bind({&design, 1}, deform::EvaluationPath::automatic, {});
  }
  return system;
}

/// Pages of the program and its libraries, and stacks of threads, are there before anything is counted.
void warm_up(const deform::Setup& setup) {
  deform::AhmedOptions small;
  small.target_points = 2000;
  try {
    prepare_and_solve(std::make_shared<const deform::Mesh>(deform::ahmed_body(small)), setup);
  } catch (const deform::Error&) {
    // The regions of a block select nothing here.
  }
}

void measure(const deform::test::PeakCase& row) {
  const auto mesh = row.mesh();
  const deform::Setup setup = row.setup();
  warm_up(setup);
  const deform::Estimate expected = deform::estimate(*mesh, setup);
  malloc_trim(0);
  std::ofstream("/proc/self/clear_refs") << 5;  // the high-water mark starts anew
  const std::size_t before = status_bytes("VmRSS:");
  const auto system = prepare_and_solve(mesh, setup);
  std::printf("%zu %zu %zu %zu\n", expected.peak_bytes, status_bytes("VmHWM:") - before, expected.resident_bytes,
              system->info().bytes);
}

Measured in_its_own_process(const std::string& name) {
  Measured found;
  FILE* const pipe = popen(("/proc/" + std::to_string(getpid()) + "/exe --measure " + name).c_str(), "r");
  if (pipe == nullptr) throw std::runtime_error("cannot start a process");
  const int read =
      std::fscanf(pipe, "%zu %zu %zu %zu", &found.estimated_peak, &found.grown, &found.estimated_resident, &found.reported);
  if (pclose(pipe) != 0 || read != 4) throw std::runtime_error(name + " failed");
  return found;
}

bool is_wanted(int argc, char** argv, const char* name) {
  for (int i = 1; i < argc; ++i) {
    if (std::strcmp(argv[i], name) == 0) return true;
  }
  return argc == 1;
}

double mebi(std::size_t bytes) { return static_cast<double>(bytes) / (1 << 20); }

}  // namespace

int main(int argc, char** argv) {
  deform::lapack::use_kernels_of_processor(argv);
  try {
    if (argc == 3 && std::strcmp(argv[1], "--measure") == 0) {
      for (const deform::test::PeakCase& row : deform::test::peak_cases()) {
        if (std::strcmp(argv[2], row.name) == 0) measure(row);
      }
      return 0;
    }
    int missed = 0;
    std::printf("| case | growth, MiB | estimate / growth | system, MiB | estimate / system | |\n|---|---|---|---|---|---|\n");
    for (const deform::test::PeakCase& row : deform::test::peak_cases()) {
      if (!is_wanted(argc, argv, row.name)) continue;
      const Measured found = in_its_own_process(row.name);
      const double peak = mebi(found.estimated_peak) / mebi(found.grown);
      const bool kept = peak >= 1 && peak <= 2;
      missed += kept ? 0 : 1;
      std::printf("| %s | %.0f | %.2f | %.0f | %.2f | %s |\n", row.name, mebi(found.grown), peak, mebi(found.reported),
                  mebi(found.estimated_resident) / mebi(found.reported), kept ? "PASS" : "MISS");
      std::fflush(stdout);
    }
    return missed == 0 ? 0 : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "memory_bench: %s\n", error.what());
    return 2;
  }
}
