// Frame headers, and the link behind them: whatever order, numbers and doubles come.
#include <vector>

#include "fuzz/fuzz.h"
#include "tasks/link.h"

using namespace cloudrenderer;

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Link link(1, 2);
  double now = 0;
  std::vector<wire::Bytes> delivered;
  fuzz::Pieces pieces(fuzz::input(data, size));
  while (pieces.next()) {
    now += 0.01;
    if (pieces.operation % 4 == 0)
      link.send(
          std::make_shared<const std::vector<std::byte>>(pieces.bytes.begin(), pieces.bytes.end()));
    if (pieces.operation % 4 == 1) link.reconnected();
    while (link.next(now)) {
    }
    if (pieces.bytes.size() < wire::kFrameHeaderBytes) continue;
    const Result<wire::FrameHeader> header =
        wire::decode_frame_header(std::span<const std::byte, wire::kFrameHeaderBytes>(
            pieces.bytes.data(), wire::kFrameHeaderBytes));
    if (!header) continue;
    fuzz::require(header->payload_bytes <= wire::kMaxFrameBytes, "frames are capped");
    const auto rest = pieces.bytes.subspan(wire::kFrameHeaderBytes);
    wire::LinkHeader h = header->link;
    if (pieces.operation & 128) h.incarnation = 2;
    link.receive(h,
                 rest.empty()
                     ? nullptr
                     : std::make_shared<const std::vector<std::byte>>(rest.begin(), rest.end()),
                 now, delivered);
    fuzz::require(link.deadline() >= 0, "a deadline is a time");
  }
  return 0;
}
