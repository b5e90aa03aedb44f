// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/base/error.h"
#include "core/cad/availability.h"
#include "core/cad/cad_apply.h"
#include "core/cad/cad_move.h"
#include "core/cad/cad_regions.h"

namespace deform::cad {

bool available() { return false; }

void require() {
  throw Error(ErrorCode::failed_precondition,
              "this program was built without CAD: install libocct-data-exchange-dev, libocct-modeling-algorithms-dev, "
              "libocct-modeling-data-dev and libocct-foundation-dev, and build it with -DDEFORM_WITH_CAD=ON");
}

namespace {

[[noreturn]] void refuse() {
  require();
  throw Error(ErrorCode::internal, "CAD");
}

}  // namespace

CarriedNodes carry_nodes(const Mesh&, const MoveRequest&, const RunContext&) { refuse(); }

void check_request(const ApplyRequest&) { refuse(); }

DeformedModel apply_to_model(const ApplyRequest&, const SpaceMap&, const RunContext&) { refuse(); }

CadRegions cad_regions(const Mesh&, const RegionsRequest&, const RunContext&) { refuse(); }

}  // namespace deform::cad
