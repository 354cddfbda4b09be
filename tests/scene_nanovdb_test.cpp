// The reader of NanoVDB files against the library's own writer, and against broken files.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <random>

#include "base/log.h"
#include "scene/cloud_voxels.h"
#include "scene/nanovdb.h"
#include "nanovdb_support.h"

namespace cloudrenderer {
namespace {

constexpr unsigned kSeed = 17;

// A ball of densities with a block of one value in it that becomes a tile, and temperatures that lie elsewhere.
float density(int x, int y, int z) {
  if (x >= 128 && x < 136 && y >= 0 && y < 8 && z >= -8 && z < 0) return 3.f;
  const float r = std::sqrt(static_cast<float>((x - 10) * (x - 10) + y * y + (z + 5) * (z + 5)));
  return r < 23 ? 1.f - r / 23 : 0.f;
}
float temperature(int x, int y, int z) { return x > -4 && x < 9 && y > -9 && y < 5 && z > -3 && z < 12 ? static_cast<float>(x + 2 * y - z) : 0.f; }

template <class F>
nanovdb_test::Handle make_grid(const char* name, double voxel, F value) {
  return nanovdb_test::make_grid(name, voxel, {-40, -30, -35}, {140, 30, 30}, value);
}

class NanoVdbTest : public ::testing::Test {
 protected:
  static std::string path() {
    return (std::filesystem::temp_directory_path() / ("nanovdb_test_" + std::to_string(getpid()) + ".nvdb")).string();
  }
  static void write(nanovdb::io::Codec codec, bool warm, double second_voxel = 0.25) {
    std::vector<nanovdb_test::Handle> grids;
    grids.push_back(make_grid("density", 0.25, density));
    if (warm) grids.push_back(make_grid("temperature", second_voxel, temperature));
    nanovdb::io::writeGrids(path(), grids, codec);
  }
  ~NanoVdbTest() override { std::filesystem::remove(path()); }
};

TEST_F(NanoVdbTest, ReadsWhatTheLibraryWrites) {
  for (const auto codec : {nanovdb::io::Codec::NONE, nanovdb::io::Codec::ZIP}) {
    write(codec, true);
    const auto vdb = NanoVdb::open(path(), {"density", "temperature"}, {});
    ASSERT_TRUE(vdb->has(1));
    EXPECT_EQ(vdb->channels(), 2u);
    EXPECT_EQ(vdb->first(), glm::ivec3(-12, -22, -27));
    EXPECT_EQ(glm::ivec3(vdb->size()), glm::ivec3(136 + 12, 45, 45));
    const Vec3 corner = vdb->index_to_world().point(Vec3(2, 4, 8));
    EXPECT_EQ(corner, Vec3(1.5f, 3.f, 5.f));
    const glm::ivec3 begin(-1), end = glm::ivec3(vdb->size()) + 1, n = end - begin;
    std::vector<float> d(static_cast<std::size_t>(n.x * n.y * n.z)), t(d.size());
    vdb->read(0, begin, end, d.data());
    vdb->read(1, begin, end, t.data());
    std::size_t i = 0;
    for (int z = begin.z; z < end.z; ++z)
      for (int y = begin.y; y < end.y; ++y)
        for (int x = begin.x; x < end.x; ++x, ++i) {
          const glm::ivec3 at = vdb->first() + glm::ivec3(x, y, z);
          ASSERT_EQ(d[i], density(at.x, at.y, at.z)) << at.x << ' ' << at.y << ' ' << at.z;
          ASSERT_EQ(t[i], temperature(at.x, at.y, at.z)) << at.x << ' ' << at.y << ' ' << at.z;
        }
  }
}

TEST_F(NanoVdbTest, SamplesAnotherGridWhereTheFirstOneLies) {
  write(nanovdb::io::Codec::NONE, true, 0.5);
  const auto vdb = NanoVdb::open(path(), {"density", "temperature"}, {});
  // Index (6, -4, 2) of the first one is (3, -2, 1) of the other; (7, -4, 2) lies between two samples.
  const glm::ivec3 at = glm::ivec3(6, -4, 2) - vdb->first();
  std::array<float, 2> t{};
  vdb->read(1, at, at + glm::ivec3(2, 1, 1), t.data());
  EXPECT_FLOAT_EQ(t[0], temperature(3, -2, 1));
  EXPECT_FLOAT_EQ(t[1], 0.5f * (temperature(3, -2, 1) + temperature(4, -2, 1)));
}

TEST_F(NanoVdbTest, SaysWhatIsMissing) {
  const auto message = [](const std::string& name) {
    try {
      NanoVdb::open(path(), {name}, FileLocation{});
    } catch (const SceneError& e) {
      return std::string(e.what());
    }
    return std::string("nothing");
  };
  EXPECT_NE(message("density").find("cannot be opened"), std::string::npos);
  write(nanovdb::io::Codec::NONE, false);
  EXPECT_FALSE(NanoVdb::open(path(), {"density", "temperature"}, {})->has(1));
  EXPECT_NE(message("heat").find("has no grid \"heat\""), std::string::npos);
  std::ofstream(path(), std::ios::binary) << "this is no grid at all";
  EXPECT_NE(message("density").find("is no NanoVDB file"), std::string::npos);
}

// Whatever a file says: an error, or numbers.
TEST_F(NanoVdbTest, SurvivesBrokenFiles) {
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  for (const auto codec : {nanovdb::io::Codec::NONE, nanovdb::io::Codec::ZIP}) {
    write(codec, true);
    std::ifstream in(path(), std::ios::binary);
    const std::string good((std::istreambuf_iterator<char>(in)), {});
    int read = 0;
    for (int round = 0; round < 150; ++round) {
      std::string bad = good;
      if (random() % 4 == 0) bad.resize(random() % bad.size());
      // Most changes in front, where the headers and the tree's root are.
      for (unsigned long change = random() % 6; change < 6 && !bad.empty(); ++change) {
        const std::size_t reach = random() % 2 ? std::min<std::size_t>(bad.size(), 2400) : bad.size();
        bad[random() % reach] = static_cast<char>(random() % 3 ? random() : 0xff);
      }
      std::ofstream(path(), std::ios::binary | std::ios::trunc) << bad;
      try {
        const auto vdb = NanoVdb::open(path(), {"density", "temperature"}, {});
        std::vector<float> out(9 * 9 * 9);
        for (std::uint32_t c = 0; c < vdb->channels(); ++c)
          for (int k = 0; k < 40; ++k) {
            const glm::ivec3 at(glm::uvec3(random(), random(), random()) % vdb->size());
            vdb->read(c, at - 1, at + 8, out.data());
            for (const float v : out) EXPECT_TRUE(std::isfinite(v));
          }
        ++read;
      } catch (const SceneError&) {
      }
    }
    EXPECT_LT(read, 150);
  }
}

// pbrt-v4's formula at a few points, worked out by hand where its noise is 0, and its bounds.
TEST(CloudVoxels, ThinWithTheHeight) {
  GridLayout layout;
  layout.size = {20, 20, 20};
  const CloudVoxels cloud(layout, {2.f, 0.f, 0.f});  // frequency 0: no noise
  std::vector<float> column(20);
  cloud.read(0, {3, 0, 4}, {4, 20, 5}, column.data());
  for (int y = 0; y < 20; ++y) {
    const float height = (static_cast<float>(y) + .5f) / 20;
    EXPECT_NEAR(column[static_cast<std::size_t>(y)], std::min(1.f, 2 * std::max(0.f, .5f - height)), 1e-6f);
  }
  const CloudVoxels wild(layout, {5.f, 1.f, 7.f});
  std::vector<float> all(22 * 22 * 22);
  wild.read(0, glm::ivec3(-1), glm::ivec3(21), all.data());
  float most = 0;
  for (const float v : all) {
    EXPECT_TRUE(v >= 0.f && v <= 1.f);
    most = std::max(most, v);
  }
  EXPECT_EQ(most, 1.f);
  EXPECT_EQ(CloudVoxels::samples(1, {1, 1, 5}), 235u);
  EXPECT_EQ(CloudVoxels::samples(1e30f, {1, 1, 5}), 384u);
}

}  // namespace
}  // namespace cloudrenderer
