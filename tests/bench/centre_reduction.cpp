// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/bench/centre_reduction.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <limits>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "core/base/vectors.h"
#include "core/deformers/rbf/centres.h"
#include "core/deformers/rbf/rbf_method.h"
#include "core/deformers/system.h"
#include "core/io/mesh_file.h"
#include "core/mesh/ahmed.h"
#include "core/mesh/remeshing/closest_point.h"
#include "core/numerics/sampling/point_tree.h"
#include "tests/bench/peak_memory.h"
#include "tests/bench/refined.h"

namespace deform::bench {

namespace {

constexpr std::size_t most_dense = 8000;        // constraint points that all centres are affordable for
constexpr std::size_t most_iterative = 100000;  // the same to a tolerance
constexpr std::size_t most_compared = 20000;    // points of a mesh at which it is compared with a finer one

struct Case {
  std::string name;
  Mesh mesh;  ///< coarse triangles
  deform::Setup setup;
  Design design;
};

/// The nearest and the farthest part of a mesh along an axis are fixed and a handle that turns and moves.
Case ends(std::string name, Mesh mesh, std::size_t axis, double low, double high) {
  const Box box = bounding_box(mesh.points);
  const double size = box.diagonal();
  Box first = box, last = box;
  for (std::size_t k = 0; k < 3; ++k) {
    for (Box* part : {&first, &last}) {
      part->min[k] -= size;
      part->max[k] += size;
    }
  }
  const double length = box.max[axis] - box.min[axis];
  first.max[axis] = box.min[axis] + low * length;
  last.min[axis] = box.min[axis] + high * length;
  Case result{std::move(name), std::move(mesh), {}, {}};
  result.setup.handles = {{"end", {Region::InBox{last.min, last.max}}}};
  result.setup.fixed = {{Region::InBox{first.min, first.max}}};
  Vec3 centre = 0.5 * (box.min + box.max), axis_of{}, along{};
  axis_of[(axis + 1) % 3] = 1;
  along[(axis + 2) % 3] = 0.05 * size;
  result.setup.variables = {{"turn", "end", DesignVariable::Rotate{axis_of, centre}},
                            {"move", "end", DesignVariable::Translate{along}}};
  result.design.variables = {0.1, 1};
  return result;
}

/// What `deform sample --points N` and deploy/examples/ahmed.yaml give.
Case readme(std::size_t points) {
  AhmedOptions options;
  options.target_points = points;
  Case result{"README's Ahmed body", ahmed_body(options), {}, {}};
  result.setup.handles = {
      {"slant", {Region::GroupName{"slant"}}},
      {"roof", {Region::Intersection{{{Region::GroupName{"roof"}}, {Region::InBox{{0.4, -1, 0}, {0.6, 1, 1}}}}}}}};
  result.setup.fixed = {{Region::GroupName{"nose"}}, {Region::GroupName{"underbody"}}, {Region::GroupName{"stilts"}}};
  result.setup.variables = {{"roof_up", "roof", DesignVariable::Translate{{0, 0, 1}}},
                            {"slant_turn", "slant", DesignVariable::Rotate{{0, 1, 0}, {0.843, 0, 0.338}}}};
  result.design.variables = {0.03, 0.1};
  return result;
}

/// A torus with radii 1 and 0.4.
Mesh torus() {
  constexpr std::size_t around = 64, across = 32;
  constexpr double pi = 3.14159265358979323846;
  Mesh mesh;
  for (std::size_t j = 0; j < around; ++j) {
    for (std::size_t i = 0; i < across; ++i) {
      const double a = 2 * pi * static_cast<double>(j) / around, b = 2 * pi * static_cast<double>(i) / across;
      mesh.points.push_back({(1 + 0.4 * std::cos(b)) * std::cos(a), (1 + 0.4 * std::cos(b)) * std::sin(a), 0.4 * std::sin(b)});
      const auto at = [&](std::size_t row, std::size_t column) {
        return static_cast<PointId>(across * (row % around) + column % across);
      };
      for (const PointId id : {at(j, i), at(j + 1, i), at(j + 1, i + 1), at(j, i), at(j + 1, i + 1), at(j, i + 1)}) {
        mesh.face_points.push_back(id);
      }
      mesh.face_sizes.insert(mesh.face_sizes.end(), {3, 3});
    }
  }
  return mesh;
}

std::vector<Case> cases(const std::filesystem::path& data) {
  std::vector<Case> result;
  result.push_back(readme(2500));
  result.push_back(ends("torus", torus(), 0, 0.3, 0.7));
  for (const auto& [name, axis] : {std::pair{"joint.off", 1}, {"spool.off", 2}}) {
    const std::filesystem::path path = data / "A_surface" / name;
    if (!std::filesystem::exists(path)) continue;
    Mesh mesh = *io::read_mesh_file(path)->mesh();
    if (std::all_of(mesh.face_sizes.begin(), mesh.face_sizes.end(), [](std::uint32_t size) { return size == 3; })) {
      result.push_back(ends(name, std::move(mesh), static_cast<std::size_t>(axis), 0.3, 0.7));
    }
  }
  return result;
}

/// Largest change of the angle between two faces at an edge that has an end on the border of the constrained regions, radians.
double roughness(const Mesh& mesh, const SelectedRegions& regions, const Points& deformed) {
  std::vector<char> held(mesh.point_count()), border(mesh.point_count());
  for (const auto& handle : regions.handles) {
    for (const PointId id : handle) held[id] = 1;
  }
  for (const PointId id : regions.fixed) held[id] = 1;
  std::map<std::pair<PointId, PointId>, std::vector<std::size_t>> edges;
  const auto corners = [&](std::size_t f) { return mesh.face_points.data() + 3 * f; };
  for (std::size_t f = 0; f < mesh.face_count(); ++f) {
    const PointId* c = corners(f);
    const int count = held[c[0]] + held[c[1]] + held[c[2]];
    if (count == 0 || count == 3) continue;
    for (int k = 0; k < 3; ++k) border[c[k]] = border[c[k]] != 0 || held[c[k]] != 0;
  }
  for (std::size_t f = 0; f < mesh.face_count(); ++f) {
    const PointId* c = corners(f);
    for (int k = 0; k < 3; ++k) {
      const PointId a = c[k], b = c[(k + 1) % 3];
      if (border[a] || border[b]) edges[std::minmax(a, b)].push_back(f);
    }
  }
  const auto normal = [&](const Points& points, std::size_t f) {
    const PointId* c = corners(f);
    const Vec3 n = cross(points[c[1]] - points[c[0]], points[c[2]] - points[c[0]]);
    return n / std::max(norm(n), 1e-300);
  };
  const auto angle = [&](const Points& points, const std::vector<std::size_t>& faces) {
    const Vec3 a = normal(points, faces[0]), b = normal(points, faces[1]);
    return std::atan2(norm(cross(a, b)), dot(a, b));
  };
  double largest = 0;
  for (const auto& [edge, faces] : edges) {
    if (faces.size() != 2) continue;
    largest = std::max(largest, std::abs(angle(deformed, faces) - angle(mesh.points, faces)));
  }
  return largest;
}

struct Result {
  Points points;
  double seconds = 0;  ///< of all cores together: other work on the machine does not count
  double mib = 0, roughness = 0;
  SystemInfo info;
  DesignReport report;
};

Result measured(const std::shared_ptr<const Mesh>& mesh, const Case& example, const RbfOptions& options) {
  Result result;
  deform::Setup setup = example.setup;
  setup.method = options;
  reset_peak();
  const double before = peak_mib();
  const std::clock_t start = std::clock();
  const auto system = prepare(mesh, setup);
  result.seconds = static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
  result.mib = peak_mib() - before;
  result.info = system->info();
  const auto bound = system->bind({&example.design, 1}, EvaluationPath::automatic, {});
  result.report = bound->report(0);
  result.points.resize(mesh->point_count());
  Vec3* const out = result.points.data();
  bound->evaluate(0, mesh->point_count(), 0, {&out, 1});
  result.roughness = roughness(*mesh, validate(setup, *mesh), result.points);
  return result;
}

double largest_displacement(const Mesh& mesh, const Points& points) {
  double largest = 0;
  for (std::size_t i = 0; i < points.size(); ++i) largest = std::max(largest, distance(points[i], mesh.points[i]));
  return largest;
}

/// Over the first points.
double difference(const Points& a, const Points& b, std::size_t count) {
  double largest = 0;
  for (std::size_t i = 0; i < count; ++i) largest = std::max(largest, distance(a[i], b[i]));
  return largest;
}

/// Displacements of a triangle mesh at any place on it, linear in its faces.
class DisplacementOnFaces {
 public:
  DisplacementOnFaces(const Mesh& mesh, const Points& deformed) : mesh_(mesh), deformed_(deformed), tree_(middles(mesh)) {
    for (std::size_t f = 0; f < mesh.face_count(); ++f) {
      for (std::size_t k = 0; k < 3; ++k) reach_ = std::max(reach_, distance(tree_.points()[f], corner(f, k)));
    }
  }

