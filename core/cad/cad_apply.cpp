// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/cad_apply.h"

#include <BRepAdaptor_Curve.hxx>
#include <BRep_Builder.hxx>
#include <BRep_Tool.hxx>
#include <GCPnts_AbscissaPoint.hxx>
#include <Geom_Curve.hxx>
#include <Geom_Surface.hxx>
#include <Precision.hxx>
#include <Standard_Failure.hxx>
#include <TopoDS_Compound.hxx>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>
#include <random>

#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/text.h"
#include "core/base/vectors.h"
#include "core/cad/crossing_faces.h"
#include "core/cad/deformed_shape.h"
#include "core/cad/derivation.h"
#include "core/cad/document.h"
#include "core/cad/model.h"
#include "core/cad/refitting.h"

namespace deform::cad {

namespace {

constexpr std::size_t least_checks = 20;      ///< of a face
constexpr int most_widenings = 3;             ///< of tolerances, each twice as wide
constexpr int most_refinements = 10;          ///< after the random points
constexpr double rigid_share = 0.1;           ///< of the tolerance
constexpr double crossing_deflection = 5e-4;  ///< of D
constexpr double reshaped_share = 0.5;        ///< of the tolerance

/// A random point of a face.
struct Check {
  int face = 0;
  double u = 0, v = 0;
};

/// A random point of an edge.
struct EdgeCheck {
  int edge = 0;
  double t = 0;
};

constexpr double edge_check_spacing = 0.005;  ///< of D
constexpr int most_edge_checks = 200;         ///< of an edge

/// Random points of the edges, each with some.
std::vector<EdgeCheck> random_edge_checks(const Model& model, std::uint64_t seed) {
  std::mt19937_64 engine(seed);
  std::vector<EdgeCheck> checks;
  for (int e = 0; e < model.edge_count(); ++e) {
    if (BRep_Tool::Degenerated(model.edge(e))) continue;
    const BRepAdaptor_Curve curve(model.edge(e));
    const double from = curve.FirstParameter(), to = curve.LastParameter();
    const double length = GCPnts_AbscissaPoint::Length(curve, 1e-3 * model.diagonal);
    const int count = std::clamp(static_cast<int>(length / (edge_check_spacing * model.diagonal)), 8, most_edge_checks);
    // One in each of equal parts, so that no part is left out.
    for (int k = 0; k < count; ++k) {
      checks.push_back({e, from + (to - from) * (k + static_cast<double>(engine() >> 11) * 0x1p-53) / count});
    }
  }
  return checks;
}

/// Random points inside the trimmed faces, as many on each as its share of the area.
std::vector<Check> random_checks(const Refitting& refitting, int faces, std::size_t count, std::uint64_t seed) {
  std::mt19937_64 engine(seed);
  const auto uniform = [&] { return static_cast<double>(engine() >> 11) * 0x1p-53; };
  const auto random = [&](int f) {
    const std::array<double, 4>& box = refitting.region(f).box();
    const double u = box[0] + uniform() * (box[1] - box[0]);
    return Check{f, u, box[2] + uniform() * (box[3] - box[2])};
  };
  // Areas from the first points.
  std::vector<std::vector<Check>> found(faces);
  std::vector<double> areas(faces, 0.0);
  double all = 0;
  for (int f = 0; f < faces; ++f) {
    const std::array<double, 4>& box = refitting.region(f).box();
    std::size_t tries = 0;
    for (; found[f].size() < least_checks && tries < 200 * least_checks; ++tries) {
      const Check check = random(f);
      if (!refitting.region(f).contains(check.u, check.v)) continue;
      const auto frame = refitting.frame_at_rest(f, {check.u, check.v});
      areas[f] += norm(cross(frame[1], frame[2]));
      found[f].push_back(check);
    }
    if (tries > 0) areas[f] *= (box[1] - box[0]) * (box[3] - box[2]) / static_cast<double>(tries);
    all += areas[f];
  }
  std::vector<Check> checks;
  for (int f = 0; f < faces; ++f) {
    checks.insert(checks.end(), found[f].begin(), found[f].end());
    const auto share = static_cast<std::size_t>(all > 0 ? areas[f] / all * static_cast<double>(count) : 0);
    if (found[f].size() < least_checks) continue;  // hardly anything of the box is inside
    for (std::size_t more = least_checks, tries = 0; more < share && tries < 100 * share; ++tries) {
      const Check check = random(f);
      if (!refitting.region(f).contains(check.u, check.v)) continue;
      checks.push_back(check);
      ++more;
    }
  }
  return checks;
}

Points places_of(const Refitting& refitting, const std::vector<Check>& checks) {
  Points places;
  for (const Check& check : checks) places.push_back(refitting.at_rest(check.face, {check.u, check.v}));
  return places;
}

/// Short steps from a point of a face, along it and into the solid: where they go says whether the map turns space inside out.
constexpr std::size_t probe_points = 4;
constexpr double probe_step = 1e-4;  ///< of D
constexpr std::size_t probes = 2;    ///< of a face

/// The first checks of each face, with their steps.
Points probes_of(const Refitting& refitting, const Model& model, const std::vector<Check>& checks) {
  Points places;
  std::size_t of_face = 0;
  for (std::size_t i = 0; i < checks.size(); ++i) {
    of_face = i > 0 && checks[i].face == checks[i - 1].face ? of_face + 1 : 0;
    if (of_face >= probes) continue;
    const auto [p, along_u, along_v] = refitting.frame_at_rest(checks[i].face, {checks[i].u, checks[i].v});
    const Vec3 normal = cross(along_u, along_v);
    if (!(norm(along_u) > 0) || !(norm(normal) > 0)) {
      --of_face;
      continue;
    }
    const double step = probe_step * model.diagonal;
    const Vec3 first = along_u / norm(along_u), inside = -model.face_sense(checks[i].face) * (normal / norm(normal));
    places.insert(places.end(), {p, p + step * first, p + step * cross(inside, first), p + step * inside});
  }
  return places;
}

/// How many of the probes the map turns inside out.
std::size_t inverted_probes(std::span<const Vec3> moved) {
  std::size_t inverted = 0;
  for (std::size_t i = 0; i + probe_points <= moved.size(); i += probe_points) {
    const Vec3& p = moved[i];
    if (!(dot(cross(moved[i + 1] - p, moved[i + 2] - p), moved[i + 3] - p) > 0)) ++inverted;
  }
  return inverted;
}

/// Distances of the new surfaces from where the map takes the checks.
std::vector<double> errors_of(const Refitting& refitting, const std::vector<Check>& checks, const Points& targets) {
  std::vector<double> errors;
  for (std::size_t i = 0; i < checks.size(); ++i) {
    errors.push_back(refitting.error(checks[i].face, {checks[i].u, checks[i].v}, targets[i]));
  }
  return errors;
}

using Stages = std::vector<std::pair<std::string, double>>;

/// Adds the time until it goes to a stage, less what other stages took in the meantime.
class StageClock {
 public:
  StageClock(Stages& stages, std::string stage) : stages_(stages), stage_(std::move(stage)) {}
  ~StageClock() {
    const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start_;
    const double seconds = elapsed.count() - (sum(stages_) - before_);
    const auto known = std::find_if(stages_.begin(), stages_.end(), [&](const auto& other) { return other.first == stage_; });
    if (known == stages_.end()) {
      stages_.emplace_back(stage_, seconds);
    } else {
      known->second += seconds;
    }
  }
  StageClock(const StageClock&) = delete;
  StageClock& operator=(const StageClock&) = delete;

