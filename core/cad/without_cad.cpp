// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/base/error.h"
#include "core/cad/cad_move.h"

namespace deform::cad {

bool available() { return false; }

CarriedNodes carry_nodes(const Mesh&, const MoveRequest&, const RunContext&) {
  throw Error(ErrorCode::failed_precondition,
              "this program was built without CAD: install libocct-data-exchange-dev, libocct-modeling-algorithms-dev, "
              "libocct-modeling-data-dev and libocct-foundation-dev, and build it with -DDEFORM_WITH_CAD=ON");
}

}  // namespace deform::cad
