// SPDX-License-Identifier: GPL-3.0-or-later
// Writes bricks.cgns (in HDF5), bricks_adf.cgns and bricks.e (netCDF-4) into a folder: N x N x N hexahedra with the quads of one
// side as a group. For tests of the command line, and to measure how long reading takes. usage: write_containers FOLDER N
#include <cstdio>
#include <cstdlib>
#include <filesystem>

#include "core/io/mesh_file.h"
#include "tests/core/io/cgns_writer.h"
#include "tests/core/io/exodus_writer.h"

namespace deform {
namespace {

struct Bricks {
  Points points;
  std::vector<cgsize_t> hexahedra, quads;  ///< nodes from 1
};

Bricks bricks(int n) {
  Bricks result;
  const auto at = [&](int i, int j, int k) { return 1 + i + (n + 1) * (j + (n + 1) * k); };
  for (int k = 0; k <= n; ++k) {
    for (int j = 0; j <= n; ++j) {
      for (int i = 0; i <= n; ++i) {
        result.points.push_back({static_cast<double>(i), static_cast<double>(j), static_cast<double>(k)});
        if (i == n || j == n) continue;
        if (k == 0) {
          for (const int node : {at(i, j, 0), at(i, j + 1, 0), at(i + 1, j + 1, 0), at(i + 1, j, 0)})
            result.quads.push_back(node);
        }
        if (k == n) continue;
        for (const int node : {at(i, j, k), at(i + 1, j, k), at(i + 1, j + 1, k), at(i, j + 1, k), at(i, j, k + 1),
                               at(i + 1, j, k + 1), at(i + 1, j + 1, k + 1), at(i, j + 1, k + 1)}) {
          result.hexahedra.push_back(node);
        }
      }
    }
  }
  return result;
}

std::string cgns(const Bricks& bricks, int container) {
  test::CgnsWriter writer(container);
  const auto cells = static_cast<int>(bricks.hexahedra.size() / 8);
  const int zone = writer.unstructured("bricks", bricks.points, cells);
  writer.section(zone, "inside", HEXA_8, cells, bricks.hexahedra);
  writer.section(zone, "floor", QUAD_4, static_cast<int>(bricks.quads.size() / 4), bricks.quads);
  return writer.bytes();
}

std::string exodus(const Bricks& bricks) {
  test::ExodusWriter writer(bricks.points, 3, test::ExodusWriter::Coordinates::apart);
  writer.block("HEX8", 8, {bricks.hexahedra.begin(), bricks.hexahedra.end()});
  writer.block("SHELL4", 4, {bricks.quads.begin(), bricks.quads.end()});
  writer.names("eb", {"inside", "floor"}, {1, 2});
  return writer.bytes(NC_NETCDF4);
}

}  // namespace
}  // namespace deform

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "usage: write_containers FOLDER N\n");
    return 2;
  }
  const std::filesystem::path folder = argv[1];
  const deform::Bricks bricks = deform::bricks(std::atoi(argv[2]));
  deform::io::write_file(folder / "bricks.cgns", deform::cgns(bricks, CG_FILE_HDF5));
  deform::io::write_file(folder / "bricks_adf.cgns", deform::cgns(bricks, CG_FILE_ADF));
  deform::io::write_file(folder / "bricks.e", deform::exodus(bricks));
  return 0;
}
