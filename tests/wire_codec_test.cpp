#include <gtest/gtest.h>

#include "wire_support.h"

namespace cloudrenderer::wire {
namespace {

template <class T>
T there_and_back(const T& m) {
  const Bytes bytes = encode(m);
  auto back = decode(*bytes);
  EXPECT_TRUE(back) << back.error();
  return std::get<T>(std::move(*back));
}

void expect_equal(const PathSegment& a, const PathSegment& b) {
  EXPECT_EQ(a.origin, b.origin);
  EXPECT_EQ(a.direction, b.direction);
  EXPECT_EQ(a.throughput, b.throughput);
  EXPECT_EQ(a.previous_pdf, b.previous_pdf);
  EXPECT_EQ(a.radiance, b.radiance);
  EXPECT_EQ(a.previous_normal, b.previous_normal);
  EXPECT_EQ(a.best.t, b.best.t);
  EXPECT_EQ(a.best.shape, b.best.shape);
  EXPECT_EQ(a.best.primitive, b.best.primitive);
  EXPECT_EQ(a.tested, b.tested);
  EXPECT_EQ(a.task, b.task);
  EXPECT_EQ(a.pixel, b.pixel);
  EXPECT_EQ(a.sample, b.sample);
  EXPECT_EQ(a.owner, b.owner);
  EXPECT_EQ(a.vertex, b.vertex);
  EXPECT_EQ(a.flags, b.flags);
  EXPECT_EQ(a.window, b.window);
  EXPECT_EQ(a.passed, b.passed);
  EXPECT_EQ(a.medium, b.medium);
  EXPECT_EQ(a.cone_width, b.cone_width);
  EXPECT_EQ(a.cone_spread, b.cone_spread);
}

TEST(Codec, KeepsEveryBitOfASegment) {
  const SubmitTask sent = some_block(300);
  const SubmitTask got = there_and_back(sent);
  EXPECT_EQ(got.id, sent.id);
  EXPECT_EQ(got.epoch, 3u);
  EXPECT_EQ(got.generation, 4u);
  const auto& a = *std::get<SegmentBlock>(sent.payload).chunks[0];
  const auto& b = *std::get<SegmentBlock>(got.payload).chunks[0];
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) expect_equal(a[i], b[i]);
}

TEST(Codec, JoinsTheChunksOfABlock) {
  SubmitTask sent = some_block(10);
  std::get<SegmentBlock>(sent.payload).chunks.push_back(some_segments(5, 10));
  const auto got = std::get<SegmentBlock>(there_and_back(sent).payload);
  ASSERT_EQ(got.chunks.size(), 1u);
  ASSERT_EQ(got.size(), 15u);
  for (std::size_t i = 0; i < 15; ++i) expect_equal((*got.chunks[0])[i], some_segment(i));
}

TEST(Codec, LeavesOutColumnsThatTheJobDoesNotNeed) {
  const auto got = std::get<SegmentBlock>(there_and_back(some_block(20, kColumnTested)).payload);
  const PathSegment& s = (*got.chunks[0])[7];
  const PathSegment original = some_segment(7);
  EXPECT_EQ(s.tested, original.tested);
  EXPECT_EQ(s.window, original.window);
  EXPECT_EQ(s.best.t, kInfinity);
  EXPECT_EQ(s.previous_normal, Vec3(0.f));
  EXPECT_EQ(s.cone_width, 0.f);
  EXPECT_EQ(s.passed, original.passed);
  EXPECT_EQ(s.medium, 0);
}

TEST(Codec, NeedsAboutAHundredBytesASegment) {
  SubmitTask block = some_block(640, kColumnBestHit | kColumnTested);
  EXPECT_LT(encode(block)->size(), 640u * 108);
  block = some_block(640, 0);
  EXPECT_LT(encode(block)->size(), 640u * 86);
  EXPECT_LT(encode(block)->size(), std::size_t{64} << 10);
}

TEST(Codec, TakesTheNarrowestRadianceThatIsExact) {
  for (const std::int64_t v :
       {std::int64_t{0}, std::int64_t{-1}, std::int64_t{127}, std::int64_t{128}, std::int64_t{-128},
        std::int64_t{-129}, std::int64_t{1} << 40, -(std::int64_t{1} << 47),
        std::numeric_limits<std::int64_t>::max(), std::numeric_limits<std::int64_t>::min()}) {
    PathEnds m;
    m.batch.ends.resize(3);
    m.batch.ends[1].radiance = {v, 1, -1};
    const PathEnds got = there_and_back(m);
    EXPECT_EQ(got.batch.ends[1].radiance, m.batch.ends[1].radiance) << v;
    EXPECT_EQ(got.batch.ends[2].radiance, m.batch.ends[2].radiance);
  }
  PathEnds small, large;
  small.batch.ends.resize(100);
  large.batch.ends.resize(100);
  large.batch.ends[5].radiance[2] = std::int64_t{1} << 50;
  EXPECT_EQ(encode(large)->size() - encode(small)->size(), 100u * 3 * 6);
}

TEST(Codec, KeepsPathEnds) {
  PathEnds m;
  m.generation = 9;
  m.batch.ends.push_back({1, 2, 3, 4, kEndInvalid, {5, -6, 7}});
  const PathEnds got = there_and_back(m);
  EXPECT_EQ(got.generation, 9u);
  ASSERT_EQ(got.batch.ends.size(), 1u);
  EXPECT_EQ(got.batch.ends[0].task, 1u);
  EXPECT_EQ(got.batch.ends[0].pixel, 2u);
  EXPECT_EQ(got.batch.ends[0].sample, 3u);
  EXPECT_EQ(got.batch.ends[0].owner, 4u);
  EXPECT_EQ(got.batch.ends[0].flags, kEndInvalid);
}

TEST(Codec, KeepsWhatPathsHaveSeen) {
  PathEnds m;
  for (std::uint32_t i = 0; i < 3; ++i) {
    PathFeatures f{i, 2 + i, 3, 4, kTellsHit, {5, 6, 7 + i}, {}};
    for (std::size_t c = 0; c < f.values.size(); ++c) f.values[c] = (c % 2 ? -1 : 1) * (std::int64_t{1} << (3 * c + i));
    m.batch.features.push_back(f);
  }
  const PathEnds got = there_and_back(m);
  EXPECT_TRUE(got.batch.ends.empty());
  ASSERT_EQ(got.batch.features.size(), 3u);
  for (std::size_t i = 0; i < 3; ++i) {
    const PathFeatures &a = got.batch.features[i], &b = m.batch.features[i];
    EXPECT_EQ(a.task, b.task);
    EXPECT_EQ(a.pixel, b.pixel);
    EXPECT_EQ(a.sample, b.sample);
    EXPECT_EQ(a.owner, b.owner);
    EXPECT_EQ(a.flags, b.flags);
    EXPECT_EQ(a.ids, b.ids);
    EXPECT_EQ(a.values, b.values);
  }
  m.batch.ends.push_back({1, 2, 3, 4, kEndWithoutHit, {5, -6, 7}});
  EXPECT_EQ(there_and_back(m).batch.features[2].values, m.batch.features[2].values);
  EXPECT_EQ(there_and_back(m).batch.ends[0].flags, kEndWithoutHit);
}

TEST(Codec, KeepsSumsOfWhatPathsHaveSeen) {
  RendererReply r;
  r.sums.resize(3);
  const auto without = encode(Reply{{1, 2}, 3, r})->size();
  r.features.resize(3);
  for (std::uint32_t i = 0; i < 3; ++i) {
    PixelFeatures& p = r.features[i];
    p.samples = 9 + i;
    p.hits = i;
    p.ids = {i, 2, 3};
    for (std::size_t c = 0; c < p.sum.size(); ++c) p.sum[c] = (static_cast<Int128>(c % 2 ? -1 : 1) << (20 * i + 6 * c)) + 1;
  }
  const auto got = std::get<RendererReply>(there_and_back(Reply{{1, 2}, 3, r}).payload);
  EXPECT_EQ(got.features, r.features);
  EXPECT_TRUE(std::get<RendererReply>(there_and_back(Reply{{1, 2}, 3, RendererReply{0, r.sums, 0, 0}}).payload).features.empty());
  EXPECT_GT(encode(Reply{{1, 2}, 3, r})->size(), without + 3 * 20);
}

TEST(Codec, KeepsLightOfPathsFromLights) {
  PathEnds m;
  for (std::uint32_t i = 0; i < 5; ++i) m.batch.ends.push_back({1, i, 3, 4, 0, {5, -6, 7}});
  const std::size_t without = encode(m)->size();
  m.batch.ends[1].target = 70000;
  m.batch.ends[1].splat = {std::int64_t{1} << 40, -1, 0};
  m.batch.ends[4].target = 0;
  m.batch.features.push_back({1, 2, 3, 4, kTellsHit, {5, 6, 7}, {}});
  const PathEnds got = there_and_back(m);
  for (std::size_t i = 0; i < 5; ++i) {
    EXPECT_EQ(got.batch.ends[i].target, m.batch.ends[i].target) << i;
    EXPECT_EQ(got.batch.ends[i].splat, m.batch.ends[i].splat) << i;
  }
  EXPECT_EQ(got.batch.features.size(), 1u);
  m.batch.features.clear();
  EXPECT_LT(encode(m)->size(), without + 2 * (8 + 3 * 6) + 8) << "two of five have some";

  RendererReply r;
  r.sums.resize(3);
  r.splats.resize(2);
  r.splats[0].pixel = 5;
  r.splats[0].sum[1][2] = -(static_cast<Int128>(7) << 70);
  r.splats[1].pixel = 1u << 30;
  r.splats[1].sum[0][0] = 9;
  const auto back = std::get<RendererReply>(there_and_back(Reply{{1, 2}, 3, r}).payload);
  ASSERT_EQ(back.splats.size(), 2u);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(back.splats[i].pixel, r.splats[i].pixel);
    EXPECT_TRUE(back.splats[i].sum == r.splats[i].sum) << i;
  }
}

