#include <gtest/gtest.h>

#include <asio/co_spawn.hpp>
#include <asio/detached.hpp>

#include "net/listener.h"
#include "net/peer_link.h"

namespace cloudrenderer {
namespace {

using namespace std::chrono_literals;

TEST(PeerLink, DeliversOnceAndInOrderOverConnectionsThatBreak) {
  asio::io_context io;
  const auto start = std::chrono::steady_clock::now();
  const auto now = [&] {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  };
  const auto a = std::make_shared<PeerLink>(io, 1, 2, now),
             b = std::make_shared<PeerLink>(io, 2, 1, now);
  std::vector<int> got;

  const auto begin = [&](const std::shared_ptr<PeerLink>& link, std::unique_ptr<Stream> stream) {
    auto session = std::make_shared<Session>(std::move(stream), SessionLimits{});
    session->trust();
    std::weak_ptr<Session> weak = session;
    session->start({[&, link](WireFrame f) {
                      for (const wire::Bytes& p : link->receive(std::move(f)))
                        got.push_back(std::to_integer<int>((*p)[0]) | std::to_integer<int>((*p)[1])
                                                                          << 8);
                    },
                    [link, weak](const std::string&) {
                      if (const auto s = weak.lock()) link->detach(s.get());
                    }});
    link->attach(session);
  };
  Listener listener(io, {"127.0.0.1", 0},
                    [&](std::unique_ptr<Stream> s) { begin(b, std::move(s)); });
  const auto join = [&]() -> asio::awaitable<void> {
    begin(a, co_await connect(io, listener.address(), 1s));
  };
  const auto run_until = [&](auto condition) {
    const auto end = std::chrono::steady_clock::now() + 20s;
    while (!condition() && std::chrono::steady_clock::now() < end) io.run_for(1ms);
  };

  constexpr int kMessages = 3000;
  asio::co_spawn(io, join(), asio::detached);
  run_until([&] { return a->connected() && b->connected(); });
  for (int i = 0; i < kMessages; ++i) {
    std::vector<std::byte> payload(300);
    payload[0] = static_cast<std::byte>(i & 255);
    payload[1] = static_cast<std::byte>(i >> 8);
    a->send(std::make_shared<const std::vector<std::byte>>(std::move(payload)));
    if (i % 500 == 250) {
      io.run_for(1ms);
      if (const auto s = (i % 1000 == 250 ? a : b)->session()) s->close();
      run_until([&] { return !a->connected() && !b->connected(); });
      asio::co_spawn(io, join(), asio::detached);
    }
  }
  run_until([&] { return got.size() >= kMessages; });
  ASSERT_EQ(got.size(), static_cast<std::size_t>(kMessages));
  for (int i = 0; i < kMessages; ++i) ASSERT_EQ(got[static_cast<std::size_t>(i)], i);
  run_until([&] { return a->queued() == 0; });
  EXPECT_EQ(a->queued(), 0u) << "everything must be acknowledged in the end";
}

TEST(PeerLink, GivesUpASessionThatIsSilentWhileSomethingWaits) {
  asio::io_context io;
  double time = 100;
  const auto link = std::make_shared<PeerLink>(io, 1, 2, [&] { return time; });
  std::unique_ptr<Stream> other;  // takes everything and never says a word
  Listener listener(io, {"127.0.0.1", 0}, [&](std::unique_ptr<Stream> s) { other = std::move(s); });
  std::string reason;
  const auto join = [&]() -> asio::awaitable<void> {
    auto session = std::make_shared<Session>(co_await connect(io, listener.address(), 1s), SessionLimits{});
    session->trust();
    session->start({[](WireFrame) {}, [&](const std::string& why) { reason = why; }});
    link->attach(session);
  };
  asio::co_spawn(io, join(), asio::detached);
  while (!link->connected() || !other) io.run_for(1ms);
  const auto look_for = [&](double seconds) {
    for (const double end = time + seconds; time < end; time += 0.25) link->close_if_silent(3);
    io.run_for(1ms);
  };
  look_for(20);
  EXPECT_EQ(reason, "") << "nothing was asked";
  link->send(std::make_shared<const std::vector<std::byte>>(300));
  look_for(2);
  EXPECT_EQ(reason, "");
  time += 60;  // this process was stopped: it has not listened
  look_for(2);
  EXPECT_EQ(reason, "");
  look_for(2);
  EXPECT_EQ(reason, "it has been silent for too long");
}

TEST(Connect, SaysWhyItFailed) {
  asio::io_context io;
  std::string error;
  asio::co_spawn(io, connect(io, {"127.0.0.1", 1}, 100ms),
                 [&](std::exception_ptr e, std::unique_ptr<Stream>) {
                   try {
                     if (e) std::rethrow_exception(e);
                   } catch (const std::exception& why) {
                     error = why.what();
                   }
                 });
  io.run();
  EXPECT_NE(error.find("127.0.0.1:1"), std::string::npos) << error;
}

}  // namespace
}  // namespace cloudrenderer
