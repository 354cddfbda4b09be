#include "shading/rgl_table.h"

#include <algorithm>
#include <cmath>

#include "base/portable_math.h"

namespace cloudrenderer {
namespace {

constexpr float kHalfPi = 0.5f * kPi;

// Both tables of directions are finer towards the normal.
float theta_place(float theta) { return std::sqrt(theta / kHalfPi); }
float phi_place(float phi) {
  const float turn = (phi + kPi) / (2.f * kPi);
  return turn - std::floor(turn);
}

float theta_of(const Vec3& w) { return portable::atan2(std::sqrt(w.x * w.x + w.y * w.y), w.z); }

}  // namespace

// wo as the file has it.
struct RglTable::Viewer {
  Vec3 signs;  // to be multiplied by: directions become the file's, and back
  Vec3 wo;
  float phi;
  Vec2 place;
  SliceMix mix;
};

struct RglTable::HalfVector {
  Vec3 m;
  Vec2 place;
  float cosine;     // with wo
  float wi_cosine;  // with the normal
};

RglTable::Viewer RglTable::viewer(const Vec3& wo) const {
  Viewer v;
  v.signs = Vec3(wo.z < 0.f ? -1.f : 1.f);
  float phi_sign = 1.f;
  if (folds_ > 1) {
    const bool turn_x = wo.x * v.signs.x * sign_x_ < 0.f, turn_y = wo.y * v.signs.y * sign_y_ < 0.f;
    if (turn_y) v.signs.y = -v.signs.y;
    if (folds_ == 2 ? turn_y : turn_x) v.signs.x = -v.signs.x;
    phi_sign = sign_y_;
  }
  v.wo = v.signs * wo;
  // At the border of what is there, a y of 0 has to count as inside.
  v.phi = folds_ > 1 ? phi_sign * portable::atan2(std::fabs(v.wo.y), v.wo.x) : portable::atan2(v.wo.y, v.wo.x);
  const float theta = theta_of(v.wo);
  v.place = {theta_place(theta), phi_place(v.phi)};
  v.mix = nodes_.at(v.phi, theta);
  return v;
}

// False where light is not reflected.
bool RglTable::half_vector(const Viewer& v, const Vec3& wi_world, HalfVector& out) const {
  const Vec3 wi = v.signs * wi_world;
  if (!(v.wo.z > 0.f && wi.z > 0.f)) return false;
  const Vec3 sum = v.wo + wi;
  out.m = sum / std::sqrt(glm::dot(sum, sum));
  const float phi = portable::atan2(out.m.y, out.m.x);
  out.place = {theta_place(theta_of(out.m)), phi_place(isotropic_ ? phi - v.phi : phi)};
  out.cosine = glm::dot(v.wo, out.m);
  out.wi_cosine = wi.z;
  return out.cosine > 0.f;
}

Rgb RglTable::value_and_pdf(const Vec3& wo, const Vec3& wi, float& density) const {
  constexpr float kLeastJacobian = 1e-9f;  // at the normal, where the places have a corner
  density = 0.f;
  const Viewer v = viewer(wo);
  HalfVector h;
  if (!half_vector(v, wi, h)) return Rgb(0.f);
  float visible;
  const Vec2 s = visible_.invert(h.place, v.mix, visible);
  const float sine = std::sqrt(h.m.x * h.m.x + h.m.y * h.m.y);
  const float jacobian = std::max(2.f * kPi * kPi * h.place.x * sine, kLeastJacobian) * 4.f * h.cosine;
  density = luminance_.pdf(s, v.mix) * visible / jacobian;
  float scale = 1.f / h.wi_cosine;
  if (jacobian_) scale *= ndf_.value(h.place, {}) / (4.f * sigma_.value(v.place, {}));
  const Rgb f = scattered_.value(s, v.mix) * scale;
  return is_finite(f) ? f : Rgb(0.f);  // no area to be seen
}

Rgb RglTable::value(const Vec3& wo, const Vec3& wi) const {
  float ignored;
  return value_and_pdf(wo, wi, ignored);
}

float RglTable::pdf(const Vec3& wo, const Vec3& wi) const {
  float density;
  value_and_pdf(wo, wi, density);
  return density;
}

bool RglTable::sample(const Vec3& wo, float, const Vec2& u, Vec3& wi) const {
  const Viewer v = viewer(wo);
  if (!(v.wo.z > 0.f)) return false;
  float ignored;
  const Vec2 place = visible_.sample(luminance_.sample(u, v.mix, ignored), v.mix, ignored);
  const float theta = place.x * place.x * kHalfPi, phi = (2.f * place.y - 1.f) * kPi + (isotropic_ ? v.phi : 0.f);
  const float sine = portable::sin(theta);
  const Vec3 m(sine * portable::cos(phi), sine * portable::sin(phi), portable::cos(theta));
  const float cosine = glm::dot(v.wo, m);
  const Vec3 reflected = 2.f * cosine * m - v.wo;
  if (!(cosine > 0.f && reflected.z > 0.f)) return false;
  wi = v.signs * glm::normalize(reflected);
  return true;
}

void RglTable::tabulate_albedo() {
  constexpr int kAcross = 16;
  for (std::size_t a = 0; a < kAngles; ++a) {
    const float z = (static_cast<float>(a) + 0.5f) / kAngles;
    double sum = 0;
    for (int i = 0; i < kAcross * kAcross; ++i) {
      const Vec2 u((static_cast<float>(i % kAcross) + 0.5f) / kAcross,
                   (static_cast<float>(i / kAcross) + 0.5f) / kAcross);
      // another azimuth each time: of an anisotropic surface the mean is meant
      float c, s;
      portable::sincos_turn((static_cast<float>(i * 89 % (kAcross * kAcross)) + 0.5f) / (kAcross * kAcross), s, c);
      const float r = std::sqrt(1.f - z * z);
      const Vec3 wo(r * c, r * s, z);
      Vec3 wi;
      if (!sample(wo, 0.f, u, wi)) continue;
      float density;
      const Rgb f = value_and_pdf(wo, wi, density);
      if (density > 0.f) sum += static_cast<double>(luminance(f) * wi.z / density);
    }
    albedo_[a] = static_cast<float>(std::min(sum / (kAcross * kAcross), 1e6));
  }
}

float RglTable::albedo(float cosine) const {
  return albedo_[std::min(static_cast<std::size_t>(std::fabs(cosine) * kAngles), kAngles - 1)];
}

std::uint64_t RglTable::bytes() const {
  return sizeof *this + ndf_.bytes() + sigma_.bytes() + visible_.bytes() + luminance_.bytes() + scattered_.bytes() +
         (nodes_.first().size() + nodes_.second().size()) * sizeof(float);
}

}  // namespace cloudrenderer
