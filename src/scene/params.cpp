#include "scene/params.h"

#include <algorithm>

#include "scene/language.h"

namespace cloudrenderer {

const char* type_word(ParamType type) {
  switch (type) {
    case ParamType::boolean:
      return "bool";
    case ParamType::integer:
      return "integer";
    case ParamType::real:
      return "float";
    case ParamType::point2:
      return "point2";
    case ParamType::vector2:
      return "vector2";
    case ParamType::point3:
      return "point";
    case ParamType::vector3:
      return "vector";
    case ParamType::normal3:
      return "normal";
    case ParamType::rgb:
      return "rgb";
    case ParamType::string:
      return "string";
    case ParamType::texture:
      return "texture";
  }
  return "?";
}

namespace {

[[noreturn]] void wrong_type(const Param& p, const char* expected) {
  throw SceneError(p.location, "parameter \"" + p.name + "\" must be of type " + expected +
                                   ", got " + type_word(p.type));
}

void need_values(const Param& p, std::size_t have, std::size_t want) {
  if (have != want)
    throw SceneError(p.location, "parameter \"" + p.name + "\" must have " + std::to_string(want) +
                                     (want == 1 ? " value" : " components") + ", got " +
                                     std::to_string(have));
}

bool holds_reals(ParamType type) {
  return type != ParamType::boolean && type != ParamType::integer && type != ParamType::string &&
         type != ParamType::texture;
}

Vec3 three(const Param& p) {
  need_values(p, p.reals.size(), 3);
  return {p.reals[0], p.reals[1], p.reals[2]};
}

}  // namespace

void ParamSet::add(Param p) {
  const auto same = std::find_if(params_.begin(), params_.end(),
                                 [&](const Param& q) { return q.name == p.name; });
  if (same != params_.end())
    *same = std::move(p);
  else
    params_.push_back(std::move(p));
}

std::optional<Param> ParamSet::take(std::string_view name) {
  const auto found =
      std::find_if(params_.begin(), params_.end(), [&](const Param& p) { return p.name == name; });
  if (found == params_.end()) return std::nullopt;
  Param out = std::move(*found);
  params_.erase(found);
  return out;
}

void ParamSet::rename(std::string_view from, std::string_view to) {
  if (auto p = take(from)) {
    p->name = to;
    add(std::move(*p));
  }
}

const Param* ParamSet::find(std::string_view name) const {
  for (const Param& p : params_)
    if (p.name == name) return &p;
  return nullptr;
}

bool ParamSet::boolean(std::string_view name, bool otherwise) const {
  const Param* p = find(name);
  if (!p) return otherwise;
  p->used = true;
  if (p->type != ParamType::boolean) wrong_type(*p, "bool");
  need_values(*p, p->integers.size(), 1);
  return p->integers[0] != 0;
}

int ParamSet::integer(std::string_view name, int otherwise) const {
  const Param* p = find(name);
  if (!p) return otherwise;
  p->used = true;
  if (p->type != ParamType::integer) wrong_type(*p, "integer");
  need_values(*p, p->integers.size(), 1);
  return p->integers[0];
}

float ParamSet::real(std::string_view name, float otherwise) const {
  const Param* p = find(name);
  if (!p) return otherwise;
  p->used = true;
  if (p->type == ParamType::integer) {
    need_values(*p, p->integers.size(), 1);
    return static_cast<float>(p->integers[0]);
  }
  if (p->type != ParamType::real) wrong_type(*p, "float");
  need_values(*p, p->reals.size(), 1);
  return p->reals[0];
}

Rgb ParamSet::rgb(std::string_view name, const Rgb& otherwise) const {
  const Param* p = find(name);
  if (!p) return otherwise;
  p->used = true;
  if (p->type == ParamType::real) {
    need_values(*p, p->reals.size(), 1);
    return Rgb(p->reals[0]);
  }
  if (p->type != ParamType::rgb) wrong_type(*p, "rgb");
  return three(*p);
}

Vec3 ParamSet::point3(std::string_view name, const Vec3& otherwise) const {
  const Param* p = find(name);
  if (!p) return otherwise;
  p->used = true;
  if (p->type != ParamType::point3) wrong_type(*p, "point");
  return three(*p);
}

Vec3 ParamSet::vector3(std::string_view name, const Vec3& otherwise) const {
  const Param* p = find(name);
  if (!p) return otherwise;
  p->used = true;
  if (p->type != ParamType::vector3) wrong_type(*p, "vector");
  return three(*p);
}

std::string ParamSet::string(std::string_view name, std::string_view otherwise) const {
  const Param* p = find(name);
  if (!p) return std::string(otherwise);
  p->used = true;
  if (p->type != ParamType::string) wrong_type(*p, "string");
  need_values(*p, p->strings.size(), 1);
  return p->strings[0];
}

std::optional<std::string> ParamSet::texture(std::string_view name) const {
  const Param* p = find(name);
  if (!p || p->type != ParamType::texture) return std::nullopt;
  p->used = true;
  need_values(*p, p->strings.size(), 1);
  return p->strings[0];
}

BulkArray<float> ParamSet::reals(std::string_view name) const {
  const Param* p = find(name);
  if (!p) return {};
  p->used = true;
  if (!holds_reals(p->type)) wrong_type(*p, "float, point, vector, normal or rgb");
  return p->reals;
}

BulkArray<std::int32_t> ParamSet::integers(std::string_view name) const {
  const Param* p = find(name);
  if (!p) return {};
  p->used = true;
  if (p->type != ParamType::integer) wrong_type(*p, "integer");
  return p->integers;
}

void ParamSet::report_unused(std::string_view owner, Warnings& warnings,
                             std::set<std::string>* once) const {
  for (const Param& p : params_) {
    if (p.used) continue;
    const std::string message = unused_message(owner, p.name);
    if (!message.empty() && (!once || once->insert(message).second))
      warnings.add(p.location, message);
  }
}

}  // namespace cloudrenderer
