// SPDX-License-Identifier: GPL-3.0-or-later
// Applies three maps of space to CAD models and prints what became of them: time, faces by what they became, error, size. Exit
// code 1 when a limit is missed. `studs` is a model of 377 faces, which is added to a folder.
//
// usage: cad_bench FOLDER_OR_FILE... [--tolerance T] [--checks N] [--stages] [--keep FOLDER]
#include <unistd.h>
#include <BRepAlgoAPI_Cut.hxx>
#include <BRepAlgoAPI_Fuse.hxx>
#include <BRepGProp.hxx>
#include <BRepPrimAPI_MakeBox.hxx>
#include <BRepPrimAPI_MakeCylinder.hxx>
#include <GProp_GProps.hxx>
#include <STEPControl_Writer.hxx>
#include <ShapeUpgrade_UnifySameDomain.hxx>
#include <TopTools_ListOfShape.hxx>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "core/cad/cad_apply.h"
#include "core/cad/document.h"
#include "core/cad/model.h"
#include "tests/bench/report.h"

namespace deform::bench {
namespace {

namespace fs = std::filesystem;

struct Options {
  double tolerance = 1e-5;
  std::size_t checks = 100'000;
  bool stages = false;
  fs::path keep;
};

/// Where the model lies: its maps are the same in units of its diagonal.
struct Frame {
  Vec3 centre{};
  double diagonal = 1;
};

Vec3 sheared(const Vec3& p) {  // keeps volumes
  const double x = p[0] + 0.03 * std::sin(5 * p[1]) + 0.02 * std::cos(4 * p[2]);
  const double y = p[1] + 0.02 * std::sin(6 * x);
  return {x, y, p[2] + 0.02 * std::sin(5 * x) * std::cos(4 * y)};
}

/// The lower third stays, the upper one turns about z and rises; between them it blends (C4).
Vec3 twisted(const Vec3& p) {
  const double s = std::clamp((p[0] + 0.1) / 0.2, 0.0, 1.0);
  const double share = s * s * s * s * (35 + s * (-84 + s * (70 - 20 * s)));
  const double angle = 0.2 * share, c = std::cos(angle), n = std::sin(angle);
  return {p[0], c * p[1] - n * p[2], n * p[1] + c * p[2] + 0.05 * share};
}

/// Stretches along the axes, each by itself: planes across them stay planes.
Vec3 stretched(const Vec3& p) { return {p[0] + 0.02 * std::sin(4 * p[0]), 1.05 * p[1], p[2] + 0.1 * p[2] * p[2]}; }

double volume(const cad::Document& document) {
  double sum = 0;
  for (const cad::Part& part : document.parts) {
    GProp_GProps properties;
    BRepGProp::VolumePropertiesGK(part.shape, properties, 1e-9, true, true);
    sum += properties.Mass();
  }
  return sum;
}

Frame frame_of(const cad::Model& model) {
  Frame frame;
  frame.diagonal = model.diagonal;
  GProp_GProps properties;
  BRepGProp::SurfaceProperties(model.shape, properties);
  const gp_Pnt c = properties.CentreOfMass();
  frame.centre = {c.X(), c.Y(), c.Z()};
  return frame;
}

/// 53 studs with a blind bore each on a plate: 377 faces.
fs::path studs(const fs::path& folder) {
  TopoDS_Shape shape = BRepPrimAPI_MakeBox(gp_Pnt(0, 0, -1), 27, 12, 1).Shape();
  TopTools_ListOfShape bodies, bores;
  for (int i = 0; i < 53; ++i) {
    const gp_Pnt corner(0.5 + 1.9 * (i % 14), 0.7 + 2.8 * (i / 14), 0);
    bodies.Append(BRepPrimAPI_MakeBox(corner, 1.4, 1.8, 2).Shape());
    bores.Append(BRepPrimAPI_MakeCylinder(gp_Ax2(corner.Translated(gp_Vec(0.7, 0.9, 1)), gp::DZ()), 0.4, 2).Shape());
  }
  TopTools_ListOfShape plate;
  plate.Append(shape);
  BRepAlgoAPI_Fuse fuse;
  fuse.SetArguments(plate);
  fuse.SetTools(bodies);
  fuse.Build();
  TopTools_ListOfShape fused;
  fused.Append(fuse.Shape());
  BRepAlgoAPI_Cut cut;
  cut.SetArguments(fused);
  cut.SetTools(bores);
  cut.Build();
  ShapeUpgrade_UnifySameDomain unify(cut.Shape());
  unify.Build();
  const fs::path file = folder / "studs377.step";
  STEPControl_Writer writer;
  writer.Transfer(unify.Shape(), STEPControl_AsIs);
  writer.Write(file.c_str());
  return file;
}

/// The worst of all models.
struct Worst {
  double error = 0, size = 0, volume = 0, seconds = 0;
  int refused_without_a_face = 0, refused = 0;
};

void run(const fs::path& given, const fs::path& folder, const Options& options, Worst& worst) {
  fs::path file = given;
  if (file.extension() == ".gz") {
    file = folder / given.stem();
    if (std::system(("gzip -dc '" + given.string() + "' > '" + file.string() + "'").c_str()) != 0) return;
  }
  const cad::Document rest = cad::read_document(file);
  const Frame frame = frame_of(cad::model_of(rest, file.string()));
  const double rest_volume = volume(rest);
  const std::vector<std::pair<const char*, Vec3 (*)(const Vec3&)>> maps{
      {"shear", sheared}, {"twist", twisted}, {"stretch", stretched}};
  for (const auto& [name, map] : maps) {
    cad::ApplyRequest request;
    request.model = file;
    request.output = folder / (given.stem().stem().string() + "_" + name + (file.extension() == ".brep" ? ".brep" : ".step"));
    request.tolerance = options.tolerance;
    request.checks = options.checks;
    const auto function = map;  // no structured binding in a lambda
    const auto start = std::chrono::steady_clock::now();
    const std::clock_t start_cpu = std::clock();
    try {
      const cad::DeformedModel model = cad::apply_to_model(request, [&](std::span<const Vec3> points) {
        Points moved;
        for (const Vec3& p : points) {
          Vec3 q;
          for (int k = 0; k < 3; ++k) q[k] = (p[k] - frame.centre[k]) / frame.diagonal;
          q = function(q);
          for (int k = 0; k < 3; ++k) q[k] = frame.centre[k] + frame.diagonal * q[k];
          moved.push_back(q);
        }
        return moved;
      });
      const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
      const double cpu = static_cast<double>(std::clock() - start_cpu) / CLOCKS_PER_SEC;
      using Became = cad::DeformedFace::Became;
      const double limit = options.tolerance * model.diagonal;
      const double size = static_cast<double>(fs::file_size(request.output)) / static_cast<double>(fs::file_size(file));
      worst.error = std::max(worst.error, model.error / limit);
      worst.size = std::max(worst.size, size);
      if (model.faces.size() > 300) worst.seconds = std::max(worst.seconds, cpu);
      std::printf("| %s | %s | %zu | %zu | %zu | %zu | %zu | %.2f | %.2f | %.2f | %.2f | %.1f | ", given.filename().c_str(), name,
                  model.faces.size(), model.count(Became::fitted), model.count(Became::reshaped), model.count(Became::moved),
                  model.count(Became::kept), seconds, cpu, model.error / limit, model.gap / limit, size);
      if (std::strcmp(name, "shear") == 0 && rest_volume > 1e-9 * std::pow(frame.diagonal, 3)) {
        const double change = std::abs(volume(cad::read_document(request.output)) / rest_volume - 1);
        worst.volume = std::max(worst.volume, change);
        std::printf("%.1e |\n", change);
      } else {
        std::printf("|\n");
      }
      if (options.stages) {
        std::printf("  ");
        for (const auto& [stage, elapsed] : model.stages) std::printf(" %s %.2f", stage.c_str(), elapsed);
        std::printf("; %zu samples in %d rounds\n", model.samples, model.rounds);
      }
    } catch (const Error& error) {
      const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
      ++worst.refused;
      if (std::strstr(error.what(), "face ") == nullptr) ++worst.refused_without_a_face;
      std::printf("| %s | %s | refused after %.2f s: %s\n", given.filename().c_str(), name, seconds, error.what());
    }
    std::fflush(stdout);
    if (options.keep.empty()) {
      std::error_code ignored;
      fs::remove(request.output, ignored);
    }
  }
}

int main_of(int argc, char** argv) {
  std::vector<fs::path> files;
  Options options;
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    if (argument == "--stages") {
      options.stages = true;
    } else if (argument == "--tolerance") {
      options.tolerance = std::atof(argv[++i]);
    } else if (argument == "--checks") {
      options.checks = static_cast<std::size_t>(std::atof(argv[++i]));
    } else if (argument == "--keep") {
      options.keep = argv[++i];
    } else {
      files.emplace_back(argument);
    }
  }
  cad::silence_messages();
  const fs::path folder =
      options.keep.empty() ? fs::temp_directory_path() / ("deform_cad_bench_" + std::to_string(getpid())) : options.keep;
  fs::create_directories(folder);
  std::vector<fs::path> models;
  for (const fs::path& file : files) {
    if (!fs::is_directory(file)) {
      models.push_back(file == "studs" ? studs(folder) : file);
      continue;
    }
    for (const auto& entry : fs::directory_iterator(file)) {
      if (entry.path().extension() != ".md") models.push_back(entry.path());
    }
    std::sort(models.begin(), models.end());
    models.push_back(studs(folder));
  }
  std::printf(
      "tolerance %g D\n\n| model | map | faces | fitted | reshaped | moved | kept | s | CPU s | error / tolerance | gap / "
      "tolerance | size | volume |\n"
      "|---|---|---|---|---|---|---|---|---|---|---|---|---|\n",
      options.tolerance);
  Worst worst;
  for (const fs::path& model : models) run(model, folder, options, worst);
  if (options.keep.empty()) fs::remove_all(folder);
  std::printf("\n");
  Report report("CAD models");
  report.at_most("refusals that name no face", worst.refused_without_a_face, 0, "");
  report.info("refusals", std::to_string(worst.refused));
  report.at_most("largest error / tolerance", worst.error, 2, "");
  if (options.tolerance <= 1e-6) report.at_most("change of the volume, a map without divergence", worst.volume, 1e-6, "");
  if (options.tolerance >= 1e-5) report.at_most("size / size of the input", worst.size, 20, "");
  if (worst.seconds > 0) report.at_most("377 faces, processor time", worst.seconds, 2, " s");
  return report.missed() > 0 ? 1 : 0;
}

}  // namespace
}  // namespace deform::bench

int main(int argc, char** argv) { return deform::bench::main_of(argc, argv); }