TEST(Codec, KeepsSumsOfNegativeLobes) {
  RendererReply r;
  r.sums.resize(6);
  r.features.resize(3);
  r.negative_lobes = true;
  for (std::uint32_t i = 0; i < 6; ++i) {
    r.sums[i].count = {i, 7};
    r.sums[i].sum[1][2] = static_cast<Int128>(i) << 50;
  }
  const auto got = std::get<RendererReply>(there_and_back(Reply{{1, 2}, 3, r}).payload);
  EXPECT_TRUE(got.negative_lobes);
  EXPECT_EQ(got.features.size(), 3u);
  ASSERT_EQ(got.sums.size(), 6u);
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_EQ(got.sums[i].count, r.sums[i].count);
    EXPECT_TRUE(got.sums[i].sum == r.sums[i].sum) << i;
  }
}

TEST(Codec, KeepsRays) {
  const auto got = std::get<OcclusionBlock>(there_and_back(some_rays(77)).payload);
  ASSERT_EQ(got.size(), 77u);
  EXPECT_EQ((*got.chunks[0])[5].origin, some_segment(5).origin);
  EXPECT_EQ((*got.chunks[0])[5].t_max, 5.f);
}

TEST(Codec, KeepsTheTimesOfRaysAndSendsNoneWhereNothingMoves) {
  SubmitTask m = some_rays(77);
  const std::size_t still = encode(m)->size();
  std::vector<float> times(77);
  for (std::size_t i = 0; i < times.size(); ++i) times[i] = 0.5f * static_cast<float>(i) - 3;
  std::get<OcclusionBlock>(m.payload).times = {std::make_shared<const std::vector<float>>(times)};
  EXPECT_EQ(encode(m)->size(), still + 4 * 77 + 2);  // and the flag
  const auto got = std::get<OcclusionBlock>(there_and_back(m).payload);
  ASSERT_EQ(got.times.size(), 1u);
  EXPECT_EQ(*got.times[0], times);
  EXPECT_EQ((*got.chunks[0])[76].origin, some_segment(76).origin);
  EXPECT_TRUE(std::get<OcclusionBlock>(there_and_back(some_rays(77)).payload).times.empty());
}

