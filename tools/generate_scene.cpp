// generate_scene: a landscape of at least any number of distinct triangles (hills, rocks, trees of single leaves; no instances)
// as a pbrt-v3 scene with binary PLY meshes. A tile of the land is made and written at a time, so memory does not grow
// with the scene. The geometry is a pure function of the options.
#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <array>
#include <atomic>
#include <bit>
#include <cstdint>
#include <cstring>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <span>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "base/portable_math.h"
#include "base/random.h"
#include "cloudrenderer/math.h"

namespace {

using namespace cloudrenderer;
using Face = std::array<std::uint32_t, 3>;
static_assert(std::endian::native == std::endian::little, "PLY files are written as little-endian");

constexpr double kCell = 0.22;                  // edge of a terrain cell, in metres
constexpr std::uint32_t kRockSide = 20;         // a rock is a cube of six 20 x 20 faces, blown up and dented
constexpr std::uint32_t kRockTriangles = 12 * kRockSide * kRockSide;
constexpr std::uint32_t kTrunkSides = 24, kTrunkRings = 20;
constexpr std::uint32_t kTrunkTriangles = 2 * kTrunkSides * kTrunkRings;
constexpr std::uint32_t kLeaves = 7500;         // of a tree, two triangles each

struct Mesh {
  std::vector<Vec3> points;
  std::vector<Face> faces;
  void clear() {
    points.clear();
    faces.clear();
  }
  std::uint32_t add(const Vec3& p) {
    points.push_back(p);
    return static_cast<std::uint32_t>(points.size() - 1);
  }
  void add_quad(std::uint32_t a, std::uint32_t b, std::uint32_t c, std::uint32_t d) {
    faces.push_back({a, b, c});
    faces.push_back({a, c, d});
  }
};

// A stream of numbers that belongs to one object.
class Stream {
 public:
  explicit Stream(std::uint64_t key) : key_(mix64(key)) {}
  float next() { return to_unit(static_cast<std::uint32_t>(mix64(key_ + 0x9e3779b97f4a7c15u * ++count_) >> 32)); }
  float between(float a, float b) { return a + (b - a) * next(); }
  Vec3 in_ball() {
    for (;;) {
      const Vec3 p(between(-1, 1), between(-1, 1), between(-1, 1));
      if (glm::dot(p, p) <= 1) return p;
    }
  }

 private:
  std::uint64_t key_, count_ = 0;
};

double smooth(double t) { return t * t * t * (t * (t * 6 - 15) + 10); }

// Value noise on a lattice, in [-1, 1] (Perlin's quintic fade).
double noise(double x, double y, double z, std::uint64_t seed) {
  const double fx = std::floor(x), fy = std::floor(y), fz = std::floor(z);
  const auto lattice = [&](int dx, int dy, int dz) {
    const auto ix = static_cast<std::int64_t>(fx) + dx, iy = static_cast<std::int64_t>(fy) + dy,
               iz = static_cast<std::int64_t>(fz) + dz;
    const std::uint64_t h = mix64(seed + static_cast<std::uint64_t>(ix) * 0x9e3779b97f4a7c15u +
                                  static_cast<std::uint64_t>(iy) * 0xd1342543de82ef95u +
                                  static_cast<std::uint64_t>(iz) * 0xa0761d6478bd642fu);
    return static_cast<double>(h >> 11) * 0x1p-52 - 1;
  };
  const double u = smooth(x - fx), v = smooth(y - fy), w = z - fz;
  const auto plane = [&](int dz) {
    const double a = lattice(0, 0, dz), b = lattice(1, 0, dz), c = lattice(0, 1, dz), d = lattice(1, 1, dz);
    return (a + (b - a) * u) * (1 - v) + (c + (d - c) * u) * v;
  };
  const double low = plane(0);
  return w == 0 ? low : low + (plane(1) - low) * smooth(w);
}

struct Landscape {
  std::uint64_t seed = 0;
  std::uint32_t tiles_x = 1, tiles_y = 1, cells = 1;  // cells along the side of a tile
  std::uint32_t rocks = 0, trees = 0, leaves = 0;     // of a tile; leaves of a tree
  double side() const { return cells * kCell; }       // of a tile
  double extent() const { return side() * std::max(tiles_x, tiles_y); }

