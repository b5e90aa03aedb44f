// SPDX-License-Identifier: GPL-3.0-or-later
// Thesis 4.2 to 4.4 and 4.6: a ball whose one side is moved and turned, the other one fixed, along no axis of a lattice.
#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/base/error.h"
#include "core/base/vectors.h"
#include "core/mesh/adjacency.h"
#include "core/quality/mean_curvature.h"
#include "tests/bench/methods/methods.h"

namespace deform::bench {

namespace {

const Vec3 oblique = (1 / std::sqrt(14.0)) * Vec3{1, 2, 3};

/// The points farthest along a direction.
std::vector<PointId> farthest(const Points& points, const Vec3& along, std::size_t count) {
  std::vector<PointId> ids(points.size());
  std::iota(ids.begin(), ids.end(), PointId{0});
  std::stable_sort(ids.begin(), ids.end(), [&](PointId a, PointId b) { return dot(points[a], along) > dot(points[b], along); });
  ids.resize(count);
  std::sort(ids.begin(), ids.end());
  return ids;
}

/// The rotation about a unit axis through the origin, then a translation.
Affine turned(const Vec3& axis, double angle, const Vec3& shift) {
  const double c = std::cos(angle), s = std::sin(angle), d = 1 - c;
  const auto& [x, y, z] = axis;
  return {c + d * x * x,     d * x * y - s * z, d * x * z + s * y, shift[0],          d * x * y + s * z, c + d * y * y,
          d * y * z - s * x, shift[1],          d * x * z - s * y, d * y * z + s * x, c + d * z * z,     shift[2]};
}

/// The sphere of figure 4.1: 7,842 points (the thesis has 7,800), 526 of the handle, 404 fixed.
Task ball(bool quick) {
  Task task;
  const std::uint32_t n = quick ? 14 : 28;
  Mesh mesh = geodesic_sphere(1, n);
  const std::size_t share = quick ? 4 : 1;
  task.handle = farthest(mesh.points, oblique, 526 / share);
  task.fixed = farthest(mesh.points, Vec3{} - oblique, 404 / share);
  double border = 1;
  for (const PointId id : task.handle) border = std::min(border, dot(mesh.points[id], oblique));
  task.moves = [border](const Vec3& x) { return dot(x, oblique) > border; };
  task.cage = sphere_cage(1.15, 7);  // 492 vertices
  task.motion = turned(oblique, 0.3, 0.4 * oblique + Vec3{0.1, -0.05, 0});
  task.mesh = std::make_shared<const Mesh>(std::move(mesh));
  return task;
}

/// Largest distance of handle points from where they are sent and of fixed points from where they were.
double misfit(const Task& task, const Points& points) {
  double largest = 0;
  for (const PointId id : task.handle) {
    largest = std::max(largest, distance(points[id], transformed(task.motion, task.mesh->points[id])));
  }
  for (const PointId id : task.fixed) largest = std::max(largest, distance(points[id], task.mesh->points[id]));
  return largest;
}

double diagonal(const Task& task) { return bounding_box(task.mesh->points).diagonal(); }

double largest_distance(const Points& a, const Points& b, std::size_t count) {
  double largest = 0;
  for (std::size_t i = 0; i < count; ++i) largest = std::max(largest, distance(a[i], b[i]));
  return largest;
}

/// What averages over neighbours leave of a field on some points, as an area-weighted root mean square. So many averages take
/// away what is longer than about `length`.
class HighPass {
 public:
  HighPass(const Mesh& mesh, std::vector<char> inside, double length) : inside_(std::move(inside)) {
    const Adjacency adjacency(mesh);
    neighbours_.resize(mesh.point_count());
    double edges = 0;
    std::size_t count = 0;
    for (std::size_t i = 0; i < mesh.point_count(); ++i) {
      for (const FaceId face : adjacency.faces_of(static_cast<PointId>(i))) {
        for (const PointId other : adjacency.points_of(face)) {
          if (other == i) continue;
          neighbours_[i].push_back(other);
          edges += squared_distance(mesh.points[i], mesh.points[other]);
          ++count;
        }
      }
    }
    // One average is a step of diffusion by a half of the mean squared edge.
    averages_ = static_cast<std::size_t>(std::ceil(length * length / (edges / static_cast<double>(count))));
  }

  double energy(const MeanCurvature& curvature) const {
    std::vector<double> smooth = curvature.value, next = smooth;
    for (std::size_t pass = 0; pass < averages_; ++pass) {
      for (std::size_t i = 0; i < smooth.size(); ++i) {
        if (!inside_[i]) continue;
        double sum = smooth[i], weight = 1;
        for (const PointId other : neighbours_[i]) {
          if (!inside_[other]) continue;
          sum += smooth[other];
          weight += 1;
        }
        next[i] = sum / weight;
      }
      smooth.swap(next);
    }
    double sum = 0, area = 0;
    for (std::size_t i = 0; i < smooth.size(); ++i) {
      if (!inside_[i]) continue;
      sum += curvature.area[i] * (curvature.value[i] - smooth[i]) * (curvature.value[i] - smooth[i]);
      area += curvature.area[i];
    }
    return std::sqrt(sum / area);
  }

