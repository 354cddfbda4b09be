#include "shapes/loop_refine.h"

#include <algorithm>
#include <tuple>

#include "base/portable_math.h"

namespace cloudrenderer {

namespace {

constexpr std::uint32_t kBorder = LoopMesh::kBorder;
constexpr std::uint32_t next(std::uint32_t k) { return k == 2 ? 0 : k + 1; }
constexpr std::uint32_t previous(std::uint32_t k) { return k == 0 ? 2 : k - 1; }

std::uint32_t corner_of(const LoopMesh& mesh, std::uint32_t face, std::uint32_t vertex) {
  const std::uint32_t* c = &mesh.corners[3 * std::size_t{face}];
  return c[0] == vertex ? 0 : c[1] == vertex ? 1 : 2;
}

// The next face around a vertex: across the edge that leaves it, or the edge that arrives.
std::uint32_t turn(const LoopMesh& mesh, std::uint32_t face, std::uint32_t vertex, bool leaving) {
  const std::uint32_t k = corner_of(mesh, face, vertex);
  return mesh.across[3 * std::size_t{face} + (leaving ? k : previous(k))];
}

// The neighbours of a vertex in the order of its fan; at a border from one border edge to the
// other.
void gather_ring(const LoopMesh& mesh, std::uint32_t vertex, std::vector<std::uint32_t>& ring) {
  ring.clear();
  std::uint32_t face = mesh.first_face[vertex];
  const auto neighbour = [&](bool leaving) {
    const std::uint32_t k = corner_of(mesh, face, vertex);
    return mesh.corners[3 * std::size_t{face} + (leaving ? next(k) : previous(k))];
  };
  if (!mesh.on_border[vertex]) {
    const std::uint32_t start = face;
    do {
      ring.push_back(neighbour(true));
      face = turn(mesh, face, vertex, true);
    } while (face != start);
    return;
  }
  for (std::uint32_t f; (f = turn(mesh, face, vertex, true)) != kBorder;) face = f;
  ring.push_back(neighbour(true));
  while (face != kBorder) {
    ring.push_back(neighbour(false));
    face = turn(mesh, face, vertex, false);
  }
}

Vec3 weigh_ring(const LoopMesh& mesh, std::uint32_t vertex, const std::vector<std::uint32_t>& ring,
                float weight) {
  Vec3 p = (1.f - static_cast<float>(ring.size()) * weight) * mesh.positions[vertex];
  for (const std::uint32_t r : ring) p += weight * mesh.positions[r];
  return p;
}
Vec3 weigh_border(const LoopMesh& mesh, std::uint32_t vertex,
                  const std::vector<std::uint32_t>& ring, float weight) {
  return (1.f - 2.f * weight) * mesh.positions[vertex] + weight * mesh.positions[ring.front()] +
         weight * mesh.positions[ring.back()];
}

float beta(std::size_t valence) {
  return valence == 3 ? 3.f / 16.f : 3.f / (8.f * static_cast<float>(valence));
}
float limit_weight(std::size_t valence) {
  return 1.f / (static_cast<float>(valence) + 3.f / (8.f * beta(valence)));
}

// Pairs every edge with the one that runs the other way; edges that have no single partner stay
// borders.
void connect(LoopMesh& mesh, LoopRepairs& repairs) {
  struct Edge {
    std::uint32_t low, high, half;  // half = 3 face + corner
  };
  std::vector<Edge> edges;
  edges.reserve(mesh.corners.size());
  for (std::uint32_t h = 0; h < mesh.corners.size(); ++h) {
    const std::uint32_t a = mesh.corners[h], b = mesh.corners[h - h % 3 + next(h % 3)];
    edges.push_back({std::min(a, b), std::max(a, b), h});
  }
  std::sort(edges.begin(), edges.end(), [](const Edge& a, const Edge& b) {
    return std::tie(a.low, a.high, a.half) < std::tie(b.low, b.high, b.half);
  });
  mesh.across.assign(mesh.corners.size(), kBorder);
  for (std::size_t i = 0; i < edges.size();) {
    std::size_t end = i + 1;
    while (end < edges.size() && edges[end].low == edges[i].low && edges[end].high == edges[i].high)
      ++end;
    const std::uint32_t h0 = edges[i].half, h1 = edges[end - 1].half;
    if (end - i == 2 && mesh.corners[h0] != mesh.corners[h1]) {
      mesh.across[h0] = h1 / 3;
      mesh.across[h1] = h0 / 3;
    } else if (end - i > 1) {
      ++repairs.cut_edges;
    }
    i = end;
  }
}

// Gives every fan of faces a vertex of its own, which also drops unused vertices.
void separate_fans(LoopMesh& mesh, std::span<const Vec3> positions, LoopRepairs& repairs) {
  std::vector<std::uint32_t> given(mesh.corners.size(), kBorder);
  std::vector<std::uint8_t> seen(positions.size(), 0);
  for (std::uint32_t h = 0; h < mesh.corners.size(); ++h) {
    if (given[h] != kBorder) continue;
    const std::uint32_t vertex = mesh.corners[h];
    const auto id = static_cast<std::uint32_t>(mesh.positions.size());
    repairs.split_vertices += seen[vertex];
    seen[vertex] = 1;
    mesh.positions.push_back(positions[vertex]);
    mesh.first_face.push_back(h / 3);
    bool border = false;
    for (const bool leaving : {true, false}) {
      std::uint32_t face = h / 3;
      do {
        given[3 * std::size_t{face} + corner_of(mesh, face, vertex)] = id;
        face = turn(mesh, face, vertex, leaving);
      } while (face != kBorder && face != h / 3);
      border = face == kBorder;
      if (!border) break;
    }
    mesh.on_border.push_back(border);
  }
  mesh.corners = std::move(given);
}

// The vectors whose cross product is pbrt's normal.
struct Tangents {
  Vec3 s{0.f}, t{0.f};
};

class TangentWeights {
 public:
  const std::vector<Vec2>& interior(
      std::size_t valence) {  // cosine and sine of each neighbour's angle
    if (interior_.size() != valence) {
      interior_.resize(valence);
      for (std::size_t j = 0; j < valence; ++j) {
        const double angle =
            2 * 3.14159265358979323846 * static_cast<double>(j) / static_cast<double>(valence);
        interior_[j] = {static_cast<float>(portable::cos(angle)),
                        static_cast<float>(portable::sin(angle))};
      }
    }
    return interior_;
  }

