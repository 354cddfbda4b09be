#pragma once
// Scenes made of lights only.
#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <functional>
#include <glm/gtc/matrix_transform.hpp>
#include <random>
#include <string>
#include <vector>

#include "base/sampling.h"
#include "film_support.h"
#include "shading/lights.h"

namespace cloudrenderer::test {

inline Param color(const std::string& name, const Rgb& c) {
  Param p = reals(name, {c.x, c.y, c.z});
  p.type = ParamType::rgb;
  return p;
}
inline Param point(const std::string& name, const Vec3& v) {
  Param p = reals(name, {v.x, v.y, v.z});
  p.type = ParamType::point3;
  return p;
}

// The rectangle with these corners, three in the order of pbrt-v4.
inline Param portal(const Vec3& a, const Vec3& b, const Vec3& c) {
  const Vec3 d = a + c - b;
  Param p = reals("portal", {a.x, a.y, a.z, b.x, b.y, b.z, c.x, c.y, c.z, d.x, d.y, d.z});
  p.type = ParamType::point3;
  return p;
}

// A scene made of lights only.
struct Scene {
  SceneDescription description;
  std::vector<AreaLightId> shape_lights;
  std::vector<Vec3> positions;
  std::vector<Vec2> uvs;
  std::vector<Triangle> triangles;
  std::vector<MeshChunk> chunks;
  std::vector<QuadricRecord> quadrics;
  Warnings warnings;

  Scene& light(const std::string& type, std::vector<Param> params, const Transform& to_world = {}) {
    LightDesc desc = entity<LightDesc>(type, std::move(params));
    desc.light_to_world = to_world;
    description.lights.push_back(std::move(desc));
    return *this;
  }
  std::uint32_t emission(const Rgb& radiance, std::vector<Param> more = {}) {
    more.push_back(color("L", radiance));
    description.area_lights.push_back(entity("diffuse", std::move(more)));
    shape_lights.emplace_back(static_cast<std::uint32_t>(description.area_lights.size() - 1));
    return static_cast<std::uint32_t>(shape_lights.size() - 1);
  }
  Scene& quadric(const Quadric& q, const Rgb& radiance, bool reverse = false,
                 std::vector<Param> more = {}) {
    QuadricRecord r;
    r.quadric = q;
    r.flip = reverse != q.object_to_world.swaps_handedness();
    r.light = emission(radiance, std::move(more));
    quadrics.push_back(r);
    return *this;
  }
  Scene& mesh(const std::vector<Vec3>& p, const std::vector<Triangle>& t, const Rgb& radiance,
              std::vector<Param> more = {}) {
    MeshChunk c;
    c.light = emission(radiance, std::move(more));
    c.first_triangle = static_cast<std::uint32_t>(triangles.size());
    c.triangle_count = static_cast<std::uint32_t>(t.size());
    c.first_vertex = static_cast<std::uint32_t>(positions.size());
    c.vertex_count = static_cast<std::uint32_t>(p.size());
    for (const Triangle& x : t) triangles.push_back(x + c.first_vertex);
    positions.insert(positions.end(), p.begin(), p.end());
    chunks.push_back(c);
    return *this;
  }
  // Of the mesh that was added last, by vertex.
  Scene& with_uvs(const std::vector<Vec2>& uv) {
    chunks.back().first_uv = static_cast<std::uint32_t>(uvs.size());
    uvs.insert(uvs.end(), uv.begin(), uv.end());
    return *this;
  }
  std::unique_ptr<Lights> build() {
    Part part;
    part.positions = positions;
    part.uvs = uvs;
    part.triangles = triangles;
    part.chunks = chunks;
    part.quadrics = quadrics;
    return Lights::build(description, shape_lights, part, {Vec3(-1), Vec3(1)}, warnings);
  }
};

inline Quadric sphere(const Vec3& center, float radius) {
  Quadric q;
  q.radius = radius;
  q.z_min = -radius;
  q.z_max = radius;
  q.object_to_world = Transform(glm::translate(Mat4(1.f), center));
  return q;
}

inline const std::vector<Triangle> kTwoTriangles = {{0, 1, 2}, {0, 2, 3}};

struct Uniform {
  std::mt19937 engine{5};
  float operator()() { return static_cast<float>(engine() >> 8) * 0x1p-24f; }
  Vec2 pair() { return {(*this)(), (*this)()}; }
};

// What a white diffuse surface gets from light samples alone, without obstacles.
inline Rgb irradiance(const Lights& lights, const Vec3& p, const Vec3& n, int samples,
                      const Vec3& hint) {
  Uniform u;
  glm::dvec3 sum(0);
  const int side = static_cast<int>(std::sqrt(samples));
  for (int y = 0; y < side; ++y)
    for (int x = 0; x < side; ++x) {  // jittered
      const Vec2 v((static_cast<float>(x) + u()) / static_cast<float>(side) * 0.9999999f,
                   (static_cast<float>(y) + u()) / static_cast<float>(side) * 0.9999999f);
      LightSample s;
      if (!lights.sample(p, hint, u(), v, s)) continue;
      EXPECT_NEAR(glm::length(s.wi), 1, 1e-5);
      sum += glm::dvec3(s.radiance * (std::max(0.f, glm::dot(n, s.wi)) / s.pdf));
    }
  return Rgb(sum / static_cast<double>(side * side));
}
inline Rgb irradiance(const Lights& lights, const Vec3& p, const Vec3& n, int samples = 10000) {
  return irradiance(lights, p, n, samples, n);
}

inline void expect_ratio(const Rgb& a, const Rgb& b, float tolerance = 0.01f) {
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(a[i] / b[i], 1, tolerance) << a[i] << " for " << b[i];
}

class MapFile {
 public:
  MapFile(int width, int height, const std::function<Rgb(int, int)>& f, const char* extension = ".exr",
          const std::vector<float>& chromaticities = {}) {
    path_ = (std::filesystem::temp_directory_path() /
             ("lights_test_" + std::to_string(::getpid()) + extension))
                .string();
    std::vector<Rgb> pixels;
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) pixels.push_back(f(x, y));
    const auto out = OIIO::ImageOutput::create(path_);
    const bool bytes = std::string(extension) == ".png";
    OIIO::ImageSpec spec(width, height, 3, bytes ? OIIO::TypeDesc::UINT8 : OIIO::TypeDesc::FLOAT);
    if (!chromaticities.empty()) spec.attribute("chromaticities", OIIO::TypeDesc(OIIO::TypeDesc::FLOAT, 8), chromaticities.data());
    if (!out || !out->open(path_, spec) ||
        !out->write_image(OIIO::TypeDesc::FLOAT, pixels.data()) || !out->close())
      throw std::runtime_error("cannot write " + path_);
  }
  ~MapFile() { std::filesystem::remove(path_); }
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

inline Rgb rough(int x, int y) {
  const auto h = static_cast<float>((x * 7919 + y * 104729) % 101) / 100.f;
  return (x == 11 && y == 3) ? Rgb(90, 80, 50) : Rgb(h * h, 0.2f * h, x < 8 ? 1.f : 0.f);
}

inline Transform tilted() {
  return Transform(glm::rotate(Mat4(1.f), 1.f, glm::normalize(Vec3(1, 2, 3))) *
                   glm::scale(Mat4(1.f), Vec3(1, 1, -1)));
}

inline Vec3 uniform_direction(Uniform& u) { return sample_uniform_sphere(u.pair()); }

}  // namespace cloudrenderer::test