TEST(Codec, KeepsPixelSumsOf128Bits) {
  RendererReply r;
  r.task = 5;
  r.invalid = 1;
  r.clamped = 2;
  r.sums.resize(4);
  for (std::uint32_t i = 0; i < 4; ++i)
    for (std::uint32_t half = 0; half < 2; ++half) {
      r.sums[i].count[half] = i + half;
      for (std::uint32_t c = 0; c < 3; ++c)
        r.sums[i].sum[half][c] = (static_cast<Int128>(c % 2 ? -1 : 1) << (20 * i + 10 * c)) + c;
    }
  const auto got = there_and_back(Reply{{1, 2}, 3, r});
  const auto& back = std::get<RendererReply>(got.payload);
  EXPECT_EQ(back.task, 5u);
  EXPECT_EQ(back.invalid, 1u);
  EXPECT_EQ(back.clamped, 2u);
  ASSERT_EQ(back.sums.size(), 4u);
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_EQ(back.sums[i].count, r.sums[i].count);
    EXPECT_TRUE(back.sums[i].sum == r.sums[i].sum) << i;
  }
}

TEST(Codec, KeepsReplies) {
  TracerReply t;
  t.count = 70;
  t.accepted = {~std::uint64_t{0}, 0b101011};
  t.tested = {3, 4};
  Reply got = there_and_back(Reply{{1, 2}, 3, t});
  EXPECT_EQ(std::get<TracerReply>(got.payload).accepted, t.accepted);
  EXPECT_EQ(std::get<TracerReply>(got.payload).tested, t.tested);
  EXPECT_TRUE(std::get<TracerReply>(got.payload).windows.empty());
  t.windows = {0, 2};
  got = there_and_back(Reply{{1, 2}, 3, t});
  EXPECT_EQ(std::get<TracerReply>(got.payload).windows, t.windows);

  OcclusionReply o;
  o.count = 65;
  o.blocked = {5, 1};
  got = there_and_back(Reply{{1, 2}, 3, o});
  EXPECT_EQ(std::get<OcclusionReply>(got.payload).blocked, o.blocked);

  got = there_and_back(Reply{{1, 2}, 8, Refusal{}});
  EXPECT_EQ(got.epoch, 8u);
  EXPECT_TRUE(std::holds_alternative<Refusal>(got.payload));
}

