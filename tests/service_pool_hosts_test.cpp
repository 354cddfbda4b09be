// What the service takes from what hosts of its pool say.
#include "service/pool_hosts.h"

#include <gtest/gtest.h>

namespace cloudrenderer {
namespace {

PoolHost host(std::uint64_t words, double cpu_s, bool working) {
  PoolHost h;
  h.name = "a";
  h.threads = 2;
  h.words = words;
  PoolUsage use;
  use.cpu_s = cpu_s;
  use.bytes_sent = 7;
  use.working = working;
  h.jobs = {{"mine.17.3", use}, {"mine.17.4", use}, {"other.17.3", use}, {"mine.x", use}, {"mine.17", use}};
  return h;
}

TEST(PoolWords, TellFramesOfTheServiceOnly) {
  PoolWords words("mine.");
  const ServiceHost h = words.take({{5, host(1, 2, false)}}).at(5);
  EXPECT_EQ(h.name, "a");
  EXPECT_EQ(h.threads, 2u);
  ASSERT_EQ(h.used.size(), 2u);
  EXPECT_DOUBLE_EQ(h.used.at({17, 3}).cpu_s, 2);
  EXPECT_DOUBLE_EQ(h.used.at({17, 4}).bytes, 7);
}

TEST(PoolWords, SayOnceWhatWasUsedAndAlwaysWhoWorks) {
  PoolWords words("mine.");
  EXPECT_EQ(words.take({{5, host(1, 2, true)}}).at(5).working, 5u);
  const ServiceHost again = words.take({{5, host(1, 2, true)}}).at(5);
  EXPECT_EQ(again.working, 5u) << "it works on, though it has said nothing new";
  EXPECT_TRUE(again.used.empty());
  EXPECT_DOUBLE_EQ(words.take({{5, host(2, 3, true)}}).at(5).used.at({17, 3}).cpu_s, 3);
}

TEST(PoolWords, AHostThatComesBackIsHeardAnew) {
  PoolWords words("mine.");
  words.take({{5, host(1, 2, true)}});
  EXPECT_TRUE(words.take({}).empty());
  EXPECT_FALSE(words.take({{5, host(1, 2, true)}}).at(5).used.empty());
}

TEST(PoolWords, WhoHasLeftIsNotHere) {
  PoolHost gone = host(1, 2, true), leaving = gone;
  gone.left_s = 3;
  leaving.leaving = true;
  PoolWords words("mine.");
  const auto hosts = words.take({{5, gone}, {6, leaving}, {7, host(1, 2, true)}});
  EXPECT_FALSE(hosts.at(5).here);
  EXPECT_FALSE(hosts.at(6).here);
  EXPECT_TRUE(hosts.at(7).here);
}

}  // namespace
}  // namespace cloudrenderer
