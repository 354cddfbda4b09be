#pragma once
#include <cstdint>

#include "parts/part.h"

namespace cloudrenderer {

// Hash of all that a manifest says but its own content_hash and where the scene file stood.
std::uint64_t manifest_hash(const Manifest& m);

}  // namespace cloudrenderer
