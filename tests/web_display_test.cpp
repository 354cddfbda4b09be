#include "web/display.h"

#include <gtest/gtest.h>

#include <cstring>

#include "base/error.h"

namespace cloudrenderer {
namespace {

std::uint32_t word(const std::string& bytes, std::size_t at) {
  std::uint32_t w = 0;
  std::memcpy(&w, bytes.data() + at, sizeof w);
  return w;
}

// The layout that tev's README gives: length, kind, whether to bring it to the front, name, ...
TEST(Tev, AnImageIsMadeWithItsChannels) {
  const std::string m = tev::create_image("a", 640, 480);
  EXPECT_EQ(word(m, 0), m.size());
  EXPECT_EQ(m.substr(4, 4), std::string("\x04\x01" "a\0", 4));
  EXPECT_EQ(word(m, 8), 640u);
  EXPECT_EQ(word(m, 12), 480u);
  EXPECT_EQ(word(m, 16), 3u);
  EXPECT_EQ(m.substr(20), std::string("R\0G\0B\0", 6));
}

TEST(Tev, ATileIsOneMessageAChannel) {
  const std::string m = tev::update_tile("a", 32, 64, 2, 1, {Rgb(1, 2, 3), Rgb(4, 5, 6)});
  const std::size_t one = word(m, 0);
  ASSERT_EQ(m.size(), 3 * one);
  const std::string green = m.substr(one, one);
  EXPECT_EQ(green.substr(4, 6), std::string("\x03\0a\0G\0", 6));
  EXPECT_EQ(word(green, 10), 32u);
  EXPECT_EQ(word(green, 14), 64u);
  EXPECT_EQ(word(green, 18), 2u);
  EXPECT_EQ(word(green, 22), 1u);
  float values[2];
  std::memcpy(values, green.data() + 26, sizeof values);
  EXPECT_EQ(values[0], 2.f);
  EXPECT_EQ(values[1], 5.f);
}

TEST(Display, NobodyThereIsSaid) {
  try {
    Display display({"127.0.0.1", 1}, "scene");
    FAIL() << "nothing was thrown";
  } catch (const UsageError& e) {
    EXPECT_NE(std::string(e.what()).find("--display 127.0.0.1:1: no viewer listens there"), std::string::npos) << e.what();
  }
}

}  // namespace
}  // namespace cloudrenderer
