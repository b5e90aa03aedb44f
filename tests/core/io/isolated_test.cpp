// SPDX-License-Identifier: GPL-3.0-or-later
// Files of libraries that may crash are read in a process of their own: with the same result, and whatever becomes of it.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <random>
#include <thread>

#include "core/io/assembly/mesh_stream.h"
#include "core/io/binary/byte_stream.h"
#include "tests/core/io/cgns_writer.h"
#include "tests/core/io/exodus_writer.h"
#include "tests/core/mesh/polyhedral.h"
#include "tests/support/expect_error.h"

namespace deform::io::isolated_test {
namespace {

using test::CgnsWriter;
using test::ExodusWriter;
using test::expect_error;

const Points house{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}, {0.5, 0.5, 1.7}};

std::string house_cgns(int container) {
  CgnsWriter writer(container);
  const int zone = writer.unstructured("house", house, 2, RealSingle);
  writer.section(zone, "block", HEXA_8, 1, {1, 2, 3, 4, 5, 6, 7, 8});
  writer.section(zone, "roof", PYRA_5, 1, {5, 6, 7, 8, 9});
  writer.section(zone, "walls", QUAD_4, 2, {1, 4, 3, 2, 1, 5, 8, 4});
  writer.condition(zone, "ground", PointRange, {3, 3}, 2, FaceCenter);
  writer.condition(zone, "corners", PointList, {1, 9}, 2, Vertex);
  return writer.bytes();
}

/// The cube of the house by its faces.
std::string polyhedra_cgns() {
  CgnsWriter writer(CG_FILE_HDF5);
  const int zone = writer.unstructured("cube", {house.begin(), house.begin() + 8}, 1);
  writer.lists(zone, "faces", NGON_n, {0, 4, 8, 12, 16, 20, 24},
               {1, 4, 3, 2, 5, 6, 7, 8, 1, 2, 6, 5, 2, 3, 7, 6, 3, 4, 8, 7, 4, 1, 5, 8});
  writer.lists(zone, "cells", NFACE_n, {0, 6}, {1, 2, 3, 4, 5, 6});
  return writer.bytes();
}

std::string flat_cgns() {
  CgnsWriter writer(CG_FILE_HDF5, 2, 2);
  const int zone = writer.unstructured("sheet", {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}, 1);
  writer.section(zone, "quad", QUAD_4, 1, {1, 2, 3, 4});
  return writer.bytes();
}

std::string house_exodus(int mode, ExodusWriter::Coordinates coordinates) {
  ExodusWriter writer(house, 3, coordinates);
  writer.block("HEX8", 8, {1, 2, 3, 4, 5, 6, 7, 8});
  writer.block("pyramid", 5, {5, 6, 7, 8, 9});
  writer.side_set({1, 1, 2}, {1, 5, 1});
  writer.node_set({9, 1});
  writer.names("eb", {"body", "roof"}, {10, 20});
  return writer.bytes(mode);
}

struct File {
  std::string name, bytes;
};
std::vector<File> files() {
  return {{"hdf5.cgns", house_cgns(CG_FILE_HDF5)},
          {"adf.cgns", house_cgns(CG_FILE_ADF)},
          {"polyhedra.cgns", polyhedra_cgns()},
          {"flat.cgns", flat_cgns()},
          {"apart.e", house_exodus(NC_NETCDF4, ExodusWriter::Coordinates::apart)},
          {"together.e", house_exodus(NC_NETCDF4, ExodusWriter::Coordinates::together)}};
}

ReadOptions isolated() {
  ReadOptions options;
  options.isolated_reader = {DEFORM_ISOLATED_READER};
  return options;
}
/// Options that read with a program that is none of ours.
ReadOptions shell(const std::string& script) {
  ReadOptions options;
  options.isolated_reader = {"/bin/sh", "-c", script};
  return options;
}

void expect_no_children() {
  EXPECT_EQ(::waitpid(-1, nullptr, WNOHANG), -1);
  EXPECT_EQ(errno, ECHILD);
}

std::string streamed(const Mesh& mesh) {
  std::string bytes;
  ByteWriter to([&](std::string_view some) { bytes += some; });
  write_mesh(mesh, to);
  to.flush();
  return bytes;
}

Mesh back(std::string_view bytes) {
  ByteReader from(
      [&](char* to, std::size_t most) {
        const std::size_t got = bytes.copy(to, most);
        bytes.remove_prefix(got);
        return got;
      },
      bytes.size());
  return read_mesh(from);
}

TEST(Isolated, GivesWhatThisProcessReadsAndWrites) {
  for (const auto& [name, bytes] : files()) {
    const auto here = parse_mesh(bytes, name), there = parse_mesh(bytes, name, isolated());
    EXPECT_EQ(there->format(), here->format()) << name;
    EXPECT_EQ(streamed(*there->mesh()), streamed(*here->mesh())) << name;
    EXPECT_EQ(there->with_points(here->mesh()->points), bytes) << name;
    Points moved = here->mesh()->points;
    for (Vec3& p : moved) p[0] += 0.25;
    EXPECT_EQ(parse_mesh(there->with_points(moved), name)->mesh()->points, moved) << name;
    EXPECT_EQ(there->with_points(moved), here->with_points(moved)) << name;
  }
  expect_no_children();
}

TEST(Isolated, RefusesInTheSameWords) {
  const auto words = [](const std::string& bytes, const std::string& name, const ReadOptions& options) -> std::string {
    try {
      Points far = parse_mesh(bytes, name, options)->mesh()->points;
      far[0][0] = 1e300;  // no float
      parse_mesh(bytes, name, options)->with_points(far);
    } catch (const Error& error) {
      return std::string(to_string(error.code())) + " " + error.what();
    }
    return {};
  };
  const std::string good = house_cgns(CG_FILE_HDF5);
  for (const auto& [name, bytes] : {File{"a.cgns", "no CGNS at all"}, File{"a.e", "no Exodus at all"}, File{"a.cgns", good},
                                    File{"a.cgns", good.substr(0, good.size() / 2)}}) {
    EXPECT_EQ(words(bytes, name, isolated()), words(bytes, name, {}));
    EXPECT_NE(words(bytes, name, {}), "");
  }
  Points raised = parse_mesh(flat_cgns(), "a.cgns")->mesh()->points;
  raised[0][2] = 1;
  expect_error(ErrorCode::invalid_argument, {"z"}, [&] { parse_mesh(flat_cgns(), "a.cgns", isolated())->with_points(raised); });
}

TEST(Isolated, ClassicNetcdfIsReadInThisProcess) {
  const std::string bytes = house_exodus(0, ExodusWriter::Coordinates::apart);
  EXPECT_EQ(parse_mesh(bytes, "a.e", shell("exit 1"))->mesh()->points, house);
}

TEST(Isolated, ACrashIsAnErrorThatNamesFileAndSignal) {
  const auto expect = [](const std::string& name, const std::string& script, ErrorCode code, const std::string& message) {
    try {
      parse_mesh("whatever", name, shell(script));
      FAIL() << script;
    } catch (const Error& error) {
      EXPECT_EQ(error.what(), message);
      EXPECT_EQ(error.code(), code) << message;
    }
    expect_no_children();
  };
  const auto wrong = ErrorCode::invalid_argument;
  expect("a.cgns", "kill -SEGV $$", wrong, "a.cgns: the CGNS library crashed while reading it (signal 11); the file is damaged");
  expect("a.e", "kill -ABRT $$", wrong, "a.e: the netCDF library crashed while reading it (signal 6); the file is damaged");
  expect("a.cgns", "printf some; kill -BUS $$", wrong,
         "a.cgns: the CGNS library crashed while reading it (signal 7); the file is damaged");
  expect("a.cgns", "kill -XCPU $$", wrong,
         "a.cgns: the CGNS library took more than 60 s of processor time while reading it; the file is damaged");
  expect("a.cgns", "kill -KILL $$", ErrorCode::out_of_budget,
         "a.cgns: the process of the CGNS library was killed while reading it (signal 9); perhaps there was not enough memory");
  expect("a.cgns", "kill -INT $$; exec sleep 60", ErrorCode::cancelled, "a.cgns: interrupted");
  expect("a.cgns", "exit 3", ErrorCode::internal, "a.cgns: the process of the CGNS library ended while reading it (exit code 3)");
  expect("a.cgns", "exec cat /dev/zero", ErrorCode::data_loss,
         "a.cgns: the process of the CGNS library gave no mesh while reading it: it does not begin as an answer");
  expect("a.cgns", "exit 0", ErrorCode::data_loss, "a.cgns: the process of the CGNS library gave no mesh while reading it");
  expect_error(ErrorCode::failed_precondition, {"cannot start /no/such/program"}, [] {
    ReadOptions options;
    options.isolated_reader = {"/no/such/program"};
    parse_mesh("whatever", "a.cgns", options);
  });
}

/// A reader, and once the file is there something else.
TEST(Isolated, ACrashWhileWritingIsAnErrorToo) {
  const std::string mark = test::temporary_path("read_once");
  const std::string script = "if [ -e " + mark + " ]; then kill -SEGV $$; fi; : > " + mark + "; exec " DEFORM_ISOLATED_READER;
  const auto file = parse_mesh(house_cgns(CG_FILE_HDF5), "a.cgns", shell(script));
  Points moved = file->mesh()->points;
  moved[0][0] += 1;
  expect_error(ErrorCode::invalid_argument, {"a.cgns: the CGNS library crashed while writing its points (signal 11)"},
               [&] { file->with_points(moved); });
  std::filesystem::remove(mark);
  expect_no_children();
}

TEST(Isolated, IsInterruptedAtOnceAlsoWhereSignalsAreBlocked) {
  ReadOptions options = shell("exec sleep 60");
  std::stop_source stop;
  options.stop = stop.get_token();
  const auto start = std::chrono::steady_clock::now();
  std::thread other([&stop] {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    stop.request_stop();
  });
  expect_error(ErrorCode::cancelled, {"a.cgns: interrupted"}, [&] { parse_mesh("whatever", "a.cgns", options); });
  other.join();
  sigset_t interrupt, before;
  sigemptyset(&interrupt);
  sigaddset(&interrupt, SIGINT);
  pthread_sigmask(SIG_BLOCK, &interrupt, &before);
  expect_error(ErrorCode::cancelled, {"interrupted"},
               [&] { parse_mesh("whatever", "a.cgns", shell("kill -INT $$; exec sleep 60")); });
  pthread_sigmask(SIG_SETMASK, &before, nullptr);
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(20));
  expect_no_children();
}

