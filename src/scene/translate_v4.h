#pragma once
#include <functional>
#include <initializer_list>
#include <string>

#include "scene/description.h"
#include "scene/transforms.h"

namespace cloudrenderer {

// What a pbrt-v4 scene says in the words of the description, which are pbrt-v3's with a few
// parameters more. Parameters that v4 does not have are gone before. Each changes the entity in
// place; `warn` is told what is only approximated.
class V4Translator {
 public:
  using Warn = std::function<void(const FileLocation&, const std::string&)>;
  explicit V4Translator(Warn warn) : warn_(std::move(warn)) {}

  void camera(Entity& e) const;
  void film(Entity& e) const;
  // When both are known: the time that the shutter is open, where the film has not one of its own (former versions). Throws SceneError.
  void expose(const Entity& camera, Entity& film) const;
  void sampler(Entity& e) const;
  void pixel_filter(Entity& e) const;
  void integrator(Entity& e) const;
  void material(Entity& e) const;
  // `ctm`: v4 puts some of these in other places of their space.
  void texture(Entity& e, DMat4& ctm) const;
  void light(Entity& e, DMat4& ctm) const;
  void area_light(Entity& e) const;
  void medium(Entity& e) const;

 private:
  void approximated(const Entity& e, const std::string& as) const;
  // Both axes of each roughness, which v4 maps to Trowbridge-Reitz widths by a root.
  void roughness(Entity& e, float otherwise, std::initializer_list<std::string> prefixes = {""}) const;
  void copper(Entity& e, const std::string& prefix) const;
  void conductor(Entity& e) const;
  void index(Entity& e, const char* name, float otherwise) const;

  Warn warn_;
};

}  // namespace cloudrenderer