 private:
  static double sum(const Stages& stages) {
    double all = 0;
    for (const auto& [stage, seconds] : stages) all += seconds;
    return all;
  }

  Stages& stages_;
  const std::string stage_;
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  const double before_ = sum(stages_);
};

template <typename Work>
auto timed(Stages& stages, const std::string& stage, const Work& work) {
  const StageClock clock(stages, stage);
  return work();
}

DeformedFace::Became became(Refit refit) {
  using Became = DeformedFace::Became;
  switch (refit) {
    case Refit::kept:
      return Became::kept;
    case Refit::moved:
      return Became::moved;
    case Refit::reshaped:
      return Became::reshaped;
    default:
      return Became::fitted;
  }
}

class Application {
 public:
  Application(const ApplyRequest& request, const SpaceMap& map, const RunContext& context)
      : request_(request),
        map_(map),
        context_(context),
        document_(timed(result_.stages, "read", [&] { return read_document(request.model); })),
        model_(model_of(document_, request.model.string())),
        held_(request.mesh != nullptr && request.hold > 0
                  ? std::optional<HeldFaces>(std::in_place, model_, *request.mesh, request.scale, request.hold * model_.diagonal)
                  : std::nullopt),
        refitting_(model_,
                   {request.tolerance * model_.diagonal, rigid_limit(request) * model_.diagonal,
                    std::max(reshaped_share * request.tolerance, request.rigid) * model_.diagonal},
                   held_ ? &*held_ : nullptr) {}

