// Peers can be wrong, old, or hostile: whatever bytes come, decoding says why not, and does no
// harm.
#include <gtest/gtest.h>
#include <xxhash.h>

#include <limits>

#include "wire_support.h"

namespace cloudrenderer::wire {
namespace {

std::vector<std::byte> bytes_of(const Message& m) { return *encode(m); }

// Makes the checksum right again, so that the checks behind it are reached.
void seal(std::vector<std::byte>& payload) {
  std::uint64_t head;
  std::memcpy(&head, payload.data(), 8);
  const std::uint64_t sum = XXH3_64bits_withSeed(payload.data() + kPayloadHeaderBytes,
                                                 payload.size() - kPayloadHeaderBytes, head);
  std::memcpy(payload.data() + 8, &sum, 8);
}

template <class Change>
void expect_refused_segment(Change change) {
  auto segments = std::make_shared<std::vector<PathSegment>>(*some_segments(9));
  change((*segments)[4]);
  SegmentBlock block;
  block.chunks = {segments};
  const auto m = decode(bytes_of(SubmitTask{{1, 2}, 3, 4, std::move(block)}));
  EXPECT_FALSE(m);
}

TEST(HostilePeer, SendsNoRayThatEmbreeWouldChokeOn) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  expect_refused_segment([&](PathSegment& s) { s.origin.x = nan; });
  expect_refused_segment([&](PathSegment& s) { s.origin.y = kInfinity; });
  expect_refused_segment([&](PathSegment& s) { s.origin.z = 2e18f; });
  expect_refused_segment([&](PathSegment& s) { s.direction.x = nan; });
  expect_refused_segment([&](PathSegment& s) { s.direction = Vec3(0.f); });
  expect_refused_segment([&](PathSegment& s) { s.direction *= 3.f; });
  expect_refused_segment([&](PathSegment& s) { s.best.t = nan; });
  expect_refused_segment([&](PathSegment& s) { s.best.t = -1.f; });
}

TEST(HostilePeer, SendsNoOcclusionRayThatEmbreeWouldChokeOn) {
  for (const OcclusionRay& bad :
       {OcclusionRay{Vec3(kInfinity, 0, 0), Vec3(0, 0, 1), 1.f},
        OcclusionRay{Vec3(0.f), Vec3(0, 0, 0), 1.f}, OcclusionRay{Vec3(0.f), Vec3(0, 0, 1), -1.f},
        OcclusionRay{Vec3(0.f), Vec3(0, 0, 1), std::numeric_limits<float>::quiet_NaN()}}) {
    OcclusionBlock block;
    block.chunks = {std::make_shared<const std::vector<OcclusionRay>>(1, bad)};
    EXPECT_FALSE(decode(bytes_of(SubmitTask{{1, 2}, 3, 4, std::move(block)})));
  }
}

TEST(HostilePeer, SendsNoTimeThatIsNone) {
  for (const float bad : {kInfinity, -kInfinity, std::numeric_limits<float>::quiet_NaN()}) {
    SubmitTask m = some_rays(3);
    std::get<OcclusionBlock>(m.payload).times = {std::make_shared<const std::vector<float>>(std::vector<float>{0, bad, 1})};
    EXPECT_FALSE(decode(bytes_of(std::move(m))));
  }
}

TEST(HostilePeer, CannotMakeUsAllocateByACount) {
  // A count of four thousand million with a bulk of a few bytes.
  for (const Message& m : {Message(some_block(1)), Message(some_rays(1))}) {
    SubmitControl c;
    const bool segments = std::holds_alternative<SegmentBlock>(std::get<SubmitTask>(m).payload);
    c.set_category(segments ? TRACER : INTERSECTION);
    c.set_count(0xffffffffu);
    c.set_radiance_bytes(8);
    std::string control = c.SerializeAsString();
    std::vector<std::byte> payload(kPayloadHeaderBytes + control.size() + 64);
    const std::uint16_t type = 16, version = kProtocolVersion;
    const auto length = static_cast<std::uint32_t>(control.size());
    std::memcpy(payload.data(), &type, 2);
    std::memcpy(payload.data() + 2, &version, 2);
    std::memcpy(payload.data() + 4, &length, 4);
    std::memcpy(payload.data() + kPayloadHeaderBytes, control.data(), control.size());
    seal(payload);
    EXPECT_FALSE(decode(payload));
  }
}

TEST(HostilePeer, SendsNoAbsurdRendererTask) {
  EXPECT_FALSE(
      decode(bytes_of(SubmitTask{{}, 0, 0, RendererRange{1, 0, 0, 1u << 20, 1u << 20, 0, 1}})));
  EXPECT_FALSE(
      decode(bytes_of(SubmitTask{{}, 0, 0, RendererRange{1, 0, 0, 8, 8, 0, 0xffffffffu}})));
  EXPECT_FALSE(decode(bytes_of(SubmitTask{{}, 0, 0, RendererRange{1, 8, 0, 8, 8, 0, 1}})));
  EXPECT_TRUE(decode(bytes_of(SubmitTask{{}, 0, 0, RendererRange{1, 0, 0, 64, 64, 0, 16}})));
}

TEST(HostilePeer, SendsNoControlValueOutOfRange) {
  SceneHostMap map;
  map.set_part_count(3);
  map.add_holdings()->add_parts(3);
  EXPECT_FALSE(decode(bytes_of(map)));
  HostList list;
  list.add_hosts()->set_host(70000);
  EXPECT_FALSE(decode(bytes_of(list)));
  Status status;
  status.set_load_s(std::numeric_limits<double>::quiet_NaN());
  EXPECT_FALSE(decode(bytes_of(status)));
  EXPECT_FALSE(decode(bytes_of(JobStart())));
  BlobRequest request;
  request.set_bytes(kMaxBlobChunk + 1);
  EXPECT_FALSE(decode(bytes_of(request)));
  BlobChunk chunk;
  chunk.set_offset(10);
  chunk.set_total(12);
  chunk.set_data("abc");
  EXPECT_FALSE(decode(bytes_of(chunk)));
}

TEST(HostilePeer, RepliesThatContradictThemselvesAreRefused) {
  TracerReply r;
  r.count = 3;
  r.accepted = {0b001};
  r.tested = {1};  // two are missing
  EXPECT_FALSE(decode(bytes_of(Reply{{}, 0, r})));
  r.accepted = {0b1011};  // a bit behind the end
  r.tested = {};
  EXPECT_FALSE(decode(bytes_of(Reply{{}, 0, r})));
}

TEST(HostilePeer, NearestHitsThatCannotBeAreRefused) {
  const auto refused = [](auto change) {
    NearestReply r = some_nearest(kAnsweredNormals | kAnsweredUvs);
    change(r);
    return !decode(bytes_of(Reply{{}, 0, r}));
  };
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_FALSE(refused([](NearestReply&) {}));
  EXPECT_TRUE(refused([](NearestReply& r) { r.hits.pop_back(); }));
  EXPECT_TRUE(refused([](NearestReply& r) { r.found[1] |= 1u << 8; }));
  EXPECT_TRUE(refused([&](NearestReply& r) { r.hits[3].t = nan; }));
  EXPECT_TRUE(refused([](NearestReply& r) { r.hits[3].t = kInfinity; }));
  EXPECT_TRUE(refused([](NearestReply& r) { r.hits[3].t = -1; }));
  EXPECT_TRUE(refused([](NearestReply& r) { r.hits[3].u = 7; }));
  EXPECT_TRUE(refused([&](NearestReply& r) { r.hits[3].v = nan; }));
  EXPECT_TRUE(refused([](NearestReply& r) { r.hits[3].surface.p[2].y = 1e19f; }));
  EXPECT_TRUE(refused([&](NearestReply& r) { r.hits[0].surface.n[1].z = nan; }));
  EXPECT_TRUE(refused([](NearestReply& r) { r.hits[0].surface.uv[0].x = -kInfinity; }));
}

TEST(HostilePeer, OtherVersionsAndTypesAreNamed) {
  auto payload = bytes_of(Leave());
  payload[2] = std::byte{9};
  EXPECT_NE(decode(payload).error().find("version 9"), std::string::npos);
  payload = bytes_of(Leave());
  payload[0] = std::byte{200};
  seal(payload);
  EXPECT_NE(decode(payload).error().find("type 200"), std::string::npos);
}

TEST(HostilePeer, AnyChangedByteIsNoticed) {
  const auto good = bytes_of(some_block(3));
  for (std::size_t i = 0; i < good.size(); ++i) {
    auto bad = good;
    bad[i] ^= std::byte{1};
    EXPECT_FALSE(decode(bad)) << i;
  }
}

TEST(HostilePeer, AnyTruncationIsNoticed) {
  const auto good = bytes_of(some_block(3));
  for (std::size_t n = 0; n < good.size(); ++n) EXPECT_FALSE(decode(std::span(good).first(n))) << n;
}

// Mutations that pass the checksum: nothing may crash, and what is accepted must be encodable
// again.
TEST(HostilePeer, SealedRandomChangesDoNoHarm) {
  TracerReply tracer;
  tracer.count = 3;
  tracer.accepted = {1};
  tracer.tested = {1, 2};
  RendererReply renderer;
  renderer.sums.resize(4);
  PathEnds ends;
  ends.batch.ends.resize(5);
  SceneHostMap map;
  map.set_part_count(7);
  map.add_hosts()->set_host(1);
  map.add_holdings()->add_parts(6);
  const std::vector<std::vector<std::byte>> corpus = {
      bytes_of(some_block(4)),
      bytes_of(some_block(2, 0)),
      bytes_of(some_rays(3)),
      bytes_of(Reply{{1, 2}, 3, tracer}),
      bytes_of(Reply{{1, 2}, 3, renderer}),
      bytes_of(ends),
      bytes_of(map),
      bytes_of(SubmitTask{{1, 2}, 3, 4, RendererRange{1, 0, 0, 8, 8, 0, 4}})};
  std::size_t accepted = 0;
  for (std::uint64_t round = 0; round < 60000; ++round) {
    auto bytes = corpus[round % corpus.size()];
    std::uint64_t r = mix64(round + 99);
    for (int change = 1 + static_cast<int>(r % 4); change > 0; --change) {
      r = mix64(r);
      const std::size_t at = (r >> 8) % bytes.size();
      switch (r % 8) {
        case 0:
          bytes.resize(std::max(kPayloadHeaderBytes, at));
          break;
        case 1:
          bytes.insert(bytes.begin() + static_cast<std::ptrdiff_t>(at), std::byte{0xff});
          break;
        default:
          bytes[at] = static_cast<std::byte>(r >> 40);
      }
    }
    const std::uint16_t version = kProtocolVersion;
    std::memcpy(bytes.data() + 2, &version, 2);
    seal(bytes);
    const auto m = decode(bytes);
    if (!m) continue;
    ++accepted;
    EXPECT_TRUE(decode(*encode(*m))) << "round " << round;
  }
  EXPECT_GT(accepted, 1000u);
  EXPECT_LT(accepted, 59000u);
}

}  // namespace
}  // namespace cloudrenderer::wire
