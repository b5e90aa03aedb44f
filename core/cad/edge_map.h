// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <BRepAdaptor_Curve.hxx>
#include <TopoDS_Edge.hxx>

namespace deform::cad {

/// Takes parameters of an edge to those of its partner: by the fraction of the parameter range, or of the arc length when the
/// curves differ in type. Immutable.
class EdgeMap {
 public:
  enum class Along { type_decides, parameter };  ///< parameter: whatever the types are
  /// sense: -1 when the partner runs the other way. phase: the start of a closed edge goes to this fraction of the partner as it
  /// is run through; 0: to its start.
  EdgeMap(const TopoDS_Edge& before, const TopoDS_Edge& after, int sense, double phase, Along along = Along::type_decides);
  double operator()(double t) const;                                                 ///< t in the range of the old edge
  double at(double fraction) const { return first_ + fraction * (last_ - first_); }  ///< parameter of the old edge
  bool degenerate() const { return degenerate_; }

 private:
  double first_ = 0, last_ = 1, first_after_ = 0, last_after_ = 1;
  const int sense_;
  const double phase_;
  bool degenerate_ = false, by_length_ = false;
  BRepAdaptor_Curve before_, after_;
  double length_ = 0, length_after_ = 0;
};

}  // namespace deform::cad
