// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/cad_apply.h"

#include <BRepBuilderAPI_MakeVertex.hxx>
#include <BRepGProp.hxx>
#include <BRepTools.hxx>
#include <BRepTopAdaptor_FClass2d.hxx>
#include <BRep_Builder.hxx>
#include <BRep_Tool.hxx>
#include <GProp_GProps.hxx>
#include <Geom_Surface.hxx>
#include <Standard_Failure.hxx>
#include <TopExp_Explorer.hxx>
#include <TopoDS_Compound.hxx>
#include <algorithm>
#include <cmath>
#include <random>

#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/vectors.h"
#include "core/cad/deformed_shape.h"
#include "core/cad/document.h"
#include "core/cad/model.h"
#include "core/cad/refitting.h"

namespace deform::cad {

namespace {

constexpr std::size_t least_checks = 20;  ///< of a face
constexpr int most_refinements = 10;      ///< after the random points
constexpr double rigid_share = 0.1;       ///< of the tolerance

/// A random point of a face.
struct Check {
  int face = 0;
  double u = 0, v = 0;
};

/// Random points inside the trimmed faces, as many on each as its share of the area.
std::vector<Check> random_checks(const Model& model, std::size_t count, std::uint64_t seed) {
  std::vector<double> areas;
  double all = 0;
  for (int f = 0; f < model.face_count(); ++f) {
    GProp_GProps properties;
    BRepGProp::SurfaceProperties(model.face(f), properties);
    areas.push_back(std::abs(properties.Mass()));
    all += areas.back();
  }
  std::mt19937_64 engine(seed);
  const auto uniform = [&] { return static_cast<double>(engine() >> 11) * 0x1p-53; };
  std::vector<Check> checks;
  for (int f = 0; f < model.face_count(); ++f) {
    const TopoDS_Face face = model.face(f);
    const BRepTopAdaptor_FClass2d region(face, 1e-9);
    double u0 = 0, u1 = 0, v0 = 0, v1 = 0;
    BRepTools::UVBounds(face, u0, u1, v0, v1);
    const auto share = static_cast<std::size_t>(all > 0 ? areas[f] / all * static_cast<double>(count) : 0);
    const std::size_t wanted = std::max(least_checks, share);
    std::size_t found = 0;
    for (std::size_t tries = 0; found < wanted && tries < 100 * wanted; ++tries) {
      const double u = u0 + uniform() * (u1 - u0), v = v0 + uniform() * (v1 - v0);
      if (region.Perform(gp_Pnt2d(u, v)) != TopAbs_IN) continue;
      checks.push_back({f, u, v});
      ++found;
    }
  }
  return checks;
}

Points places_of(const Model& model, const std::vector<Check>& checks) {
  Points places;
  Handle(Geom_Surface) surface;
  int face = -1;
  for (const Check& check : checks) {
    if (check.face != face) surface = BRep_Tool::Surface(model.face(check.face));
    face = check.face;
    const gp_Pnt p = surface->Value(check.u, check.v);
    places.push_back({p.X(), p.Y(), p.Z()});
  }
  return places;
}

/// Distances of the fitted surfaces from where the map takes the checks.
std::vector<double> errors_of(const Refitting& refitting, const std::vector<Check>& checks, const Points& targets) {
  std::vector<double> errors;
  Handle(Geom_Surface) surface;
  int face = -1;
  for (std::size_t i = 0; i < checks.size(); ++i) {
    if (checks[i].face != face) surface = refitting.surface(checks[i].face);
    face = checks[i].face;
    const gp_Pnt p = surface->Value(checks[i].u, checks[i].v);
    errors.push_back(distance({p.X(), p.Y(), p.Z()}, targets[i]));
  }
  return errors;
}

/// Of the solids, to some digits.
double volume_of(const TopoDS_Shape& shape) {
  double volume = 0;
  for (TopExp_Explorer solid(shape, TopAbs_SOLID); solid.More(); solid.Next()) {
    GProp_GProps properties;
    BRepGProp::VolumeProperties(solid.Current(), properties);
    volume += properties.Mass();
  }
  return volume;
}

class Application {
 public:
  Application(const ApplyRequest& request, const SpaceMap& map, const RunContext& context)
      : request_(request),
        map_(map),
        context_(context),
        document_(read_document(request.model)),
        model_(model_of(document_, request.model.string())),
        refitting_(model_, request.tolerance * model_.diagonal, rigid_limit(request) * model_.diagonal) {}

  DeformedModel apply() {
    result_.notes = document_.notes;
    result_.diagonal = model_.diagonal;
    fit();
    deform();
    measure();
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
    points = map_(points);
    if (points.size() != count) throw Error(ErrorCode::internal, "the deformation gave another number of points");
    for (Vec3& p : points) p = p / request_.scale;
    return points;
  }

