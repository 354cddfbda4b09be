#include "shapes/geometry.h"

#include <string_view>

#include "scene/language.h"
#include "shapes/quadric_builder.h"

namespace cloudrenderer {

namespace {

struct ShapeKind {
  std::string_view name;
  ShapeGeometry (*make)(const ShapeDesc&, Dialect, Warnings&);
};

// clang-format off
constexpr ShapeKind kShapes[] = {
    {"bilinearmesh", make_bilinearmesh},
    {"cone", make_cone},
    {"curve", make_curve},
    {"cylinder", make_cylinder},
    {"disk", make_disk},
    {"heightfield", make_heightfield},
    {"hyperboloid", make_hyperboloid},
    {"loopsubdiv", make_loopsubdiv},
    {"nurbs", make_nurbs},
    {"paraboloid", make_paraboloid},
    {"plymesh", make_plymesh},
    {"sphere", make_sphere},
    {"trianglemesh", make_trianglemesh},
};
// clang-format on

}  // namespace

ShapeGeometry make_geometry(const ShapeDesc& shape, Dialect dialect, Warnings& warnings) {
  for (const ShapeKind& kind : kShapes) {
    if (kind.name != shape.type) continue;
    if (!shape.object_to_world.is_invertible())
      throw SceneError(shape.location, "the transform of Shape \"" + shape.type + "\" is singular");
    try {
      return kind.make(shape, dialect, warnings);
    } catch (const EmptyShape& e) {
      warnings.add(e.location, e.what() + std::string(": the shape is left out"));
      return TriangleMesh{};
    }
  }
  warnings.add(shape.location, "Shape \"" + shape.type + "\" is left out; known shapes are " + known_types("Shape", dialect));
  return TriangleMesh{};
}

}  // namespace cloudrenderer
