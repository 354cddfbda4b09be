#include "shapes/geometry.h"

#include <string_view>

#include "shapes/builders.h"

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
    return kind.make(shape, dialect, warnings);
  }
  std::string known;
  for (const ShapeKind& kind : kShapes)
    known += (known.empty() ? "" : ", ") + std::string(kind.name);
  warnings.add(shape.location,
               "Shape \"" + shape.type + "\" is left out; known shapes are " + known);
  return TriangleMesh{};
}

}  // namespace cloudrenderer
