// Eight vertices at once have the bits that each has by itself.
#include <gtest/gtest.h>

#include <bit>
#include <cstring>
#include <random>

#include "shading/bsdf_disney.h"
#include "shading/bsdf_lobes.h"
#include "shading/material.h"
#include "shapes/triangle.h"
#include "shading_lights_support.h"

namespace cloudrenderer {
namespace {

using namespace bsdf;
using test::Uniform;

void expect_bits(float a, float b) { ASSERT_EQ(std::bit_cast<std::uint32_t>(a), std::bit_cast<std::uint32_t>(b)) << a << " " << b; }
void expect_bits(const Vec3& a, const Vec3& b) {
  for (int i = 0; i < 3; ++i) expect_bits(a[i], b[i]);
}

// Lists of lobes of one kind, with numbers that depend on x in [0, 1).
std::vector<Lobe> lobes(std::size_t kind, float x) {
  const Rgb color(0.1f + 0.8f * x, 0.5f, 0.9f - 0.7f * x);
  const Rgb eta(0.2f + x, 0.92f, 1.1f), k(3.9f, 2.45f * x, 2.14f);
  switch (kind) {
    case 0:
      return {lambert(color)};
    case 1:
      return {oren_nayar(color, 5.f + 60.f * x)};
    case 2:
      return {lambert(color), microfacet(Rgb(x), blinn(0.01f + x), dielectric_one_sided(1.f / 1.5f))};
    case 3:
      return {lambert(color), microfacet(color, trowbridge_reitz(0.05f + x, 0.05f + x), dielectric(1.f / 1.5f))};
    case 4:
      return {microfacet(Rgb(1.f), blinn(0.3f * x), conductor_v2(eta, k))};
    case 5:
      return {microfacet(Rgb(1.f), trowbridge_reitz(0.1f + x, 0.5f), conductor(eta, k)), lambert(Rgb(0.f))};
    case 6:
      return {fresnel_blend(color, Rgb(x), trowbridge_reitz(0.2f, 0.1f + x))};
    case 7:
      return {disney_diffuse(DisneyDiffuse{color, x, 0.5f, 0.3f + 0.5f * x, Rgb(0.1f)}),
              microfacet(Rgb(1.f), separable(trowbridge_reitz(0.1f + x, 0.3f)), disney_fresnel(color, x, 1.5f))};
    case 8:
      return {specular_reflection(color, conductor(eta, k))};
    case 9:
      return {specular_dielectric(color, Rgb(x), 1.1f + x, true)};
    case 10:
      return {specular_reflection(color, dielectric(1.f + x)), specular_transmission(color, 0.6f + x, true), lambert(color)};
    case 11:
      return {thin_dielectric(1.2f + x), microfacet(color, trowbridge_reitz(0.1f, 0.1f), no_fresnel())};
    case 12:
      return {coated_lambert(color, 1.1f + x, 0.5f * x), specular_reflection(Rgb(x), dielectric(1.5f))};
    default:
      return {fresnel_blend(color, Rgb(x), blinn_anisotropic(0.1f, 0.01f + x)), lambert(color), microfacet(color, blinn(0.1f), no_fresnel())};
  }
}
constexpr std::size_t kKinds = 14;

Vec3 direction(Uniform& u) { return sample_uniform_sphere<float>(u.pair()); }

TEST(Bsdf8, HasTheBitsOfEachVertex) {
  Uniform u;
  int sampled = 0, absorbed = 0;
  for (std::size_t kind = 0; kind < kKinds; ++kind) {
    for (int round = 0; round < 400; ++round) {
      std::array<Bsdf, kLanes> one;
      std::array<LobeOf<Float8>, Bsdf::kMaxLobes> eight_lobes;
      Vec3x8 ns, ng, wo, wi;
      Float8 choice;
      Vec2x8 numbers;
      std::size_t count = 0;
      for (std::size_t i = 0; i < kLanes; ++i) {
        const std::vector<Lobe> own = lobes(kind, u());
        count = own.size();
        for (std::size_t k = 0; k < count; ++k) {
          ASSERT_TRUE(eight_wide(own[k]));
          if (i == 0) eight_lobes[k] = in_all_lanes(own[k]);
          put(eight_lobes[k], i, own[k]);
        }
        const Vec3 n = direction(u);
        // Some views along the surface, some from its back.
        const Vec3 view = round % 7 == 0 ? Frame(n).s : direction(u);
        lanes::put(ns, i, n);
        lanes::put(ng, i, glm::normalize(n + 0.3f * direction(u)));
        lanes::put(wo, i, view);
        lanes::put(wi, i, round % 5 == 0 ? -view : direction(u));
        lanes::put(choice, i, u());
        lanes::put(numbers.x, i, round % 11 == 0 ? 0.5f : u());
        lanes::put(numbers.y, i, round % 11 == 0 ? 0.5f : u());
        one[i] = Bsdf(Frame(n), lanes::get(ng, i));
        one[i].add(std::span<const Lobe>(own));
        one[i].finish(view);
      }
      Bsdf8 eight(FrameOf<Float8>(ns), ng);
      for (std::size_t k = 0; k < count; ++k) eight.add(eight_lobes[k]);
      eight.finish(wo);
      Float8 pdf;
      const Vec3x8 f = eight.eval_cos(wo, wi, pdf);
      const Float8 even = eight.even_pdf(wo, wi);
      BsdfSampleOf<Float8> sample;
      const std::uint32_t found = lanes::to_bits(eight.sample(wo, choice, numbers, sample));
      for (std::size_t i = 0; i < kLanes; ++i) {
        SCOPED_TRACE("kind " + std::to_string(kind) + " round " + std::to_string(round) + " lane " + std::to_string(i));
        float p;
        expect_bits(one[i].eval_cos(lanes::get(wo, i), lanes::get(wi, i), p), lanes::get(f, i));
        expect_bits(p, lanes::get(pdf, i));
        expect_bits(one[i].even_pdf(lanes::get(wo, i), lanes::get(wi, i)), lanes::get(even, i));
        BsdfSample s;
        const bool is_found = one[i].sample(lanes::get(wo, i), lanes::get(choice, i), lanes::get(numbers, i), s);
        ASSERT_EQ(is_found, (found >> i & 1u) != 0);
        ++(is_found ? sampled : absorbed);
        if (!is_found) continue;
        expect_bits(s.wi, lanes::get(sample.wi, i));
        expect_bits(s.weight, lanes::get(sample.weight, i));
        expect_bits(s.pdf, lanes::get(sample.pdf, i));
        expect_bits(s.eta, lanes::get(sample.eta, i));
        ASSERT_EQ(s.specular, (lanes::to_bits(sample.specular) >> i & 1u) != 0);
        ASSERT_EQ(s.transmission, (lanes::to_bits(sample.transmission) >> i & 1u) != 0);
      }
    }
  }
  EXPECT_GT(sampled, 10000);
  EXPECT_GT(absorbed, 100);
}

TEST(Lights, EightPointsGetTheBitsOfEach) {
  using namespace test;
  const auto add_flat = [](Scene& s) {
    s.mesh({{0, 0, 2}, {0, 3, 2}, {1, 3, 2}, {1, 0, 2}, {0.3f, 1.1f, 2}}, {{0, 1, 4}, {1, 2, 4}, {2, 3, 4}, {3, 0, 4}}, Rgb(1));
    s.mesh({{-3, 0, 2}, {-3, 3, 2}, {-2, 3, 2}, {-2, 0, 2}}, kTwoTriangles, Rgb(2, 1, 0.5f));
  };
  const auto add_delta = [](Scene& s) {
    s.light("point", {color("I", Rgb(3)), point("from", Vec3(1, 2, 3))});
    s.light("spot", {color("I", Rgb(3)), point("from", Vec3(0, 0, 3)), point("to", Vec3(0))});
    s.light("distant", {color("L", Rgb(3)), point("from", Vec3(0, 1, 1)), point("to", Vec3(0))});
  };
  const MapFile map(64, 32, [](int x, int y) { return Rgb(0.1f, 0.2f, x == 5 && y == 9 ? 300.f : 0.3f); });
  const auto add_map = [&](Scene& s) {
    s.light("infinite", {string("mapname", map.path())}, Transform(glm::rotate(Mat4(1.f), 1.f, Vec3(1, 2, 3))));
  };
  std::vector<Scene> scenes(9);
  scenes[0].quadric(sphere({0, 0, 2}, 1.5f), {1, 2, 3});
  add_flat(scenes[1]);
  add_delta(scenes[2]);
  scenes[3].quadric(sphere({0, 0, 2}, 0.5f), {1, 2, 3}).light("infinite", {color("L", Rgb(0.5f))});
  add_flat(scenes[3]);
  add_delta(scenes[3]);
  // More than are listed one by one.
  for (int i = 0; i < 40; ++i) scenes[4].quadric(sphere({static_cast<float>(i), 0, 2}, 0.2f), Rgb(1));
  add_map(scenes[5]);
  add_map(scenes[6]);
  scenes[6].light("infinite", {color("L", Rgb(0.5f))});
  Quadric disk = sphere({1, 0, 2}, 0.7f);
  disk.kind = QuadricKind::disk;
  disk.z_min = disk.z_max = 0;
  scenes[6].quadric(disk, Rgb(4)).quadric(disk, Rgb(3), true);
  scenes[7].light("infinite", {string("mapname", map.path()), portal({-1, -2, 1}, {-1, 1, 1}, {2, 1, 1})});
  scenes[7].light("infinite", {color("L", Rgb(0.5f)), portal({3, 1, -1}, {3, -1, -1}, {3, -1, 1})});
  // Flat ones of all kinds, which are sampled together: seen large and small, from both sides, hidden.
  const std::vector<Vec3> corners = {{-2, -3, 2}, {-2, 3, 2}, {2, 3, 2}, {2, -3, 2}};
  scenes[8].mesh(corners, kTwoTriangles, {1, 2, 3}).mesh(corners, {{0, 2, 1}}, {3, 2, 1}).quadric(disk, Rgb(4));
  scenes[8].mesh({{5, 0, 0}, {5, 0.2f, 0}, {5, 0.2f, 0.1f}, {5, 0, 0.1f}}, kTwoTriangles, Rgb(50));
  scenes[8].mesh({{-4, -1, 0}, {-4, 1, 0}, {-4, 1, 2}, {-4, 0.5f, 3}}, kTwoTriangles, Rgb(5), {boolean("twosided", true)});
  const std::vector<Vec3> low = {{1, -3, 1}, {2, -3, 1}, {2, -2, 1}, {1, -2, 1}};
  scenes[8].mesh(low, kTwoTriangles, Rgb(7), {boolean("invisible", true)});
  scenes[8].mesh(low, kTwoTriangles, Rgb(9), {boolean("invisible", true), boolean("weighed", true)});
  Uniform u;
  int found = 0;
  for (std::size_t number = 0; number < scenes.size(); ++number) {
    const auto lights = scenes[number].build();
    for (int round = 0; round < 300; ++round) {
      Vec3x8 p, n;
      Float8 choice;
      Vec2x8 numbers;
      for (std::size_t i = 0; i < kLanes; ++i) {
        lanes::put(p, i, 3.f * direction(u));
        lanes::put(n, i, i == 3 ? Vec3(0.f) : direction(u));
        lanes::put(choice, i, u());
        lanes::put(numbers.x, i, u());
        lanes::put(numbers.y, i, u());
      }
      const std::uint32_t active = round % 3 ? 0xffu : 0x5bu;
      LightSample8 eight;
      const std::uint32_t arrives =
          lanes::to_bits(lights->sample(lanes::from_mask_bits(active), p, n, choice, numbers, eight));
      for (std::size_t i = 0; i < kLanes; ++i) {
        SCOPED_TRACE("scene " + std::to_string(number) + " round " + std::to_string(round) + " lane " + std::to_string(i));
        LightSample s;
        const bool one = (active >> i & 1u) && lights->sample(lanes::get(p, i), lanes::get(n, i), lanes::get(choice, i), lanes::get(numbers, i), s);
        ASSERT_EQ(one, (arrives >> i & 1u) != 0);
        if (!one) continue;
        ++found;
        expect_bits(s.wi, lanes::get(eight.wi, i));
        expect_bits(s.distance, lanes::get(eight.distance, i));
        expect_bits(s.radiance, lanes::get(eight.radiance, i));
        expect_bits(s.pdf, lanes::get(eight.pdf, i));
        expect_bits(s.weight_pdf, lanes::get(eight.weight_pdf, i));
        ASSERT_EQ(s.delta, (lanes::to_bits(eight.delta) >> i & 1u) != 0);
      }
      Vec3x8 away;
      for (std::size_t i = 0; i < kLanes; ++i) lanes::put(away, i, direction(u));
      Float8 pdf;
      const Mask8 some = lanes::from_mask_bits(active);
      const Vec3x8 weighed = lights->escaped(some, p, n, away, pdf), seen = lights->escaped(some, p, away);
      lanes::for_each(some, [&](std::size_t i) {
        SCOPED_TRACE("scene " + std::to_string(number) + " round " + std::to_string(round) + " lane " + std::to_string(i));
        float one_pdf;
        expect_bits(lights->escaped(lanes::get(p, i), lanes::get(n, i), lanes::get(away, i), one_pdf), lanes::get(weighed, i));
        expect_bits(one_pdf, lanes::get(pdf, i));
        expect_bits(lights->escaped(lanes::get(p, i), lanes::get(away, i)), lanes::get(seen, i));
      });
    }
  }
  EXPECT_GT(found, 3500);
}

// Triangles of all kinds with their footprints: without normals or uvs, with uv maps that are mirrored or points, needles.
TEST(TrianglePoints, EightHaveTheBitsOfEach) {
  Uniform u;
  const auto point = [&] { return Vec3(2.f * u() - 1.f, 2.f * u() - 1.f, 2.f * u() - 1.f); };
  for (int round = 0; round < 4000; ++round) {
    const Dialect dialect = std::array{Dialect::v2, Dialect::v3, Dialect::v4}[static_cast<std::size_t>(round) % 3];
    const bool derivatives = round % 7 != 0;
    std::array<TriangleVertices, kLanes> each;
    std::array<Vec3, kLanes> direction;
    std::array<Vec2, kLanes> at;
    std::array<float, kLanes> width;
    TriangleVerticesOf<Float8> all;
    Vec3x8 directions;
    Vec2x8 places;
    Float8 widths;
    std::uint32_t flips = 0;
    all.has_normals = round & 1;
    all.has_uvs = round & 2;
    for (std::size_t i = 0; i < kLanes; ++i) {
      TriangleVertices& t = each[i];
      t.has_normals = all.has_normals;
      t.has_uvs = all.has_uvs;
      for (std::size_t k = 0; k < 3; ++k) {
        t.p[k] = point();
        t.n[k] = u() < 0.05f ? Vec3(0.f) : point();
        t.uv[k] = {u(), u()};
      }
      if (u() < 0.1f) t.p[2] = 0.5f * (t.p[0] + t.p[1]);
      if (u() < 0.1f) t.uv[1] = t.uv[2] = t.uv[0];
      if (u() < 0.1f) t.n[0] = t.n[1] = t.n[2] = t.p[0] - t.p[2];  // along dpdu, or nearly
      direction[i] = u() < 0.1f ? glm::normalize(glm::cross(t.p[0] - t.p[2], t.p[1] - t.p[2]) + Vec3(1e-9f)) : glm::normalize(point());
      at[i] = {0.5f * u(), 0.5f * u()};
      width[i] = u() < 0.2f ? 0.f : 0.01f * u();
      if (u() < 0.5f) flips |= 1u << i;
      for (std::size_t k = 0; k < 3; ++k) {
        lanes::put(all.p[k], i, t.p[k]);
        lanes::put(all.n[k], i, t.n[k]);
        lanes::put(all.uv[k], i, t.uv[k]);
      }
      lanes::put(directions, i, direction[i]);
      lanes::put(places, i, at[i]);
      lanes::put(widths, i, width[i]);
    }
    const auto eight = triangle_point<Float8>(all, lanes::from_mask_bits(flips), dialect, places.x, places.y, derivatives);
    const FootprintOf<Float8> prints(eight, directions * widths, glm::cross(directions, eight.ng) * widths);
    std::array<SurfacePoint, kLanes> apart;
    lanes::take_apart(eight, apart);
    for (std::size_t i = 0; i < kLanes; ++i) {
      SCOPED_TRACE("round " + std::to_string(round) + " lane " + std::to_string(i));
      const SurfacePoint one = triangle_point(each[i], (flips >> i & 1u) != 0, dialect, at[i].x, at[i].y, derivatives);
      ASSERT_EQ(std::memcmp(&one, &apart[i], sizeof one), 0) << one.dpdu.x << " " << apart[i].dpdu.x << ", " << one.shading_dpdu.x << " " << apart[i].shading_dpdu.x;
      const Footprint print(one, direction[i] * width[i], glm::cross(direction[i], one.ng) * width[i]);
      expect_bits(print.dpdy, lanes::get(prints.dpdy, i));
      for (int k = 0; k < 2; ++k) {
        expect_bits(print.duvdx[k], lanes::get(prints.duvdx, i)[k]);
        expect_bits(print.duvdy[k], lanes::get(prints.duvdy, i)[k]);
      }
    }
  }
}

}  // namespace
}  // namespace cloudrenderer
