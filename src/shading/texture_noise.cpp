#include "shading/texture_noise.h"

#include "base/noise.h"
#include "base/portable_math.h"

namespace cloudrenderer {
namespace {

float lerp(float t, float a, float b) { return (1.f - t) * a + t * b; }

float smooth_step(float from, float to, float x) {
  const float t = std::clamp((x - from) / (to - from), 0.f, 1.f);
  return t * t * (3.f - 2.f * t);
}

// How many octaves the footprint has room for: 1 / frequency of the last one is twice its width.
float visible_octaves(const SolidCoordinates& at, const Octaves& octaves) {
  const float width2 = std::max(glm::dot(at.dpdx, at.dpdx), glm::dot(at.dpdy, at.dpdy));
  const float n = octaves.beyond - 0.5f * portable::log2(width2);
  return n > 0.f ? std::min(n, static_cast<float>(octaves.count)) : 0.f;
}

constexpr float kLacunarity = 1.99f;  // a little less than 2, so that the lattices do not coincide
constexpr float kMeanAbsolute = 0.2f;
constexpr int kMostOctaves = 64;  // the frequencies of more of them are no numbers

}  // namespace

float fbm(const SolidCoordinates& at, const Octaves& octaves) {
  const float visible = visible_octaves(at, octaves), whole = std::floor(visible);
  float sum = 0.f, frequency = 1.f, weight = 1.f;
  for (int i = 0; i < static_cast<int>(whole); ++i) {
    sum += weight * noise(frequency * at.p);
    frequency *= kLacunarity;
    weight *= octaves.roughness;
  }
  const float faded = smooth_step(0.3f, 0.7f, visible - whole);
  return faded > 0.f ? sum + weight * faded * noise(frequency * at.p) : sum;
}

float turbulence(const SolidCoordinates& at, const Octaves& octaves, Dialect dialect) {
  const float visible = visible_octaves(at, octaves), whole = std::floor(visible);
  float sum = 0.f, frequency = 1.f, weight = 1.f;
  for (int i = 0; i < static_cast<int>(whole); ++i) {
    sum += weight * std::fabs(noise(frequency * at.p));
    frequency *= kLacunarity;
    weight *= octaves.roughness;
  }
  const float faded = smooth_step(0.3f, 0.7f, visible - whole);
  const float last = faded > 0.f ? std::fabs(noise(frequency * at.p)) : 0.f;
  if (dialect == Dialect::v2)
    return sum + weight * faded * last +
           kMeanAbsolute * (static_cast<float>(octaves.count) - visible);
  sum += weight * lerp(faded, kMeanAbsolute, last);
  for (int i = static_cast<int>(whole); i < octaves.count; ++i) {
    sum += weight * kMeanAbsolute;
    weight *= octaves.roughness;
  }
  return sum;
}

Octaves read_octaves(TextureInputs& in) {
  const ParamSet& p = in.params.params();
  Octaves out{p.real("roughness", 0.5f), p.integer("octaves", 8), Octaves::beyond_of(in.params.dialect())};
  if (out.count < 0 || out.count > kMostOctaves) {
    in.params.warn("octaves must be from 0 to " + std::to_string(kMostOctaves) + ", not " +
                   std::to_string(out.count) + "; using the nearest");
    out.count = std::clamp(out.count, 0, kMostOctaves);
  }
  in.params.needs().footprint = true;
  return out;
}

}  // namespace cloudrenderer
