#include <gtest/gtest.h>

#include "base/random.h"
#include "tasks/checkpoint.h"

namespace cloudrenderer {
namespace {

CheckpointJob a_job() {
  CheckpointJob j;
  j.split = 0x1234567890abcdef;
  j.fingerprint = 77;
  j.seed = 3;
  j.frame = {100, 80, 5, 7, 28, 30};  // 3 x 3 tiles, the last ones cut by the frame
  j.k = 30;
  j.tile = 8;
  j.light_vertices = 6;
  j.emission_vertex = 5;
  j.ao_distance = kInfinity;
  j.footprint_spp = 16;
  return j;
}

TileSums a_tile(std::uint32_t column, std::uint32_t row, std::vector<SampleRange> samples,
                std::uint64_t seed, int bits = 40) {
  const FilmFrame f = a_job().frame;
  TileSums t{f.x0 + 8 * column, f.y0 + 8 * row, 0, 0, std::move(samples), seed, 2, true, {}};
  t.x1 = std::min(f.x1, t.x0 + 8);
  t.y1 = std::min(f.y1, t.y0 + 8);
  t.sums.resize(std::size_t{t.x1 - t.x0} * (t.y1 - t.y0));
  for (PixelSums& p : t.sums)
    for (const SampleRange& r : t.samples)
      for (std::uint32_t s = r.begin; s < r.end; ++s) {
        Fixed3 v;
        for (auto& c : v) c = static_cast<std::int64_t>(mix64(++seed)) >> (64 - bits);
        p.add(v, s);
      }
  return t;
}

bool same(const TileSums& a, const TileSums& b) {
  if (a.x0 != b.x0 || a.y0 != b.y0 || a.x1 != b.x1 || a.y1 != b.y1 || a.samples != b.samples ||
      a.invalid != b.invalid || a.clamped != b.clamped || a.exact != b.exact ||
      a.sums.size() != b.sums.size())
    return false;
  for (std::size_t i = 0; i < a.sums.size(); ++i)
    if (a.sums[i].sum != b.sums[i].sum || a.sums[i].count != b.sums[i].count) return false;
  return true;
}

TEST(Checkpoint, KeepsTheLastDecision) {
  Bytes bytes = encode_header(a_job());
  const std::uint64_t checksum = header_checksum(bytes);
  const std::vector<std::uint32_t> early(9, 16), late{16, 24, 32, 16, 40, 16, 16, 16, 17};
  encode_goals(early, checksum, bytes);
  encode_record(a_tile(0, 0, {{0, 4}}, 1), checksum, bytes);
  encode_goals(late, checksum, bytes);
  const std::size_t good = bytes.size();
  encode_goals({late.data(), 8}, checksum, bytes);  // of a film with other tiles
  CheckpointReader reader(bytes, a_job());
  ASSERT_TRUE(reader.next());
  EXPECT_EQ(reader.goals(), early);
  EXPECT_FALSE(reader.next());
  EXPECT_EQ(reader.goals(), late);
  EXPECT_EQ(reader.position(), good);
}

TEST(Checkpoint, KeepsNegativeLobesApart) {
  CheckpointJob job = a_job();
  job.negative_lobes = true;
  Bytes bytes = encode_header(job);
  EXPECT_TRUE((*read_header(bytes))->negative_lobes);
  EXPECT_NE(difference(job, a_job())->find("lobes"), std::string::npos);
  TileSums tile = a_tile(1, 1, {{0, 4}}, 5);
  const std::size_t pixels = tile.sums.size();
  tile.sums.resize(2 * pixels, tile.sums.front());
  for (std::size_t i = 0; i < tile.sums.size(); ++i) tile.sums[i].count = {static_cast<std::uint32_t>(i % 3), 1};
  encode_record(tile, header_checksum(bytes), bytes);
  CheckpointReader reader(bytes, job);
  const auto read = reader.next();
  ASSERT_TRUE(read);
  EXPECT_TRUE(same(*read, tile));
  EXPECT_FALSE(CheckpointReader(bytes, a_job()).next()) << "as many sums as pixels are expected there";
}

TEST(Checkpoint, TellsLightInMediaAndBelowSurfacesApart) {
  CheckpointJob job = a_job();
  job.media = MediaTransport::multiple;
  job.subsurface = false;
  const Bytes bytes = encode_header(job);
  const auto read = read_header(bytes);
  ASSERT_TRUE(read && *read);
  EXPECT_EQ(**read, job);
  EXPECT_FALSE(difference(job, job));
  for (const auto change : {+[](CheckpointJob& j) { j.media = MediaTransport::none; }, +[](CheckpointJob& j) { j.subsurface = true; }}) {
    CheckpointJob other = job;
    change(other);
    EXPECT_NE(difference(job, other).value_or("").find("--integrator"), std::string::npos);
  }
}

TEST(Checkpoint, KeepsLightOfPathsFromLights) {
  CheckpointJob job = a_job();
  job.light_paths = LightPaths::all;
  Bytes bytes = encode_header(job);
  EXPECT_EQ((*read_header(bytes))->light_paths, LightPaths::all);
  EXPECT_NE(difference(job, a_job())->find("--light-paths"), std::string::npos);
  TileSums tile = a_tile(1, 1, {{0, 3}}, 5), none = a_tile(0, 1, {{0, 3}}, 6);
  tile.light_paths = none.light_paths = true;
  for (std::uint32_t i = 0; i < 3; ++i) {
    Splat& s = tile.splats.emplace_back();
    s.pixel = 100 * (10 + i) + 6;
    for (std::size_t c = 0; c < 3; ++c) s.sum[i % 2][c] = -(static_cast<Int128>(i + c) << 90);
  }
  encode_record(tile, header_checksum(bytes), bytes);
  encode_record(none, header_checksum(bytes), bytes);
  const std::size_t good = bytes.size();
  tile.light_paths = false;
  tile.splats.clear();
  encode_record(tile, header_checksum(bytes), bytes);  // of a job without
  CheckpointReader reader(bytes, job);
  const auto got = reader.next(), bare = reader.next();
  ASSERT_TRUE(got && bare);
  EXPECT_TRUE(same(*got, a_tile(1, 1, {{0, 3}}, 5)));
  ASSERT_EQ(got->splats.size(), 3u);
  EXPECT_EQ(got->splats[2].pixel, 1206u);
  EXPECT_TRUE(got->splats[2].sum[0][1] == -(static_cast<Int128>(3) << 90));
  EXPECT_TRUE(bare->splats.empty());
  EXPECT_FALSE(reader.next());
  EXPECT_EQ(reader.position(), good);
}

TEST(Checkpoint, KeepsWhatPathsHaveSeen) {
  CheckpointJob job = a_job();
  job.features = true;
  Bytes bytes = encode_header(job);
  EXPECT_TRUE((*read_header(bytes))->features);
  EXPECT_NE(difference(job, a_job())->find("--layers"), std::string::npos);
  TileSums tile = a_tile(1, 1, {{0, 3}}, 5);
  for (std::uint32_t i = 0; i < tile.sums.size(); ++i) {
    PixelFeatures& p = tile.features.emplace_back();
    p.samples = 3;
    p.hits = i % 4;
    p.ids = {i, i + 1, 7};
    for (std::size_t c = 0; c < p.sum.size(); ++c) p.sum[c] = -(static_cast<Int128>(i) << (10 * c));
  }
  encode_record(tile, header_checksum(bytes), bytes);
  const std::size_t good = bytes.size();
  tile.features.pop_back();
  encode_record(tile, header_checksum(bytes), bytes);  // one pixel short
  CheckpointReader reader(bytes, job);
  const auto got = reader.next();
  ASSERT_TRUE(got);
  EXPECT_TRUE(same(*got, a_tile(1, 1, {{0, 3}}, 5)));
  tile.features = got->features;
  EXPECT_EQ(got->features.size(), got->sums.size());
  EXPECT_EQ(got->features[5].ids, (FeatureIds{5, 6, 7}));
  EXPECT_TRUE(got->features[5].sum[9] == -(static_cast<Int128>(5) << 90));
  EXPECT_FALSE(reader.next());
  EXPECT_EQ(reader.position(), good);
}

struct Journal {
  Journal() : bytes(encode_header(a_job())) {
    tiles = {a_tile(0, 0, {{0, 4}}, 1), a_tile(2, 2, {{0, 1}}, 2, 3),
             a_tile(1, 0, {{1, 4}, {7, 8}}, 3, 62), a_tile(0, 0, {{4, 5}}, 4)};
    tiles[1].exact = false;
    tiles[3].sums[5] = {};  // its sample was invalid
    for (const TileSums& t : tiles) {
      encode_record(t, header_checksum(bytes), bytes);
      ends.push_back(bytes.size());
    }
  }
  // Whether what is read of these bytes is a beginning of what was written; and how much.
  bool is_beginning(std::span<const std::byte> read, std::size_t& count) const {
    count = 0;
    CheckpointReader reader(read, a_job());
    while (const auto tile = reader.next()) {
      if (count == tiles.size() || !same(*tile, tiles[count])) return false;
      if (reader.position() != ends[count++]) return false;
    }
    return true;
  }
  Bytes bytes;
  std::vector<TileSums> tiles;
  std::vector<std::size_t> ends;
};

TEST(Checkpoint, IsReadAsItWasWritten) {
  const Journal j;
  const auto job = read_header(j.bytes);
  ASSERT_TRUE(job) << job.error();
  EXPECT_EQ(*job, a_job());
  std::size_t n = 0;
  EXPECT_TRUE(j.is_beginning(j.bytes, n));
  EXPECT_EQ(n, j.tiles.size());
}

TEST(Checkpoint, HoldsTheLargestSums) {
  Bytes bytes = encode_header(a_job());
  TileSums t = a_tile(0, 0, {{0, 2}}, 1);
  const Int128 big = static_cast<Int128>(0x7fffffffffffffff) << 64;
  t.sums[0].sum[0] = {big, -big, -1};
  t.sums[1].sum[1] = {-big - 1, 0, 1};
  encode_record(t, header_checksum(bytes), bytes);
  const auto read = CheckpointReader(bytes, a_job()).next();
  ASSERT_TRUE(read);
  EXPECT_TRUE(same(*read, t));
}

TEST(Checkpoint, CutOffAtAnyByteKeepsTheRecordsBeforeIt) {
  const Journal j;
  for (std::size_t size = 0; size < j.bytes.size(); ++size) {
    // A copy of its own, so that a sanitizer sees every step over the end.
    const Bytes cut(j.bytes.begin(), j.bytes.begin() + static_cast<std::ptrdiff_t>(size));
    const auto job = read_header(cut);
    ASSERT_TRUE(job) << job.error();
    ASSERT_EQ(job->has_value(), size >= kCheckpointHeaderBytes);
    if (!*job) continue;
    std::size_t n = 0;
    ASSERT_TRUE(j.is_beginning(cut, n));
    std::size_t whole = 0;
    while (whole < j.ends.size() && j.ends[whole] <= size) ++whole;
    ASSERT_EQ(n, whole) << "cut at " << size;
  }
}

TEST(Checkpoint, AFlippedBitEndsItBeforeTheRecord) {
  const Journal j;
  for (std::size_t at = 0; at < j.bytes.size(); ++at) {
    Bytes bytes = j.bytes;
    bytes[at] ^= std::byte{1} << (at % 8);
    if (at < kCheckpointHeaderBytes) {
      ASSERT_FALSE(read_header(bytes)) << "bit at " << at;
      continue;
    }
    std::size_t n = 0;
    ASSERT_TRUE(j.is_beginning(bytes, n)) << "bit at " << at;
    ASSERT_LT(n, j.tiles.size());
    ASSERT_LE(n == 0 ? 0 : j.ends[n - 1], at);
  }
}

TEST(Checkpoint, RecordsOfAnotherHeaderAreNotTaken) {
  const Journal j;
  CheckpointJob other = a_job();
  other.seed = 4;
  Bytes bytes = encode_header(other);
  bytes.insert(bytes.end(), j.bytes.begin() + kCheckpointHeaderBytes, j.bytes.end());
  EXPECT_FALSE(CheckpointReader(bytes, other).next());
}

TEST(Checkpoint, TilesThatAreNotOfTheFilmAreNotTaken) {
  for (const int wrong : {0, 1, 2, 3, 4}) {
    Bytes bytes = encode_header(a_job());
    TileSums t = a_tile(1, 1, {{0, 2}}, 1);
    if (wrong == 0) ++t.x0;
    if (wrong == 1) t.x1 += 8;
    if (wrong == 2) t.y0 = t.y1 = 4000;
    if (wrong == 3) t.samples = {{4, 2}};
    if (wrong == 4) t.samples = {{0, 2}, {1, 3}};
    encode_record(t, header_checksum(bytes), bytes);
    EXPECT_FALSE(CheckpointReader(bytes, a_job()).next()) << wrong;
  }
}

TEST(Checkpoint, AnythingElseIsNoCheckpoint) {
  const auto bytes_of = [](const std::string& text) {
    Bytes b;
    for (const char c : text) b.push_back(static_cast<std::byte>(c));
    return b;
  };
  EXPECT_EQ(read_header(bytes_of("Film \"image\"")).error(), "it is not a checkpoint");
  EXPECT_FALSE(read_header(bytes_of("x")));
  Bytes newer = encode_header(a_job());
  newer[8] = std::byte{9};
  EXPECT_NE(read_header(newer).error().find("version 9"), std::string::npos);
}

TEST(Checkpoint, ADifferenceNamesTheField) {
  const CheckpointJob made = a_job();
  EXPECT_EQ(difference(made, made), std::nullopt);
  const auto of = [&](auto change) {
    CheckpointJob now = made;
    change(now);
    return difference(made, now).value_or("");
  };
  EXPECT_EQ(of([](CheckpointJob& j) { j.seed = 0; }), "seed 3, this render has seed 0");
  EXPECT_EQ(of([](CheckpointJob& j) { j.frame.width = 50; }),
            "resolution 100x80, this render has resolution 50x80");
  EXPECT_EQ(of([](CheckpointJob& j) { j.frame.x0 = 6; }).find("crop window"), 0u);
  EXPECT_EQ(of([](CheckpointJob& j) { j.integrator = IntegratorKind::direct; }),
            "integrator path, this render has integrator directlighting");
  EXPECT_EQ(of([](CheckpointJob& j) { j.light_vertices = 2; }).find("depth"), 0u);
  EXPECT_EQ(of([](CheckpointJob& j) { j.frame.y1 = 29; }).find("crop window"), 0u);
  EXPECT_EQ(of([](CheckpointJob& j) { j.emission_vertex = 4; }).find("depth"), 0u);
  EXPECT_EQ(of([](CheckpointJob& j) { j.sequence = SampleSequence::Kind::independent; }),
            "sample sequence sobol, this render has sample sequence independent");
  EXPECT_EQ(of([](CheckpointJob& j) { j.ao_distance = 2; }).find("occlusion distance inf"), 0u);
  EXPECT_EQ(of([](CheckpointJob& j) { j.ao_cosine = true; }).find("cosine-weighted occlusion"), 0u);
  EXPECT_EQ(of([](CheckpointJob& j) { j.k = 29; }), "fixed point 30, this render has fixed point 29");
  EXPECT_EQ(of([](CheckpointJob& j) { j.split = 1; }).find("split 1234567890abcdef"), 0u);
  EXPECT_EQ(of([](CheckpointJob& j) { j.tile = 16; }), "");
  EXPECT_EQ(of([](CheckpointJob& j) { j.footprint_spp = 99; }), "");
}

TEST(SampleSet, JoinsWhatTouchesAndRefusesWhatIsThere) {
  SampleSet s;
  EXPECT_TRUE(s.add({4, 6}));
  EXPECT_TRUE(s.add({8, 9}));
  EXPECT_TRUE(s.add({0, 2}));
  EXPECT_FALSE(s.add({5, 7}));
  EXPECT_FALSE(s.add({3, 5}));
  EXPECT_FALSE(s.add({1, 10}));
  EXPECT_FALSE(s.add({7, 7}));
  EXPECT_EQ(s.ranges().size(), 3u);
  EXPECT_EQ(s.gaps({0, 12}), (std::vector<SampleRange>{{2, 4}, {6, 8}, {9, 12}}));
  EXPECT_EQ(s.gaps({1, 5}), (std::vector<SampleRange>{{2, 4}}));
  EXPECT_TRUE(s.gaps({4, 6}).empty());
  EXPECT_TRUE(s.add({2, 4}));
  EXPECT_TRUE(s.add({6, 8}));
  EXPECT_EQ(s.ranges().size(), 1u);
  EXPECT_EQ(s.gaps({3, 10}), (std::vector<SampleRange>{{9, 10}}));
}

}  // namespace
}  // namespace cloudrenderer
