#include "scene/material_order.h"

#include <charconv>

namespace cloudrenderer {

std::vector<std::uint32_t> material_order(const SceneDescription& scene) {
  const std::size_t n = scene.materials.size();
  std::vector<std::uint32_t> order, waiting;
  order.reserve(n);
  std::vector<bool> placed(n);
  const auto is_ready = [&](const MaterialDesc& m) {
    if (m.type != "mix") return true;
    for (const char* name : {"namedmaterial1", "namedmaterial2"}) {
      const Param* p = m.params.find(name);
      std::size_t i = n;
      if (p && p->strings.size() == 1) std::from_chars(p->strings[0].data(), p->strings[0].data() + p->strings[0].size(), i);
      if (i < n && !placed[i]) return false;
    }
    return true;
  };
  const auto place = [&](std::uint32_t i) {
    if (!is_ready(scene.materials[i])) return false;
    placed[i] = true;
    order.push_back(i);
    return true;
  };
  for (std::uint32_t i = 0; i < n; ++i)
    if (!place(i)) waiting.push_back(i);
  while (!waiting.empty())
    if (std::erase_if(waiting, place) == 0)
      throw SceneError(scene.materials[waiting.front()].location, "materials that mix each other in a circle");
  return order;
}

}  // namespace cloudrenderer
