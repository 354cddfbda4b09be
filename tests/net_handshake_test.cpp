#include <gtest/gtest.h>

#include "net/handshake.h"

namespace cloudrenderer {
namespace {

using Messages = std::vector<wire::Message>;

// Lets both ends talk until nothing is left to say; false when one of them refuses.
bool talk(Handshake& a, Handshake& b) {
  Messages to_b = a.begin(), to_a = b.begin();
  while (!to_a.empty() || !to_b.empty()) {
    for (auto [end, in, out] : {std::tuple{&a, &to_a, &to_b}, std::tuple{&b, &to_b, &to_a}})
      for (const wire::Message& m : std::exchange(*in, {})) {
        Result<Messages> answer = end->receive(m);
        if (!answer) return false;
        out->insert(out->end(), answer->begin(), answer->end());
      }
  }
  return true;
}

TEST(Handshake, EndsWithBothSuresWhenTheSecretIsShared) {
  for (const char* secret : {"", "open sesame"}) {
    Handshake a(Handshake::Role::connects, secret), b(Handshake::Role::accepts, secret);
    EXPECT_TRUE(talk(a, b));
    EXPECT_TRUE(a.done());
    EXPECT_TRUE(b.done());
  }
}

TEST(Handshake, RefusesAnotherSecretOrNone) {
  for (const char* other : {"", "open sesamE"}) {
    Handshake a(Handshake::Role::connects, other), b(Handshake::Role::accepts, "open sesame");
    EXPECT_FALSE(talk(a, b));
    EXPECT_FALSE(b.done());
  }
}

TEST(Handshake, ACodePlayedBackProvesNothing) {
  // The attacker sends our own challenge back to us and returns our own answer as its proof.
  Handshake us(Handshake::Role::accepts, "secret");
  const Messages challenge = us.begin();
  const Result<Messages> ours = us.receive(challenge[0]);
  ASSERT_TRUE(ours);
  EXPECT_FALSE(us.receive((*ours)[0]));
  EXPECT_FALSE(us.done());
}

TEST(Handshake, HoldsForOneChannelOnly) {
  const std::string one(32, '1'), other(32, '2');
  for (const auto& [left, right, good] :
       {std::tuple{one, one, true}, {one, other, false}, {one, std::string(), false}}) {
    Handshake a(Handshake::Role::connects, "secret", left);
    Handshake b(Handshake::Role::accepts, "secret", right);
    EXPECT_EQ(talk(a, b), good);
  }
}

TEST(Handshake, AnOldProofDoesNotAnswerANewChallenge) {
  Handshake a(Handshake::Role::connects, "secret"), b(Handshake::Role::accepts, "secret");
  const Result<Messages> old = a.receive(b.begin()[0]);
  ASSERT_TRUE(old);
  EXPECT_TRUE(b.receive((*old)[0]));
  Handshake later(Handshake::Role::accepts, "secret");
  EXPECT_FALSE(later.receive((*old)[0]));
}

TEST(Handshake, ChallengesAreNeverTheSame) {
  const auto nonce = [] {
    return std::get<wire::Challenge>(Handshake(Handshake::Role::accepts, "x").begin()[0]).nonce();
  };
  EXPECT_NE(nonce(), nonce());
}

TEST(Handshake, RefusesOtherMessagesAndOddChallenges) {
  Handshake h(Handshake::Role::accepts, "");
  EXPECT_FALSE(h.receive(wire::Hello{}));
  EXPECT_FALSE(h.receive(wire::Challenge{}));
}

}  // namespace
}  // namespace cloudrenderer
