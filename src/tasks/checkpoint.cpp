#include "tasks/checkpoint.h"

#include <spdlog/fmt/fmt.h>
#include <xxhash.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>

namespace cloudrenderer {
namespace {

constexpr std::array<char, 8> kMagic{'c', 'r', 'c', 'k', 'p', 't', '\r', '\n'};
constexpr std::uint32_t kVersion = 3, kTileMark = 0x656c6974, kGoalMark = 0x6c616f67;  // "tile", "goal"
constexpr std::size_t kRecordHeaderBytes = 16, kBodyHeaderBytes = 40;
constexpr std::uint32_t kLargestTile = 128, kLargestFilm = 1u << 16;
constexpr std::uint8_t kInexact = 1, kCounts = 2;
// Flags of a job; of LightPaths and MediaTransport the lowest of two bits.
constexpr std::uint32_t kJobFeatures = 1, kJobNegativeLobes = 2, kJobLightPaths = 4, kJobMedia = 16, kJobBoundaries = 64,
                        kJobRegularize = 128, kJobSamplesPerRay = 256, kJobIfWorth = 1024, kJobUnknown = ~2047u;
constexpr std::size_t kFeatureSumBytes = sizeof(Int128), kFeatureBytes = 4 + 4 * kFeatureIds + kFeatureSumBytes * kFeatureNumbers;

static_assert(std::endian::native == std::endian::little, "numbers are written as they are");

__extension__ typedef unsigned __int128 UInt128;

template <class T>
void put(Bytes& out, T value) {
  const std::size_t at = out.size();
  out.resize(at + sizeof(T));
  std::memcpy(out.data() + at, &value, sizeof(T));
}

// Lengths are checked by the caller.
class Cursor {
 public:
  explicit Cursor(std::span<const std::byte> bytes) : bytes_(bytes) {}
  template <class T>
  T take() {
    T value;
    std::memcpy(&value, bytes_.data() + at_, sizeof(T));
    at_ += sizeof(T);
    return value;
  }
  Int128 take_sum(unsigned width) {
    Int128 value = 0;
    std::memcpy(&value, bytes_.data() + at_, width);
    at_ += width;
    const unsigned spare = 128 - 8 * width;
    return static_cast<Int128>(static_cast<UInt128>(value) << spare) >> spare;
  }

