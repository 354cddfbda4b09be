#include <gtest/gtest.h>

#include <asio/co_spawn.hpp>
#include <asio/detached.hpp>
#include <asio/write.hpp>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "base/error.h"
#include "net/greeting.h"
#include "net/listener.h"
#include "net/own_certificate.h"
#include "net/tls.h"

namespace cloudrenderer {
namespace {

using namespace std::chrono_literals;
using asio::ip::tcp;
using Role = Handshake::Role;

std::shared_ptr<const Tls> tls(TlsMode mode) {
  TlsOptions o;
  o.mode = mode;
  return std::make_shared<const Tls>(o);
}

// A message with a text of so many bytes.
wire::Bytes bytes_of(std::size_t n) {
  std::string text(n, 0);
  for (std::size_t i = 0; i < n; ++i) text[i] = static_cast<char>('a' + (i * 31 + i / 251) % 26);
  wire::Error message;
  message.set_text(text);
  return wire::encode(message);
}

// One end of a connection that greets, introduces itself by a PeerHello, and notes what happens.
struct End {
  std::string token = "secret";
  SessionLimits limits{};
  std::shared_ptr<Session> session{};
  int proved = 0, introduced = 0, closed = 0;
  std::string reason{};
  std::vector<wire::Bytes> frames{};

  void greet_on(std::unique_ptr<Stream> stream, Role role) {
    GreetingHandlers h;
    h.proved = [this](const auto& s) {
      ++proved;
      send_unsequenced(*s, wire::PeerHello{});
    };
    h.introduced = [this](const auto&, wire::Message&&) {
      ++introduced;
      return true;
    };
    h.frame = [this](const auto&, WireFrame f) { frames.push_back(std::move(f.payload)); };
    h.closed = [this](const auto&, const std::string& why) {
      ++closed;
      reason = why;
      session.reset();
    };
    session = greet(std::move(stream), role, token, std::move(h), limits);
  }
};

// Hands on what it decrypts, and keeps a copy.
asio::awaitable<void> pass_on(std::shared_ptr<Stream> from, std::shared_ptr<Stream> to,
                              std::vector<std::byte>& seen) {
  std::array<std::byte, 4096> bytes;
  try {
    for (;;) {
      const std::size_t n = co_await from->read_some(asio::buffer(bytes));
      seen.insert(seen.end(), bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(n));
      const asio::const_buffer buffer(bytes.data(), n);
      co_await to->write({&buffer, 1});
    }
  } catch (const std::system_error&) {
    from->close();
    to->close();
  }
}

class TlsSessions : public testing::Test {
 protected:
  // The server's end is `server`, whoever comes.
  void listen(TlsMode mode) {
    listener_ = std::make_unique<Listener>(
        io_, Address{"127.0.0.1", 0},
        [this](std::unique_ptr<Stream> s) { server.greet_on(std::move(s), Role::accepts); },
        tls(mode));
  }
  void connect(TlsMode mode, const Address& to) {
    asio::co_spawn(
        io_,
        [](TlsSessions& test, TlsMode how, Address where) -> asio::awaitable<void> {
          test.client.greet_on(
              co_await cloudrenderer::connect(test.io_, where, 1s, cloudrenderer::tls(how)),
              Role::connects);
        }(*this, mode, to),
        asio::detached);
  }
  void connect(TlsMode mode) { connect(mode, listener_->address()); }
  tcp::socket raw() {
    tcp::socket s(io_);
    s.connect({asio::ip::make_address("127.0.0.1"), listener_->address().port});
    return s;
  }
  template <class F>
  void run_until(F condition) {
    const auto end = std::chrono::steady_clock::now() + 10s;
    while (!condition()) {
      ASSERT_LT(std::chrono::steady_clock::now(), end)
          << "it never came; server: " << server.reason << "; client: " << client.reason;
      io_.run_for(2ms);
      io_.restart();
    }
  }
  void expect_strangers() {
    EXPECT_EQ(server.introduced, 0);
    EXPECT_EQ(client.introduced, 0);
  }

