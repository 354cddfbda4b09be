// Users get their parts of the processors though their frames begin and end all the time.
#include <gtest/gtest.h>

#include <map>
#include <random>
#include <string>

#include "service/fair_shares.h"

namespace cloudrenderer {
namespace {

using Parts = std::map<std::string, double>;

// Processors that are shared out by weight among those that can compute, in steps of a tenth of a second; what was used is
// told once a second.
class Processors {
 public:
  explicit Processors(Parts parts) : parts_(std::move(parts)) {}
  template <class CanCompute>
  void run(double seconds, const CanCompute& can_compute) {
    for (int step = 0; step < seconds * 10; ++step) {
      now += 0.1;
      double whole = 0;
      for (const auto& [user, part] : parts_) whole += can_compute(user) ? part * fair.factor(user) : 0;
      for (const auto& [user, part] : parts_)
        if (can_compute(user)) {
          const double cpu = 2 * 0.1 * part * fair.factor(user) / whole;
          used[user] += cpu;
          untold_[user] += cpu;
        }
      if (++steps_ % 10 == 0)
        for (auto& [user, cpu] : untold_) fair.used(user, std::exchange(cpu, 0));
      fair.tick(now, parts_);
    }
  }
  double share(const std::string& user) const {
    double sum = 0;
    for (const auto& [other, cpu] : used) sum += cpu;
    return used.at(user) / sum;
  }

  FairShares fair;
  double now = 1000;
  Parts used;

 private:
  const Parts parts_;
  Parts untold_;
  int steps_ = 0;
};

TEST(FairShares, WhoHasTheirPartsAreLeftAlone) {
  Processors p({{"ann", 1}, {"bob", 3}});
  p.run(30, [](const auto&) { return true; });
  EXPECT_NEAR(p.fair.factor("ann"), 1, 0.05);
  EXPECT_NEAR(p.fair.factor("bob"), 1, 0.05);
  EXPECT_NEAR(p.share("ann"), 0.25, 0.005);
}

TEST(FairShares, WhatAUserMissesIsMadeUpFor) {
  Processors p({{"ann", 1}, {"bob", 1}});
  p.run(10, [](const auto&) { return true; });
  p.run(3, [](const auto& user) { return user == "bob"; });
  EXPECT_GT(p.fair.factor("ann"), 1.3);
  EXPECT_LT(p.fair.factor("bob"), 0.8);
  p.run(27, [](const auto&) { return true; });
  EXPECT_NEAR(p.share("ann"), 0.5, 0.01);
  EXPECT_NEAR(p.fair.factor("ann"), 1, 0.1);
}

TEST(FairShares, NobodySavesUp) {
  FairShares fair;
  fair.tick(1, {{"ann", 1}, {"bob", 1}});
  for (int t = 2; t < 20; ++t) {
    fair.used("bob", 1);
    fair.tick(t, {{"bob", 1}});  // ann has no work
  }
  fair.tick(20, {{"ann", 1}, {"bob", 1}});
  EXPECT_EQ(fair.factor("ann"), 1);
  EXPECT_EQ(fair.factor("cy"), 1) << "nobody knows of this one";
}

TEST(FairShares, ACatchingUpUserShutsNobodyOut) {
  Processors p({{"ann", 1}, {"bob", 1}});
  p.run(600, [](const auto& user) { return user == "bob"; });
  EXPECT_LE(p.fair.factor("ann"), 4);
  EXPECT_GE(p.fair.factor("bob"), 0.25);
  const double bob = p.used["bob"];
  p.run(10, [](const auto&) { return true; });
  EXPECT_GT(p.used["bob"] - bob, 10 * 2 * 0.05);
}

// Frames of a few seconds, before each of which nothing is computed for a while, differently long for each user.
TEST(FairShares, PausesBetweenFramesCostNobodyTheirPart) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    std::mt19937 random(seed);
    const Parts parts{{"a", 1}, {"b", 1}, {"c", 2}, {"d", 2}, {"e", 4}};
    Processors p(parts);
    std::map<std::string, std::pair<double, double>> frames;  // when the frame begins to compute, and ends
    const auto can_compute = [&](const std::string& user) {
      auto& [begins, ends] = frames[user];
      if (p.now > ends) {
        begins = p.now + std::uniform_real_distribution<double>(0, user == "a" || user == "e" ? 1.5 : 0.3)(random);
        ends = begins + std::uniform_real_distribution<double>(1, 4)(random);
      }
      return p.now >= begins;
    };
    p.run(120, can_compute);
    for (const auto& [user, part] : parts) EXPECT_NEAR(p.share(user) / (part / 10), 1, 0.1) << user;
  }
}

}  // namespace
}  // namespace cloudrenderer
