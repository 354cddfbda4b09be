// Light that goes to and fro between the layers. Radiance counts here as a share of the index squared, which refraction
// leaves as it is. Directions inside point the way that light is followed, against its own.
#include <bit>

#include "base/random.h"
#include "shading/bsdf_layered.h"
#include "shading/bsdf_layered_slab.h"
#include "shading/bsdf_math.h"
#include "shading/phase.h"

namespace cloudrenderer::bsdf {
namespace {

constexpr float kCertain = kInfinity;  // the density of a mirror's direction

class Random {
 public:
  Random(const Lobe& l, const Vec3& wo, const Vec3& wi, std::uint32_t salt) : state_(salt) {
    take(wo.x, wo.y);
    take(wo.z, wi.x);
    take(wi.y, wi.z);
    take(l.k.x, l.alpha_x);
  }
  Vec2 two() {
    const std::uint64_t bits = mix64(state_ += 0x9e3779b97f4a7c15u);
    return {to_unit(static_cast<std::uint32_t>(bits >> 32)), to_unit(static_cast<std::uint32_t>(bits))};
  }
  float one() { return two().x; }

 private:
  void take(float a, float b) {
    state_ = mix64(state_ ^ (std::uint64_t{std::bit_cast<std::uint32_t>(a)} << 32 | std::bit_cast<std::uint32_t>(b)));
  }
  std::uint64_t state_;
};

// Of two ways to find a direction, the share of the one with density a (Veach 1997, power heuristic).
float share(float a, float b) {
  if (a == kCertain) return 1.f;
  return a * a / std::max(a * a + b * b, 1e-30f);
}

// G2 / G1 for a direction whose facet has been chosen among those that `from` sees.
float unmasked(const Lobe& l, const Vec3& from, const Vec3& to) {
  const float cf = std::fabs(from.z), ct = std::fabs(to.z), sf = smith_root(l, from), st = smith_root(l, to);
  return ct * (cf + sf) / (sf * ct + st * cf);
}

// Through a facet of the rough coat: `out` is outside, `in` inside, both away from it.
struct Crossing {
  float value = 0.f;    // of the refraction, over the index squared
  float density = 0.f;  // of `in`, when a facet that `out` sees refracts it
};
Crossing cross(const Slab& s, const Vec3& out, const Vec3& in) {
  Vec3 wh = out + s.eta * in;
  const float length2 = glm::dot(wh, wh);
  if (!(length2 > 0.f)) return {};
  wh *= (wh.z < 0.f ? -1.f : 1.f) / std::sqrt(length2);
  const float oh = glm::dot(out, wh), ih = glm::dot(in, wh);
  if (!(oh > 0.f) || !(ih < 0.f)) return {};  // the facet would be seen from its back
  const float co = out.z, ci = -in.z, so = smith_root(s.coat, out), si = smith_root(s.coat, in);
  const float common = 2.f * normal_density(s.coat, wh) * oh * -ih / length2;
  return {common * (1.f - fresnel_dielectric(oh, s.eta)) / (ci * so + co * si), common * s.eta * s.eta / (co + so)};
}

// A way in from outside.
struct Entry {
  Vec3 direction{0, 0, -1};
  float weight = 0.f;  // 0: none
};
Entry enter(const Slab& s, const Vec3& out, const Vec2& u) {
  Entry e;
  if (!s.rough) {
    if (refract(out, Vec3(0, 0, 1), s.eta, e.direction)) e.weight = 1.f - fresnel_dielectric(out.z, s.eta);
    return e;
  }
  const Vec3 wh = sample_visible_normal(s.coat, out, u);
  const float c = glm::dot(out, wh);
  if (!(c > 0.f) || !refract(out, wh, s.eta, e.direction) || !(e.direction.z < 0.f)) return e;
  e.weight = (1.f - fresnel_dielectric(c, s.eta)) * unmasked(s.coat, out, e.direction);
  return e;
}

// Back down from the coat: the weight, 0 for none.
float reflect_inside(const Slab& s, Vec3& w, const Vec2& u) {
  if (!s.rough) {
    const float f = fresnel_dielectric(w.z, 1.f / s.eta);
    w.z = -w.z;
    return f;
  }
  // in the coat's mirror image, where the facets are distributed alike
  const Vec3 from(-w.x, -w.y, w.z), wh = sample_visible_normal(s.coat, from, u);
  const float c = glm::dot(from, wh);
  const Vec3 to = 2.f * c * wh - from;
  if (!(c > 0.f) || !(to.z > 0.f)) return 0.f;
  w = {to.x, to.y, -to.z};
  return fresnel_dielectric(c, 1.f / s.eta) * unmasked(s.coat, from, to);
}

// f times the cosine of the direction `up` that is left, and the density with which reflect_below() takes it.
Rgb base_value(const Slab& s, const Vec3& down, const Vec3& up, float& density) {
  if (s.diffuse()) {
    density = up.z * kInvPi;
    return s.base.k * density;
  }
  const Vec3 from = -down;
  Vec3 wh = from + up;
  wh /= glm::length(wh);
  const float d = normal_density(s.base, wh), cf = from.z, cu = up.z, sf = smith_root(s.base, from), su = smith_root(s.base, up);
  density = 0.5f * d / (cf + sf);
  return fresnel(s.base, glm::dot(from, wh), true) * (0.5f * d * cu / (cu * sf + cf * su));
}
// The weight, black for none.
Rgb reflect_below(const Slab& s, Vec3& w, const Vec2& u, float& density) {
  if (s.diffuse()) {
    w = sample_cosine(u);
    density = w.z * kInvPi;
    return s.base.k;
  }
  const Vec3 from = -w;
  if (s.mirror()) {
    w.z = -w.z;
    density = kCertain;
    return fresnel(s.base, w.z, true);
  }
  const Vec3 wh = sample_visible_normal(s.base, from, u);
  const float c = glm::dot(from, wh);
  w = 2.f * c * wh - from;
  if (!(c > 0.f) || !(w.z > 0.f)) return Rgb(0.f);
  density = 0.5f * normal_density(s.base, wh) / (from.z + smith_root(s.base, from));
  return fresnel(s.base, c, true) * unmasked(s.base, from, w);
}

float largest(const Rgb& c) { return std::max(c.x, std::max(c.y, c.z)); }

// Light that leaves the base, is mirrored by a smooth coat, and leaves the base again towards `up`: the direction between
// the two is drawn for the second one, where the walk draws it for the first one. Of two glossy reflections either may be the
// one that bends much, and a walk that has to hit the peak of the second one rarely does.
Rgb mirrored_once(const Slab& s, const Vec3& down, const Vec3& up, const Vec2& u) {
  Vec3 v = -up;
  float density, other;
  const Rgb last = reflect_below(s, v, u, density);
  if (!(largest(last) > 0.f) || !(v.z > 0.f)) return Rgb(0.f);
  const Rgb first = base_value(s, down, {-v.x, -v.y, v.z}, other);
  const float way = attenuation(s.thickness, v.z);
  return first * last * (way * way * fresnel_dielectric(v.z, 1.f / s.eta) * share(density, other) * up.z / v.z);
}

// One walk from wo, each event of which is joined to wi.
Rgb walk(const Slab& s, const Vec3& wo, const Vec3& wi, Random& random) {
  const Entry first = enter(s, wo, random.two());
  if (first.weight == 0.f) return Rgb(0.f);
  const Entry last = !s.mirror() || s.scatters ? enter(s, wi, random.two()) : Entry{};
  const Vec3 up = -last.direction;
  const float exit = last.weight / (s.eta * s.eta * up.z);
  const float exit_density = !s.rough || exit == 0.f ? kCertain : cross(s, wi, last.direction).density;
  // Between two mirrors light that has been scattered may leave at once, or by way of the base, each after any number of rounds.
  const bool mirrors = s.mirror() && !s.rough;
  constexpr float kWide = 0.25f;  // less than this has peaks that are worth another sample
  const bool glossy = !s.rough && !s.diffuse() && !s.mirror() && std::min(s.base.alpha_x, s.base.alpha_y) < kWide;
  Rgb rounds(1.f), by_base(0.f);
  if (mirrors && exit > 0.f) {
    const float once = attenuation(s.thickness, up.z);
    const Rgb metal = fresnel(s.base, up.z, true);
    by_base = metal * once;
    rounds = 1.f / (Rgb(1.f) - metal * (once * once * fresnel_dielectric(up.z, 1.f / s.eta)));
  }
  Rgb sum(0.f), beta(first.weight);
  Vec3 w = first.direction;
  float density = 0.f;         // with which w has been sampled by the last event that spreads light
  bool from_base = false;      // that was the base
  float height = s.thickness;  // above the base
  // Behind the last event light may still leave.
  for (int event = 0; event <= s.events; ++event) {
    const bool over = event == s.events;
    const bool down = w.z < 0.f;
    const float slope = std::fabs(w.z), room = down ? height : s.thickness - height;
    float step = kInfinity;
    if (s.scatters)
      step = -portable::log(1.f - random.one()) * slope;
    else
      beta *= attenuation(room, slope);
    if (over && (down || step < room)) return sum;
    if (step < room) {
      height = std::clamp(down ? height - step : height + step, 0.f, s.thickness);
      beta *= s.base.scale2;
      if (exit > 0.f) {
        const float phase = phase_hg(-w, up, s.g);
        sum += beta * rounds * (phase * share(exit_density, phase) * attenuation(s.thickness - height, up.z) * exit);
        if (mirrors) sum += beta * rounds * by_base * (phase_hg(-w, {up.x, up.y, -up.z}, s.g) * attenuation(height, up.z) * exit);
      }
      const Vec3 back = -w;
      w = sample_phase_hg(back, s.g, random.two());
      density = phase_hg(back, w, s.g);
      from_base = false;
      if (w.z == 0.f) return sum;
    } else if (down) {
      height = 0.f;
      if (exit > 0.f && !s.mirror()) {
        float other;
        Rgb value = base_value(s, w, up, other);
        value *= share(exit_density, other);
        if (glossy) {
          if (from_base) {
            base_value(s, -up, -w, other);
            value *= share(density, other);
          }
          if (event + 2 < s.events) value += mirrored_once(s, w, up, random.two());
        }
        sum += beta * value * (attenuation(s.thickness, up.z) * exit);
      }
      beta *= reflect_below(s, w, random.two(), density);
      from_base = true;
    } else {
      height = s.thickness;
      if (s.rough) {
        const Crossing c = cross(s, wi, -w);
        sum += beta * (c.value * share(density, c.density));
      }
      beta *= reflect_inside(s, w, random.two());
    }
    const float most = largest(beta);
    if (most < 0.1f) {  // also where nothing is left
      if (!(random.one() < 10.f * most)) return sum;
      beta *= 0.1f / most;
    }
  }
  return sum;
}

}  // namespace

Rgb layered_value(const Lobe& l, const Vec3& wo, const Vec3& wi, std::uint32_t salt) {
  const Slab s(l);
  Random random(l, wo, wi, salt);
  const Vec3 out(wo.x, wo.y, std::fabs(wo.z)), in(wi.x, wi.y, std::fabs(wi.z));
  Rgb sum(0.f);
  for (int i = 0; i < s.walks; ++i) sum += walk(s, out, in, random);
  return sum / static_cast<float>(s.walks);
}

}  // namespace cloudrenderer::bsdf