  DeformedModel apply() {
    result_.notes = document_.notes;
    result_.diagonal = model_.diagonal;
    if (request_.mesh != nullptr) {
      check_place(model_, *request_.mesh, request_.scale);
      const auto doubt = timed(result_.stages, "check", [&] { return doubt_of_place(model_, *request_.mesh, request_.scale); });
      if (doubt) result_.notes.push_back(*doubt);
    }
    timed(result_.stages, "fit", [&] { fit(); });
    timed(result_.stages, "build", [&] { deform(); });
    timed(result_.stages, "fit", [&] { measure(); });
    if (request_.crossings == ApplyRequest::Crossings::looked_for)
      timed(result_.stages, "crossings", [&] { look_for_crossings(); });
    write();
    return result_;
  }

 private:
  static double rigid_limit(const ApplyRequest& request) {
    return request.rigid > 0 ? request.rigid : rigid_share * request.tolerance;
  }
  double tolerance() const { return request_.tolerance * model_.diagonal; }
  /// What a face may be off.
  double tolerance(int f) const {
    if (refitting_.refit(f) == Refit::fitted) return tolerance();
    return std::max(tolerance(), rigid_limit(request_) * model_.diagonal);
  }

  /// The map in the unit of the model.
  Points mapped(Points points) {
    context_.check();
    if (points.empty()) return points;
    ++result_.rounds;
    for (Vec3& p : points) p = request_.scale * p;
    const std::size_t count = points.size();
    points = timed(result_.stages, "map", [&] { return map_(points); });
    if (points.size() != count) throw Error(ErrorCode::internal, "the deformation gave another number of points");
    for (Vec3& p : points) p = p / request_.scale;
    return points;
  }

  /// Rounds until nodes and random points agree with the map.
  void fit() {
    const std::vector<Check> checks = random_checks(refitting_, model_.face_count(), request_.checks, request_.seed);
    const std::vector<EdgeCheck> edge_checks = random_edge_checks(model_, request_.seed);
    Points places = places_of(refitting_, checks);
    for (const EdgeCheck& check : edge_checks) places.push_back(refitting_.edge_at_rest(check.edge, check.t));
    // Asked for at once, and not looked at until the geometry is there.
    last_checks_ = random_checks(refitting_, model_.face_count(), request_.checks, request_.seed ^ 0x9e3779b97f4a7c15u);
    const Points last_places = places_of(refitting_, last_checks_);
    const Points probed = model_.solids.IsEmpty() ? Points() : probes_of(refitting_, model_, checks);
    Points asked = refitting_.wanted();
    result_.samples = asked.size() + probed.size();
    asked.insert(asked.end(), probed.begin(), probed.end());
    asked.insert(asked.end(), places.begin(), places.end());
    asked.insert(asked.end(), last_places.begin(), last_places.end());
    Points answer = mapped(asked);
    last_targets_.assign(answer.end() - static_cast<std::ptrdiff_t>(last_places.size()), answer.end());
    answer.resize(answer.size() - last_places.size());
    const Points targets(answer.end() - static_cast<std::ptrdiff_t>(places.size()), answer.end());
    answer.resize(answer.size() - places.size());
    check_handedness(std::span(answer).last(probed.size()));
    answer.resize(answer.size() - probed.size());
    refitting_.give(answer);
    for (int round = 0;; ++round) {
      // It ends: each round adds nodes, of which there are at most so many.
      for (const Points* wanted = &refitting_.wanted(); !wanted->empty(); wanted = &refitting_.wanted()) {
        result_.samples += wanted->size();
        refitting_.give(mapped(*wanted));
      }
      if (refitting_.check_borders()) continue;  // each face once
      if (round >= most_refinements) return;
      const bool finer_faces = refine(checks, errors_of(refitting_, checks, targets));
      const bool finer_edges = refine_edges(edge_checks, std::span(targets).subspan(checks.size()));
      if (!finer_faces && !finer_edges) return;
    }
  }

  void check_handedness(std::span<const Vec3> moved) {
    const std::size_t folds = inverted_probes(moved), probe_count = moved.size() / probe_points;
    if (2 * folds > probe_count) refuse("the deformation turns the model inside out");
    if (folds > 0) {
      result_.notes.push_back("The deformation turns space inside out at " + std::to_string(folds) + " of " +
                              std::to_string(probe_count) + " points at which that was looked for.");
    }
  }

