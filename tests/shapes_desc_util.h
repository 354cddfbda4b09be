#pragma once
// Shape descriptions written by hand: the shape stands at test.pbrt:5:1, its parameters at 7:3.
#include <cmath>
#include <string>
#include <vector>

#include "scene/description.h"

namespace cloudrenderer::shapes_test {

inline FileLocation at(std::uint32_t line, std::uint32_t column) {
  return {std::make_shared<const std::string>("test.pbrt"), line, column};
}

inline ShapeDesc shape(const std::string& type) {
  ShapeDesc s;
  s.type = type;
  s.location = at(5, 1);
  return s;
}

inline void add_reals(ShapeDesc& s, const std::string& name, ParamType type,
                      std::vector<float> values) {
  Param p;
  p.type = type;
  p.name = name;
  p.reals = BulkArray<float>(std::move(values));
  p.location = at(7, 3);
  s.params.add(std::move(p));
}

inline void add_ints(ShapeDesc& s, const std::string& name, std::vector<std::int32_t> values) {
  Param p;
  p.type = ParamType::integer;
  p.name = name;
  p.integers = BulkArray<std::int32_t>(std::move(values));
  p.location = at(7, 3);
  s.params.add(std::move(p));
}

}  // namespace cloudrenderer::shapes_test
