#pragma once
#include <condition_variable>
#include <deque>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "cluster/render.h"
#include "net/address.h"
#include "web/tiles.h"

namespace cloudrenderer {

// Messages of the viewer tev (its README describes them): little-endian, each after its length, which counts itself.
namespace tev {
std::string create_image(const std::string& name, std::uint32_t width, std::uint32_t height);
// One message a channel.
std::string update_tile(const std::string& name, std::uint32_t x, std::uint32_t y, std::uint32_t width,
                        std::uint32_t height, const std::vector<Rgb>& pixels);
}  // namespace tev

// Sends the picture to tev as it grows. A viewer that is slow, or gone, does not hold up the render: what it has no
// time for is left out, and a tile's last state always comes.
class Display {
 public:
  // Throws UsageError when nobody listens at the address.
  Display(const Address& viewer, std::string name);
  ~Display();
  Display(const Display&) = delete;
  Display& operator=(const Display&) = delete;

  void look(const RenderView& view);  // the render's thread

 private:
  void run();

  const std::string name_;
  struct Connection;
  std::unique_ptr<Connection> connection_;
  TileWatch watch_;
  bool created_ = false;

  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<std::string> waiting_;
  bool closing_ = false, broken_ = false;
  std::thread thread_;
};

}  // namespace cloudrenderer
