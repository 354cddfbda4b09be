#include <gtest/gtest.h>

#include <asio/connect.hpp>
#include <asio/write.hpp>

#include "net/greeting.h"
#include "net/listener.h"
#include "net/session.h"
#include "net/strangers.h"

namespace cloudrenderer {
namespace {

using namespace std::chrono_literals;
using asio::ip::tcp;

wire::Bytes bytes_of(std::size_t n, int first = 0) {
  std::vector<std::byte> v(n);
  for (std::size_t i = 0; i < n; ++i)
    v[i] = static_cast<std::byte>(i * 7 + static_cast<std::size_t>(first));
  return std::make_shared<const std::vector<std::byte>>(std::move(v));
}

// A server on the loopback that sends every frame back, and plain sockets that talk to it.
class Sessions : public testing::Test {
 protected:
  void listen(SessionLimits limits = {}, bool trust = true) {
    listener_ = std::make_unique<Listener>(
        io_, Address{"127.0.0.1", 0}, [this, limits, trust](std::unique_ptr<Stream> s) {
          auto session = std::make_shared<Session>(std::move(s), limits);
          if (trust) session->trust();
          std::weak_ptr<Session> weak = session;
          session->start({[weak](WireFrame f) {
                            if (const auto held = weak.lock()) held->send(std::move(f));
                          },
                          [this](const std::string& reason) {
                            ++closed_;
                            reason_ = reason;
                          }});
          sessions_.push_back(session);
        });
  }
  tcp::socket connect() {
    tcp::socket s(io_);
    const Address a = listener_->address();
    s.connect({asio::ip::make_address(a.host), a.port});
    return s;
  }
  // Runs the server until the condition holds; fails after some seconds.
  template <class F>
  void run_until(F condition) {
    const auto end = std::chrono::steady_clock::now() + 10s;
    while (!condition()) {
      ASSERT_LT(std::chrono::steady_clock::now(), end) << "it never came";
      io_.run_for(2ms);
    }
  }
  static std::vector<std::byte> frame(const wire::Bytes& payload, std::uint32_t sequence) {
    wire::LinkHeader link;
    link.sequence = sequence;
    const auto head = wire::encode_frame_header(link, payload ? payload->size() : 0);
    std::vector<std::byte> out(head.size() + (payload ? payload->size() : 0));
    std::copy(head.begin(), head.end(), out.begin());
    if (payload) std::copy(payload->begin(), payload->end(), out.begin() + wire::kFrameHeaderBytes);
    return out;
  }
  std::vector<std::byte> read(tcp::socket& s, std::size_t n) {
    std::vector<std::byte> out;
    s.non_blocking(true);
    run_until([&] {
      std::array<std::byte, 65536> piece;
      std::error_code error;
      const std::size_t got =
          s.read_some(asio::buffer(piece, std::min(piece.size(), n - out.size())), error);
      out.insert(out.end(), piece.begin(), piece.begin() + static_cast<std::ptrdiff_t>(got));
      return out.size() == n;
    });
    return out;
  }