 private:
  std::vector<char> inside_;
  std::vector<std::vector<PointId>> neighbours_;
  std::size_t averages_ = 0;
};

/// Without caps, needles and the like: the faces that thesis figure 4.2 shows, over the points that are there.
Mesh with_defects(const Mesh& mesh) {
  Mesh all = mesh;
  const auto add = [&](PointId a, PointId b, PointId c) {
    all.face_sizes.push_back(3);
    all.face_points.insert(all.face_points.end(), {a, b, c});
  };
  const auto& corners = mesh.face_points;
  for (std::size_t f = 0; f + 40 < mesh.face_sizes.size(); f += 97) {
    const PointId a = corners[3 * f], b = corners[3 * f + 1], c = corners[3 * f + 2], far = corners[3 * (f + 40)];
    add(a, b, far);                                         // an edge with three faces, through others
    add(a, a, b);                                           // a face without area
    add(c, b, a);                                           // a face on its back
    if (f % 2 == 0) add(a, far, corners[3 * (f + 1) + 1]);  // a needle
  }
  const auto first = static_cast<PointId>(all.points.size());  // another component, inside
  for (const Vec3& x : {Vec3{0, 0, 0}, Vec3{0.1, 0, 0}, Vec3{0, 0.1, 0}}) all.points.push_back(x);
  add(first, first + 1, first + 2);
  return all;
}

Json by_method(const std::function<Json(MethodKind)>& measure) {
  Json rows = Json::array();
  for (const MethodKind kind : all_methods) {
    Json row;
    row["method"] = to_string(kind);
    try {
      row.update(measure(kind));
    } catch (const Error& error) {
      row["refused"] = error.what();
    }
    rows.push_back(std::move(row));
  }
  return rows;
}

}  // namespace

Json performance(bool quick) {
  const Task task = ball(quick);
  Json result;
  result["points"] = task.mesh->point_count();
  result["handle"] = task.handle.size();
  result["fixed"] = task.fixed.size();
  result["cage"] = task.cage.vertices.size();
  result["rows"] = by_method([&](MethodKind kind) {
    const Setup setup = setup_of(task, kind);
    std::shared_ptr<const System> system;
    Json row;
    for (const int threads : {1, 0}) {
      RunContext context;
      context.threads = threads;
      const double seconds = seconds_of([&] { system = prepare(task.mesh, setup, context); });
      row[threads == 1 ? "prepare_one_thread" : "prepare"] = seconds;
    }
    for (const auto& [stage, seconds] : system->info().stage_seconds) row["stages"][stage] = seconds;
    const Design design = design_of(task);
    const auto once = [&](EvaluationPath path) { return seconds_of([&] { (void)system->evaluate({&design, 1}, path, {}); }, 5); };
    row["design"] = once(EvaluationPath::automatic);
    row["bytes"] = system->bytes();
    const SystemInfo& info = system->info();
    row["unknowns"] = info.functions > 0 ? info.functions : info.centres + info.samples;
    return row;
  });
  return result;
}

Json robustness(bool quick) {
  const Task clean = ball(quick);
  Task broken = clean;
  broken.mesh = std::make_shared<const Mesh>(with_defects(*clean.mesh));
  Json result;
  result["faces_added"] = broken.mesh->face_count() - clean.mesh->face_count();
  result["rows"] = by_method([&](MethodKind kind) {
    // The same functions in both: energies in space choose them by the faces otherwise.
    const Points a = prepare(clean.mesh, setup_of(clean, kind))->evaluate(design_of(clean));
    const Points b = prepare(broken.mesh, setup_of(broken, kind))->evaluate(design_of(broken));
    Json row;
    row["difference"] = largest_distance(a, b, a.size()) / diagonal(clean);
    return row;
  });
  return result;
}

Json smoothness(bool quick) {
  Task task = ball(quick);
  task.lattice = {9, 9, 9};
  task.cage = sphere_cage(1.15, 9);  // 812 vertices
  const Adjacency adjacency(*task.mesh);
  // Where a method decides: from three rings beside handle and fixed points on.
  std::vector<char> held(task.mesh->point_count(), 0);
  for (const PointId id : task.handle) held[id] = 1;
  for (const PointId id : task.fixed) held[id] = 1;
  std::vector<char> inside = adjacency.grow(held, 3);
  for (char& value : inside) value = value == 0 ? 1 : 0;
  const double cell = 2.0 / 6;  // of the lattice
  const HighPass filter(*task.mesh, inside, cell);
  Json result;
  result["length"] = cell;
  result["at_rest"] = filter.energy(mean_curvature(*task.mesh, adjacency));
  const Vec3 side = (1 / std::sqrt(5.0)) * Vec3{2, -1, 0}, up = cross(oblique, side);
  Json places = Json::array();
  for (const Vec3& x : task.mesh->points) {
    places.push_back({std::atan2(dot(x, up), dot(x, side)), std::asin(std::clamp(dot(x, oblique), -1.0, 1.0))});
  }
  result["places"] = std::move(places);
  result["rows"] = by_method([&](MethodKind kind) {
    Mesh deformed = *task.mesh;
    deformed.points = prepare(task.mesh, setup_of(task, kind))->evaluate(design_of(task));
    const MeanCurvature curvature = mean_curvature(deformed, adjacency);
    Json row;
    row["high_pass"] = filter.energy(curvature);
    Json values = Json::array();
    for (const double h : curvature.value) values.push_back(std::round(1e4 * h) / 1e4);
    row["curvature"] = std::move(values);
    return row;
  });
  return result;
}

Json lattice_resolution(bool quick) {
  Task task = ball(quick);
  Json result;
  for (const MethodKind kind : {MethodKind::ffd_mesh, MethodKind::ffd_energy}) {
    std::vector<Points> shapes;
    const std::vector<std::size_t> counts{5, 8, 12};
    for (const std::size_t n : counts) {
      task.lattice = {n, n, n};
      shapes.push_back(prepare(task.mesh, setup_of(task, kind))->evaluate(design_of(task)));
    }
    double moved = 0;
    for (const PointId id : task.handle) {
      moved = std::max(moved, distance(task.mesh->points[id], transformed(task.motion, task.mesh->points[id])));
    }
    Json row;
    row["method"] = to_string(kind);
    for (std::size_t k = 0; k + 1 < shapes.size(); ++k) {
      Json entry;
      entry["from"] = counts[k];
      entry["to"] = counts[k + 1];
      entry["difference"] = largest_distance(shapes[k], shapes[k + 1], shapes[k].size()) / moved;
      row["steps"].push_back(std::move(entry));
    }
    result["rows"].push_back(std::move(row));
  }
  // A lattice over a part of a plate, whose middle control points are lifted; with planes of control points at rest beside them.
  const auto flat = std::make_shared<const Mesh>(plate(quick ? 61 : 201, 11, 2, 0.1));
  for (const std::size_t planes : {0, 1, 2, 3}) {
    const double span = 0.1, length = span * static_cast<double>(2 + 2 * planes);
    FfdOptions options;
    options.control = FfdControl::controls;
    options.lattice.frame = LatticeFrame{{1 - length / 2, -0.05, -0.1}, {{{length, 0, 0}, {0, 0.2, 0}, {0, 0, 0.2}}}};
    const std::size_t count = 2 + 2 * planes + 3;  // uniform cubic: spans + 3
    options.lattice.points = {count, 4, 4};
    Setup setup;
    setup.method = options;
    const auto first = static_cast<std::uint32_t>(planes), last = static_cast<std::uint32_t>(count - 1 - planes);
    setup.handles = {{"middle", {Region::LatticeRange{{Region::LatticeRange::Range{first, last}, std::nullopt, std::nullopt}}}}};
    const auto system = prepare(flat, setup);
    Design design;
    design.motions.push_back({0, Affine{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0.2}});
    const auto evaluation = system->bind({&design, 1}, EvaluationPath::automatic, {});
    const Points points = system->evaluate(design);
    double jump = 0;
    std::size_t corner = 0;
    for (const std::uint32_t size : flat->face_sizes) {
      for (std::uint32_t k = 0; k < size; ++k) {
        const PointId a = flat->face_points[corner + k], b = flat->face_points[corner + (k + 1) % size];
        jump = std::max(jump, std::abs(points[a][2] - points[b][2]));
      }
      corner += size;
    }
    Json entry;
    entry["planes"] = planes;
    entry["largest_step"] = jump / 0.2;
    entry["torn_edges"] = evaluation->report(0).torn_edges;
    result["partial"].push_back(std::move(entry));
  }
  return result;
}

Json precision(bool quick) {
  const Task task = ball(quick);
  Json result;
  result["rows"] = by_method([&](MethodKind kind) {
    const auto system = prepare(task.mesh, setup_of(task, kind));
    const Design design = design_of(task);
    const auto evaluation = system->bind({&design, 1}, EvaluationPath::automatic, {});
    Json row;
    row["misfit"] = misfit(task, system->evaluate(design)) / diagonal(task);
    row["estimated_error"] = evaluation->report(0).error / diagonal(task);
    return row;
  });
  return result;
}

}  // namespace deform::bench
