#include "images/images.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <thread>

#include "base/error.h"

namespace cloudrenderer {
namespace {

struct Images : testing::Test {
  Images() { std::filesystem::create_directories(folder); }
  ~Images() override { std::filesystem::remove_all(folder); }
  std::string write(const std::string& name, const std::vector<unsigned char>& bytes) const {
    const std::filesystem::path path = folder / name;
    std::ofstream(path, std::ios::binary).write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    return path;
  }
  std::filesystem::path folder = std::filesystem::temp_directory_path() / ("images_test" + std::to_string(::getpid()));
  std::string why;
};

// Hosts read the textures of a scene on several threads. (The first case: later ones find the module loaded.)
TEST_F(Images, AnyThreadMayBeTheFirst) {
  std::vector<std::thread> threads;
  for (int i = 0; i < 8; ++i)
    threads.emplace_back([] {
      std::string reason;
      std::vector<unsigned char> file;
      const std::uint8_t rgb[3]{1, 2, 3};
      EXPECT_TRUE(encode_bytes("a.png", 1, 1, rgb, file, reason)) << reason;
    });
  for (std::thread& t : threads) t.join();
}

TEST_F(Images, WhatIsEncodedIsReadAgain) {
  const std::vector<std::uint8_t> rgb{255, 0, 10, 20, 30, 40, 1, 2, 3, 4, 5, 6};
  for (const char* name : {"a.png", "a.tga"}) {
    std::vector<unsigned char> file;
    ASSERT_TRUE(encode_bytes(name, 2, 2, rgb.data(), file, why)) << why;
    const auto image = open_image(write(name, file), false, why);
    ASSERT_TRUE(image) << why;
    EXPECT_EQ(image->info().width, 2);
    EXPECT_EQ(image->info().height, 2);
    EXPECT_EQ(image->info().channels, 3);
    EXPECT_EQ(image->info().rgb, (std::array{0, 1, 2}));
    EXPECT_TRUE(image->info().bytes);
    std::vector<std::uint8_t> read(rgb.size());
    ASSERT_TRUE(image->read(3, read.data(), why)) << why;
    EXPECT_EQ(read, rgb);
    std::vector<float> red(4);
    ASSERT_TRUE(image->read(1, red.data(), why)) << why;
    EXPECT_EQ(red[0], 1.f);
  }
}

TEST_F(Images, SayWhatIsWrongWithAFile) {
  EXPECT_FALSE(open_image(folder / "none.png", false, why));
  EXPECT_NE(why, "");
  why.clear();
  EXPECT_FALSE(open_image(write("broken.png", {1, 2, 3}), true, why));
  EXPECT_NE(why, "");
  why.clear();
  std::vector<unsigned char> file;
  const std::uint8_t rgb[3]{};
  EXPECT_FALSE(encode_bytes("a.nothing", 1, 1, rgb, file, why));
  EXPECT_NE(why, "");
}

// A picture of 36 million pixels in a file of some kilobytes.
TEST_F(Images, WhatIsTooLargeToReadIsRefused) {
  std::vector<unsigned char> file;
  ASSERT_TRUE(encode_bytes("a.png", 6000, 6000, std::vector<std::uint8_t>(108'000'000).data(), file, why)) << why;
  EXPECT_LT(file.size(), 1'000'000u);
  const std::string path = write("a.png", file);
  EXPECT_TRUE(open_image(path, true, why)) << why;
  limit_images(0);  // half a gigabyte remains
  try {
    open_image(path, true, why);
    ADD_FAILURE();
  } catch (const ClusterError& e) {
    EXPECT_STREQ(e.what(), ("to read the 6000 x 6000 pixels of " + path + " takes 514 MiB, and this host may use 512 MiB").c_str());
  }
  limit_images(std::uint64_t{2} << 30);
  EXPECT_TRUE(open_image(path, true, why)) << why;
  limit_images(~std::uint64_t{0});
}

}  // namespace
}  // namespace cloudrenderer
