// Answers of hosts that only intersect: nearest hits, each with the triangle that was hit.
#include <limits>

#include "wire/codec.h"
#include "wire/columns.h"

namespace cloudrenderer::wire {
namespace {

bool finite(float v) { return within(v, std::numeric_limits<float>::max()); }

// Null: fine. What a surface's numbers lead to is checked where rays start, but a corner far away or a point outside of
// its triangle is an error that shows here best.
const char* check(const AnsweredHit& h) {
  if (!at_least_zero(h.t) || !finite(h.t)) return "a hit is behind the ray's origin or no number";
  if (!within(h.u, 2.f) || !within(h.v, 2.f)) return "a hit is not on its triangle";
  for (std::size_t i = 0; i < 3; ++i) {
    const AnsweredSurface& s = h.surface;
    if (!within(s.p[i], kMaxCoordinate) || !within(s.n[i], kMaxCoordinate))
      return "a triangle is not finite or too far away";
    if (!finite(s.uv[i].x) || !finite(s.uv[i].y)) return "a triangle's uv is not finite";
  }
  return nullptr;
}

}  // namespace

void set_control(const NearestReply& r, ReplyControl& c) {
  std::uint32_t flags = 0;
  for (const AnsweredHit& h : r.hits) flags |= h.surface.flags;
  c.set_category(INTERSECTION);
  c.set_nearest(true);
  c.set_count(r.count);
  c.set_hits(static_cast<std::uint32_t>(r.hits.size()));
  c.set_normals((flags & kAnsweredNormals) != 0);
  c.set_uvs((flags & kAnsweredUvs) != 0);
}

std::size_t hit_bytes(const ReplyControl& c) {
  return 12 + 8 + 36 + (c.normals() ? 36 : 0) + (c.uvs() ? 24 : 0) + 8 + 2;
}

void write_nearest(const NearestReply& r, const ReplyControl& c, ColumnWriter& w) {
  w.put_low(r.found.data(), 8 * words(r.count));
  for (const AnsweredHit& h : r.hits) w.put(h.t);
  for (const AnsweredHit& h : r.hits) {
    w.put(h.u);
    w.put(h.v);
  }
  for (const AnsweredHit& h : r.hits) w.put(h.shape);
  for (const AnsweredHit& h : r.hits) w.put(h.primitive);
  for (const AnsweredHit& h : r.hits) w.put(h.surface.p);
  if (c.normals())
    for (const AnsweredHit& h : r.hits) w.put(h.surface.n);
  if (c.uvs())
    for (const AnsweredHit& h : r.hits) w.put(h.surface.uv);
  for (const AnsweredHit& h : r.hits) w.put(h.surface.material);
  for (const AnsweredHit& h : r.hits) w.put(h.surface.light);
  for (const AnsweredHit& h : r.hits) w.put(h.surface.flags);
}

Result<Message> read_nearest(Reply m, const ReplyControl& c, std::span<const std::byte> bulk) {
  const std::size_t n = c.count();
  if (c.hits() > n || bulk.size() != 8 * words(n) + hit_bytes(c) * c.hits())
    return failure("a reply has the wrong length");
  NearestReply r;
  r.count = c.count();
  r.found.resize(words(n));
  std::memcpy(r.found.data(), bulk.data(), 8 * r.found.size());
  std::size_t found = 0;
  for (const std::uint64_t w : r.found) found += static_cast<std::size_t>(std::popcount(w));
  if (trailing_bits(r.found, n) || found != c.hits()) return failure("a reply's bits do not match its hits");
  r.hits.resize(found);
  ColumnReader in(bulk.subspan(8 * r.found.size()));
  for (auto& h : r.hits) in.get(h.t);
  for (auto& h : r.hits) {
    in.get(h.u);
    in.get(h.v);
  }
  for (auto& h : r.hits) in.get(h.shape);
  for (auto& h : r.hits) in.get(h.primitive);
  for (auto& h : r.hits) in.get(h.surface.p);
  if (c.normals())
    for (auto& h : r.hits) in.get(h.surface.n);
  if (c.uvs())
    for (auto& h : r.hits) in.get(h.surface.uv);
  for (auto& h : r.hits) in.get(h.surface.material);
  for (auto& h : r.hits) in.get(h.surface.light);
  for (auto& h : r.hits) in.get(h.surface.flags);
  for (auto& h : r.hits) {
    if (const char* why = check(h)) return failure(why);
    if ((!c.normals() && (h.surface.flags & kAnsweredNormals)) || (!c.uvs() && (h.surface.flags & kAnsweredUvs)))
      return failure("a hit's flags name columns that are not there");
  }
  m.payload = std::move(r);
  return Message(std::move(m));
}

}  // namespace cloudrenderer::wire
