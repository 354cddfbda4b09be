#pragma once
// Directives made by hand, for tests of what reads them.
#include <string>
#include <utility>
#include <vector>

#include "scene/description.h"

namespace cloudrenderer::test {

inline Param reals(const std::string& name, std::vector<float> values) {
  Param p;
  p.type = ParamType::real;
  p.name = name;
  p.reals = BulkArray<float>(std::move(values));
  return p;
}
inline Param integer(const std::string& name, int value) {
  Param p;
  p.type = ParamType::integer;
  p.name = name;
  p.integers = BulkArray<std::int32_t>(std::vector<std::int32_t>{value});
  return p;
}
inline Param boolean(const std::string& name, bool value) {
  Param p = integer(name, value);
  p.type = ParamType::boolean;
  return p;
}
inline Param string(const std::string& name, const std::string& value) {
  Param p;
  p.type = ParamType::string;
  p.name = name;
  p.strings = {value};
  return p;
}
template <class E = Entity>
E entity(const std::string& type, std::vector<Param> params) {
  E e;
  e.type = type;
  for (Param& p : params) e.params.add(std::move(p));
  return e;
}

}  // namespace cloudrenderer::test
