// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/edge_map.h"

#include <BRep_Tool.hxx>
#include <GCPnts_AbscissaPoint.hxx>
#include <algorithm>
#include <cmath>

namespace deform::cad {

EdgeMap::EdgeMap(const TopoDS_Edge& before, const TopoDS_Edge& after, int sense, double phase, Along along)
    : sense_(sense), phase_(phase) {
  BRep_Tool::Range(before, first_, last_);
  BRep_Tool::Range(after, first_after_, last_after_);
  degenerate_ = BRep_Tool::Degenerated(before) || BRep_Tool::Degenerated(after);
  if (degenerate_) return;
  before_.Initialize(before);
  after_.Initialize(after);
  if (along == Along::parameter || before_.GetType() == after_.GetType()) return;
  by_length_ = true;
  length_ = GCPnts_AbscissaPoint::Length(before_, first_, last_, 1e-10);
  length_after_ = GCPnts_AbscissaPoint::Length(after_, first_after_, last_after_, 1e-10);
}

double EdgeMap::operator()(double t) const {
  t = std::clamp(t, first_, last_);
  double fraction =
      by_length_ ? GCPnts_AbscissaPoint::Length(before_, first_, t, 1e-10) / length_ : (t - first_) / (last_ - first_);
  fraction = std::clamp(fraction, 0.0, 1.0);
  if (phase_ != 0) fraction = fraction + phase_ - std::floor(fraction + phase_);
  if (sense_ < 0) fraction = 1 - fraction;
  if (fraction == 0) return first_after_;
  if (fraction == 1) return last_after_;
  if (!by_length_) return first_after_ + fraction * (last_after_ - first_after_);
  return GCPnts_AbscissaPoint(1e-10, after_, fraction * length_after_, first_after_).Parameter();
}

}  // namespace deform::cad