  /// In the face that is nearest to x, which lies on the faces up to the difference of two meshes of one shape.
  Vec3 at(const Vec3& x) const {
    std::vector<PointTree::Near> near;
    tree_.within(x, 1.21 * reach_ * reach_, near);
    Vec3 result{};
    double least = std::numeric_limits<double>::infinity();
    for (const auto& [f, square] : near) {
      const Vec3 foot = closest_point({corner(f, 0), corner(f, 1), corner(f, 2)}, x);
      if (distance(foot, x) >= least) continue;
      least = distance(foot, x);
      result = displacement(f, foot);
    }
    return result;
  }

 private:
  static std::vector<Vec3> middles(const Mesh& mesh) {
    std::vector<Vec3> result;
    for (std::size_t f = 0; f < mesh.face_count(); ++f) {
      const PointId* c = mesh.face_points.data() + 3 * f;
      result.push_back((mesh.points[c[0]] + mesh.points[c[1]] + mesh.points[c[2]]) / 3);
    }
    return result;
  }
  PointId id(std::size_t f, std::size_t k) const { return mesh_.face_points[3 * f + k]; }
  const Vec3& corner(std::size_t f, std::size_t k) const { return mesh_.points[id(f, k)]; }
  Vec3 displacement(std::size_t f, const Vec3& foot) const {
    const Vec3 ab = corner(f, 1) - corner(f, 0), ac = corner(f, 2) - corner(f, 0), ax = foot - corner(f, 0);
    const Vec3 n = cross(ab, ac);
    const double v = dot(cross(ax, ac), n) / dot(n, n), w = dot(cross(ab, ax), n) / dot(n, n);
    const auto of = [&](std::size_t k) { return deformed_[id(f, k)] - corner(f, k); };
    return (1 - v - w) * of(0) + v * of(1) + w * of(2);
  }

