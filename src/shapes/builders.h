#pragma once
// One builder a kind of shape; geometry.cpp has the table of their names.
#include "shapes/geometry.h"

namespace cloudrenderer {

ShapeGeometry make_trianglemesh(const ShapeDesc& shape, Dialect dialect, Warnings& warnings);
ShapeGeometry make_plymesh(const ShapeDesc& shape, Dialect dialect, Warnings& warnings);
ShapeGeometry make_loopsubdiv(const ShapeDesc& shape, Dialect dialect, Warnings& warnings);
ShapeGeometry make_heightfield(const ShapeDesc& shape, Dialect dialect, Warnings& warnings);
ShapeGeometry make_nurbs(const ShapeDesc& shape, Dialect dialect, Warnings& warnings);
ShapeGeometry make_bilinearmesh(const ShapeDesc& shape, Dialect dialect, Warnings& warnings);
ShapeGeometry make_curve(const ShapeDesc& shape, Dialect dialect, Warnings& warnings);
ShapeGeometry make_sphere(const ShapeDesc& shape, Dialect dialect, Warnings& warnings);
ShapeGeometry make_cylinder(const ShapeDesc& shape, Dialect dialect, Warnings& warnings);
ShapeGeometry make_disk(const ShapeDesc& shape, Dialect dialect, Warnings& warnings);
ShapeGeometry make_cone(const ShapeDesc& shape, Dialect dialect, Warnings& warnings);
ShapeGeometry make_paraboloid(const ShapeDesc& shape, Dialect dialect, Warnings& warnings);
ShapeGeometry make_hyperboloid(const ShapeDesc& shape, Dialect dialect, Warnings& warnings);

// Where a parameter stands, or else the shape.
inline const FileLocation& location_of(const ShapeDesc& shape, std::string_view parameter) {
  const Param* p = shape.params.find(parameter);
  return p ? p->location : shape.location;
}

}  // namespace cloudrenderer
