#include <gtest/gtest.h>

#include "base/error.h"
#include "net/address.h"

namespace cloudrenderer {
namespace {

TEST(Address, ReadsHostsNumbersAndBrackets) {
  EXPECT_EQ(Address::parse("10.0.0.1:7800"), (Address{"10.0.0.1", 7800}));
  EXPECT_EQ(Address::parse("render-7.local:1"), (Address{"render-7.local", 1}));
  EXPECT_EQ(Address::parse("[::1]:65535"), (Address{"::1", 65535}));
  EXPECT_EQ(Address::parse(":0"), (Address{"", 0}));
}

TEST(Address, SaysWhatIsWrong) {
  for (const char* text : {"", "host", "host:", "host:x", "host:65536", "host:-1", "::1:80",
                           "[::1:80", "host:80 ", "[[::1]]:80", "ho[st]:80"})
    EXPECT_THROW(Address::parse(text), UsageError) << text;
}

TEST(Address, WritesWhatItReads) {
  for (const char* text : {"10.0.0.1:7800", "[fe80::1]:9", "name:80"})
    EXPECT_EQ(Address::parse(text).to_string(), text);
}

TEST(Address, KnowsTheLoopback) {
  EXPECT_TRUE(Address::parse("127.0.0.1:1").is_loopback());
  EXPECT_TRUE(Address::parse("[::1]:1").is_loopback());
  EXPECT_FALSE(Address::parse("10.0.0.1:1").is_loopback());
  EXPECT_FALSE(Address::parse(":1").is_loopback());
}

}  // namespace
}  // namespace cloudrenderer
