#include "core/base/version.h"

namespace deform {

const char* version() { return DEFORM_VERSION; }

}  // namespace deform
