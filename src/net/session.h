#pragma once
#include <asio/steady_timer.hpp>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <string>

#include "net/stream.h"
#include "wire/codec.h"

namespace cloudrenderer {

// What travels as one piece: see wire/codec.h. A null payload only acknowledges.
struct WireFrame {
  wire::LinkHeader link;
  wire::Bytes payload;
};

struct SessionLimits {
  // Until trust() is called: a stranger may neither send much nor sit there in silence. Later
  // wire::kMaxFrameBytes.
  std::uint32_t max_stranger_payload = 64u << 10;
  std::chrono::milliseconds stranger_timeout{10'000};
  // A peer that reads nothing while we send is closed at this many queued bytes.
  std::uint64_t max_queued = std::uint64_t{512} << 20;
};

// Frames over a stream. Reads one after the other, writes what is queued in gathered system calls.
// It lives while the connection does (it holds itself) and ends with exactly one call of on_close,
// on the I/O thread.
class Session : public std::enable_shared_from_this<Session> {
 public:
  struct Handlers {
    std::function<void(WireFrame)> on_frame;  // on the I/O thread
    std::function<void(const std::string& reason)>
        on_close;                             // why it ended; "" after a close() of our own
    std::function<void()> on_open = nullptr;  // before all frames; may be left out
  };

  Session(std::unique_ptr<Stream> stream, const SessionLimits& limits);
  void start(Handlers handlers);  // once, on the I/O thread

  // The rest may be called from any thread, also inside handlers.
  void send(WireFrame frame);
  void close(const std::string& reason = {});
  // After what is queued has left, or a few seconds; the reason is this one, whoever closes first.
  void close_when_sent(const std::string& reason = {});
  void trust();            // the peer is who it should be: strangers' limits no longer hold

  bool is_open() const { return !closed_; }
  const std::string& peer() const { return peer_; }
  const Address& local() const { return local_; }
  // With what still waits to be written: whoever tells how much it was tells it behind all of that.
  std::uint64_t bytes_sent() const { return bytes_sent_; }
  std::uint64_t bytes_received() const { return bytes_received_; }
  std::uint64_t bytes_queued() const;
  const std::string& channel_binding() const { return channel_binding_; }  // from on_open on

 private:
  asio::awaitable<void> run();
  asio::awaitable<void> read_frames();
  asio::awaitable<void> write_frames();
  void start_writing();
  void finish(const std::string& reason);  // on the I/O thread

  std::unique_ptr<Stream> stream_;
  const SessionLimits limits_;
  const std::string peer_;
  const Address local_;
  std::string channel_binding_;
  Handlers handlers_;
  asio::steady_timer timer_;  // of strangers, then of close_when_sent()
  std::atomic<bool> closing_ = false, closed_ = false, trusted_ = false;
  std::atomic<std::uint64_t> bytes_sent_ = 0, bytes_received_ = 0;

  mutable std::mutex mutex_;  // guards the queue
  std::deque<WireFrame> queue_;
  std::uint64_t queued_bytes_ = 0;
  bool writing_ = true;  // until the stream is open nothing else may write
  bool close_when_sent_ = false;
  std::string last_reason_;  // of close_when_sent(); on the I/O thread
};

}  // namespace cloudrenderer
