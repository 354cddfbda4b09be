#include "scene/description.h"

#include <cmath>
#include <utility>

namespace cloudrenderer {

Shutter shutter_of(const CameraDesc& camera) {
  Shutter s{camera.params.real("shutteropen", 0.f), camera.params.real("shutterclose", 1.f)};
  if (!std::isfinite(s.open) || !std::isfinite(s.close))
    throw SceneError(camera.location, "shutteropen and shutterclose must be finite");
  if (s.close < s.open) std::swap(s.open, s.close);
  return s;
}

}  // namespace cloudrenderer
