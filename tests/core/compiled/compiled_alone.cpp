// SPDX-License-Identifier: GPL-3.0-or-later
// Reads a compiled deformation and writes the points of one design as doubles: compiled_alone FILE OUT VALUE...
#include <cstdlib>
#include <exception>
#include <fstream>
#include <iostream>
#include <vector>

#include "core/compiled/deformation.h"

int main(int argc, char** argv) {
  if (argc < 3) return 2;
  try {
    const auto deformation = deform::compiled::Deformation::load(argv[1]);
    std::vector<double> values;
    for (int i = 3; i < argc; ++i) values.push_back(std::strtod(argv[i], nullptr));
    std::vector<double> points(3 * deformation.points());
    deformation.evaluate(values, points);
    std::ofstream out(argv[2], std::ios::binary);
    out.write(reinterpret_cast<const char*>(points.data()), static_cast<std::streamsize>(points.size() * sizeof(double)));
    return out ? 0 : 1;
  } catch (const std::exception& error) {
    std::cerr << error.what() << '\n';
    return 1;
  }
}
