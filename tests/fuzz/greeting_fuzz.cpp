// A whole connection: what a stranger sends before and after it is known, in any pieces. The stream
// is made of the input; everything behind it is the real thing.
#include <asio/io_context.hpp>
#include <asio/use_awaitable.hpp>
#include <deque>

#include "fuzz/sealed.h"
#include "net/greeting.h"

using namespace cloudrenderer;

namespace {

constexpr unsigned kSealed = 1, kFramed = 2;  // bits of a piece's operation

class InputStream final : public Stream {
 public:
  InputStream(asio::io_context& io, fuzz::Input bytes) : io_(io) {
    fuzz::Pieces pieces(bytes);
    while (pieces.next()) {
      std::vector<std::byte> payload(pieces.bytes.begin(), pieces.bytes.end());
      if (pieces.operation & kSealed) payload = fuzz::sealed_payload(payload);
      if (pieces.operation & kFramed) {
        const auto head = wire::encode_frame_header({}, payload.size());
        pieces_.emplace_back(head.begin(), head.end());
      }
      pieces_.push_back(std::move(payload));
    }
  }
  asio::any_io_executor executor() override { return io_.get_executor(); }
  asio::awaitable<void> open() override { co_return; }
  asio::awaitable<std::size_t> read_some(asio::mutable_buffer to) override {
    while (!pieces_.empty() && pieces_.front().empty()) pieces_.pop_front();
    if (closed_ || pieces_.empty()) throw std::system_error(asio::error::eof);
    std::vector<std::byte>& from = pieces_.front();
    const std::size_t n = std::min(from.size(), to.size());
    std::memcpy(to.data(), from.data(), n);
    from.erase(from.begin(), from.begin() + static_cast<std::ptrdiff_t>(n));
    co_return n;
  }
  asio::awaitable<void> write(std::span<const asio::const_buffer>) override { co_return; }
  void close() noexcept override { closed_ = true; }
  std::string channel_binding() override { return {}; }
  std::string peer() const override { return "stranger"; }
  Address local() const override { return {"127.0.0.1", 1}; }

 private:
  asio::io_context& io_;
  std::deque<std::vector<std::byte>> pieces_;
  bool closed_ = false;
};

void converse(fuzz::Input bytes, Handshake::Role role, const std::string& secret) {
  asio::io_context io(1);
  int proved = 0, introduced = 0, closed = 0;
  GreetingHandlers h;
  h.proved = [&](const auto&) { ++proved; };
  h.introduced = [&](const auto& session, wire::Message&& m) {
    ++introduced;
    if (std::holds_alternative<wire::Hello>(m)) return true;
    session->close_when_sent();
    return false;
  };
  h.frame = [&](const auto&, const WireFrame& f) {
    if (f.payload) (void)wire::decode(*f.payload);
  };
  h.closed = [&](const auto&, const std::string&) { ++closed; };
  const auto session =
      greet(std::make_unique<InputStream>(io, bytes), role, secret, std::move(h), SessionLimits());
  io.run();
  fuzz::require(closed == 1, "a connection ends once");
  fuzz::require(proved <= 1, "who has proved it need not again");
  fuzz::require(introduced <= proved, "nobody is introduced who has not proved it, nor twice");
  fuzz::require(secret.empty() || proved == 0, "nobody knows the secret by chance");
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const fuzz::Input bytes = fuzz::input(data, size);
  for (const Handshake::Role role : {Handshake::Role::accepts, Handshake::Role::connects})
    for (const char* secret : {"", "a secret"}) converse(bytes, role, secret);
  return 0;
}
