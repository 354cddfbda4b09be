#pragma once
#include <iosfwd>
#include <string>
#include <string_view>

#include "scene/description.h"

namespace cloudrenderer {

// Writes scene values as pbrt text that the given dialect reads back to the same values: floats are
// the shortest decimals that give the same float.
void write_float(std::ostream& out, float v);
void write_quoted(std::ostream& out, std::string_view text);
void write_transform(std::ostream& out,
                     const Transform& t);  // Transform [ ... ]: replaces the current one
// Both transformations of something that moves from `start`.
void write_motion(std::ostream& out, const Transform& start, const Transform& end);
void write_params(std::ostream& out, const ParamSet& params,
                  Dialect dialect);  // each on a line of its own, indented
// A directive: `Shape "sphere"` and its parameters.
void write_entity(std::ostream& out, std::string_view directive, const Entity& entity,
                  Dialect dialect);

// Everything up to WorldBegin: camera, film, sampler, filter, integrator.
void write_options(std::ostream& out, const SceneDescription& scene);
// WorldBegin, then textures, materials (by the names below) and lights. WorldEnd is the caller's.
void write_world_head(std::ostream& out, const SceneDescription& scene);

// What a shape needs before it, inside of its attribute block.
std::string material_name(MaterialId id);
void write_material_use(std::ostream& out, const SceneDescription& scene, MaterialId id);
void write_area_light(std::ostream& out, const SceneDescription& scene, AreaLightId id);

}  // namespace cloudrenderer
