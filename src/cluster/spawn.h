#pragma once
#include <asio/awaitable.hpp>
#include <asio/co_spawn.hpp>
#include <asio/io_context.hpp>
#include <exception>
#include <string>
#include <utility>

namespace cloudrenderer {

// Runs `work` on the I/O thread; `failed(why)` is called there with what it throws.
template <class Failed>
void spawn(asio::io_context& io, asio::awaitable<void> work, Failed failed) {
  asio::co_spawn(io, std::move(work), [failed = std::move(failed)](std::exception_ptr error) {
    if (!error) return;
    try {
      std::rethrow_exception(error);
    } catch (const std::exception& e) {
      failed(std::string(e.what()));
    }
  });
}

}  // namespace cloudrenderer
