// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <vector>

#include "core/deformers/splitting.h"
#include "core/quality/face_intersections.h"
#include "core/quality/flipped_faces.h"
#include "core/quality/safe_amplitude.h"
#include "deform/v1/deformation.pb.h"
#include "server/engine/memory.h"

namespace deform::server {

struct ResidentSystem;

/// The check of the cells of a system's mesh: made when first asked for, then kept with the memory charged for it. Thread-safe.
class CellCheckCache {
 public:
  /// Also for the motions of `fields`, if there are any and the budget allows; they are the same in every call. Throws
  /// Error(out_of_budget), cancelled, deadline_exceeded.
  std::shared_ptr<const InversionCheck> get(const Mesh& mesh, const CellSet& cells, const DisplacementFields* fields,
                                            MemoryBudget& budget, const RunContext& context) const;

 private:
  mutable std::mutex mutex_;
  // guarded by mutex_
  mutable std::shared_ptr<const InversionCheck> check_;
  mutable Charge charge_;
};

/// The same for a check of the faces of a system's mesh. Thread-safe.
template <typename Check>
class FaceCheckCache {
 public:
  /// Throws Error(out_of_budget), cancelled, deadline_exceeded.
  std::shared_ptr<const Check> get(const Mesh& mesh, MemoryBudget& budget, const RunContext& context) const {
    const std::lock_guard lock(mutex_);
    if (!check_) {
      Charge charge = budget.charge(Check::bytes_for(mesh),
                                    {"checking the faces", "set check: CELL_CHECK_OFF, or raise the server's memory budget", 0});
      check_ = std::make_shared<const Check>(mesh, mesh.points, context);
      charge_ = std::move(charge);
      charge_.shrink(check_->bytes());
    }
    return check_;
  }

 private:
  mutable std::mutex mutex_;
  // guarded by mutex_
  mutable std::shared_ptr<const Check> check_;
  mutable Charge charge_;
};

/// The internal faces of polyhedral cells that are severely non-orthogonal at rest, by the formula and limit of checkMesh.
/// For a FaceCheckCache. Immutable.
class SevereFaces {
 public:
  /// At most, while it is made.
  static std::size_t bytes_for(const Mesh& mesh);
  SevereFaces(const Mesh& mesh, const Points& rest, const RunContext& context);

  std::size_t bytes() const { return severe_.size(); }
  /// How many of them are so by these angles, degrees, one for each internal face, and were not at rest.
  std::uint64_t appeared(std::span<const double> non_orthogonality) const;

 private:
  std::vector<char> severe_;  ///< of each internal face
};

/// What a request wants to know or have of each of its designs as a whole.
struct DesignChecks {
  v1::CellCheck check = v1::SAFE_AMPLITUDE;
  bool intersections = false;
  std::optional<SplitOptions> splitting;

  /// Throws Error(invalid_argument) naming the field.
  static DesignChecks from_proto(const v1::DeformRequest& request);
  bool none() const { return check == v1::CELL_CHECK_OFF && !splitting; }
};

/// Looks at the designs of one request. Immutable; any thread may call.
class DesignChecker {
 public:
  /// What is said about a design.
  struct Findings {
    std::optional<v1::CellReport> cells;
    std::optional<v1::QualityReport> quality;
    std::optional<v1::SplitReport> split;
    std::optional<v1::FaceReport> faces;  ///< of the points that are delivered
    void move_to(v1::DesignResult& result);
  };

  /// Null when there is nothing to look at. `designs`: those of the request, called for splitting only. Throws
  /// Error(failed_precondition) for splitting without cells, out_of_budget.
  static std::unique_ptr<const DesignChecker> make(std::shared_ptr<const ResidentSystem> system, const DesignChecks& checks,
                                                   const std::function<std::vector<Design>()>& designs, MemoryBudget& budget,
                                                   const RunContext& context);

  /// Whether only faces are looked at: check_faces() then says all, and design by design it may do so after the blocks were made.
  bool only_faces() const { return !inversions_ && checks_.check != v1::CELL_QUALITY; }

  /// points: n x 3, of the full step; those of a split design take their place. `motion`: Evaluation::field_motion().
  Findings check(std::size_t design, const std::optional<FieldMotion>& motion, Points& points, const RunContext& context) const;
  /// points: n x 3, as they are delivered. Absent: there are no faces, or they are not to be looked at.
  std::optional<v1::FaceReport> check_faces(std::span<const Vec3> points, const RunContext& context) const;
  std::size_t check_faces_bytes() const {
    return (flips_ ? flips_->call_bytes() : 0) + (intersections_ ? intersections_->call_bytes() : 0);
  }

 private:
  DesignChecker() = default;
  void split(std::size_t design, Points& points, const SafeAmplitude& safety, Findings& findings,
             const RunContext& context) const;
  /// Stores in *cells, if given, how many faces of polyhedral cells became severely non-orthogonal.
  v1::QualityReport quality(const Points& points, v1::CellReport* cells) const;
  bool in_plane(const Points& points) const;
  SafeAmplitude amplitude(const std::optional<FieldMotion>& motion, const Points& points, const RunContext& context) const;

  std::shared_ptr<const ResidentSystem> system_;
  DesignChecks checks_;
  std::optional<CellSet> cells_;
  std::shared_ptr<const InversionCheck> inversions_;        ///< null: there are no cells
  std::shared_ptr<const FlipCheck> flips_;                  ///< null: there are no faces, or they are not to be looked at
  std::shared_ptr<const IntersectionCheck> intersections_;  ///< null: not asked for, or like flips_
  std::vector<Design> designs_;
  std::shared_ptr<const SevereFaces> severe_;  ///< null: no polyhedral cells whose quality is asked for
  Charge charge_;
};

}  // namespace deform::server