  bool refine_edges(const std::vector<EdgeCheck>& checks, std::span<const Vec3> targets) {
    std::map<int, std::vector<double>> bad;
    for (std::size_t i = 0; i < checks.size(); ++i) {
      const auto& [edge, t] = checks[i];
      if (!refitting_.edge_held(edge) && refitting_.edge_error(edge, t, targets[i]) > tolerance()) bad[edge].push_back(t);
    }
    bool finer = false;
    for (const auto& [edge, parameters] : bad) finer = refitting_.refine_edge(edge, parameters) || finer;
    return finer;
  }

  /// Makes faces finer around errors above their tolerance.
  bool refine(const std::vector<Check>& checks, const std::vector<double>& errors) {
    std::vector<std::vector<std::array<double, 2>>> bad(model_.face_count());
    for (std::size_t i = 0; i < checks.size(); ++i) {
      if (!refitting_.held(checks[i].face) && errors[i] > tolerance(checks[i].face))
        bad[checks[i].face].push_back({checks[i].u, checks[i].v});
    }
    bool finer = false;
    for (int f = 0; f < model_.face_count(); ++f) {
      if (!bad[f].empty()) finer = refitting_.refine_face(f, bad[f]) || finer;
    }
    return finer;
  }

  /// OpenCASCADE takes edges without a length for valid, and reads faces without them from STEP.
  void check_edges() const {
    for (int e = 0; e < model_.edge_count(); ++e) {
      double from = 0, to = 0;
      const Handle(Geom_Curve) rest = BRep_Tool::Curve(model_.edge(e), from, to), now = refitting_.curve(e);
      if (now.IsNull() || is_point(*rest, from, to) || !is_point(*now, from, to)) continue;
      refuse("edge " + std::to_string(e + 1) + " shrinks to a point");
    }
  }

  static bool is_point(const Geom_Curve& curve, double from, double to) {
    constexpr int pieces = 12;
    for (int k = 1; k <= pieces; ++k) {
      if (curve.Value(from).Distance(curve.Value(from + (to - from) * k / pieces)) > Precision::Confusion()) return false;
    }
    return true;
  }

  void deform() {
    check_edges();
    deformed_ = document_;
    for (Part& part : deformed_.parts) {
      context_.check();
      const DeformedShape shape = deformed_shape(part.shape, model_, refitting_, tolerance());
      part.shape = shape.shape;
      result_.gap = std::max(result_.gap, shape.largest_gap);
    }
  }

  /// The error, at other random points than those that the fit knows.
  void measure() {
    const std::vector<Check>& checks = last_checks_;
    const std::vector<double> errors = errors_of(refitting_, checks, last_targets_);
    result_.checks = checks.size();
    result_.faces.resize(model_.face_count());
    double squares = 0;
    for (std::size_t i = 0; i < checks.size(); ++i) {
      DeformedFace& face = result_.faces[checks[i].face];
      const bool held = refitting_.held(checks[i].face);
      double& largest = held ? face.overlooked : face.error;
      largest = std::max(largest, errors[i]);
      if (!held) squares += errors[i] * errors[i];
    }
    for (int f = 0; f < model_.face_count(); ++f) {
      DeformedFace& face = result_.faces[f];
      face.number = f + 1;
      face.type = surface_type(model_.face(f));
      face.became = refitting_.scaled(f) ? DeformedFace::Became::reshaped : became(refitting_.refit(f));
      if (face.became == DeformedFace::Became::fitted) face.poles = refitting_.nodes(f);
      face.held = refitting_.held(f);
      result_.error = std::max(result_.error, face.error);
      result_.overlooked = std::max(result_.overlooked, face.overlooked);
      if (face.error > std::max(2 * tolerance(), tolerance(f))) result_.coarse.push_back(face.number);
    }
    if (!checks.empty()) result_.rms = std::sqrt(squares / static_cast<double>(checks.size()));
  }

  void look_for_crossings() {
    const double deflection = crossing_deflection * model_.diagonal;
    const auto before = crossing_faces(model_, deflection, context_);
    for (const std::array<int, 2>& pair : crossing_faces(model_of(deformed_, model_.name), deflection, context_)) {
      if (before.count(pair) == 0) result_.crossings.push_back({pair[0] + 1, pair[1] + 1});
    }
  }

  [[noreturn]] void refuse(const std::string& why) const {
    throw Error(ErrorCode::failed_precondition, request_.model.string() + ": " + why + "; nothing is written");
  }