 private:
  std::span<const std::byte> bytes_;
  std::size_t at_ = 0;
};

std::uint64_t hash(std::span<const std::byte> bytes, std::uint64_t seed = 0) {
  return XXH3_64bits_withSeed(bytes.data(), bytes.size(), seed);
}

// Bytes that hold every sum of the tile in two's complement.
unsigned sum_width(const TileSums& tile) {
  UInt128 all = 0;
  for (const PixelSums& p : tile.sums)
    for (const auto& half : p.sum)
      for (const Int128 v : half) all |= static_cast<UInt128>(v < 0 ? ~v : v);
  for (const Splat& s : tile.splats)
    for (const auto& half : s.sum)
      for (const Int128 v : half) all |= static_cast<UInt128>(v < 0 ? ~v : v);
  unsigned bits = 1;  // the sign
  for (; all != 0; all >>= 1) ++bits;
  return (bits + 7) / 8;
}

// Samples of the ranges by parity: what a pixel counts if none of them is invalid.
std::array<std::uint32_t, 2> counts_of(std::span<const SampleRange> samples) {
  std::array<std::uint32_t, 2> n{};
  for (const SampleRange& r : samples) {
    n[0] += (r.end + 1) / 2 - (r.begin + 1) / 2;
    n[1] += r.end / 2 - r.begin / 2;
  }
  return n;
}

const char* name_of(LightPaths paths) {
  static constexpr std::array<const char*, 3> kNames{"off", "caustics", "all"};
  return kNames[static_cast<std::size_t>(paths)];
}

const char* name(IntegratorKind kind) {
  static constexpr std::array<const char*, 3> kNames{"path", "directlighting", "ambientocclusion"};
  return kNames[static_cast<std::size_t>(kind)];
}

}  // namespace

CheckpointJob checkpoint_job(std::uint64_t split, const JobSettings& s) {
  CheckpointJob job;
  job.split = split;
  job.seed = s.seed;
  job.frame = s.film.frame;
  job.k = s.k;
  job.integrator = s.integrator;
  job.light_vertices = s.light_vertices;
  job.emission_vertex = s.emission_vertex;
  job.sequence = s.sequence;
  job.ao_cosine = s.ao_cosine;
  job.ao_distance = s.ao_distance;
  job.footprint_spp = s.spp;
  job.features = s.features;
  job.negative_lobes = s.lobes.sums_per_pixel() > 1;
  job.light_paths = s.light_paths;
  job.media = s.media;
  job.subsurface = s.subsurface;
  job.regularize = s.regularize;
  job.samples_per_ray = s.samples_per_ray;
  job.share_if_worth = s.share_if_worth;
  return job;
}

std::optional<std::string> difference(const CheckpointJob& made, const CheckpointJob& now) {
  const auto differs = [](const char* field, const std::string& a, const std::string& b) {
    return fmt::format("{} {}, this render has {} {}", field, a, field, b);
  };
  const auto size = [](const FilmFrame& f) { return fmt::format("{}x{}", f.width, f.height); };
  const auto crop = [](const FilmFrame& f) {
    return fmt::format("[{}, {}) x [{}, {})", f.x0, f.x1, f.y0, f.y1);
  };
  const auto text = [](auto v) { return fmt::format("{}", v); };
  if (size(made.frame) != size(now.frame))
    return differs("resolution", size(made.frame), size(now.frame));
  if (made.frame != now.frame) return differs("crop window", crop(made.frame), crop(now.frame));
  if (made.seed != now.seed) return differs("seed", text(made.seed), text(now.seed));
  if (made.integrator != now.integrator)
    return differs("integrator", name(made.integrator), name(now.integrator));
  const auto depth = [](const CheckpointJob& j) {
    return fmt::format("{}/{}", j.light_vertices, j.emission_vertex);
  };
  if (depth(made) != depth(now))
    return differs("depth (vertices with light / emission)", depth(made), depth(now));
  const auto sequence = [](const CheckpointJob& j) {
    return j.sequence == SampleSequence::Kind::sobol ? "sobol" : "independent";
  };
  if (made.sequence != now.sequence)
    return differs("sample sequence", sequence(made), sequence(now));
  if (made.ao_distance != now.ao_distance)
    return differs("occlusion distance", text(made.ao_distance), text(now.ao_distance));
  if (made.ao_cosine != now.ao_cosine)
    return differs("cosine-weighted occlusion", text(made.ao_cosine), text(now.ao_cosine));
  if (made.k != now.k) return differs("fixed point", text(made.k), text(now.k));
  if (made.features != now.features)
    return std::string(made.features ? "layers of what paths see" : "no layers of what paths see") + ", this render has " +
           (now.features ? "some" : "none") + " (--layers)";
  if (made.light_paths != now.light_paths)
    return differs("paths from lights", name_of(made.light_paths), name_of(now.light_paths)) + " (--light-paths)";
  if (made.media != now.media || made.subsurface != now.subsurface)
    return "light in media or below surfaces in another way (--integrator)";
  if (made.regularize != now.regularize) return std::string(made.regularize ? "" : "not ") + "regularized, this render the other way (--integrator)";
  if (made.negative_lobes != now.negative_lobes) return "samples of the filter's negative lobes summed in another way";
  if (made.split != now.split)
    return differs("split", fmt::format("{:016x}", made.split), fmt::format("{:016x}", now.split)) +
           " (the scene's files or --part-size are not the same)";
  return std::nullopt;
}

Bytes encode_header(const CheckpointJob& job) {
  Bytes out;
  for (const char c : kMagic) put(out, c);
  put(out, kVersion);
  put(out, static_cast<std::uint32_t>(kCheckpointHeaderBytes));
  for (const std::uint64_t v : {job.split, job.fingerprint, job.seed}) put(out, v);
  const FilmFrame& f = job.frame;
  for (const std::uint32_t v : {f.width, f.height, f.x0, f.y0, f.x1, f.y1}) put(out, v);
  put(out, static_cast<std::int32_t>(job.k));
  put(out, job.tile);
  put(out, static_cast<std::uint32_t>(job.integrator));
  put(out, job.light_vertices);
  put(out, job.emission_vertex);
  put(out, static_cast<std::uint32_t>(job.sequence));
  put(out, static_cast<std::uint32_t>(job.ao_cosine));
  put(out, job.ao_distance);
  put(out, job.footprint_spp);
  put(out, (job.features ? kJobFeatures : 0u) | (job.negative_lobes ? kJobNegativeLobes : 0u) |
               kJobLightPaths * static_cast<std::uint32_t>(job.light_paths) | kJobMedia * static_cast<std::uint32_t>(job.media) |
               (job.subsurface ? 0u : kJobBoundaries) | (job.regularize ? kJobRegularize : 0u) |
               kJobSamplesPerRay * static_cast<std::uint32_t>(std::countr_zero(job.samples_per_ray)) |
               (job.share_if_worth ? kJobIfWorth : 0u));
  put(out, hash(out));
  static_assert(kCheckpointHeaderBytes == 8 + 2 * 4 + 3 * 8 + 6 * 4 + 10 * 4 + 8);
  return out;
}

std::uint64_t header_checksum(std::span<const std::byte> header) {
  return Cursor(header.subspan(kCheckpointHeaderBytes - 8)).take<std::uint64_t>();
}

Result<std::optional<CheckpointJob>> read_header(std::span<const std::byte> bytes) {
  const auto fail = [](const std::string& why) {
    return Result<std::optional<CheckpointJob>>::failure(why);
  };
  const std::size_t magic = std::min(bytes.size(), kMagic.size());
  if (magic != 0 && std::memcmp(bytes.data(), kMagic.data(), magic) != 0)
    return fail("it is not a checkpoint");
  if (bytes.size() < kCheckpointHeaderBytes)
    return Result<std::optional<CheckpointJob>>(std::optional<CheckpointJob>{});
  Cursor in(bytes.subspan(kMagic.size()));
  if (const auto version = in.take<std::uint32_t>(); version != kVersion)
    return fail(fmt::format("it has format version {}, this program reads {}", version, kVersion));
  if (in.take<std::uint32_t>() != kCheckpointHeaderBytes ||
      hash(bytes.first(kCheckpointHeaderBytes - 8)) != header_checksum(bytes))
    return fail("its header is damaged");
  CheckpointJob job;
  for (auto* v : {&job.split, &job.fingerprint, &job.seed}) *v = in.take<std::uint64_t>();
  FilmFrame& f = job.frame;
  for (auto* v : {&f.width, &f.height, &f.x0, &f.y0, &f.x1, &f.y1}) *v = in.take<std::uint32_t>();
  job.k = in.take<std::int32_t>();
  job.tile = in.take<std::uint32_t>();
  const auto integrator = in.take<std::uint32_t>();
  job.light_vertices = in.take<std::uint32_t>();
  job.emission_vertex = in.take<std::uint32_t>();
  job.sequence = static_cast<SampleSequence::Kind>(in.take<std::uint32_t>());
  job.ao_cosine = in.take<std::uint32_t>() != 0;
  job.ao_distance = in.take<float>();
  job.footprint_spp = in.take<std::uint32_t>();
  const auto flags = in.take<std::uint32_t>();
  job.features = (flags & kJobFeatures) != 0;
  job.negative_lobes = (flags & kJobNegativeLobes) != 0;
  job.light_paths = static_cast<LightPaths>(flags / kJobLightPaths % 4);
  job.media = static_cast<MediaTransport>(flags / kJobMedia % 4);
  job.subsurface = (flags & kJobBoundaries) == 0;
  job.regularize = (flags & kJobRegularize) != 0;
  job.samples_per_ray = 1u << (flags / kJobSamplesPerRay % 4);
  job.share_if_worth = (flags & kJobIfWorth) != 0;
  if (f.width > kLargestFilm || f.height > kLargestFilm || f.x0 >= f.x1 || f.y0 >= f.y1 ||
      f.x1 > f.width || f.y1 > f.height || job.tile > kLargestTile || (flags & kJobUnknown) != 0 || job.light_paths > LightPaths::all ||
      integrator > static_cast<std::uint32_t>(IntegratorKind::ambient_occlusion))
    return fail("its header makes no sense");
  job.integrator = static_cast<IntegratorKind>(integrator);
  return Result<std::optional<CheckpointJob>>(job);
}

void encode_goals(std::span<const std::uint32_t> goals, std::uint64_t header_checksum, Bytes& out) {
  const auto bytes = std::as_bytes(goals);
  put(out, kGoalMark);
  put(out, static_cast<std::uint32_t>(bytes.size()));
  put(out, hash(bytes, header_checksum + bytes.size()));
  out.insert(out.end(), bytes.begin(), bytes.end());
}

void encode_record(const TileSums& tile, std::uint64_t header_checksum, Bytes& out) {
  const auto expected = counts_of(tile.samples);
  const bool counts = std::any_of(tile.sums.begin(), tile.sums.end(),
                                  [&](const PixelSums& p) { return p.count != expected; });
  const unsigned width = sum_width(tile);
  const std::size_t body = kBodyHeaderBytes + 8 * tile.samples.size() +
                           tile.sums.size() * (6 * width + (counts ? 8 : 0)) + tile.features.size() * kFeatureBytes +
                           (tile.light_paths ? 4 + tile.splats.size() * (4 + 6 * width) : 0);
  put(out, kTileMark);
  put(out, static_cast<std::uint32_t>(body));
  const std::size_t checksum_at = out.size();
  put(out, std::uint64_t{0});
  const std::size_t body_at = out.size();
  for (const std::uint32_t v : {tile.x0, tile.y0, tile.x1, tile.y1}) put(out, v);
  put(out, static_cast<std::uint32_t>(tile.samples.size()));
  put(out, static_cast<std::uint8_t>((tile.exact ? 0 : kInexact) | (counts ? kCounts : 0)));
  put(out, static_cast<std::uint8_t>(width));
  put(out, std::uint16_t{0});
  put(out, tile.invalid);
  put(out, tile.clamped);
  for (const SampleRange& r : tile.samples) {
    put(out, r.begin);
    put(out, r.end);
  }
  std::size_t at = out.size();
  out.resize(body_at + body);
  for (const PixelSums& p : tile.sums) {
    if (counts) {
      std::memcpy(out.data() + at, p.count.data(), 8);
      at += 8;
    }
    for (const auto& half : p.sum) {
      for (const Int128& v : half) {
        std::memcpy(out.data() + at, &v, width);
        at += width;
      }
    }
  }
  for (const PixelFeatures& p : tile.features) {
    std::memcpy(out.data() + at, &p.hits, 4);
    std::memcpy(out.data() + at + 4, p.ids.data(), 4 * kFeatureIds);
    at += 4 + 4 * kFeatureIds;
    std::memcpy(out.data() + at, p.sum.data(), kFeatureSumBytes * kFeatureNumbers);
    at += kFeatureSumBytes * kFeatureNumbers;
  }
  const auto append = [&](const auto& value, std::size_t bytes) {
    std::memcpy(out.data() + at, &value, bytes);
    at += bytes;
  };
  if (tile.light_paths) append(static_cast<std::uint32_t>(tile.splats.size()), 4);
  for (const Splat& s : tile.splats) {
    append(s.pixel, 4);
    for (const auto& half : s.sum)
      for (const Int128& v : half) append(v, width);
  }
  const std::uint64_t checksum =
      hash(std::span(out).subspan(body_at), header_checksum + std::uint64_t{body});
  std::memcpy(out.data() + checksum_at, &checksum, 8);
}

CheckpointReader::CheckpointReader(std::span<const std::byte> bytes, const CheckpointJob& job)
    : bytes_(bytes), job_(job), seed_(header_checksum(bytes)) {}

std::optional<TileSums> CheckpointReader::next() {
  for (;;) {
    const auto rest = bytes_.subspan(position_);
    if (rest.size() < kRecordHeaderBytes) return std::nullopt;
    Cursor in(rest);
    const auto mark = in.take<std::uint32_t>();
    const auto bytes = in.take<std::uint32_t>();
    const auto checksum = in.take<std::uint64_t>();
    if (bytes > rest.size() - kRecordHeaderBytes) return std::nullopt;
    const auto body = rest.subspan(kRecordHeaderBytes, bytes);
    if (hash(body, seed_ + bytes) != checksum) return std::nullopt;
    std::optional<TileSums> tile;
    if (mark == kTileMark && bytes >= kBodyHeaderBytes) tile = decode(body);
    if (!tile && (mark != kGoalMark || !decode_goals(body))) return std::nullopt;
    position_ += kRecordHeaderBytes + bytes;
    if (tile) return tile;
  }
}

bool CheckpointReader::decode_goals(std::span<const std::byte> body) {
  const FilmFrame& f = job_.frame;
  const std::uint64_t tile = job_.tile;
  if (tile == 0) return false;
  const std::uint64_t tiles = ((f.crop_width() + tile - 1) / tile) * ((f.crop_height() + tile - 1) / tile);
  if (body.size() != tiles * sizeof(std::uint32_t)) return false;
  goals_.resize(tiles);
  std::memcpy(goals_.data(), body.data(), body.size());
  return true;
}

std::optional<TileSums> CheckpointReader::decode(std::span<const std::byte> body) const {
  Cursor in(body);
  TileSums t;
  for (auto* v : {&t.x0, &t.y0, &t.x1, &t.y1}) *v = in.take<std::uint32_t>();
  const auto ranges = in.take<std::uint32_t>();
  const auto flags = in.take<std::uint8_t>();
  const unsigned width = in.take<std::uint8_t>();
  (void)in.take<std::uint16_t>();
  t.invalid = in.take<std::uint64_t>();
  t.clamped = in.take<std::uint64_t>();
  t.exact = (flags & kInexact) == 0;
  const FilmFrame& f = job_.frame;
  const std::uint32_t tile = job_.tile;
  if (tile == 0 || t.x0 < f.x0 || t.y0 < f.y0 || t.x0 >= f.x1 || t.y0 >= f.y1 ||
      (t.x0 - f.x0) % tile != 0 || (t.y0 - f.y0) % tile != 0 ||
      t.x1 != std::min(f.x1, t.x0 + tile) || t.y1 != std::min(f.y1, t.y0 + tile) || width < 1 ||
      width > 16 || ranges == 0)
    return std::nullopt;
  const std::uint64_t pixels = std::uint64_t{t.x1 - t.x0} * (t.y1 - t.y0), sums = pixels * (job_.negative_lobes ? 2 : 1);
  const bool counts = (flags & kCounts) != 0;
  t.light_paths = job_.light_paths != LightPaths::none;
  const std::uint64_t before_splats =
      kBodyHeaderBytes + std::uint64_t{8} * ranges + sums * (6 * width + (counts ? 8 : 0)) + pixels * (job_.features ? kFeatureBytes : 0);
  std::uint32_t splats = 0;
  if (t.light_paths) {
    if (body.size() < before_splats + 4) return std::nullopt;
    std::memcpy(&splats, body.data() + before_splats, 4);
  }
  if (body.size() != before_splats + (t.light_paths ? 4 + std::uint64_t{splats} * (4 + 6 * width) : 0)) return std::nullopt;
  SampleSet set;
  for (std::uint32_t i = 0; i < ranges; ++i) {
    const auto begin = in.take<std::uint32_t>();
    const SampleRange r{begin, in.take<std::uint32_t>()};
    if (!set.add(r) || r.end > 1u << 30) return std::nullopt;
    t.samples.push_back(r);
  }
  const auto expected = counts_of(t.samples);
  t.sums.resize(sums);
  for (PixelSums& p : t.sums) {
    p.count = expected;
    if (counts)
      for (std::uint32_t& n : p.count) n = in.take<std::uint32_t>();
    for (auto& half : p.sum)
      for (Int128& v : half) v = in.take_sum(width);
  }
  if (job_.features) t.features.resize(pixels);
  for (PixelFeatures& p : t.features) {
    p.samples = expected[0] + expected[1];
    p.hits = in.take<std::uint32_t>();
    if (p.hits > p.samples) return std::nullopt;
    for (std::uint32_t& id : p.ids) id = in.take<std::uint32_t>();
    for (Int128& sum : p.sum) sum = in.take_sum(kFeatureSumBytes);
  }
  if (t.light_paths) (void)in.take<std::uint32_t>();
  for (std::uint32_t i = 0; i < splats; ++i) {
    Splat& s = t.splats.emplace_back();
    s.pixel = in.take<std::uint32_t>();
    for (auto& half : s.sum)
      for (Int128& v : half) v = in.take_sum(width);
  }
  return t;
}

}  // namespace cloudrenderer
