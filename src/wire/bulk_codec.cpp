#include "wire/bulk_codec.h"

#include <bit>
#include <cstring>
#include <limits>

#include "wire/codec.h"
#include "wire/columns.h"

namespace cloudrenderer::wire {

std::size_t segment_bytes(ColumnSet columns, std::size_t radiance_bytes) {
  std::size_t n = 12 + 12 + 12 + 4 + 3 * radiance_bytes + 12 + 8;
  if (columns & kColumnPreviousNormal) n += 12;
  if (columns & kColumnBestHit) n += 12;
  if (columns & kColumnTested) n += 10;
  if (columns & kColumnCone) n += 8;
  if (columns & kColumnMedium) n += 2;
  return n;
}

namespace {

static_assert(std::endian::native == std::endian::little,
              "columns are copied as they lie in memory");
static_assert(sizeof(OcclusionRay) == 28);

// Renderer tasks beyond this are refused: their bookkeeping would be absurdly large.
constexpr std::uint64_t kMaxTaskPixels = 1u << 16, kMaxTaskPaths = 1u << 26;

// The bits of all values in one word: its width is the width of the widest.
struct WidthScan {
  std::uint64_t bits = 0;
  template <class Values>
  void add(const Values& v) {
    for (std::int64_t c : v) bits |= static_cast<std::uint64_t>(c < 0 ? ~c : c);
  }
  std::uint32_t bytes() const {
    return static_cast<std::uint32_t>((64 - std::countl_zero(bits)) / 8 + 1);
  }
};

std::size_t ray_bytes(const SubmitControl& c) { return sizeof(OcclusionRay) + (c.times() ? sizeof(float) : 0); }
std::size_t end_bytes(std::size_t radiance_bytes) { return 16 + 3 * radiance_bytes; }
std::size_t features_bytes(std::size_t value_bytes) { return 16 + 4 * kFeatureIds + kFeatureNumbers * value_bytes; }
// Of a pixel in the reply of a renderer task.
std::size_t sums_bytes(const ReplyControl& c) {
  return (c.negative_lobes() ? 2 : 1) * (8 + 6 * std::size_t{c.sum_bytes()}) +
         (c.feature_bytes() ? 8 + 4 * kFeatureIds + kFeatureNumbers * std::size_t{c.feature_bytes()} : 0);
}
std::size_t miss_bytes(const ReplyControl& c) { return c.windows() ? 10 : 8; }

template <class F>
void for_segments(const SegmentBlock& block, F f) {
  for (const auto& chunk : block.chunks)
    for (const PathSegment& s : *chunk) f(s);
}

bool is_direction(const Vec3& d) {
  if (!within(d, 2.f)) return false;
  const float length2 = d.x * d.x + d.y * d.y + d.z * d.z;
  return length2 > 0.98f && length2 < 1.02f;
}

Result<Message> read_segments(SubmitTask m, const SubmitControl& c,
                              std::span<const std::byte> bulk) {
  const std::uint32_t w = c.radiance_bytes();
  const ColumnSet columns = c.columns();
  if (w < 1 || w > 8) return failure("radiance width must be 1 to 8 bytes");
  if (columns & ~kAllColumns) return failure("unknown segment columns");
  const std::size_t n = c.count();
  if (n == 0 || bulk.size() != n * segment_bytes(columns, w))
    return failure("segment columns have the wrong length");
  auto segments = std::make_shared<std::vector<PathSegment>>(n);
  auto& s = *segments;
  ColumnReader in(bulk);
  for (auto& x : s) in.get(x.origin);
  for (auto& x : s) in.get(x.direction);
  for (auto& x : s) in.get(x.throughput);
  for (auto& x : s) in.get(x.previous_pdf);
  for (auto& x : s)
    for (auto& r : x.radiance) r = in.get_int(w);
  if (columns & kColumnPreviousNormal)
    for (auto& x : s) in.get(x.previous_normal);
  if (columns & kColumnBestHit) {
    for (auto& x : s) {
      in.get(x.best.t);
      in.get(x.best.shape);
      in.get(x.best.primitive);
    }
  }
  if (columns & kColumnTested) {
    for (auto& x : s) in.get(x.tested);
    for (auto& x : s) in.get(x.window);
  }
  for (auto& x : s) in.get(x.task);
  for (auto& x : s) in.get(x.pixel);
  for (auto& x : s) in.get(x.sample);
  for (auto& x : s) in.get(x.owner);
  for (auto& x : s) in.get(x.vertex);
  for (auto& x : s) in.get(x.flags);
  for (auto& x : s) in.get(x.passed);
  if (columns & kColumnCone) {
    for (auto& x : s) {
      in.get(x.cone_width);
      in.get(x.cone_spread);
    }
  }
  if (columns & kColumnMedium)
    for (auto& x : s) in.get(x.medium);
  for (const auto& x : s) {
    if (!within(x.origin, kMaxCoordinate))
      return failure("a segment's origin is not finite or too far away");
    if (!is_direction(x.direction)) return failure("a segment's direction is not of unit length");
    // The rest of the state cannot do harm: a contribution that is not finite never reaches the
    // film.
    if (!at_least_zero(x.best.t))
      return failure("a segment's best hit is behind its origin or no number");
  }
  SegmentBlock block;
  block.columns = columns;
  block.chunks.push_back(std::move(segments));
  m.payload = std::move(block);
  return Message(std::move(m));
}

Result<Message> read_rays(SubmitTask m, const SubmitControl& c, std::span<const std::byte> bulk) {
  const std::size_t n = c.count();
  if (n == 0 || bulk.size() != n * ray_bytes(c)) return failure("rays have the wrong length");
  auto rays = std::make_shared<std::vector<OcclusionRay>>(n);
  std::memcpy(rays->data(), bulk.data(), n * sizeof(OcclusionRay));
  for (const OcclusionRay& r : *rays) {
    if (!within(r.origin, kMaxCoordinate))
      return failure("a ray's origin is not finite or too far away");
    if (!is_direction(r.direction)) return failure("a ray's direction is not of unit length");
    if (!at_least_zero(r.t_max)) return failure("a ray's length is negative or no number");
  }
  OcclusionBlock block;
  if (c.times()) {
    auto times = std::make_shared<std::vector<float>>(n);
    std::memcpy(times->data(), bulk.data() + n * sizeof(OcclusionRay), n * sizeof(float));
    for (const float t : *times)
      if (!within(t, std::numeric_limits<float>::max())) return failure("a ray's time is not finite");
    block.times.push_back(std::move(times));
  }
  block.nearest = c.nearest();
  block.chunks.push_back(std::move(rays));
  m.payload = std::move(block);
  return Message(std::move(m));
}

}  // namespace

SubmitControl control_of(const SubmitTask& m) {
  SubmitControl c;
  c.mutable_id()->set_origin(m.id.origin);
  c.mutable_id()->set_number(m.id.number);
  c.set_epoch(m.epoch);
  c.set_generation(m.generation);
  if (const auto* range = std::get_if<RendererRange>(&m.payload)) {
    c.set_category(RENDERER);
    c.set_task(range->task);
    c.set_x0(range->x0);
    c.set_y0(range->y0);
    c.set_x1(range->x1);
    c.set_y1(range->y1);
    c.set_sample_begin(range->sample_begin);
    c.set_sample_end(range->sample_end);
    c.set_shares(range->shares);
  } else if (const auto* segments = std::get_if<SegmentBlock>(&m.payload)) {
    WidthScan scan;
    for_segments(*segments, [&](const PathSegment& s) { scan.add(s.radiance); });
    c.set_category(TRACER);
    c.set_count(static_cast<std::uint32_t>(segments->size()));
    c.set_columns(segments->columns);
    c.set_radiance_bytes(scan.bytes());
  } else {
    c.set_category(INTERSECTION);
    const auto& rays = std::get<OcclusionBlock>(m.payload);
    c.set_count(static_cast<std::uint32_t>(rays.size()));
    c.set_times(!rays.times.empty());
    c.set_nearest(rays.nearest);
  }
  return c;
}

ReplyControl control_of(const Reply& m) {
  ReplyControl c;
  c.mutable_id()->set_origin(m.id.origin);
  c.mutable_id()->set_number(m.id.number);
  c.set_epoch(m.epoch);
  if (std::holds_alternative<Refusal>(m.payload)) {
    c.set_refused(true);
  } else if (const auto* tracer = std::get_if<TracerReply>(&m.payload)) {
    c.set_category(TRACER);
    c.set_count(tracer->count);
    c.set_misses(static_cast<std::uint32_t>(tracer->tested.size()));
    c.set_windows(!tracer->windows.empty());
  } else if (const auto* occlusion = std::get_if<OcclusionReply>(&m.payload)) {
    c.set_category(INTERSECTION);
    c.set_count(occlusion->count);
  } else if (const auto* nearest = std::get_if<NearestReply>(&m.payload)) {
    set_control(*nearest, c);
  } else {
    const auto& renderer = std::get<RendererReply>(m.payload);
    std::uint32_t width = 1;
    for (const PixelSums& p : renderer.sums)
      for (const auto& half : p.sum)
        for (const Int128& v : half) width = std::max(width, width_of(v));
    c.set_category(RENDERER);
    c.set_count(static_cast<std::uint32_t>(renderer.sums.size() / (renderer.negative_lobes ? 2 : 1)));
    c.set_negative_lobes(renderer.negative_lobes);
    c.set_task(renderer.task);
    c.set_sum_bytes(width);
    if (!renderer.features.empty()) {
      width = 1;
      for (const PixelFeatures& p : renderer.features)
        for (const Int128& v : p.sum) width = std::max(width, width_of(v));
      c.set_feature_bytes(width);
    }
    c.set_invalid(renderer.invalid);
    c.set_clamped(renderer.clamped);
    set_control(renderer.splats, c);
  }
  return c;
}

EndsControl control_of(const PathEnds& m) {
  WidthScan scan;
  for (const PathEnd& e : m.batch.ends) scan.add(e.radiance);
  EndsControl c;
  c.set_generation(m.generation);
  c.set_count(static_cast<std::uint32_t>(m.batch.ends.size()));
  c.set_radiance_bytes(scan.bytes());
  if (!m.batch.features.empty()) {
    WidthScan values;
    for (const PathFeatures& f : m.batch.features) values.add(f.values);
    c.set_features(static_cast<std::uint32_t>(m.batch.features.size()));
    c.set_feature_bytes(values.bytes());
  }
  set_control(m.batch.ends, c);
  return c;
}

std::size_t bulk_bytes(const SubmitTask&, const SubmitControl& c) {
  switch (c.category()) {
    case TRACER:
      return c.count() * segment_bytes(c.columns(), c.radiance_bytes());
    case INTERSECTION:
      return c.count() * ray_bytes(c);
    default:
      return 0;
  }
}
std::size_t bulk_bytes(const Reply&, const ReplyControl& c) {
  if (c.refused()) return 0;
  switch (c.category()) {
    case TRACER:
      return 8 * words(c.count()) + miss_bytes(c) * c.misses();
    case INTERSECTION:
      return 8 * words(c.count()) + (c.nearest() ? hit_bytes(c) * c.hits() : 0);
    default:
      return c.count() * sums_bytes(c) + splats_bytes(c);
  }
}
std::size_t bulk_bytes(const PathEnds&, const EndsControl& c) {
  return c.count() * end_bytes(c.radiance_bytes()) + c.features() * features_bytes(c.feature_bytes()) + splats_bytes(c);
}

void write_bulk(const SubmitTask& m, const SubmitControl& c, std::span<std::byte> out) {
  ColumnWriter w(out);
  if (const auto* rays = std::get_if<OcclusionBlock>(&m.payload)) {
    for (const auto& chunk : rays->chunks)
      w.put_low(chunk->data(), chunk->size() * sizeof(OcclusionRay));
    for (const auto& chunk : rays->times) w.put_low(chunk->data(), chunk->size() * sizeof(float));
    return;
  }
  const auto* block = std::get_if<SegmentBlock>(&m.payload);
  if (!block) return;
  for_segments(*block, [&](const PathSegment& s) { w.put(s.origin); });
  for_segments(*block, [&](const PathSegment& s) { w.put(s.direction); });
  for_segments(*block, [&](const PathSegment& s) { w.put(s.throughput); });
  for_segments(*block, [&](const PathSegment& s) { w.put(s.previous_pdf); });
  for_segments(*block, [&](const PathSegment& s) {
    for (const std::int64_t& r : s.radiance) w.put_low(&r, c.radiance_bytes());
  });
  if (block->columns & kColumnPreviousNormal)
    for_segments(*block, [&](const PathSegment& s) { w.put(s.previous_normal); });
  if (block->columns & kColumnBestHit) {
    for_segments(*block, [&](const PathSegment& s) {
      w.put(s.best.t);
      w.put(s.best.shape);
      w.put(s.best.primitive);
    });
  }
  if (block->columns & kColumnTested) {
    for_segments(*block, [&](const PathSegment& s) { w.put(s.tested); });
    for_segments(*block, [&](const PathSegment& s) { w.put(s.window); });
  }
  for_segments(*block, [&](const PathSegment& s) { w.put(s.task); });
  for_segments(*block, [&](const PathSegment& s) { w.put(s.pixel); });
  for_segments(*block, [&](const PathSegment& s) { w.put(s.sample); });
  for_segments(*block, [&](const PathSegment& s) { w.put(s.owner); });
  for_segments(*block, [&](const PathSegment& s) { w.put(s.vertex); });
  for_segments(*block, [&](const PathSegment& s) { w.put(s.flags); });
  for_segments(*block, [&](const PathSegment& s) { w.put(s.passed); });
  if (block->columns & kColumnCone) {
    for_segments(*block, [&](const PathSegment& s) {
      w.put(s.cone_width);
      w.put(s.cone_spread);
    });
  }
  if (block->columns & kColumnMedium)
    for_segments(*block, [&](const PathSegment& s) { w.put(s.medium); });
}

void write_bulk(const Reply& m, const ReplyControl& c, std::span<std::byte> out) {
  ColumnWriter w(out);
  if (const auto* tracer = std::get_if<TracerReply>(&m.payload)) {
    w.put_low(tracer->accepted.data(), 8 * words(tracer->count));
    w.put_low(tracer->tested.data(), 8 * tracer->tested.size());
    w.put_low(tracer->windows.data(), 2 * tracer->windows.size());
  } else if (const auto* occlusion = std::get_if<OcclusionReply>(&m.payload)) {
    w.put_low(occlusion->blocked.data(), 8 * words(occlusion->count));
  } else if (const auto* nearest = std::get_if<NearestReply>(&m.payload)) {
    write_nearest(*nearest, c, w);
  } else if (const auto* renderer = std::get_if<RendererReply>(&m.payload)) {
    for (const PixelSums& p : renderer->sums) w.put(p.count);
    for (const PixelSums& p : renderer->sums)
      for (const auto& half : p.sum)
        for (const Int128& v : half) w.put_low(&v, c.sum_bytes());
    for (const PixelFeatures& p : renderer->features) {
      w.put(p.samples);
      w.put(p.hits);
      w.put(p.ids);
    }
    for (const PixelFeatures& p : renderer->features)
      for (const Int128& v : p.sum) w.put_low(&v, c.feature_bytes());
    write_splats(renderer->splats, c, w);
  }
}

void write_bulk(const PathEnds& m, const EndsControl& c, std::span<std::byte> out) {
  ColumnWriter w(out);
  const auto put_whose = [&](const auto& list) {
    for (const auto& e : list) w.put(e.task);
    for (const auto& e : list) w.put(e.pixel);
    for (const auto& e : list) w.put(e.sample);
    for (const auto& e : list) w.put(e.owner);
    for (const auto& e : list) w.put(e.flags);
  };
  put_whose(m.batch.ends);
  for (const PathEnd& e : m.batch.ends)
    for (const std::int64_t& r : e.radiance) w.put_low(&r, c.radiance_bytes());
  put_whose(m.batch.features);
  for (const PathFeatures& f : m.batch.features) w.put(f.ids);
  for (const PathFeatures& f : m.batch.features)
    for (const std::int64_t& v : f.values) w.put_low(&v, c.feature_bytes());
  write_splats(m.batch.ends, c, w);
}

Result<Message> read_submit(const SubmitControl& c, std::span<const std::byte> bulk) {
  SubmitTask m;
  m.id = {c.id().origin(), c.id().number()};
  m.epoch = c.epoch();
  m.generation = c.generation();
  switch (c.category()) {
    case TRACER:
      return read_segments(std::move(m), c, bulk);
    case INTERSECTION:
      return read_rays(std::move(m), c, bulk);
    case RENDERER:
      break;
    default:
      return failure("tasks of this category are not submitted");
  }
  if (!bulk.empty()) return failure("a renderer task has no bulk");
  const RendererRange r{c.task(), c.x0(), c.y0(), c.x1(), c.y1(), c.sample_begin(), c.sample_end(), c.shares()};
  if (r.x0 >= r.x1 || r.y0 >= r.y1 || r.sample_begin >= r.sample_end)
    return failure("an empty renderer task");
  if (r.pixels() > kMaxTaskPixels || r.pixels() * (r.sample_end - r.sample_begin) > kMaxTaskPaths)
    return failure("a renderer task is too large");
  m.payload = r;
  return Message(std::move(m));
}

Result<Message> read_reply(const ReplyControl& c, std::span<const std::byte> bulk) {
  Reply m;
  m.id = {c.id().origin(), c.id().number()};
  m.epoch = c.epoch();
  if (c.refused()) {
    if (!bulk.empty()) return failure("a refusal has no bulk");
    return Message(std::move(m));
  }
  const std::size_t n = c.count();
  if (n == 0) return failure("an empty reply");
  if (c.category() == TRACER) {
    if (c.misses() > n || bulk.size() != 8 * words(n) + miss_bytes(c) * c.misses())
      return failure("a reply has the wrong length");
    TracerReply r;
    r.count = c.count();
    r.accepted.resize(words(n));
    r.tested.resize(c.misses());
    std::memcpy(r.accepted.data(), bulk.data(), 8 * r.accepted.size());
    ColumnReader in(bulk.subspan(8 * r.accepted.size()));
    for (std::uint64_t& t : r.tested) in.get(t);
    if (c.windows()) r.windows.resize(c.misses());
    for (std::uint16_t& w : r.windows) in.get(w);
    std::size_t accepted = 0;
    for (const std::uint64_t w : r.accepted) accepted += static_cast<std::size_t>(std::popcount(w));
    if (trailing_bits(r.accepted, n) || accepted + r.tested.size() != n)
      return failure("a reply's bits do not match its masks");
    m.payload = std::move(r);
  } else if (c.category() == INTERSECTION && c.nearest()) {
    return read_nearest(std::move(m), c, bulk);
  } else if (c.category() == INTERSECTION) {
    if (bulk.size() != 8 * words(n)) return failure("a reply has the wrong length");
    OcclusionReply r;
    r.count = c.count();
    r.blocked.resize(words(n));
    std::memcpy(r.blocked.data(), bulk.data(), bulk.size());
    if (trailing_bits(r.blocked, n)) return failure("a reply has bits behind its end");
    m.payload = std::move(r);
  } else if (c.category() == RENDERER) {
    const std::size_t w = c.sum_bytes();
    if (w < 1 || w > 16 || c.feature_bytes() > 16 || n > kMaxTaskPixels || !good_splats(c) ||
        bulk.size() != n * sums_bytes(c) + splats_bytes(c))
      return failure("pixel sums have the wrong length");
    RendererReply r;
    r.task = c.task();
    r.invalid = c.invalid();
    r.clamped = c.clamped();
    r.negative_lobes = c.negative_lobes();
    r.sums.resize(r.negative_lobes ? 2 * n : n);
    ColumnReader in(bulk);
    for (PixelSums& p : r.sums) in.get(p.count);
    for (PixelSums& p : r.sums)
      for (auto& half : p.sum)
        for (Int128& v : half) v = in.get_int128(w);
    if (const std::size_t v = c.feature_bytes(); v != 0) {
      r.features.resize(n);
      for (PixelFeatures& p : r.features) {
        in.get(p.samples);
        in.get(p.hits);
        in.get(p.ids);
      }
      for (PixelFeatures& p : r.features)
        for (Int128& sum : p.sum) sum = in.get_int128(v);
    }
    read_splats(c, in, r.splats);
    m.payload = std::move(r);
  } else {
    return failure("tasks of this category are not replied");
  }
  return Message(std::move(m));
}

Result<Message> read_ends(const EndsControl& c, std::span<const std::byte> bulk) {
  const std::size_t n = c.count(), w = c.radiance_bytes();
  const std::size_t told = c.features(), v = c.feature_bytes();
  if (w < 1 || w > 8 || n + told == 0 || (told != 0 && (v < 1 || v > 8)) ||
      !good_splats(c) || bulk.size() != n * end_bytes(w) + told * features_bytes(v) + splats_bytes(c))
    return failure("path ends have the wrong length");
  PathEnds m;
  m.generation = c.generation();
  m.batch.ends.resize(n);
  m.batch.features.resize(told);
  ColumnReader in(bulk);
  const auto get_whose = [&](auto& list) {
    for (auto& e : list) in.get(e.task);
    for (auto& e : list) in.get(e.pixel);
    for (auto& e : list) in.get(e.sample);
    for (auto& e : list) in.get(e.owner);
    for (auto& e : list) in.get(e.flags);
  };
  get_whose(m.batch.ends);
  for (PathEnd& e : m.batch.ends)
    for (auto& r : e.radiance) r = in.get_int(w);
  get_whose(m.batch.features);
  for (PathFeatures& f : m.batch.features) in.get(f.ids);
  for (PathFeatures& f : m.batch.features)
    for (auto& value : f.values) value = in.get_int(v);
  if (!read_splats(c, in, m.batch.ends)) return failure("a path's light is of no path");
  return Message(std::move(m));
}

}  // namespace cloudrenderer::wire
