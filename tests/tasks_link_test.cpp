#include <gtest/gtest.h>

#include "base/random.h"
#include "tasks/link.h"

namespace cloudrenderer {
namespace {

wire::Bytes payload(std::size_t n) { return std::make_shared<const std::vector<std::byte>>(n + 1); }

struct Pair {
  explicit Pair(LinkOptions o = {}) : a(1, 2, o), b(2, 1, o) {}
  Link a, b;
  std::vector<wire::Bytes> at_a, at_b;
  void to_b(const Link::Frame& f, double now) { b.receive(f.link, f.payload, now, at_b); }
  void to_a(const Link::Frame& f, double now) { a.receive(f.link, f.payload, now, at_a); }
};

TEST(Link, DeliversInOrderAndOnce) {
  Pair p;
  for (std::size_t i = 0; i < 3; ++i) p.a.send(payload(i));
  std::vector<Link::Frame> frames;
  while (auto f = p.a.next(0)) frames.push_back(*f);
  ASSERT_EQ(frames.size(), 3u);
  p.to_b(frames[2], 0);
  p.to_b(frames[0], 0);
  EXPECT_EQ(p.at_b.size(), 1u);
  p.to_b(frames[1], 0);
  p.to_b(frames[1], 0);
  p.to_b(frames[0], 0);
  ASSERT_EQ(p.at_b.size(), 3u);
  for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(p.at_b[i]->size(), i + 1);
  EXPECT_EQ(p.b.counters().duplicates, 2u);
}

TEST(Link, AcknowledgesAfterAWhileAndThenForgets) {
  Pair p;
  p.a.send(payload(0));
  p.to_b(*p.a.next(0), 0);
  EXPECT_FALSE(p.a.drained());
  EXPECT_FALSE(p.b.next(0.001));
  EXPECT_LE(p.b.deadline(), 0.02);
  const auto ack = p.b.next(0.03);
  ASSERT_TRUE(ack);
  EXPECT_FALSE(ack->payload);
  EXPECT_FALSE(p.b.next(0.03));
  p.to_a(*ack, 0.04);
  EXPECT_TRUE(p.a.drained());
}

TEST(Link, NeedsNoAcknowledgementOfItsOwnWhereDataFlowBack) {
  Pair p;
  p.a.send(payload(0));
  p.to_b(*p.a.next(0), 0);
  p.b.send(payload(0));
  p.to_a(*p.b.next(0), 0);
  EXPECT_TRUE(p.a.drained());
  EXPECT_FALSE(p.b.next(1));
}

TEST(Link, SendsAgainOnlyWhatTheWindowLacks) {
  LinkOptions o;
  o.retransmit_after = 1;
  o.ack_frames = 1;
  Pair p(o);
  std::vector<Link::Frame> frames;
  for (std::size_t i = 0; i < 4; ++i) p.a.send(payload(i));
  while (auto f = p.a.next(0)) frames.push_back(*f);
  p.to_b(frames[0], 0);
  p.to_b(frames[2], 0);  // the second and fourth are lost
  p.to_a(*p.b.next(0), 0);
  std::vector<std::uint32_t> again;
  while (auto f = p.a.next(1.5)) again.push_back(f->link.sequence);
  EXPECT_EQ(again, (std::vector<std::uint32_t>{2, 4}));
}

TEST(Link, WaitsLongerEachTime) {
  LinkOptions o;
  o.retransmit_after = 1;
  Pair p(o);
  p.a.send(payload(0));
  ASSERT_TRUE(p.a.next(0));
  EXPECT_FALSE(p.a.next(0.9));
  EXPECT_TRUE(p.a.next(1.1));
  EXPECT_FALSE(p.a.next(2.5));
  EXPECT_TRUE(p.a.next(3.2));
}

TEST(Link, SendsNothingAgainOverTcpUntilReconnected) {
  Pair p;
  p.a.send(payload(0));
  p.a.send(payload(1));
  const auto first = *p.a.next(0);
  (void)p.a.next(0);
  EXPECT_FALSE(p.a.next(1e9));
  p.to_b(first, 0);
  p.to_a(*p.b.next(1), 1);
  p.a.reconnected();
  const auto again = p.a.next(2);
  ASSERT_TRUE(again);
  EXPECT_EQ(again->link.sequence, 2u);
  EXPECT_FALSE(p.a.next(2));
}

TEST(Link, KeepsABoundedNumberOfFramesOnTheWay) {
  LinkOptions o;
  o.window = 8;
  Pair p(o);
  for (std::size_t i = 0; i < 20; ++i) p.a.send(payload(i));
  std::vector<Link::Frame> frames;
  while (auto f = p.a.next(0)) frames.push_back(*f);
  EXPECT_EQ(frames.size(), 8u);
  Link::Frame far = frames[0];
  far.link.sequence = 1000;
  p.to_b(far, 0);
  EXPECT_TRUE(p.at_b.empty());
  for (const auto& f : frames) p.to_b(f, 0);
  p.to_a(*p.b.next(1), 1);
  EXPECT_TRUE(p.a.next(1));
}

TEST(Link, RefusesAnotherIncarnation) {
  Pair p;
  p.a.send(payload(0));
  auto f = *p.a.next(0);
  f.link.incarnation = 77;
  p.to_b(f, 0);
  EXPECT_TRUE(p.at_b.empty());
  EXPECT_EQ(p.b.counters().refused, 1u);
}

TEST(Link, IgnoresAcknowledgementsOfWhatWasNeverSent) {
  Pair p;
  p.a.send(payload(0));
  (void)p.a.next(0);
  std::vector<wire::Bytes> none;
  p.a.receive({2, 0, 5, 0}, nullptr, 0, none);
  EXPECT_FALSE(p.a.drained());
}

// A network that loses a third, doubles, and reorders within twenty frames.
TEST(Link, SurvivesABadNetwork) {
  for (std::uint64_t seed = 0; seed < 50; ++seed) {
    LinkOptions o;
    o.retransmit_after = 0.1;
    o.window = 16;
    Pair p(o);
    std::uint64_t r = mix64(seed + 1);
    std::multimap<double, std::pair<bool, Link::Frame>> air;
    double now = 0;
    std::size_t sent = 0;
    while ((p.at_b.size() < 200 || p.at_a.size() < 200) && now < 1000) {
      now += 0.01;
      if (sent < 200 && (r = mix64(r)) % 2) {
        p.a.send(payload(sent));
        p.b.send(payload(sent++));
      }
      for (const bool from_a : {true, false}) {
        while (auto f = (from_a ? p.a : p.b).next(now)) {
          for (int copies = (r = mix64(r)) % 5 == 0 ? 2 : 1; copies > 0; --copies)
            if ((r = mix64(r)) % 3 != 0)
              air.emplace(now + 0.01 * static_cast<double>(mix64(r) % 20), std::pair(from_a, *f));
        }
      }
      while (!air.empty() && air.begin()->first <= now) {
        const auto [from_a, f] = air.begin()->second;
        air.erase(air.begin());
        from_a ? p.to_b(f, now) : p.to_a(f, now);
      }
    }
    ASSERT_EQ(p.at_b.size(), 200u) << seed;
    ASSERT_EQ(p.at_a.size(), 200u) << seed;
    for (std::size_t i = 0; i < 200; ++i) ASSERT_EQ(p.at_b[i]->size(), i + 1);
  }
}

}  // namespace
}  // namespace cloudrenderer