  asio::io_context io_;
  std::unique_ptr<Listener> listener_;
  End server, client;
};

TEST_F(TlsSessions, CarryLargeFramesBothWaysAtOnce) {
  listen(TlsMode::on);
  connect(TlsMode::on);
  run_until([&] { return server.introduced == 1 && client.introduced == 1; });
  EXPECT_EQ(server.session->channel_binding().size(), 32u);
  EXPECT_EQ(server.session->channel_binding(), client.session->channel_binding());
  const std::array<std::size_t, 6> sizes{1, 16'364, 16'365, 70'000, 3'000'000, 16'000'000};
  for (const std::size_t n : sizes) {
    server.session->send({{}, bytes_of(n)});
    client.session->send({{}, bytes_of(n)});
  }
  run_until([&] { return server.frames.size() == 6 && client.frames.size() == 6; });
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    EXPECT_TRUE(*server.frames[i] == *bytes_of(sizes[i])) << sizes[i];
    EXPECT_TRUE(*client.frames[i] == *bytes_of(sizes[i])) << sizes[i];
  }
  client.session->close();
  run_until([&] { return server.closed == 1; });
}

TEST_F(TlsSessions, SendWhatIsQueuedBeforeTheyClose) {
  listen(TlsMode::on);
  connect(TlsMode::on);
  run_until([&] { return server.introduced == 1 && client.introduced == 1; });
  for (int i = 0; i < 50; ++i) client.session->send({{}, bytes_of(50'000)});
  client.session->close_when_sent();
  run_until([&] { return server.closed == 1; });
  EXPECT_EQ(server.frames.size(), 50u);
}

TEST_F(TlsSessions, EncryptWhatLeavesTheLoopbackOnly) {
  listen(TlsMode::automatic);
  connect(TlsMode::automatic);
  run_until([&] { return server.introduced == 1 && client.introduced == 1; });
  EXPECT_EQ(client.session->channel_binding(), "");
}

TEST_F(TlsSessions, RefuseAnotherSecret) {
  client.token = "another";
  listen(TlsMode::on);
  connect(TlsMode::on);
  run_until([&] { return server.closed == 1 && client.closed == 1; });
  expect_strangers();
  EXPECT_NE((server.reason + client.reason).find("secret"), std::string::npos);
}

TEST_F(TlsSessions, RefuseWhoDecryptsInBetween) {
  listen(TlsMode::on);
  const auto middle = tls(TlsMode::on);
  std::vector<std::byte> from_client, from_server;
  Listener between(
      io_, Address{"127.0.0.1", 0},
      [&](std::unique_ptr<Stream> stream) {
        asio::co_spawn(
            io_,
            [](asio::io_context& io, std::shared_ptr<Stream> to_client, Address real,
               std::shared_ptr<const Tls> ours, std::vector<std::byte>& a,
               std::vector<std::byte>& b) -> asio::awaitable<void> {
              const std::shared_ptr<Stream> to_server =
                  co_await cloudrenderer::connect(io, real, 1s, ours);
              co_await to_client->open();
              co_await to_server->open();
              asio::co_spawn(io, pass_on(to_client, to_server, a), asio::detached);
              asio::co_spawn(io, pass_on(to_server, to_client, b), asio::detached);
            }(io_, std::move(stream), listener_->address(), middle, from_client, from_server),
            asio::detached);
      },
      middle);
  connect(TlsMode::on, between.address());
  run_until([&] { return server.closed == 1 && client.closed == 1; });
  expect_strangers();
  EXPECT_GT(from_client.size() + from_server.size(), 0u) << "it was not in between";
  EXPECT_NE((server.reason + client.reason).find("secret"), std::string::npos)
      << server.reason << "; " << client.reason;
}

TEST_F(TlsSessions, RefuseAPeerWithoutTlsAndSayWhy) {
  listen(TlsMode::on);
  connect(TlsMode::off);
  run_until([&] { return server.closed == 1 && client.closed == 1; });
  expect_strangers();
  EXPECT_NE(server.reason.find("does not speak TLS"), std::string::npos) << server.reason;
  EXPECT_NE(client.reason.find("it speaks TLS"), std::string::npos) << client.reason;
}

TEST_F(TlsSessions, RefuseAPeerThatWantsTlsAndSayWhy) {
  listen(TlsMode::off);
  connect(TlsMode::on);
  run_until([&] { return server.closed == 1 && client.closed == 1; });
  expect_strangers();
  EXPECT_NE(server.reason.find("it speaks TLS"), std::string::npos) << server.reason;
  EXPECT_NE(client.reason.find("does not speak TLS"), std::string::npos) << client.reason;
}

TEST_F(TlsSessions, CloseOnGarbageAndOnHalfAHandshake) {
  server.limits.stranger_timeout = 100ms;
  listen(TlsMode::on);
  const std::string record{"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03", 11};
  for (const std::string& said :
       {std::string("GET / HTTP/1.1\r\n\r\n"), std::string(100'000, '\xff'), std::string(64, '\0'),
        record + std::string(1000, 'x'),                // the head of a hello, then noise
        record, std::string("\x16"), std::string()}) {  // and then nothing more
    tcp::socket s = raw();
    s.non_blocking(true);
    std::error_code ignored;
    asio::write(s, asio::buffer(said), ignored);
    const int before = server.closed;
    run_until([&] { return server.closed == before + 1; });
    EXPECT_NE(server.reason, "") << said.size();
  }
  expect_strangers();
}

TEST_F(TlsSessions, AnOldRecordingGetsNothing) {
  // The plain bytes of a good connection, and the encrypted ones, played to the same port again.
  for (const TlsMode mode : {TlsMode::off, TlsMode::on}) {
    server = End{};
    client = End{};
    listen(mode);
    std::vector<std::byte> said, heard;
    Listener recorder(io_, Address{"127.0.0.1", 0}, [&](std::unique_ptr<Stream> stream) {
      asio::co_spawn(
          io_,
          [](asio::io_context& io, std::shared_ptr<Stream> near, Address real,
             std::vector<std::byte>& a, std::vector<std::byte>& b) -> asio::awaitable<void> {
            const std::shared_ptr<Stream> far = co_await cloudrenderer::connect(io, real, 1s);
            asio::co_spawn(io, pass_on(near, far, a), asio::detached);
            asio::co_spawn(io, pass_on(far, near, b), asio::detached);
          }(io_, std::move(stream), listener_->address(), said, heard),
          asio::detached);
    });
    connect(mode, recorder.address());
    run_until([&] { return server.introduced == 1 && client.introduced == 1; });
    client.session->close();
    run_until([&] { return server.closed == 1; });
    ASSERT_GT(said.size(), 100u);

    server.reason.clear();
    tcp::socket s = raw();
    asio::write(s, asio::buffer(said));
    run_until([&] { return server.closed == 2; });
    EXPECT_EQ(server.introduced, 1);
    EXPECT_EQ(server.proved, 1);
    EXPECT_NE(server.reason, "");
    if (mode == TlsMode::off) {
      EXPECT_NE(server.reason.find("secret"), std::string::npos) << server.reason;
    }
  }
}

class Files : public TlsSessions {
 protected:
  Files() {
    folder_ =
        std::filesystem::temp_directory_path() /
        ("cloudrenderer-tls-" + std::to_string(::testing::UnitTest::GetInstance()->random_seed()) +
         "-" + std::to_string(reinterpret_cast<std::uintptr_t>(this)));
    std::filesystem::create_directories(folder_);
  }
  ~Files() override { std::filesystem::remove_all(folder_); }
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  // A certificate that signs itself, by the openssl program.
  bool make(const std::string& name) const {
    const std::string command =
        "openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 2 -subj /CN=" +
        name + " -keyout " + path(name + ".key") + " -out " + path(name + ".pem") + " 2>/dev/null";
    return std::system(command.c_str()) == 0;
  }
  std::shared_ptr<const Tls> own(const std::string& name, const std::string& authority) const {
    TlsOptions o{TlsMode::on, path(name + ".pem"), path(name + ".key"), path(authority + ".pem")};
    return std::make_shared<const Tls>(o);
  }
  void meet(std::shared_ptr<const Tls> accepts, std::shared_ptr<const Tls> connects) {
    server = End{};
    client = End{};
    Listener listener(
        io_, Address{"127.0.0.1", 0},
        [this](std::unique_ptr<Stream> s) { server.greet_on(std::move(s), Role::accepts); },
        std::move(accepts));
    asio::co_spawn(
        io_,
        [](asio::io_context& io, End& end, Address to,
           std::shared_ptr<const Tls> how) -> asio::awaitable<void> {
          end.greet_on(co_await cloudrenderer::connect(io, to, 1s, how), Role::connects);
        }(io_, client, listener.address(), std::move(connects)),
        asio::detached);
    run_until([&] {
      return (server.introduced == 1 && client.introduced == 1) ||
             (server.closed == 1 && client.closed == 1);
    });
  }
  std::filesystem::path folder_;
};

TEST_F(Files, PeersMayBringCertificatesOfAnAuthority) {
  if (!make("ours") || !make("other")) GTEST_SKIP() << "no openssl program";
  meet(own("ours", "ours"), own("ours", "ours"));
  EXPECT_EQ(client.introduced, 1) << client.reason << "; " << server.reason;
  client.session->close();
  run_until([&] { return server.closed == 1; });
  meet(own("ours", "ours"), own("other", "ours"));  // a client from elsewhere
  expect_strangers();
  meet(own("other", "ours"), own("ours", "ours"));  // a server from elsewhere
  expect_strangers();
  meet(own("ours", "ours"), tls(TlsMode::on));  // a certificate of its own making
  expect_strangers();
}

TEST_F(Files, WrongOptionsAreNamed) {
  const auto message = [](TlsOptions o) -> std::string {
    try {
      const Tls made(o);
      return "";
    } catch (const UsageError& e) {
      return e.what();
    }
  };
  EXPECT_NE(message({TlsMode::on, "a.pem", "", ""}).find("--tls-key"), std::string::npos);
  EXPECT_NE(message({TlsMode::on, "", "", "ca.pem"}).find("--tls-cert"), std::string::npos);
  EXPECT_NE(message({TlsMode::on, path("none.pem"), path("none.key"), ""}).find("none.pem"),
            std::string::npos);
  EXPECT_NE(message({TlsMode::off, "a.pem", "a.key", ""}).find("--tls off"), std::string::npos);
}

TEST_F(Files, AKeptCertificateIsMadeAgainOnlyWhereItIsOfNoUse) {
  using Names = std::vector<std::string>;
  const auto text = [](const std::string& file) {
    std::ifstream in(file);
    return std::string(std::istreambuf_iterator<char>(in), {});
  };
  const std::string folder = path("");
  const CertificateFiles files = kept_certificate(folder, Names{"farm.example", "10.1.2.3"}, Names{"localhost", "::1"});
  EXPECT_TRUE(files.made);
  EXPECT_EQ(std::filesystem::status(files.key).permissions(), std::filesystem::perms::owner_read | std::filesystem::perms::owner_write);
  const std::string first = text(files.certificate);
  const auto made_for = [&](const Names& names) { return kept_certificate(folder, names, Names{}).made; };
  EXPECT_FALSE(made_for({"farm.example", "10.1.2.3"}));
  EXPECT_FALSE(made_for({"localhost"}));
  EXPECT_FALSE(made_for({"::1"}));
  EXPECT_EQ(text(files.certificate), first);
  EXPECT_TRUE(made_for({"other.example"}));
  EXPECT_NE(text(files.certificate), first);
  EXPECT_FALSE(made_for({"other.example"}));
  EXPECT_TRUE(made_for({"10.1.2.4"}));
  std::ofstream(files.certificate) << first;  // another key's
  EXPECT_TRUE(made_for({"farm.example"}));
  std::filesystem::remove(files.key);
  EXPECT_TRUE(made_for({"farm.example"}));
  std::ofstream(files.certificate) << "nothing";
  EXPECT_TRUE(made_for({"farm.example"}));
  EXPECT_THROW(kept_certificate(path("nowhere"), Names{"farm.example"}, Names{}), ClusterError);
  EXPECT_THROW(kept_certificate(folder, Names{"a,DNS:b"}, Names{}), UsageError);
  EXPECT_THROW(kept_certificate(folder, Names{"fe80::1%eth0"}, Names{}), UsageError);
}

TEST_F(Files, TheTokenComesFromAFileOrTheEnvironment) {
  std::ofstream(path("token")) << "  of the file \n";
  ASSERT_EQ(setenv("CLOUDRENDERER_TOKEN", "of the environment\n", 1), 0);
  EXPECT_EQ(read_token(path("token")), "of the file");
  EXPECT_EQ(read_token(""), "of the environment");
  ASSERT_EQ(setenv("CLOUDRENDERER_TOKEN", " ", 1), 0);
  EXPECT_THROW(read_token(""), UsageError);
  ASSERT_EQ(unsetenv("CLOUDRENDERER_TOKEN"), 0);
  EXPECT_EQ(read_token(""), "");
  EXPECT_THROW(read_token(path("nowhere")), UsageError);
}

}  // namespace
}  // namespace cloudrenderer