  asio::io_context io_;
  std::unique_ptr<Listener> listener_;
  std::vector<std::shared_ptr<Session>> sessions_;
  int closed_ = 0;
  std::string reason_;
};

TEST_F(Sessions, CarryFramesOfEverySizeBothWays) {
  listen();
  tcp::socket s = connect();
  for (const std::size_t n :
       {std::size_t{0}, std::size_t{1}, std::size_t{100}, std::size_t{70'000}}) {
    const auto sent = frame(n == 0 ? nullptr : bytes_of(n), 5);
    asio::write(s, asio::buffer(sent));
    EXPECT_EQ(read(s, sent.size()), sent) << n;
  }
  EXPECT_EQ(sessions_[0]->bytes_sent(), sessions_[0]->bytes_received());
}

TEST_F(Sessions, TakeFramesThatComeInAnyPieces) {
  listen();
  tcp::socket s = connect();
  std::vector<std::byte> sent;
  for (int i = 1; i <= 5; ++i) {
    const auto f = frame(bytes_of(static_cast<std::size_t>(i) * 13), static_cast<std::uint32_t>(i));
    sent.insert(sent.end(), f.begin(), f.end());
  }
  for (const std::byte b : sent) {
    asio::write(s, asio::buffer(&b, 1));
    io_.poll();
  }
  EXPECT_EQ(read(s, sent.size()), sent);
}

TEST_F(Sessions, AreClosedOnALengthThatNobodyMaySend) {
  listen();
  for (const std::uint32_t length :
       {0xffffffffu, 0u, 19u, static_cast<std::uint32_t>(wire::kMaxFrameBytes) + 1}) {
    tcp::socket s = connect();
    std::array<std::uint32_t, wire::kFrameHeaderBytes / 4> words{length};
    asio::write(s, asio::buffer(words));
    const int before = closed_;
    run_until([&] { return closed_ == before + 1; });
    EXPECT_FALSE(reason_.empty());
  }
}

TEST_F(Sessions, LetNoStrangerSendMuch) {
  SessionLimits limits;
  limits.max_stranger_payload = 1000;
  listen(limits, false);
  tcp::socket s = connect();
  asio::write(s, asio::buffer(frame(bytes_of(1001), 1)));
  run_until([&] { return closed_ == 1; });
  EXPECT_NE(reason_.find("1001"), std::string::npos) << reason_;
}

TEST_F(Sessions, LetNoStrangerSitInSilence) {
  SessionLimits limits;
  limits.stranger_timeout = 30ms;
  listen(limits, false);
  tcp::socket s = connect();
  run_until([&] { return closed_ == 1; });
  EXPECT_NE(reason_.find("introduce"), std::string::npos) << reason_;
}

TEST_F(Sessions, EndWhenThePeerHasSaidAll) {
  listen();
  tcp::socket s = connect();
  const auto half = frame(bytes_of(1000), 1);
  asio::write(s, asio::buffer(half.data(), 500));  // in the middle of a frame
  s.shutdown(tcp::socket::shutdown_send);
  run_until([&] { return closed_ == 1; });
  EXPECT_FALSE(reason_.empty());
}

TEST_F(Sessions, CloseAPeerThatReadsNothing) {
  SessionLimits limits;
  limits.max_queued = 1 << 20;
  listen(limits);
  tcp::socket s = connect();
  run_until([&] { return !sessions_.empty(); });
  const wire::Bytes block = bytes_of(1 << 16);
  run_until([&] {
    for (int i = 0; i < 64; ++i) sessions_[0]->send({{}, block});
    return closed_ == 1;
  });
  EXPECT_NE(reason_.find("read"), std::string::npos) << reason_;
}

TEST_F(Sessions, SendWhatIsQueuedBeforeTheyClose) {
  listen();
  tcp::socket s = connect();
  run_until([&] { return !sessions_.empty(); });
  const wire::Bytes block = bytes_of(1 << 16);
  for (int i = 0; i < 100; ++i) sessions_[0]->send({{}, block});
  sessions_[0]->close_when_sent();
  EXPECT_EQ(read(s, 100 * (block->size() + wire::kFrameHeaderBytes)).size(),
            100 * (block->size() + wire::kFrameHeaderBytes));
  run_until([&] { return closed_ == 1; });
  EXPECT_EQ(reason_, "");
}

TEST_F(Sessions, ManyAtATimeAreNoTrouble) {
  listen();
  std::vector<tcp::socket> sockets;
  for (int i = 0; i < 200; ++i) {
    sockets.push_back(connect());
    asio::write(sockets.back(), asio::buffer(frame(bytes_of(100, i), 1)));
  }
  for (int i = 0; i < 200; ++i)
    EXPECT_EQ(read(sockets[static_cast<std::size_t>(i)], 100 + wire::kFrameHeaderBytes), frame(bytes_of(100, i), 1));
  sockets.clear();
  run_until([&] { return closed_ == 200; });
}

TEST_F(Sessions, GarbageClosesAGreetingWithOneReason) {
  int closed = 0, introduced = 0;
  std::vector<std::string> reasons;
  Listener listener(io_, {"127.0.0.1", 0}, [&](std::unique_ptr<Stream> stream) {
    greet(std::move(stream), Handshake::Role::accepts, "secret",
          {[](const auto&) {},
           [&](const auto&, wire::Message&&) {
             ++introduced;
             return true;
           },
           [](const auto&, WireFrame) {},
           [&](const auto&, const std::string& reason) {
             ++closed;
             reasons.push_back(reason);
           }});
  });
  const auto send = [&](const std::vector<std::byte>& bytes) {
    tcp::socket s(io_);
    s.connect({asio::ip::make_address("127.0.0.1"), listener.address().port});
    asio::write(s, asio::buffer(bytes));
    const int before = closed;
    run_until([&] { return closed == before + 1; });
  };
  send(frame(bytes_of(50), 0));                 // no message
  send(frame(nullptr, 0));                      // acknowledges before it has said anything
  send(frame(wire::encode(wire::Hello{}), 0));  // not its turn
  wire::Proof proof;
  proof.set_code("guessed");
  send(frame(wire::encode(proof), 0));
  EXPECT_EQ(introduced, 0);
  for (const std::string& reason : reasons) EXPECT_FALSE(reason.empty());
}

TEST_F(Sessions, OfPeersThatWereRefusedAreNotListenedToAnyMore) {
  int introduced = 0;
  std::vector<std::string> reasons;
  Listener listener(io_, {"127.0.0.1", 0}, [&](std::unique_ptr<Stream> stream) {
    greet(std::move(stream), Handshake::Role::accepts, "",
          {[](const auto&) {},
           [&](const auto& session, wire::Message&&) {
             ++introduced;
             session->close_when_sent("it is refused");
             return false;
           },
           [](const auto&, WireFrame) { ADD_FAILURE() << "it was let in"; },
           [&](const auto&, const std::string& reason) { reasons.push_back(reason); }});
  });
  tcp::socket s(io_);
  s.connect({asio::ip::make_address("127.0.0.1"), listener.address().port});
  std::vector<std::byte> all = frame(wire::encode(wire::Proof{}), 0);
  const auto hello = frame(wire::encode(wire::Hello{}), 0);
  for (int i = 0; i < 100; ++i) all.insert(all.end(), hello.begin(), hello.end());
  asio::write(s, asio::buffer(all));
  run_until([&] { return !reasons.empty(); });
  EXPECT_EQ(introduced, 1);
  EXPECT_EQ(reasons, std::vector<std::string>{"it is refused"});
}

TEST_F(Sessions, OfTooManyStrangersTheOldestMakesRoom) {
  Strangers strangers(3);
  Listener listener(io_, {"127.0.0.1", 0}, [&](std::unique_ptr<Stream> stream) {
    auto session = std::make_shared<Session>(std::move(stream), SessionLimits());
    session->start({[](WireFrame) {}, [](const std::string&) {}});
    strangers.add(session);
    sessions_.push_back(std::move(session));
  });
  std::vector<tcp::socket> sockets;
  for (std::size_t n = 1; n <= 5; ++n) {
    sockets.emplace_back(io_).connect(
        {asio::ip::make_address("127.0.0.1"), listener.address().port});
    run_until([&] { return sessions_.size() == n; });
    if (n == 2) strangers.remove(sessions_[0]);  // it has introduced itself
  }
  run_until([&] { return !sessions_[1]->is_open(); });
  EXPECT_EQ(strangers.size(), 3u);
  for (const unsigned there : {0u, 2u, 3u, 4u}) EXPECT_TRUE(sessions_[there]->is_open()) << there;
}

}  // namespace
}  // namespace cloudrenderer