  /// Rounds until nodes and random points agree with the map.
  void fit() {
    const std::vector<Check> checks = random_checks(model_, request_.checks, request_.seed);
    Points asked = refitting_.wanted();
    result_.samples = asked.size();
    const Points places = places_of(model_, checks);
    asked.insert(asked.end(), places.begin(), places.end());
    Points answer = mapped(asked);
    const Points targets(answer.end() - static_cast<std::ptrdiff_t>(checks.size()), answer.end());
    answer.resize(answer.size() - checks.size());
    refitting_.give(answer);
    for (int round = 0;; ++round) {
      // It ends: each round adds nodes, of which there are at most so many.
      for (const Points* wanted = &refitting_.wanted(); !wanted->empty(); wanted = &refitting_.wanted()) {
        result_.samples += wanted->size();
        refitting_.give(mapped(*wanted));
      }
      if (round == most_refinements || !refine(checks, errors_of(refitting_, checks, targets))) return;
    }
  }

  /// Makes faces finer around errors above their tolerance.
  bool refine(const std::vector<Check>& checks, const std::vector<double>& errors) {
    std::vector<std::vector<std::array<double, 2>>> bad(model_.face_count());
    for (std::size_t i = 0; i < checks.size(); ++i) {
      if (errors[i] > tolerance(checks[i].face)) bad[checks[i].face].push_back({checks[i].u, checks[i].v});
    }
    bool finer = false;
    for (int f = 0; f < model_.face_count(); ++f) {
      if (!bad[f].empty()) finer = refitting_.refine_face(f, bad[f]) || finer;
    }
    return finer;
  }

  void deform() {
    deformed_ = document_;
    for (Part& part : deformed_.parts) {
      context_.check();
      const TopoDS_Shape rest = part.shape;
      const DeformedShape shape = deformed_shape(part.shape, model_, refitting_);
      part.shape = shape.shape;
      result_.gap = std::max(result_.gap, shape.largest_gap);
      if (volume_of(rest) > 0 && !(volume_of(part.shape) > 0)) {
        refuse("the deformation turns the model inside out: a volume of " + number_digits(volume_of(rest)) + " becomes " +
               number_digits(volume_of(part.shape)));
      }
    }
  }

  /// The error, at other random points than those that the fit knows.
  void measure() {
    const std::vector<Check> checks = random_checks(model_, request_.checks, request_.seed ^ 0x9e3779b97f4a7c15u);
    const std::vector<double> errors = errors_of(refitting_, checks, mapped(places_of(model_, checks)));
    result_.checks = checks.size();
    result_.faces.resize(model_.face_count());
    double squares = 0;
    for (std::size_t i = 0; i < checks.size(); ++i) {
      double& largest = result_.faces[checks[i].face].error;
      largest = std::max(largest, errors[i]);
      squares += errors[i] * errors[i];
    }
    for (int f = 0; f < model_.face_count(); ++f) {
      DeformedFace& face = result_.faces[f];
      face.number = f + 1;
      face.type = surface_type(model_.face(f));
      face.became = refitting_.refit(f) == Refit::kept    ? DeformedFace::Became::kept
                    : refitting_.refit(f) == Refit::moved ? DeformedFace::Became::moved
                                                          : DeformedFace::Became::fitted;
      if (face.became == DeformedFace::Became::fitted) face.poles = refitting_.nodes(f);
      result_.error = std::max(result_.error, face.error);
      if (face.error > std::max(2 * tolerance(), tolerance(f))) result_.coarse.push_back(face.number);
    }
    if (!checks.empty()) result_.rms = std::sqrt(squares / static_cast<double>(checks.size()));
  }

  [[noreturn]] void refuse(const std::string& why) const {
    throw Error(ErrorCode::failed_precondition, request_.model.string() + ": " + why + "; nothing is written");
  }

  void check_validity(const Document& document, const std::string& when) const {
    for (std::size_t i = 0; i < document.parts.size(); ++i) {
      const std::string faults = faults_of(document.parts[i].shape);
      if (faults.empty()) continue;
      if (i < document_.parts.size() && !faults_of(document_.parts[i].shape).empty()) continue;  // it was not before, either
      refuse("the deformed model is not valid" + when +
             (document.parts.size() > 1 ? ", part " + std::to_string(i + 1) : std::string()) + ": " + faults);
    }
  }

  void write() {
    check_validity(deformed_, "");
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
    write_document(deformed_, partial);
    const Document again = read_document(partial);
    check_validity(again, " after reading it again");
    const Model model = model_of(again, partial.string());
    if (model.face_count() != model_.face_count()) {
      refuse("reading the deformed model again gives " + std::to_string(model.face_count()) + " faces instead of " +
             std::to_string(model_.face_count()));
    }
    std::filesystem::rename(partial, request_.output);
  }

  const ApplyRequest& request_;
  const SpaceMap& map_;
  const RunContext& context_;
  const Document document_;
  const Model model_;
  Refitting refitting_;
  Document deformed_;
  DeformedModel result_;
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