TEST(Codec, KeepsNearestHitsAndSendsTheColumnsThatSomeHitHas) {
  const std::uint16_t all = kAnsweredFlip | kAnsweredNormals | kAnsweredUvs;
  std::array<std::size_t, 4> bytes{};
  for (const std::uint16_t flags : {std::uint16_t{0}, std::uint16_t{kAnsweredNormals}, std::uint16_t{kAnsweredUvs}, all}) {
    const NearestReply r = some_nearest(flags);
    const Reply m{{1, 2}, 3, r};
    bytes[flags / 2] = encode(m)->size();
    const auto back = std::get<NearestReply>(there_and_back(m).payload);
    EXPECT_EQ(back.found, r.found);
    ASSERT_EQ(back.hits.size(), r.hits.size());
    for (std::size_t i = 0; i < r.hits.size(); ++i) {
      const AnsweredHit &a = back.hits[i], &b = r.hits[i];
      EXPECT_EQ(std::tie(a.t, a.u, a.v, a.shape, a.primitive), std::tie(b.t, b.u, b.v, b.shape, b.primitive));
      EXPECT_TRUE(a.surface.p == b.surface.p && a.surface.n == b.surface.n && a.surface.uv == b.surface.uv);
      EXPECT_EQ(std::tie(a.surface.material, a.surface.light, a.surface.flags),
                std::tie(b.surface.material, b.surface.light, b.surface.flags));
    }
  }
  EXPECT_NEAR(static_cast<double>(bytes[1] - bytes[0]), 36 * 46, 8);
  EXPECT_NEAR(static_cast<double>(bytes[3] - bytes[2]), 36 * 46, 8);
  SubmitTask ask = some_rays(3);
  std::get<OcclusionBlock>(ask.payload).nearest = true;
  EXPECT_TRUE(std::get<OcclusionBlock>(there_and_back(ask).payload).nearest);
}

