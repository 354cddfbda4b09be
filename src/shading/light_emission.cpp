// AreaLightSource: how shapes shine.
#include "shading/light_map.h"
#include "shading/light_record.h"

namespace cloudrenderer {

std::vector<Emission> read_emissions(const SceneDescription& scene, std::span<const AreaLightId> shape_lights, Warnings& warnings,
                                   bool read_maps) {
  std::vector<Emission> sources;
  for (const Entity& desc : scene.area_lights) {
    Emission e;
    if (desc.type == "diffuse" || desc.type == "area") {
      e.radiance = light_color(desc.params, "L", desc.location, warnings);
      if (const std::string path = desc.params.string("filename", ""); !path.empty())
        e.radiance *= mean(read_light_map(path, Rgb(1.f), read_maps, desc.location,
                                             "the light is even", warnings));
      e.power = std::max(0.f, desc.params.real("power", 0.f));
      e.patches = desc.params.boolean("patches", false);
      e.invisible = desc.params.boolean("invisible", false);
      if (!is_finite(e.radiance) || !(e.power < kInfinity))
        throw SceneError{desc.location, "the light's radiance must be finite"};
      if (scene.dialect == Dialect::v3) e.two_sided = desc.params.boolean("twosided", false);
      desc.params.report_unused("AreaLightSource \"" + desc.type + "\"", warnings);
    } else {
      warnings.add(desc.location,
                   "area light \"" + desc.type + "\" is unknown and does not shine");
    }
    sources.push_back(e);
  }
  std::vector<Emission> out;
  for (const AreaLightId id : shape_lights) out.push_back(id.value < sources.size() ? sources[id.value] : Emission{});
  return out;
}

}  // namespace cloudrenderer