 private:
  std::vector<Vec2> interior_;
};

// The weights of a tangent sum to zero: differences to the vertex keep the digits of a mesh far
// from the origin.
Tangents interior_tangents(const LoopMesh& mesh, std::uint32_t vertex,
                           const std::vector<std::uint32_t>& ring, TangentWeights& weights) {
  Tangents out;
  const std::vector<Vec2>& w = weights.interior(ring.size());
  for (std::size_t j = 0; j < ring.size(); ++j) {
    const Vec3 to_neighbour = mesh.positions[ring[j]] - mesh.positions[vertex];
    out.s += w[j].x * to_neighbour;
    out.t += w[j].y * to_neighbour;
  }
  return out;
}

Tangents border_tangents(const LoopMesh& mesh, std::uint32_t vertex,
                         const std::vector<std::uint32_t>& ring) {
  const auto at = [&](std::size_t j) { return mesh.positions[ring[j]] - mesh.positions[vertex]; };
  const std::size_t valence = ring.size();
  Tangents out;
  out.s = at(valence - 1) - at(0);
  if (valence == 2) {
    out.t = at(0) + at(1);
  } else if (valence == 3) {
    out.t = at(1);
  } else if (valence == 4) {
    out.t = 2.f * (at(1) + at(2)) - at(0) - at(3);
  } else {
    const double theta = 3.14159265358979323846 / static_cast<double>(valence - 1);
    out.t = -static_cast<float>(portable::sin(theta)) * (at(0) + at(valence - 1));
    const double scale = 2 * portable::cos(theta) - 2;
    for (std::size_t k = 1; k + 1 < valence; ++k)
      out.t -= static_cast<float>(scale * portable::sin(static_cast<double>(k) * theta)) * at(k);
  }
  return out;
}

}  // namespace

LoopMesh make_loop_mesh(std::span<const Vec3> positions, std::span<const std::int32_t> indices,
                        LoopRepairs& repairs) {
  LoopMesh mesh;
  mesh.corners.reserve(indices.size());
  for (std::size_t i = 0; i + 2 < indices.size(); i += 3) {
    if (indices[i] == indices[i + 1] || indices[i + 1] == indices[i + 2] ||
        indices[i + 2] == indices[i]) {
      ++repairs.degenerate_faces;
      continue;
    }
    for (std::size_t k = 0; k < 3; ++k)
      mesh.corners.push_back(static_cast<std::uint32_t>(indices[i + k]));
  }
  connect(mesh, repairs);
  separate_fans(mesh, positions, repairs);
  return mesh;
}

LoopMesh refine(const LoopMesh& mesh) {
  const std::size_t faces = mesh.faces(), vertices = mesh.positions.size();
  LoopMesh out;
  out.positions.reserve(vertices + faces * 3 / 2 + 16);

  // Old vertices keep their numbers.
  std::vector<std::uint32_t> ring;
  for (std::uint32_t v = 0; v < vertices; ++v) {
    gather_ring(mesh, v, ring);
    out.positions.push_back(mesh.on_border[v] ? weigh_border(mesh, v, ring, 1.f / 8.f)
                                              : weigh_ring(mesh, v, ring, beta(ring.size())));
    const std::uint32_t face = mesh.first_face[v];
    out.first_face.push_back(4 * face + corner_of(mesh, face, v));
  }
  out.on_border = mesh.on_border;

  // A new vertex on every edge, made by the first of its faces.
  std::vector<std::uint32_t> on_edge(3 * faces);
  for (std::uint32_t f = 0; f < faces; ++f) {
    for (std::uint32_t k = 0; k < 3; ++k) {
      const std::size_t h = 3 * std::size_t{f} + k;
      const std::uint32_t a = mesh.corners[h], b = mesh.corners[3 * std::size_t{f} + next(k)],
                          g = mesh.across[h];
      if (g != kBorder && g < f) {
        on_edge[h] = on_edge[3 * std::size_t{g} + corner_of(mesh, g, b)];
        continue;
      }
      on_edge[h] = static_cast<std::uint32_t>(out.positions.size());
      const Vec3 &pa = mesh.positions[a], &pb = mesh.positions[b];
      if (g == kBorder) {
        out.positions.push_back(0.5f * pa + 0.5f * pb);
      } else {
        const std::uint32_t opposite = mesh.corners[3 * std::size_t{f} + previous(k)];
        const std::uint32_t beyond =
            mesh.corners[3 * std::size_t{g} + previous(corner_of(mesh, g, b))];
        out.positions.push_back(3.f / 8.f * pa + 3.f / 8.f * pb +
                                1.f / 8.f * mesh.positions[opposite] +
                                1.f / 8.f * mesh.positions[beyond]);
      }
      out.first_face.push_back(4 * f + 3);
      out.on_border.push_back(g == kBorder);
    }
  }

  // Child j is the one at corner j, child 3 the middle; corner j of child j is the old vertex.
  out.corners.resize(12 * faces);
  out.across.resize(12 * faces);
  for (std::uint32_t f = 0; f < faces; ++f) {
    const std::size_t base = 3 * std::size_t{f};
    for (std::uint32_t j = 0; j < 3; ++j) {
      const std::size_t child = 3 * (4 * std::size_t{f} + j), middle = 3 * (4 * std::size_t{f} + 3);
      const std::uint32_t vertex = mesh.corners[base + j];
      out.corners[child + j] = vertex;
      out.corners[child + next(j)] = on_edge[base + j];
      out.corners[child + previous(j)] = on_edge[base + previous(j)];
      out.corners[middle + j] = on_edge[base + j];
      out.across[middle + j] = 4 * f + next(j);
      out.across[child + next(j)] = 4 * f + 3;
      for (const std::uint32_t edge : {j, previous(j)}) {
        const std::uint32_t g = mesh.across[base + edge];
        out.across[child + edge] = g == kBorder ? kBorder : 4 * g + corner_of(mesh, g, vertex);
      }
    }
  }
  return out;
}

std::vector<Vec3> push_to_limit(LoopMesh& mesh) {
  const auto vertices = static_cast<std::uint32_t>(mesh.positions.size());
  std::vector<std::uint32_t> ring;
  std::vector<Vec3> limit;
  limit.reserve(vertices);
  for (std::uint32_t v = 0; v < vertices; ++v) {
    gather_ring(mesh, v, ring);
    limit.push_back(mesh.on_border[v] ? weigh_border(mesh, v, ring, 1.f / 5.f)
                                      : weigh_ring(mesh, v, ring, limit_weight(ring.size())));
  }
  mesh.positions = std::move(limit);

  TangentWeights weights;
  std::vector<Vec3> normals;
  normals.reserve(vertices);
  float largest = 0.f,
        scale =
            0.f;  // lengths are divided before the product, so that tiny meshes do not underflow
  for (std::uint32_t v = 0; v < vertices; ++v) {
    gather_ring(mesh, v, ring);
    for (const std::uint32_t r : ring)
      scale = std::max(scale, glm::distance(mesh.positions[v], mesh.positions[r]));
  }
  const float inverse = scale > 0.f ? 1.f / scale : 1.f;
  for (std::uint32_t v = 0; v < vertices; ++v) {
    gather_ring(mesh, v, ring);
    const Tangents t = mesh.on_border[v] ? border_tangents(mesh, v, ring)
                                         : interior_tangents(mesh, v, ring, weights);
    normals.push_back(glm::cross(t.s * inverse, t.t * inverse));
    largest = std::max(largest, glm::length(normals.back()));
  }
  if (largest > 0.f)
    for (Vec3& n : normals) n /= largest;
  return normals;
}

}  // namespace cloudrenderer