TEST(Codec, KeepsRendererTasks) {
  const RendererRange r{9, 1, 2, 33, 34, 5, 21};
  const auto got = std::get<RendererRange>(there_and_back(SubmitTask{{1, 2}, 3, 4, r}).payload);
  EXPECT_EQ(got.task, 9u);
  EXPECT_EQ(got.x1, 33u);
  EXPECT_EQ(got.y0, 2u);
  EXPECT_EQ(got.paths(), r.paths());
}

TEST(Codec, KeepsControlMessages) {
  Hello hello;
  hello.set_threads(3);
  hello.set_name("w\xc3\xb6rker");
  hello.add_categories(INTERSECTION);
  EXPECT_EQ(there_and_back(hello).SerializeAsString(), hello.SerializeAsString());
  SceneHostMap map;
  map.set_part_count(3);
  map.add_hosts()->set_host(4);
  map.add_holdings()->set_host(4);
  map.mutable_holdings(0)->add_parts(2);
  EXPECT_EQ(there_and_back(map).SerializeAsString(), map.SerializeAsString());
  BlobChunk chunk;
  chunk.set_data(std::string(kMaxBlobChunk, 'x'));
  chunk.set_total(kMaxBlobChunk + 5);
  chunk.set_offset(5);
  EXPECT_EQ(there_and_back(chunk).data().size(), kMaxBlobChunk);
}

TEST(Codec, NamesMessages) {
  EXPECT_STREQ(message_name(Challenge()), "Challenge");
  EXPECT_STREQ(message_name(some_block(1)), "SubmitTask");
  EXPECT_STREQ(message_name(Error()), "Error");
}

TEST(FrameHeader, GoesThereAndBack) {
  const auto bytes = encode_frame_header({1, 2, 3, 4}, 1000);
  const auto h = decode_frame_header(bytes);
  ASSERT_TRUE(h);
  EXPECT_EQ(h->payload_bytes, 1000u);
  EXPECT_EQ(h->link.incarnation, 1u);
  EXPECT_EQ(h->link.sequence, 2u);
  EXPECT_EQ(h->link.ack, 3u);
  EXPECT_EQ(h->link.window, 4u);
}

TEST(FrameHeader, RefusesAbsurdLengths) {
  EXPECT_FALSE(decode_frame_header(encode_frame_header({}, kMaxFrameBytes)));
  EXPECT_TRUE(decode_frame_header(encode_frame_header({}, kMaxFrameBytes - kFrameHeaderBytes)));
  auto bytes = encode_frame_header({}, 0);
  EXPECT_TRUE(decode_frame_header(bytes));
  bytes[0] = std::byte{19};
  EXPECT_FALSE(decode_frame_header(bytes));
}

TEST(FrameHeader, RefusesAnyAlteredByte) {
  const auto whole = encode_frame_header({0x12345678, 17, 16, 5}, 300);
  for (std::size_t i = 0; i < whole.size(); ++i)
    for (const int bit : {0, 3, 7}) {
      auto bytes = whole;
      bytes[i] ^= std::byte{1} << bit;
      EXPECT_FALSE(decode_frame_header(bytes)) << "byte " << i;
    }
}

}  // namespace
}  // namespace cloudrenderer::wire
