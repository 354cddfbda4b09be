#pragma once
#include <string>
#include <utility>
#include <vector>

#include "scene/params.h"

namespace cloudrenderer {

// Parameters that stand in no file.
inline Param make_param(ParamType type, std::string name, const FileLocation& where) {
  Param p;
  p.type = type;
  p.name = std::move(name);
  p.location = where;
  return p;
}
inline Param make_reals(ParamType type, std::string name, std::vector<float> v,
                        const FileLocation& where) {
  Param p = make_param(type, std::move(name), where);
  p.reals = BulkArray<float>(std::move(v));
  return p;
}
inline Param make_real(std::string name, float v, const FileLocation& where) {
  return make_reals(ParamType::real, std::move(name), {v}, where);
}
inline Param make_rgb(std::string name, const Rgb& v, const FileLocation& where) {
  return make_reals(ParamType::rgb, std::move(name), {v.x, v.y, v.z}, where);
}
inline Param make_vector(std::string name, const Vec3& v, const FileLocation& where) {
  return make_reals(ParamType::vector3, std::move(name), {v.x, v.y, v.z}, where);
}
inline Param make_string(std::string name, std::string v, const FileLocation& where) {
  Param p = make_param(ParamType::string, std::move(name), where);
  p.strings = {std::move(v)};
  return p;
}
inline Param make_integer(std::string name, int v, const FileLocation& where) {
  Param p = make_param(ParamType::integer, std::move(name), where);
  p.integers = BulkArray<std::int32_t>(std::vector<std::int32_t>{v});
  return p;
}
inline Param make_bool(std::string name, bool v, const FileLocation& where) {
  Param p = make_integer(std::move(name), v ? 1 : 0, where);
  p.type = ParamType::boolean;
  return p;
}

}  // namespace cloudrenderer
