#pragma once
#include <functional>
#include <memory>
#include <string>

#include "cluster/render.h"
#include "net/address.h"
#include "net/tls.h"

namespace cloudrenderer {

struct WindowOptions {
  Address listen;     // port 0 takes a free one
  std::string token;  // "": whoever reaches a loopback address may look; other addresses need one
  TlsOptions tls;     // automatic: encrypted unless `listen` is on the loopback
  std::string scene;  // its name, for people
};

// A web page that shows a render, the same as JSON, and figures for Prometheus (src/web/README.md). Has threads of its
// own for whoever looks; without any the render pays next to nothing.
class Window {
 public:
  // `cancel` is called, on any thread, when a viewer ends the job. Throws UsageError: the address cannot be had, or is
  // open to strangers.
  Window(const WindowOptions& options, std::function<void()> cancel);
  // Viewers get the last state first, a second at most.
  ~Window();
  Window(const Window&) = delete;
  Window& operator=(const Window&) = delete;

  std::string url() const;
  // The render's thread, a few times a second (RenderObserver::look).
  void look(const RenderView& view);

 private:
  struct Server;
  std::unique_ptr<Server> server_;
};

}  // namespace cloudrenderer
