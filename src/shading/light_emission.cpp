// AreaLightSource: how shapes shine.
#include <algorithm>

#include "parts/part_triangle.h"
#include "shading/light_map.h"
#include "shading/light_record.h"

namespace cloudrenderer {

Rgb EmitterPicture::radiance(const Vec3& p) const {
  return scale * clamped(*map, uv0 + Vec2(glm::dot(p - corner, u), glm::dot(p - corner, v)));
}

EmitterPicture make_picture(const Emission& emission, float power, const std::array<Vec3, 3>& p, const std::array<Vec2, 3>& uv) {
  EmitterPicture out;
  out.map = emission.picture.get();
  out.scale = emission.scale * power;
  out.corner = p[0];
  out.uv0 = uv[0];
  // The dual of the two edges within their plane.
  const glm::dvec3 e0(p[1] - p[0]), e1(p[2] - p[0]);
  const double a = glm::dot(e0, e0), b = glm::dot(e0, e1), c = glm::dot(e1, e1), det = a * c - b * b;
  const glm::dvec3 d0 = (c * e0 - b * e1) / det, d1 = (a * e1 - b * e0) / det;
  const auto gradient = [&](int i) { return Vec3(static_cast<double>(uv[1][i] - uv[0][i]) * d0 + static_cast<double>(uv[2][i] - uv[0][i]) * d1); };
  out.u = gradient(0);
  out.v = gradient(1);
  return out;
}

std::vector<Emission> read_emissions(const SceneDescription& scene, std::span<const AreaLightId> shape_lights, Warnings& warnings,
                                   bool read_maps) {
  std::vector<Emission> sources;
  for (const Entity& desc : scene.area_lights) {
    Emission e;
    if (desc.type == "diffuse" || desc.type == "area") {
      e.radiance = light_color(desc.params, "L", desc.location, warnings);
      e.power = std::max(0.f, desc.params.real("power", 0.f));
      e.scale = e.radiance;
      if (auto map = read_light_map(desc, "filename", scene.dialect, Rgb(1.f), read_maps, "the light is even", warnings); !map.empty()) {
        const Rgb average = mean(map);
        // A power is that of the picture.
        if (e.power > 0.f) e.scale /= std::max(luminance(average), 1e-30f);
        e.radiance = e.scale * average;
        e.picture = std::make_shared<LightMap>(std::move(map));
      }
      e.patches = static_cast<std::uint32_t>(std::max(0, desc.params.integer("patches", 0)));
      e.only_seen = desc.params.boolean("onlyseen", false);
      e.invisible = desc.params.boolean("invisible", false);
      e.weighed = desc.params.boolean("weighed", false);
      if (!is_finite(e.radiance) || !(e.power < kInfinity))
        throw SceneError{desc.location, "the light's radiance must be finite"};
      if (scene.dialect == Dialect::v3) e.two_sided = desc.params.boolean("twosided", false);
      desc.params.report_unused("AreaLightSource \"" + desc.type + "\"", warnings);
    } else if (!desc.type.empty()) {  // that is how a lamp is switched off
      warnings.add(desc.location,
                   "area light \"" + desc.type + "\" is unknown and does not shine");
    }
    sources.push_back(e);
  }
  std::vector<Emission> out;
  for (const AreaLightId id : shape_lights) out.push_back(id.value < sources.size() ? sources[id.value] : Emission{});
  return out;
}

std::vector<PrimitiveRange> primitive_ranges(const Part& part, std::span<const Emission> emissions) {
  std::vector<PrimitiveRange> ranges(emissions.size());
  for (const MeshChunk& chunk : part.chunks) {
    if (!can_be_sampled(emissions, chunk.light)) continue;
    std::uint32_t& count = ranges[chunk.light].count;
    for (std::uint32_t i = 0; i < chunk.triangle_count; ++i) count = std::max(count, part.source_primitive(chunk, chunk.first_triangle + i) + 1);
  }
  for (const QuadricRecord& record : part.quadrics)
    if (can_be_sampled(emissions, record.light)) ranges[record.light].count = 1;
  std::uint32_t total = 0;
  for (PrimitiveRange& range : ranges) {
    range.first = total;
    total += range.count;
  }
  return ranges;
}

std::vector<float> power_factors(const Part& part, std::span<const Emission> emissions, std::span<const PrimitiveRange> ranges, std::uint32_t total) {
  std::vector<float> areas(total, 0.f);
  for (const QuadricRecord& record : part.quadrics) {
    if (!can_be_sampled(emissions, record.light)) continue;
    Quadric unplaced = record.quadric;
    unplaced.object_to_world = Transform();
    areas[ranges[record.light].first] = surface_area(unplaced);
  }
  // The first primitive of the patch that primitive `i` is of.
  const auto patch = [&](std::uint32_t light, std::uint32_t i) {
    const std::uint32_t patches = emissions[light].patches;
    if (patches == 0) return i;
    const std::uint32_t each = (ranges[light].count + patches - 1) / patches;
    return i / each * each;
  };
  for (const MeshChunk& chunk : part.chunks)
    for (std::uint32_t i = 0; can_be_sampled(emissions, chunk.light) && i < chunk.triangle_count; ++i) {
      const TriangleVertices t = vertices_of(part, chunk, chunk.first_triangle + i);
      const std::uint32_t number = patch(chunk.light, part.source_primitive(chunk, chunk.first_triangle + i));
      areas[ranges[chunk.light].first + number] += 0.5f * glm::length(glm::cross(t.p[1] - t.p[0], t.p[2] - t.p[0]));
    }
  std::vector<float> factors(total, 0.f);
  for (std::uint32_t light = 0; light < ranges.size(); ++light) {
    const Emission& e = emissions[light];
    for (std::uint32_t i = 0; i < ranges[light].count; ++i) {
      const float factor = e.power / (kPi * areas[ranges[light].first + patch(light, i)] * (e.two_sided ? 2.f : 1.f));
      factors[ranges[light].first + i] = factor < kInfinity ? factor : 0.f;
    }
  }
  return factors;
}

}  // namespace cloudrenderer
