#include "shading/texture_mapping.h"

#include "base/portable_math.h"

namespace cloudrenderer {
namespace {

// The difference of an angle in turns that may have crossed the seam.
float unwrap(float d) {
  if (d > 0.5f) return d - 1.f;
  return d < -0.5f ? d + 1.f : d;
}

}  // namespace

TextureMapping::TextureMapping(TextureInputs& inputs)
    : world_to_texture_(inputs.texture_to_world.inverse()) {
  const ParamSet& p = inputs.params.params();
  const std::string kind = p.string("mapping", "uv");
  if (kind == "spherical") {
    kind_ = Kind::spherical;
  } else if (kind == "cylindrical") {
    kind_ = Kind::cylindrical;
    by_height_ = p.boolean("byheight", false);
  } else {
    if (kind == "planar") {
      kind_ = Kind::planar;
      vs_ = p.vector3("v1", vs_);
      vt_ = p.vector3("v2", vt_);
    } else {
      if (kind != "uv")
        inputs.params.warn("unknown texture mapping \"" + kind +
                           "\", expected uv, spherical, cylindrical or planar; using uv");
      scale_ = {p.real("uscale", 1.f), p.real("vscale", 1.f)};
      inputs.params.needs().uv = true;
    }
    delta_ = {p.real("udelta", 0.f), p.real("vdelta", 0.f)};
  }
}

Vec2 TextureMapping::around(const Vec3& world) const {
  const Vec3 v = world_to_texture_.point(world);
  const float length2 = glm::dot(v, v);
  if (!(length2 > 0.f)) return Vec2(0.f);
  const Vec3 w = v / std::sqrt(length2);
  const float phi = portable::atan2(w.y, w.x) * (0.5f * kInvPi);
  if (kind_ == Kind::cylindrical) return {0.5f + phi, by_height_ ? v.z : w.z};
  return {portable::acos(w.z) * kInvPi, phi < 0.f ? phi + 1.f : phi};
}

TextureCoordinates TextureMapping::operator()(const TexturePoint& at) const {
  switch (kind_) {
    case Kind::uv:
      return {at.uv * scale_ + delta_, at.duvdx * scale_, at.duvdy * scale_};
    case Kind::planar:
      return {delta_ + Vec2(glm::dot(at.p, vs_), glm::dot(at.p, vt_)),
              {glm::dot(at.dpdx, vs_), glm::dot(at.dpdx, vt_)},
              {glm::dot(at.dpdy, vs_), glm::dot(at.dpdy, vt_)}};
    default:
      break;
  }
  TextureCoordinates c{around(at.p), Vec2(0.f), Vec2(0.f)};
  if (at.dpdx == Vec3(0.f) && at.dpdy == Vec3(0.f)) return c;
  // Finite differences over a tenth of the footprint, as the mapping has no simple derivative.
  constexpr float kStep = 0.1f;
  c.dstdx = (around(at.p + kStep * at.dpdx) - c.st);
  c.dstdy = (around(at.p + kStep * at.dpdy) - c.st);
  float& turn_x = kind_ == Kind::cylindrical ? c.dstdx.x : c.dstdx.y;
  float& turn_y = kind_ == Kind::cylindrical ? c.dstdy.x : c.dstdy.y;
  turn_x = unwrap(turn_x);
  turn_y = unwrap(turn_y);
  c.dstdx /= kStep;
  c.dstdy /= kStep;
  return c;
}

}  // namespace cloudrenderer
