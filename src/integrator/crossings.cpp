#include "integrator/crossings.h"

namespace cloudrenderer {

bool PathTracer::Crossings::next() {
  if (!(left_ > 0.f) || !traceable(from_, direction_) || ++count_ > kMaxCrossings) return false;
  Hit hit;
  hit.t = left_;
  if (!set_.intersect(0, {from_, left_, direction_, time_}, hit)) return false;
  std::uint32_t light;
  const SurfacePoint p = tracer_.surface(set_, from_, direction_, time_, hit, material_, light, false);
  outwards_ = glm::dot(direction_, p.ng) > 0.f;
  from_ = ray_start(p.p, ray_offset(p.p, p.p_error, p.ng), p.ng, direction_);
  step_ = hit.t;
  t_ += hit.t;
  left_ -= hit.t;
  return true;
}

bool PathTracer::Crossings::is_border() const {
  const Interface between = sides();
  return between.inside != between.outside;
}

std::span<const MediumStretch> PathTracer::ShadowStretches::along(std::uint32_t medium) {
  if (!tracer_.bounded_[medium]) return {};
  if (!found_.empty()) return found_;
  Crossings at(tracer_, set_, ray_.origin, ray_.direction, ray_.t_max, time_);
  float begin = 0;
  std::uint16_t now = 0;
  while (at.next()) {
    if (!at.is_border()) continue;
    found_.push_back({begin, at.t(), found_.empty() ? at.left_medium() : now});
    now = at.entered_medium();
    begin = at.t();
  }
  found_.push_back({begin, ray_.t_max, found_.empty() ? medium_at_start() : now});
  return found_;
}

std::uint16_t PathTracer::ShadowStretches::medium_at_start() const {
  for (const Vec3& direction : {ray_.direction, -ray_.direction}) {
    Crossings at(tracer_, set_, ray_.origin, direction, 1e18f, time_);
    while (at.next())
      if (at.is_border()) return at.left_medium();
  }
  return tracer_.camera_medium_;
}

}  // namespace cloudrenderer