  const Mesh& mesh_;
  const Points& deformed_;
  const PointTree tree_;  ///< of the middles of the faces
  double reach_ = 0;      ///< largest distance of a corner from the middle of its face
};

/// The largest difference between the displacements of two meshes of one shape, at points of the coarser one.
double difference(const Mesh& coarse, const Points& deformed, const DisplacementOnFaces& fine) {
  double largest = 0;
  const std::size_t stride = coarse.point_count() / most_compared + 1;
  for (std::size_t i = 0; i < coarse.point_count(); i += stride) {
    largest = std::max(largest, norm(deformed[i] - coarse.points[i] - fine.at(coarse.points[i])));
  }
  return largest;
}

/// The residual at the centres as a fraction of the shortest edge of a face that joins a handle or fixed point and a free one.
/// All such points of a reduced choice are centres, which is checked: not a number where one is not.
double misfit_at_joins(const Mesh& mesh, const SelectedRegions& regions, const RbfOptions& options, double residual) {
  const ConstraintPoints points = constraint_points(mesh, regions);
  const std::vector<PointId> centres = choose_centres(mesh, points, regions.handles.size(), options).ids;
  const auto is_free = [&](PointId id) { return points.region_of[id] == deformable_region; };
  double shortest = std::numeric_limits<double>::infinity();
  for (std::size_t f = 0; f < mesh.face_count(); ++f) {
    const PointId* c = mesh.face_points.data() + 3 * f;
    const auto free_corners = std::count_if(c, c + 3, is_free);
    if (free_corners == 0 || free_corners == 3) continue;
    for (std::size_t k = 0; k < 3; ++k) {
      if (!is_free(c[k]) && !std::binary_search(centres.begin(), centres.end(), c[k])) return std::nan("");
      shortest = std::min(shortest, distance(mesh.points[c[k]], mesh.points[c[(k + 1) % 3]]));
    }
  }
  return residual / shortest;
}

void print(const char* name, const Result& result, double moved, std::size_t common, const Points* coarser, const Result* all) {
  std::printf("  %-10s %8zu %9zu %9.1e %9.1e %8.2f %7.0f %9.1e", name, result.info.centres, result.info.constraint_points,
              result.info.reduction_misfit, result.info.reduction_error, result.seconds, result.mib, result.info.condition);
  coarser != nullptr ? std::printf(" %10.2e", difference(*coarser, result.points, common) / moved) : std::printf(" %10s", "");
  all != nullptr ? std::printf(" %10.2e %9.3f", difference(all->points, result.points, all->points.size()) / moved,
                               result.roughness / all->roughness)
                 : std::printf(" %10s %9s", "", "");
  std::printf("\n");
  std::fflush(stdout);
}

void refine(const Case& example, const std::vector<std::size_t>& sizes) {
  std::printf("\n%s\n  %-10s %8s %9s %9s %9s %8s %7s %9s %10s %10s %9s\n", example.name.c_str(), "centres", "number", "of",
              "misfit", "estimate", "CPU s", "MiB", "condition", "d coarser", "d all", "rough/all");
  const std::size_t common = example.mesh.point_count();  // these points keep their ids
  Points few, rings, everything;
  for (const std::size_t size : sizes) {
    const auto mesh = std::make_shared<const Mesh>(refined(example.mesh, size));
    std::printf(" %zu points\n", mesh->point_count());
    RbfOptions options;
    const Result reduced = measured(mesh, example, options);
    const double moved = largest_displacement(*mesh, reduced.points);
    Result all;
    const bool dense = reduced.info.constraint_points <= most_dense;
    const bool affordable = dense || reduced.info.constraint_points <= most_iterative;
    if (affordable) {
      options.reduction = CentreReduction::off;
      options.solver = dense ? Solver::automatic : Solver::iterative;
      options.tolerance = 1e-7;
      all = measured(mesh, example, options);
      print(dense ? "all" : "all, iter.", all, moved, common, everything.empty() ? nullptr : &everything, nullptr);
      everything = all.points;
    }
    print("tolerance", reduced, moved, common, few.empty() ? nullptr : &few, affordable ? &all : nullptr);
    options = {};
    options.reduction = CentreReduction::rings;
    const Result ringed = measured(mesh, example, options);
    print("3 rings", ringed, moved, common, rings.empty() ? nullptr : &rings, affordable ? &all : nullptr);
    few = reduced.points;
    rings = ringed.points;
  }
}

}  // namespace

void large_reductions(const std::vector<std::size_t>& sizes) {
  std::printf(
      "\nreduction of centres, the README's setup on meshes of deform sample --points; differences in fractions of the largest\n"
      "displacement, misfit at joins in fractions of the shortest edge there\n  %-10s %8s %9s %9s %9s %8s %7s %9s %10s %10s %9s "
      "%9s\n",
      "centres", "number", "of", "misfit", "estimate", "CPU s", "MiB", "condition", "d coarser", "d all", "joins", "moves");
  Mesh coarser;
  Points few, rings, everything;
  for (const std::size_t size : sizes) {
    const Case example = readme(size);
    const auto mesh = std::make_shared<const Mesh>(example.mesh);
    std::printf(" %zu points\n", mesh->point_count());
    const auto row = [&](const char* name, const Result& result, const Points* before, const Result* all, double joins) {
      const double moved = largest_displacement(*mesh, result.points);
      std::printf("  %-10s %8zu %9zu %9.1e %9.1e %8.2f %7.0f %9.1e", name, result.info.centres, result.info.constraint_points,
                  result.info.reduction_misfit, result.info.reduction_error, result.seconds, result.mib, result.info.condition);
      const auto number = [](bool known, double value) { known ? std::printf(" %10.2e", value) : std::printf(" %10s", ""); };
      number(before != nullptr && !before->empty(),
             before == nullptr || before->empty()
                 ? 0
                 : difference(coarser, *before, DisplacementOnFaces(*mesh, result.points)) / moved);
      number(all != nullptr, all == nullptr ? 0 : difference(all->points, result.points, mesh->point_count()) / moved);
      joins >= 0 ? std::printf(" %9.1e", joins) : std::printf(" %9s", "");
      std::printf(" %9.5f\n", moved);
      std::fflush(stdout);
    };
    RbfOptions options;
    const Result reduced = measured(mesh, example, options);
    const double joins = misfit_at_joins(*mesh, validate(example.setup, *mesh), with_defaults(options, *mesh),
                                         reduced.report.interpolation_residual);
    const bool dense = reduced.info.constraint_points <= most_dense;
    const bool affordable = dense || reduced.info.constraint_points <= most_iterative;
    Result all;
    if (affordable) {
      options.reduction = CentreReduction::off;
      options.solver = dense ? Solver::automatic : Solver::iterative;
      options.basis = BasisMode::never;
      all = measured(mesh, example, options);
      row(dense ? "all" : "all, iter.", all, &everything, nullptr, -1);
    }
    row("tolerance", reduced, &few, affordable ? &all : nullptr, joins);
    options = {};
    options.reduction = CentreReduction::rings;
    const Result ringed = measured(mesh, example, options);
    row("3 rings", ringed, &rings, affordable ? &all : nullptr, -1);
    few = reduced.points;
    rings = ringed.points;
    everything = all.points;
    coarser = *mesh;
  }
}

void centre_reduction(ReductionSizes sizes, const std::filesystem::path& data) {
  std::printf(
      "\nreduction of centres, r^3; differences in fractions of the largest displacement: from the result on the coarser mesh, "
      "at its\n"
      "points, and from all centres; roughness: largest change of an angle between faces at the border of regions\n");
  for (const Case& example : cases(data)) {
    sizes == ReductionSizes::small ? refine(example, {2500, 10000}) : refine(example, {2500, 10000, 50000, 150000});
  }
}

}  // namespace deform::bench
