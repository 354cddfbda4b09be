#include "net/session.h"

#include <algorithm>
#include <array>
#include <asio/co_spawn.hpp>
#include <asio/post.hpp>
#include <vector>

#include "net/tls.h"

namespace cloudrenderer {
namespace {

using HeaderBytes = std::array<std::byte, wire::kFrameHeaderBytes>;
constexpr std::size_t kGatherFrames = 64;
constexpr std::size_t kGatherBytes = std::size_t{1} << 20;
constexpr std::size_t kReadBytes = std::size_t{64} << 10;
constexpr auto kCloseTimeout = std::chrono::seconds(5);

std::size_t payload_size(const WireFrame& f) { return f.payload ? f.payload->size() : 0; }
std::size_t size_of(const WireFrame& f) { return payload_size(f) + wire::kFrameHeaderBytes; }

std::string reason_of(std::exception_ptr error) {
  try {
    std::rethrow_exception(error);
  } catch (const std::system_error& e) {
    return e.code().message();
  } catch (const std::exception& e) {
    return e.what();
  }
}

}  // namespace

Session::Session(std::unique_ptr<Stream> stream, const SessionLimits& limits)
    : stream_(std::move(stream)),
      limits_(limits),
      peer_(stream_->peer()),
      local_(stream_->local()),
      timer_(stream_->executor()) {}

void Session::start(Handlers handlers) {
  handlers_ = std::move(handlers);
  const auto self = shared_from_this();
  timer_.expires_after(limits_.stranger_timeout);
  timer_.async_wait([weak = weak_from_this()](const std::error_code& cancelled) {
    const auto session = weak.lock();
    if (!cancelled && session && !session->trusted_)
      session->finish("it did not introduce itself in time");
  });
  asio::co_spawn(stream_->executor(), run(), [self](std::exception_ptr error) {
    if (error) self->finish(reason_of(error));
  });
}

asio::awaitable<void> Session::run() {
  co_await stream_->open();
  if (closing_ || closed_) co_return;
  channel_binding_ = stream_->channel_binding();
  if (handlers_.on_open) handlers_.on_open();
  start_writing();
  co_await read_frames();
}

asio::awaitable<void> Session::read_frames() {
  std::vector<std::byte> buffer(kReadBytes);
  std::size_t begin = 0, end = 0;  // bytes read and not yet used
  bool first = true;
  while (!closing_ && !closed_) {
    while (end - begin < wire::kFrameHeaderBytes) {
      if (begin == end) begin = end = 0;
      if (end == buffer.size()) {
        std::copy(buffer.begin() + static_cast<std::ptrdiff_t>(begin), buffer.end(),
                  buffer.begin());
        end -= begin;
        begin = 0;
      }
      const std::size_t n =
          co_await stream_->read_some(asio::buffer(buffer.data() + end, buffer.size() - end));
      bytes_received_ += n;
      end += n;
      if (first && end >= 2) {
        first = false;
        if (channel_binding_.empty() && looks_like_tls(std::to_integer<unsigned char>(buffer[0]),
                                                       std::to_integer<unsigned char>(buffer[1]))) {
          finish("it speaks TLS, we do not; do both have the same --tls?");
          co_return;
        }
      }
    }
    HeaderBytes head;
    std::copy_n(buffer.begin() + static_cast<std::ptrdiff_t>(begin), head.size(), head.begin());
    begin += head.size();
    const Result<wire::FrameHeader> header = wire::decode_frame_header(head);
    if (!header) {
      finish(header.error());
      co_return;
    }
    const std::size_t length = header->payload_bytes;
    if (!trusted_ && length > limits_.max_stranger_payload) {
      finish("a stranger's message of " + std::to_string(length) + " bytes");
      co_return;
    }
    std::vector<std::byte> payload;
    std::size_t filled = std::min(length, end - begin);
    // Memory follows the bytes that have really come, not the length that was claimed.
    payload.reserve(std::min(length, std::max(filled, kReadBytes)));
    payload.assign(buffer.begin() + static_cast<std::ptrdiff_t>(begin),
                   buffer.begin() + static_cast<std::ptrdiff_t>(begin + filled));
    begin += filled;
    while (filled < length) {
      if (filled == payload.size())
        payload.resize(std::min(length, std::max(filled * 2, filled + kReadBytes)));
      const std::size_t n = co_await stream_->read_some(
          asio::buffer(payload.data() + filled, payload.size() - filled));
      bytes_received_ += n;
      filled += n;
    }
    if (closing_ || closed_) co_return;
    wire::Bytes shared;
    if (length > 0) shared = std::make_shared<const std::vector<std::byte>>(std::move(payload));
    handlers_.on_frame({header->link, std::move(shared)});
  }
}

void Session::send(WireFrame frame) {
  if (closed_) return;
  {
    const std::lock_guard lock(mutex_);
    if (close_when_sent_) return;
    queued_bytes_ += size_of(frame);
    if (queued_bytes_ > limits_.max_queued) {
      asio::post(stream_->executor(), [self = shared_from_this()] {
        self->finish("it does not read what is sent to it");
      });
      return;
    }
    bytes_sent_ += size_of(frame);
    queue_.push_back(std::move(frame));
    if (writing_) return;
    writing_ = true;
  }
  // Posted: callers may hold locks of their own, and nothing of ours may run inside of them.
  asio::post(stream_->executor(), [self = shared_from_this()] { self->start_writing(); });
}

void Session::start_writing() {
  asio::co_spawn(stream_->executor(), write_frames(),
                 [self = shared_from_this()](std::exception_ptr error) {
                   if (error) self->finish(reason_of(error));
                 });
}

asio::awaitable<void> Session::write_frames() {
  std::vector<WireFrame> frames;
  std::vector<HeaderBytes> headers;
  std::vector<asio::const_buffer> buffers;
  while (!closed_) {
    frames.clear();
    std::size_t bytes = 0;
    bool close_now = false;
    {
      const std::lock_guard lock(mutex_);
      while (!queue_.empty() && frames.size() < kGatherFrames && bytes < kGatherBytes) {
        bytes += size_of(queue_.front());
        frames.push_back(std::move(queue_.front()));
        queue_.pop_front();
      }
      if (frames.empty()) {
        writing_ = false;
        close_now = close_when_sent_;
      }
    }
    if (frames.empty()) {
      if (close_now) finish({});
      co_return;
    }
    headers.clear();
    buffers.clear();
    headers.reserve(frames.size());  // the buffers point into it
    for (const WireFrame& f : frames) {
      headers.push_back(wire::encode_frame_header(f.link, payload_size(f)));
      buffers.emplace_back(headers.back().data(), headers.back().size());
      if (f.payload) buffers.emplace_back(f.payload->data(), f.payload->size());
    }
    co_await stream_->write(buffers);
    const std::lock_guard lock(mutex_);
    queued_bytes_ -= bytes;
  }
}

void Session::close(const std::string& reason) {
  if (closing_.exchange(true)) return;
  asio::post(stream_->executor(), [self = shared_from_this(), reason] { self->finish(reason); });
}

void Session::close_when_sent(const std::string& reason) {
  asio::post(stream_->executor(), [self = shared_from_this(), reason] {
    if (self->closed_) return;
    bool idle = false;
    if (self->last_reason_.empty()) self->last_reason_ = reason;
    {
      const std::lock_guard lock(self->mutex_);
      self->close_when_sent_ = true;
      idle = !self->writing_;
    }
    if (idle) return self->finish({});
    self->timer_.expires_after(kCloseTimeout);
    self->timer_.async_wait([weak = self->weak_from_this()](const std::error_code& cancelled) {
      const auto session = weak.lock();
      if (!cancelled && session) session->finish({});
    });
  });
}

void Session::trust() { trusted_ = true; }

std::uint64_t Session::bytes_queued() const {
  const std::lock_guard lock(mutex_);
  return queued_bytes_;
}

void Session::finish(const std::string& reason) {
  if (closed_.exchange(true)) return;
  timer_.cancel();
  stream_->close();
  {
    const std::lock_guard lock(mutex_);
    queue_.clear();
  }
  // The handlers often own what owns this session: let go of them so that no cycle stays.
  const Handlers handlers = std::move(handlers_);
  handlers_ = {};
  if (handlers.on_close) handlers.on_close(last_reason_.empty() ? reason : last_reason_);
}

}  // namespace cloudrenderer
