#pragma once
#include <initializer_list>
#include <string>
#include <vector>

#include "scene/description.h"

namespace cloudrenderer::testing {

inline Param rgb_param(const std::string& name, const Rgb& c) {
  Param p;
  p.type = ParamType::rgb;
  p.name = name;
  p.reals = BulkArray<float>(std::vector<float>{c.x, c.y, c.z});
  return p;
}
inline Param real_param(const std::string& name, float v) {
  Param p;
  p.type = ParamType::real;
  p.name = name;
  p.reals = BulkArray<float>(std::vector<float>{v});
  return p;
}
inline Param integer_param(const std::string& name, int v) {
  Param p;
  p.type = ParamType::integer;
  p.name = name;
  p.integers = BulkArray<std::int32_t>(std::vector<std::int32_t>{v});
  return p;
}
inline Param bool_param(const std::string& name, bool v) {
  Param p = integer_param(name, v ? 1 : 0);
  p.type = ParamType::boolean;
  return p;
}
inline Param string_param(const std::string& name, const std::string& v,
                          ParamType type = ParamType::string) {
  Param p;
  p.type = type;
  p.name = name;
  p.strings = {v};
  return p;
}
inline Param texture_param(const std::string& name, const std::string& v) {
  return string_param(name, v, ParamType::texture);
}

inline MaterialDesc material(const std::string& type, std::initializer_list<Param> params = {}) {
  MaterialDesc m;
  m.type = type;
  for (const Param& p : params) m.params.add(p);
  return m;
}
inline TextureDesc texture(const std::string& name, const std::string& type, bool is_float,
                           std::initializer_list<Param> params = {}) {
  TextureDesc t;
  t.name = name;
  t.type = type;
  t.is_float = is_float;
  for (const Param& p : params) t.params.add(p);
  return t;
}

}  // namespace cloudrenderer::testing
