// Half models and the whole ones that they are halves of.
#pragma once

#include <cmath>
#include <cstddef>
#include <memory>
#include <vector>

#include "core/deformers/setup.h"
#include "core/deformers/system.h"
#include "core/mesh/mesh.h"
#include "tests/support/random.h"