#ifndef DEFORM_SANITIZED  // where allocations that fail end the process
/// Coordinates that nobody has written take no room in the file, and far more than its size allows in memory.
TEST(Isolated, MemoryIsLimitedByTheSizeOfTheFile) {
  test::NetcdfWriter writer;
  writer.dimensions = {{"num_dim", 3}, {"num_nodes", 90'000'000}, {"noise", 500'000}};
  for (const char* name : {"coordx", "coordy", "coordz"}) writer.variables.push_back({name, {"num_nodes"}, {}, {}, "", ""});
  std::mt19937_64 random(1);
  std::vector<double> noise(500'000);
  for (double& value : noise) value = static_cast<double>(random());
  writer.variables.push_back({"noise", {"noise"}, {}, noise, "", ""});
  writer.compressed = true;
  const std::string bytes = writer.bytes(NC_NETCDF4, NC_DOUBLE);
  EXPECT_LT(bytes.size(), std::size_t{1} << 23);
  expect_error(ErrorCode::invalid_argument, {"a.e: reading it takes more than ", " MiB of memory; the file is damaged"},
               [&] { parse_mesh(bytes, "a.e", isolated()); });
}
#endif

TEST(Isolated, AProgramThatNobodyAskedSaysSo) {
  EXPECT_EQ(WEXITSTATUS(std::system(DEFORM_ISOLATED_READER " < /dev/null")), 2);
  EXPECT_EQ(WEXITSTATUS(std::system("echo hello, world | " DEFORM_ISOLATED_READER)), 2);
}

/// A request that is kept, and given again: the exit code says whether there was one, not what became of it.
TEST(Isolated, AProgramThatIsAskedAnswersAndEndsWell) {
  const std::string request = testing::TempDir() + "request_" + std::to_string(::getpid());
  EXPECT_NO_THROW(parse_mesh(house_cgns(CG_FILE_ADF), "a.cgns",
                             shell("cat > " + request + "; exec " DEFORM_ISOLATED_READER " < " + request)));
  const auto code_of = [&](const std::string& change) {
    return WEXITSTATUS(std::system((change + " | " DEFORM_ISOLATED_READER " > /dev/null").c_str()));
  };
  EXPECT_EQ(code_of("cat " + request), 0);
  EXPECT_EQ(code_of("(printf 12345678; tail -c +9 " + request + ")"), 2) << "it does not begin as a request";
  EXPECT_EQ(code_of("head -c -1 " + request), 2) << "it ends early";
  std::remove(request.c_str());
}

// ---- what a hostile child could say ----

TEST(MeshStream, CarriesAllOfAMesh) {
  Mesh mesh = *parse_mesh(house_cgns(CG_FILE_ADF), "a.cgns")->mesh();
  ASSERT_TRUE(mesh.elements);
  for (const bool by_faces : {false, true}) {
    if (by_faces) {
      auto cells = test::by_faces(*mesh.elements);
      cells.empty_faces.assign(cells.face_count(), 0);
      cells.empty_faces.back() = 1;
      mesh.cells = std::make_shared<const PolyhedralCells>(std::move(cells));
      mesh.elements = nullptr;
    }
    const Mesh same = back(streamed(mesh));
    EXPECT_EQ(same.points, mesh.points);
    EXPECT_EQ(same.groups.size(), mesh.groups.size());
    EXPECT_EQ(same.cell_count(), 2u);
    EXPECT_EQ(streamed(same), streamed(mesh));
  }
}

TEST(MeshStream, DamageIsAnErrorOrAMesh) {
  Mesh mesh = *parse_mesh(house_cgns(CG_FILE_ADF), "a.cgns")->mesh();
  for (const bool by_faces : {false, true}) {
    if (by_faces) {
      mesh.cells = std::make_shared<const PolyhedralCells>(test::by_faces(*mesh.elements));
      mesh.elements = nullptr;
    }
    const std::string bytes = streamed(mesh);
    std::size_t refused = 0;
    for (unsigned seed = 0; seed < 3000; ++seed) {
      std::mt19937 random(seed);
      std::string damaged = bytes.substr(0, seed % 3 == 0 ? random() % bytes.size() : bytes.size());
      for (unsigned i = 0; i < seed % 4 && !damaged.empty(); ++i)
        damaged[random() % damaged.size()] = static_cast<char>(random());
      try {
        back(damaged).validate();
      } catch (const Error& error) {
        EXPECT_TRUE(error.code() == ErrorCode::data_loss || error.code() == ErrorCode::invalid_argument) << error.what();
        ++refused;
      }
    }
    EXPECT_GT(refused, 1000u);
  }
}

TEST(ByteStream, TakesNoMemoryForWhatIsOnlyClaimed) {
  std::string bytes;
  ByteWriter to([&](std::string_view some) { bytes += some; });
  to.number(std::uint64_t{1} << 40);
  to.flush();
  std::size_t given = 0;
  ByteReader from(
      [&](char* target, std::size_t most) {
        const std::size_t got = std::string_view(bytes).substr(given).copy(target, most);
        given += got;
        return got;
      },
      std::uint64_t{1} << 50);
  expect_error(ErrorCode::data_loss, {"end early"}, [&] { from.array<double>(); });
  given = 0;
  ByteReader limited(
      [&](char* target, std::size_t most) { return std::exchange(given, 8) ? 0 : std::string_view(bytes).copy(target, most); },
      1000);
  expect_error(ErrorCode::data_loss, {"1099511627776 entries"}, [&] { limited.array<char>(); });
}

}  // namespace
}  // namespace deform::io::isolated_test
