#include "scene/material_order.h"

#include <charconv>

namespace cloudrenderer {

std::optional<std::uint32_t> mixed_material(const ParamSet& mix, std::string_view name) {
  const Param* p = mix.find(name);
  if (!p || p->type != ParamType::string || p->strings.size() != 1) return std::nullopt;
  const std::string& digits = p->strings[0];
  std::uint32_t number = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), number);
  if (error != std::errc{} || end != digits.data() + digits.size()) return std::nullopt;
  return number;
}

std::vector<std::uint32_t> material_order(const SceneDescription& scene) {
  const std::size_t n = scene.materials.size();
  std::vector<std::uint32_t> order, waiting;
  order.reserve(n);
  std::vector<bool> placed(n);
  const auto is_ready = [&](const MaterialDesc& m) {
    if (m.type != "mix") return true;
    for (const char* name : kMixed)
      if (const auto i = mixed_material(m.params, name); i && *i < n && !placed[*i]) return false;
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
