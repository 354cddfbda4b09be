// A manager and peers that say anything: a worker's core goes on.
#include "fuzz/sealed.h"
#include "tasks_support.h"

using namespace cloudrenderer;

namespace {

constexpr int kSteps = 64;  // of work after each message: some paths are still there at the next

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  WorkerOptions options;
  options.path_credits = 256;
  options.camera_batch = 16;
  TestHost host(1, options);
  host.start({1, 2, 3, 4}, map_of(1, 1, TestHost::kParts, {{1, {1, 2, 3, 4}}, {2, {5, 6, 7, 8}}}));
  host.give_range(1);
  fuzz::Pieces pieces(fuzz::input(data, size));
  while (pieces.next()) {
    host.now += pieces.operation & 128 ? 1.0 : 0.001;
    Result<wire::Message> message = wire::decode(fuzz::sealed_payload(pieces.bytes));
    const HostId from(pieces.operation % 4);
    if (message)
      host.core.receive(from, std::move(*message), host.now);
    else
      host.core.peer_unreachable(from);
    host.core.tick(host.now);
    host.run_loader();
    for (int i = 0; i < kSteps && host.step(); ++i) {
    }
    for (const auto& [to, said] : host.core.take_outbox()) {
      fuzz::require(to != host.id, "a host does not write to itself");
      fuzz::require(static_cast<bool>(wire::decode(*wire::encode(said))),
                    "a host can read what it is told");
    }
    fuzz::require(host.core.deadline() >= 0, "a deadline is a time");
  }
  return 0;
}