  // Hills whose size follows the whole extent, then octaves down to some cells.
  double height(double x, double y) const {
    double wavelength = extent() / 2.5, amplitude = extent() * 0.07, sum = 0;
    for (std::uint64_t octave = 0; wavelength > 3 * kCell && octave < 16; ++octave) {
      sum += amplitude * noise(x / wavelength, y / wavelength, 0, seed * 977 + octave);
      wavelength /= 2;
      amplitude *= 0.42;
    }
    return sum;
  }
  std::uint64_t triangles_per_tile() const {
    return std::uint64_t{2} * cells * cells + std::uint64_t{rocks} * kRockTriangles +
           std::uint64_t{trees} * (kTrunkTriangles + 2 * std::uint64_t{leaves});
  }
};

// Shares of a tile: 40 % ground, 25 % rocks, 35 % trees.
Landscape plan(std::uint64_t triangles, std::uint64_t per_file, std::uint64_t seed) {
  Landscape land;
  land.seed = seed;
  const auto tiles = std::max<std::uint64_t>(1, (triangles * 2 / 5 + per_file - 1) / per_file);
  land.tiles_x = static_cast<std::uint32_t>(std::ceil(std::sqrt(static_cast<double>(tiles))));
  land.tiles_y = static_cast<std::uint32_t>((tiles + land.tiles_x - 1) / land.tiles_x);
  const double budget = static_cast<double>(triangles) / (land.tiles_x * static_cast<double>(land.tiles_y));
  land.rocks = static_cast<std::uint32_t>(0.25 * budget / kRockTriangles);
  land.leaves = std::min(kLeaves, static_cast<std::uint32_t>(budget / 40));
  land.trees = static_cast<std::uint32_t>(0.35 * budget / (kTrunkTriangles + 2.0 * land.leaves));
  const double rest = budget - land.rocks * static_cast<double>(kRockTriangles) -
                      land.trees * (kTrunkTriangles + 2.0 * land.leaves);
  // Upwards: at least as many as were asked for.
  land.cells = std::max(1u, static_cast<std::uint32_t>(std::ceil(std::sqrt(rest / 2))));
  return land;
}

void make_ground(const Landscape& land, std::uint32_t tx, std::uint32_t ty, Mesh& mesh) {
  const std::uint32_t n = land.cells, row = n + 1;
  for (std::uint32_t j = 0; j <= n; ++j)
    for (std::uint32_t i = 0; i <= n; ++i) {
      // From the cell's number in the whole land: neighbouring tiles share their border to the bit.
      const double x = (static_cast<double>(tx) * n + i) * kCell, y = (static_cast<double>(ty) * n + j) * kCell;
      mesh.add(Vec3(glm::dvec3(x, y, land.height(x, y))));
    }
  for (std::uint32_t j = 0; j < n; ++j)
    for (std::uint32_t i = 0; i < n; ++i) {
      const std::uint32_t a = j * row + i;
      mesh.add_quad(a, a + 1, a + row + 1, a + row);
    }
}

Vec3 place(const Landscape& land, std::uint32_t tx, std::uint32_t ty, Stream& random) {
  const double x = (tx + static_cast<double>(random.next())) * land.side();
  const double y = (ty + static_cast<double>(random.next())) * land.side();
  return Vec3(glm::dvec3(x, y, land.height(x, y)));
}

void make_rock(const Vec3& foot, std::uint64_t key, Mesh& mesh) {
  Stream random(key);
  const float u = random.next();
  const float size = 0.3f + 2.2f * u * u * u;
  const Vec3 stretch = size * Vec3(random.between(0.7f, 1.4f), random.between(0.7f, 1.4f), random.between(0.5f, 1.f));
  for (int axis = 0; axis < 3; ++axis)
    for (const float sign : {-1.f, 1.f}) {
      const auto first = static_cast<std::uint32_t>(mesh.points.size());
      for (std::uint32_t j = 0; j <= kRockSide; ++j)
        for (std::uint32_t i = 0; i <= kRockSide; ++i) {
          Vec3 d;
          d[axis] = sign;
          d[(axis + 1) % 3] = 2.f * static_cast<float>(i) / kRockSide - 1.f;
          d[(axis + 2) % 3] = 2.f * static_cast<float>(j) / kRockSide - 1.f;
          d = glm::normalize(d);
          double dent = 1;
          for (int octave = 0; octave < 4; ++octave) {
            const double f = 1.3 * (1 << octave);
            dent += 0.35 / (1 << octave) * noise(d.x * f + 9, d.y * f + 9, d.z * f + 9, key + 31u * octave);
          }
          mesh.add(foot + stretch * d * static_cast<float>(dent));
        }
      for (std::uint32_t j = 0; j < kRockSide; ++j)
        for (std::uint32_t i = 0; i < kRockSide; ++i) {
          const std::uint32_t a = first + j * (kRockSide + 1) + i, b = a + kRockSide + 1;
          sign > 0 ? mesh.add_quad(a, a + 1, b + 1, b) : mesh.add_quad(a, b, b + 1, a + 1);
        }
    }
}

void make_tree(const Vec3& foot, std::uint64_t key, std::uint32_t leaves, Mesh& wood, Mesh& foliage) {
  Stream random(key);
  const float tall = random.between(5, 12), thick = 0.03f * tall;
  const Vec3 lean(random.between(-0.1f, 0.1f), random.between(-0.1f, 0.1f), 1.f);
  const auto axis = [&](float t) { return foot + lean * (tall * t) - Vec3(0, 0, 0.3f); };
  const auto first = static_cast<std::uint32_t>(wood.points.size());
  for (std::uint32_t ring = 0; ring <= kTrunkRings; ++ring)
    for (std::uint32_t side = 0; side < kTrunkSides; ++side) {
      const float t = static_cast<float>(ring) / kTrunkRings;
      float s, c;
      portable::sincos(2 * kPi * static_cast<float>(side) / kTrunkSides, s, c);
      const float r = thick * (1 - 0.85f * t) * random.between(0.85f, 1.1f);
      wood.add(axis(0.9f * t) + Vec3(r * c, r * s, 0));
    }
  for (std::uint32_t ring = 0; ring < kTrunkRings; ++ring)
    for (std::uint32_t side = 0; side < kTrunkSides; ++side) {
      const std::uint32_t next = (side + 1) % kTrunkSides, a = first + ring * kTrunkSides;
      wood.add_quad(a + side, a + next, a + kTrunkSides + next, a + kTrunkSides + side);
    }
  // The crown: leaves in a dozen overlapping clumps around the upper trunk.
  std::array<Vec3, 12> clumps;
  for (Vec3& clump : clumps) {
    const float t = random.between(0.45f, 1.f);
    clump = axis(t) + random.in_ball() * (tall * 0.28f * (1.35f - t));
  }
  const float radius = 0.16f * tall;
  for (std::uint32_t leaf = 0; leaf < leaves; ++leaf) {
    const auto which = std::min<std::size_t>(clumps.size() - 1, static_cast<std::size_t>(random.next() * 12.f));
    const Vec3 center = clumps[which] + random.in_ball() * radius;
    const Vec3 along = random.in_ball() * 0.22f, other = random.in_ball() * 0.1f;
    const std::uint32_t a = foliage.add(center - along);
    foliage.add(center + other);
    foliage.add(center + along);
    foliage.add(center - other);
    foliage.add_quad(a, a + 1, a + 2, a + 3);
  }
}

void write_ply(const std::filesystem::path& path, const Mesh& mesh) {
  constexpr std::size_t kRecord = 1 + sizeof(Face);
  std::vector<char> records(mesh.faces.size() * kRecord);
  for (std::size_t i = 0; i < mesh.faces.size(); ++i) {
    records[i * kRecord] = 3;
    std::memcpy(&records[i * kRecord + 1], &mesh.faces[i], sizeof(Face));
  }
  std::ofstream out(path, std::ios::binary);
  out << fmt::format(
      "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\n"
      "property float z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
      mesh.points.size(), mesh.faces.size());
  const auto points = std::as_bytes(std::span(mesh.points));
  out.write(reinterpret_cast<const char*>(points.data()), static_cast<std::streamsize>(points.size()));
  out.write(records.data(), static_cast<std::streamsize>(records.size()));
  if (!out.flush()) throw std::runtime_error("cannot write " + path.string());
}

constexpr std::array<const char*, 4> kKinds{"ground", "rock", "wood", "leaf"};

void make_tile(const Landscape& land, std::uint32_t tile, const std::filesystem::path& folder,
               std::array<Mesh, 4>& meshes) {
  for (Mesh& mesh : meshes) mesh.clear();
  const std::uint32_t tx = tile % land.tiles_x, ty = tile / land.tiles_x;
  make_ground(land, tx, ty, meshes[0]);
  Stream random(mix64(land.seed + 0x51ed) + tile);
  for (std::uint32_t i = 0; i < land.rocks; ++i)
    make_rock(place(land, tx, ty, random), mix64(land.seed) ^ (std::uint64_t{tile} << 32 | i), meshes[1]);
  for (std::uint32_t i = 0; i < land.trees; ++i)
    make_tree(place(land, tx, ty, random), mix64(land.seed + 1) ^ (std::uint64_t{tile} << 32 | i), land.leaves,
              meshes[2], meshes[3]);
  for (std::size_t kind = 0; kind < meshes.size(); ++kind)
    if (!meshes[kind].faces.empty())
      write_ply(folder / fmt::format("{}_{:05}.ply", kKinds[kind], tile), meshes[kind]);
}

void write_main(const Landscape& land, const std::filesystem::path& folder) {
  const double w = land.side() * land.tiles_x, h = land.side() * land.tiles_y, e = land.extent();
  const double ex = 0.5 * w, ey = -0.08 * h, eye_z = std::max(land.height(ex, 0), 0.0) + 0.16 * e;
  std::ofstream out(folder / "scene.pbrt");
  out << fmt::format(
      "# A generated landscape of {} distinct triangles in {} x {} tiles, seed {}.\n"
      "Scale -1 1 1\nLookAt {} {} {}  {} {} {}  0 0 1\nCamera \"perspective\" \"float fov\" [40]\n"
      "Film \"image\" \"integer xresolution\" [960] \"integer yresolution\" [540] \"string filename\" \"landscape.exr\"\n"
      "PixelFilter \"box\"\nSampler \"halton\" \"integer pixelsamples\" [64]\n"
      "Integrator \"path\" \"integer maxdepth\" [6]\n\nWorldBegin\n"
      "LightSource \"infinite\" \"rgb L\" [0.35 0.5 0.8]\n"
      "LightSource \"distant\" \"point from\" [{} {} {}] \"point to\" [0 0 0] \"rgb L\" [3.2 2.9 2.4]\n\n"
      "MakeNamedMaterial \"rock\" \"string type\" \"plastic\" \"rgb Kd\" [0.32 0.3 0.28] \"rgb Ks\" [0.06 0.06 0.06] "
      "\"float roughness\" [0.15]\n"
      "MakeNamedMaterial \"wood\" \"string type\" \"matte\" \"rgb Kd\" [0.2 0.13 0.08]\n",
      land.triangles_per_tile() * land.tiles_x * land.tiles_y, land.tiles_x, land.tiles_y, land.seed, ex, ey, eye_z,
      0.5 * w, 0.42 * h, 0.0, -0.6, -0.35, 0.5);
  for (std::uint32_t tile = 0; tile < land.tiles_x * land.tiles_y; ++tile) {
    Stream random(mix64(land.seed + 77) + tile);
    const float g = random.between(0.94f, 1.06f), l = random.between(0.7f, 1.3f);
    const auto shape = [&](const char* kind) {
      out << fmt::format("Shape \"plymesh\" \"string filename\" \"geometry/{}_{:05}.ply\"\n", kind, tile);
    };
    out << fmt::format("Material \"matte\" \"rgb Kd\" [{:.4f} {:.4f} {:.4f}]\n", 0.34f * g, 0.3f * g, 0.17f * g);
    shape("ground");
    if (land.rocks > 0) {
      out << "NamedMaterial \"rock\"\n";
      shape("rock");
    }
    if (land.trees > 0) {
      out << "NamedMaterial \"wood\"\n";
      shape("wood");
      out << fmt::format("Material \"matte\" \"rgb Kd\" [{:.4f} {:.4f} {:.4f}]\n", 0.12f * l, 0.32f, 0.06f * l);
      shape("leaf");
    }
  }
  out << "WorldEnd\n";
  if (!out.flush()) throw std::runtime_error("cannot write " + (folder / "scene.pbrt").string());
}

void generate(const Landscape& land, const std::filesystem::path& folder, unsigned threads) {
  std::filesystem::create_directories(folder / "geometry");
  write_main(land, folder);
  std::atomic<std::uint32_t> next{0};
  std::vector<std::exception_ptr> failures(threads);
  {
    std::vector<std::jthread> workers;
    for (unsigned t = 0; t < threads; ++t)
      workers.emplace_back([&, t] {
        try {
          std::array<Mesh, 4> meshes;  // kept from tile to tile
          for (std::uint32_t tile; (tile = next++) < land.tiles_x * land.tiles_y;)
            make_tile(land, tile, folder / "geometry", meshes);
        } catch (...) {
          failures[t] = std::current_exception();
        }
      });
  }
  for (const auto& failure : failures)
    if (failure) std::rethrow_exception(failure);
}

}  // namespace

int main(int argc, char** argv) try {
  std::uint64_t triangles = 1'000'000, per_file = 1'000'000, seed = 0;
  unsigned threads = std::max(1u, std::thread::hardware_concurrency());
  std::string folder;
  CLI::App app{"Writes a landscape of distinct triangles: DIR/scene.pbrt and DIR/geometry/*.ply"};
  app.add_option("--triangles", triangles, "how many, to about a percent")->check(CLI::Range(1e3, 1e11));
  app.add_option("-o,--output", folder, "the folder to write")->required();
  app.add_option("--seed", seed, "another landscape");
  app.add_option("--triangles-per-file", per_file, "about, in the largest")->check(CLI::Range(1e3, 1e8));
  app.add_option("--threads", threads, "tiles made at once")->check(CLI::Range(1, 256));
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  const Landscape land = plan(triangles, per_file, seed);
  generate(land, folder, threads);
  std::cout << fmt::format("{}/scene.pbrt: {} triangles in {} tiles\n", folder,
                           land.triangles_per_tile() * land.tiles_x * land.tiles_y, land.tiles_x * land.tiles_y);
  return 0;
} catch (const std::exception& error) {
  std::cerr << "generate_scene: " << error.what() << '\n';
  return 1;
}