  /// The faults of parts that were valid; empty: none.
  std::string faults_of(const Document& document) const {
    for (std::size_t i = 0; i < document.parts.size(); ++i) {
      const std::string faults = cad::faults_of(document.parts[i].shape);
      if (faults.empty()) continue;
      if (i < document_.parts.size() && !cad::faults_of(document_.parts[i].shape).empty()) continue;  // it was not before, either
      return (document.parts.size() > 1 ? ", part " + std::to_string(i + 1) : std::string()) + ": " + faults;
    }
    return {};
  }

  void check_again(const std::filesystem::path& file) {
    const auto read = [&](Reading how) { return timed(result_.stages, "read again", [&] { return read_document(file, how); }); };
    const StageClock timing(result_.stages, "check");
    Document again = read(Reading::as_it_stands);
    std::string faults = faults_of(again);
    if (!faults.empty()) {  // readers add the poles of surfaces, for example
      again = read(Reading::mended);
      faults = faults_of(again);
    }
    if (!faults.empty()) refuse("the deformed model is not valid after reading it again" + faults);
    int faces = 0;
    for (const Part& part : again.parts) faces += face_count(part.shape);
    if (faces != model_.face_count()) {
      refuse("reading the deformed model again gives " + std::to_string(faces) + " faces instead of " +
             std::to_string(model_.face_count()));
    }
  }

  void write() {
    std::string faults = timed(result_.stages, "check", [&] { return faults_of(deformed_); });
    // Between the points at which gaps were measured they may be larger, and edges that meet at a vertex have gaps of their own.
    for (int attempt = 0; attempt < most_widenings && !faults.empty(); ++attempt) {
      for (const Part& part : deformed_.parts) widen(part.shape);
      faults = timed(result_.stages, "check", [&] { return faults_of(deformed_); });
    }
    if (!faults.empty()) refuse("the deformed model is not valid" + faults);
    // Under another name until it has been read again.
    std::filesystem::path partial = request_.output;
    partial.replace_extension(".partial" + request_.output.extension().string());
    struct Removal {
      const std::filesystem::path& path;
      ~Removal() {
        std::error_code ignored;
        std::filesystem::remove(path, ignored);
      }
    } const removal{partial};
    deformed_.derivation = derivation(model_, model_of(deformed_, model_.name));
    timed(result_.stages, "write", [&] { write_document(deformed_, partial); });
    if (lower_case(partial.extension().string()) != ".brep") check_again(partial);  // .brep files hold what was checked
    std::filesystem::rename(partial, request_.output);
  }

  const ApplyRequest& request_;
  const SpaceMap& map_;
  const RunContext& context_;
  DeformedModel result_;  // first: reading is timed
  const Document document_;
  const Model model_;
  const std::optional<HeldFaces> held_;
  Refitting refitting_;
  Document deformed_;
  std::vector<Check> last_checks_;  ///< at which the result is measured
  Points last_targets_;
};

}  // namespace

void check_request(const ApplyRequest& request) {
  const auto refuse = [](const std::string& why) { throw Error(ErrorCode::invalid_argument, why); };
  if (!(request.tolerance >= 1e-9 && request.tolerance <= 1e-2)) {
    refuse("tolerance: " + number_digits(request.tolerance) + " is not from 1e-9 to 1e-2 of the diagonal");
  }
  if (!(request.rigid >= 0 && request.rigid <= 1e-2)) {
    refuse("rigid: " + number_digits(request.rigid) + " is not from 0 to 1e-2 of the diagonal");
  }
  if (!(request.hold >= 0 && request.hold <= 1e-2)) {
    refuse("hold: " + number_digits(request.hold) + " is not from 0 to 1e-2 of the diagonal");
  }
  if (!(request.scale > 0) || !std::isfinite(request.scale))
    refuse("scale: " + number_digits(request.scale) + " is not greater than 0");
  if (request.checks > 10'000'000) refuse("checks: " + std::to_string(request.checks) + " are more than 10000000");
  if (!can_be_written(request.output))
    refuse("output: " + request.output.string() + ": CAD models are written to .step, .stp and .brep");
}

DeformedModel apply_to_model(const ApplyRequest& request, const SpaceMap& map, const RunContext& context) {
  check_request(request);
  try {
    return Application(request, map, context).apply();
  } catch (const Standard_Failure& failure) {
    throw Error(ErrorCode::internal, request.model.string() + ": OpenCASCADE fails: " + failure.GetMessageString());
  }
}

}  // namespace deform::cad
