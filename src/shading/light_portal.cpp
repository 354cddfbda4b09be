#include "shading/light_portal.h"

namespace cloudrenderer {

std::optional<Portal> Portal::of(const LightDesc& desc, Warnings& warnings) {
  const Param* given = desc.params.find("portal");
  if (!given) return std::nullopt;
  given->used = true;
  const auto fail = [&](const std::string& why) { return SceneError(given->location, "the light's portal " + why); };
  if (given->type != ParamType::point3 || given->reals.size() != 12)
    throw fail("must be four points, got " + std::to_string(given->reals.size()) + " numbers");
  std::array<Vec3, 4> p;
  for (std::size_t i = 0; i < 4; ++i) p[i] = Vec3(given->reals[3 * i], given->reals[3 * i + 1], given->reals[3 * i + 2]);
  Portal out;
  const Vec3 x = p[3] - p[0], y = p[1] - p[0], across = p[2] - p[0];
  out.corner_ = p[0];
  out.x_ = glm::normalize(x);
  out.z_ = glm::normalize(glm::cross(x, y));
  out.y_ = glm::cross(out.z_, out.x_);
  out.width_ = glm::dot(across, out.x_);
  out.height_ = glm::dot(across, out.y_);
  if (!(out.width_ > 0.f && out.height_ > 0.f) || !std::isfinite(out.width_ * out.height_)) throw fail("has no area");
  constexpr float kSmall = 1e-3f;
  const float size = std::max(out.width_, out.height_);
  if (!(glm::length(across - x - y) <= kSmall * size && std::fabs(glm::dot(x, y)) <= kSmall * size * size))
    warnings.add(given->location, "the light's portal is no rectangle: one with its first and third corner is used");
  return out;
}

bool Portal::enters(Vec3& origin, const Vec3& towards) const {
  const float cosine = glm::dot(towards, z_);
  if (!(cosine > 0.f)) return false;
  const Vec3 at = origin + towards * (glm::dot(corner_ - origin, z_) / cosine);
  if (!is_finite(at) || !inside<float>(at)) return false;
  origin = at;
  return true;
}

}  // namespace cloudrenderer
