#include "web/display.h"

#include <asio/ip/tcp.hpp>
#include <bit>
#include <chrono>
#include <cstring>

#include "base/error.h"
#include "base/log.h"

namespace cloudrenderer {
namespace {

constexpr std::uint64_t kPixelsPerLook = 64 * 1024;
constexpr std::size_t kMostWaiting = 64;  // messages; each holds at most one look's tile
constexpr auto kPatience = std::chrono::seconds(5);

constexpr std::uint8_t kUpdateImage = 3, kCreateImage = 4;

class Message {
 public:
  explicit Message(std::uint8_t kind) : bytes_(4, '\0') { put(kind); }
  template <class T>
  Message& put(T value) {
    static_assert(std::endian::native == std::endian::little);
    const auto* p = reinterpret_cast<const char*>(&value);
    bytes_.append(p, sizeof value);
    return *this;
  }
  Message& put(const std::string& text) {
    bytes_.append(text.c_str(), text.size() + 1);
    return *this;
  }
  std::string finish() {
    const auto n = static_cast<std::uint32_t>(bytes_.size());
    std::memcpy(bytes_.data(), &n, sizeof n);
    return std::move(bytes_);
  }

 private:
  std::string bytes_;
};

}  // namespace

std::string tev::create_image(const std::string& name, std::uint32_t width, std::uint32_t height) {
  Message m(kCreateImage);
  m.put(std::uint8_t{1}).put(name).put(width).put(height).put(std::uint32_t{3});
  for (const char* channel : {"R", "G", "B"}) m.put(std::string(channel));
  return m.finish();
}

std::string tev::update_tile(const std::string& name, std::uint32_t x, std::uint32_t y, std::uint32_t width,
                             std::uint32_t height, const std::vector<Rgb>& pixels) {
  std::string out;
  for (int channel = 0; channel < 3; ++channel) {
    Message m(kUpdateImage);
    m.put(std::uint8_t{0}).put(name).put(std::string(1, "RGB"[channel])).put(x).put(y).put(width).put(height);
    for (const Rgb& c : pixels) m.put(c[channel]);
    out += m.finish();
  }
  return out;
}

struct Display::Connection {
  asio::ip::tcp::iostream stream;
};

Display::Display(const Address& viewer, std::string name) : name_(std::move(name)), connection_(std::make_unique<Connection>()) {
  auto& stream = connection_->stream;
  stream.expires_after(kPatience);
  stream.connect(viewer.host, std::to_string(viewer.port));
  if (!stream)
    throw UsageError("--display " + viewer.to_string() + ": no viewer listens there (" + stream.error().message() + ")");
  thread_ = std::thread([this] { run(); });
}

Display::~Display() {
  {
    const std::lock_guard lock(mutex_);
    closing_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

void Display::look(const RenderView& view) {
  const FilmFrame& frame = view.core.film().frame();
  const bool ended = view.core.finished();
  {
    const std::lock_guard lock(mutex_);
    if (broken_ || (waiting_.size() >= kMostWaiting && !ended)) return;
  }
  std::vector<std::string> messages;
  if (!created_) messages.push_back(tev::create_image(name_, frame.crop_width(), frame.crop_height()));
  created_ = true;
  for (const std::size_t tile : watch_.choose(view.core, ended ? frame.pixels() : kPixelsPerLook)) {
    const RendererRange r = view.core.tile_range(tile);
    messages.push_back(tev::update_tile(name_, r.x0 - frame.x0, r.y0 - frame.y0, r.x1 - r.x0, r.y1 - r.y0,
                                        tile_pixels(view.core, r, view.facts.settings.film)));
  }
  const std::lock_guard lock(mutex_);
  for (std::string& m : messages) waiting_.push_back(std::move(m));
  changed_.notify_all();
}

void Display::run() {
  auto& stream = connection_->stream;
  for (;;) {
    std::string message;
    {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [&] { return closing_ || !waiting_.empty(); });
      if (waiting_.empty()) return;
      message = std::move(waiting_.front());
      waiting_.pop_front();
    }
    stream.expires_after(kPatience);
    stream.write(message.data(), static_cast<std::streamsize>(message.size()));
    stream.flush();
    if (stream) continue;
    spdlog::warn("the viewer has gone: {}", stream.error().message());
    const std::lock_guard lock(mutex_);
    broken_ = true;
    waiting_.clear();
    return;
  }
}

}  // namespace cloudrenderer
