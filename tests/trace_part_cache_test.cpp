// Parts that scenes of one process share.
#include <gtest/gtest.h>

#include <atomic>
#include <memory>
#include <stdexcept>
#include <thread>
#include <vector>

#include "trace/part_cache.h"
#include "trace/resident.h"

namespace cloudrenderer {
namespace {

struct Arrays {
  std::vector<Vec3> positions;
  std::vector<Triangle> triangles;
  std::vector<MeshChunk> chunks;
};

// A square of 2 n^2 triangles at y = 0, with an alpha texture.
Part square(std::uint32_t n) {
  auto a = std::make_shared<Arrays>();
  for (std::uint32_t z = 0; z <= n; ++z)
    for (std::uint32_t x = 0; x <= n; ++x) a->positions.emplace_back(static_cast<float>(x), 0.f, static_cast<float>(z));
  for (std::uint32_t z = 0; z < n; ++z)
    for (std::uint32_t x = 0; x < n; ++x) {
      const std::uint32_t p = z * (n + 1) + x;
      a->triangles.push_back({p, p + 1, p + n + 1});
      a->triangles.push_back({p + n + 1, p + 1, p + n + 2});
    }
  a->positions.reserve(a->positions.size() + 2);
  MeshChunk c;
  c.shape = 1;
  c.triangle_count = static_cast<std::uint32_t>(a->triangles.size());
  c.vertex_count = static_cast<std::uint32_t>(a->positions.size());
  c.alpha_texture = 0;
  a->chunks.push_back(c);
  Part p;
  p.positions = a->positions;
  p.triangles = a->triangles;
  p.chunks = a->chunks;
  p.owner = std::move(a);
  return p;
}

constexpr std::uint32_t kSide = 60;
constexpr auto kFine = [](const Part&) {};

PartKey key(std::uint64_t file) { return {file, 1000, 0, false}; }

struct Scene {
  explicit Scene(const std::shared_ptr<PartCache>& cache, AlphaFunction alpha = nullptr) : resident({1, "avx2", std::move(alpha), cache}) {}
  bool load(std::uint32_t part, std::uint64_t file) {
    return resident.share_part(PartId{part}, key(file), BvhForm::fast, [] { return square(kSide); }, kFine);
  }
  Resident resident;
};

std::shared_ptr<PartCache> cache_of(std::uint64_t memory = ~std::uint64_t{0}) {
  return std::make_shared<PartCache>(PartCache::Options{1, "avx2", memory});
}

// What one square takes.
std::uint64_t one_square() {
  const auto cache = cache_of();
  Scene scene(cache);
  scene.load(1, 7);
  return cache->bytes();
}

TEST(PartCache, TwoScenesLoadAPartOnceAndShareItsBytes) {
  prepare_compute_thread();
  const auto cache = cache_of();
  Scene a(cache), b(cache);
  EXPECT_FALSE(a.load(1, 7));
  const std::uint64_t bytes = cache->bytes();
  EXPECT_TRUE(b.load(5, 7));
  EXPECT_EQ(cache->bytes(), bytes);
  EXPECT_EQ(a.resident.bytes(), b.resident.bytes());
  EXPECT_DOUBLE_EQ(a.resident.own_bytes(), 0.5 * static_cast<double>(a.resident.bytes()));
  EXPECT_FALSE(b.load(2, 8));  // another file
  b.resident.unload_part(PartId{5});
  EXPECT_DOUBLE_EQ(a.resident.own_bytes(), static_cast<double>(a.resident.bytes()));
}

TEST(PartCache, EachSceneAsksItsOwnAlphaTextures) {
  prepare_compute_thread();
  const auto cache = cache_of();
  const auto from = [](float x) { return [x](std::uint32_t, const Vec2&, const Vec3& p) { return p.x < x ? 0.f : 1.f; }; };
  Scene a(cache, from(10)), b(cache, from(20)), none(cache);
  EXPECT_FALSE(a.load(1, 7));
  EXPECT_TRUE(b.load(1, 7));
  EXPECT_TRUE(none.load(1, 7));
  const auto meets = [](const Scene& s, float x) {
    const TraceRay ray{{x, 5, 3.3f}, kInfinity, {0, -1, 0}};
    Hit hit;
    const bool met = s.resident.snapshot()->intersect(1, ray, hit);
    EXPECT_EQ(s.resident.snapshot()->occluded(1, ray), met);
    return met;
  };
  EXPECT_FALSE(meets(a, 5));
  EXPECT_TRUE(meets(a, 15));
  EXPECT_FALSE(meets(b, 15));
  EXPECT_TRUE(meets(b, 25));
  EXPECT_TRUE(meets(none, 5));
}

TEST(PartCache, WhatASceneLeavesStaysForTheNextWhileThereIsRoom) {
  const std::uint64_t one = one_square();
  const auto cache = cache_of(5 * one / 2);
  {
    Scene first(cache);
    first.load(1, 7);
    first.load(2, 8);
  }
  EXPECT_TRUE(cache->has(key(7)));
  Scene second(cache);
  EXPECT_TRUE(second.load(1, 7));
  // A third one needs room: the one that nobody uses goes.
  EXPECT_TRUE(cache->reserve(&second, {{key(9), one}}));
  EXPECT_FALSE(cache->has(key(8)));
  EXPECT_FALSE(second.load(3, 9));
  cache->release(&second);
  EXPECT_FALSE(cache->reserve(&second, {{key(10), one}}));
  EXPECT_TRUE(cache->reserve(&second, {{key(9), one}}));  // is there
  EXPECT_LE(cache->peak_bytes(), cache->budget());
}

TEST(PartCache, WhatIsReservedIsTakenFromTheOthersAndStays) {
  const std::uint64_t one = one_square();
  const auto cache = cache_of(5 * one / 2);
  Scene a(cache), b(cache);
  {
    Scene before(cache);
    before.load(1, 7);
  }
  EXPECT_TRUE(cache->reserve(&a, {{key(7), one}}));  // there, so that it takes no more
  EXPECT_TRUE(cache->reserve(&b, {{key(8), one}}));
  EXPECT_TRUE(cache->has(key(7)));
  EXPECT_FALSE(cache->reserve(&cache, {{key(9), one}}));  // but for what is reserved there would be room
  EXPECT_TRUE(cache->has(key(7)));
  EXPECT_TRUE(a.load(1, 7));
  cache->release(&b);
  cache->add_other(static_cast<std::int64_t>(one));
  EXPECT_FALSE(cache->reserve(&b, {{key(8), one}}));
  cache->add_other(-static_cast<std::int64_t>(one));
}

TEST(PartCache, PartsOfOneSceneGoWithIt) {
  const auto cache = cache_of();
  const std::uint64_t before = cache->bytes();
  {
    Scene scene(cache);
    scene.resident.load_part(PartId{0}, square(kSide));
    EXPECT_GT(cache->bytes(), before);
  }
  cache->tidy();
  EXPECT_EQ(cache->bytes(), before);
}

TEST(PartCache, WhatABatchStillTracesIsNotDropped) {
  const auto cache = cache_of(1);
  std::shared_ptr<const ResidentSet> batch;
  {
    Scene scene(cache);
    scene.load(1, 7);
    batch = scene.resident.snapshot();
  }
  cache->tidy();
  EXPECT_TRUE(cache->has(key(7)));
  batch.reset();
  cache->tidy();
  EXPECT_FALSE(cache->has(key(7)));
}

TEST(PartCache, AFailureIsForgotten) {
  const auto cache = cache_of();
  Scene scene(cache);
  const auto fail = []() -> Part { throw std::runtime_error("no such file"); };
  EXPECT_THROW(scene.resident.share_part(PartId{1}, key(7), BvhForm::fast, fail, kFine), std::runtime_error);
  EXPECT_FALSE(scene.load(1, 7));
  const auto bad = [](const Part&) { throw std::runtime_error("no such material"); };
  Scene other(cache);
  EXPECT_THROW(other.resident.share_part(PartId{1}, key(7), BvhForm::fast, fail, bad), std::runtime_error);
  EXPECT_DOUBLE_EQ(scene.resident.own_bytes(), static_cast<double>(scene.resident.bytes()));
}

TEST(PartCache, ManyThreadsThatWantTheSameLoadItOnce) {
  const auto cache = cache_of();
  std::atomic<int> reads = 0;
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&] {
      for (int i = 0; i < 20; ++i) {
        Scene scene(cache);
        for (std::uint64_t file = 1; file <= 3; ++file)
          scene.resident.share_part(PartId{1}, key(file), BvhForm::fast, [&] {
            ++reads;
            return square(10);
          }, kFine);
      }
    });
  for (auto& t : threads) t.join();
  EXPECT_EQ(reads, 3);
}

}  // namespace
}  // namespace cloudrenderer
