#pragma once
// Which part on which host (scene partition): a pure function of its arguments.
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/id.h"
#include "cloudrenderer/math.h"

namespace cloudrenderer {

struct PlacementPart {
  std::uint64_t bytes = 0;  // loaded
  Vec3 center{0.f};
  std::vector<std::uint32_t> prototypes;  // that its instances need: counted once a host
  std::uint64_t build = 0;    // more, while it or one of its prototypes is being built
  std::uint64_t page = 0;     // for a while, build included; 0: as `bytes` and `build`
  double visits = 0;  // how often rays are expected in it, in any unit, >= 0; all 0: not known
};
struct PlacementHost {
  HostId host;
  std::uint64_t memory = 0;
  double speed = 1;            // > 0, in any unit: its share of the visits
  std::vector<PartId> holds;   // stay where they are: a placement only adds
  std::vector<PartId> cannot;  // parts whose features the host lacks
  bool traces = true;  // else it only intersects: it needs no main scene, and more copies than must be save no moves
};
struct PlacementInput {
  std::vector<PlacementPart> parts;  // [0] is the main scene's, on every host; in spatial order
  std::vector<std::uint64_t> prototype_bytes;
  std::vector<PlacementHost> hosts;
  std::uint32_t min_replication = 1;
  std::uint64_t seed = 0;
};
// For every host (same order) the parts that it shall hold, part 0 left out, ascending. Fails with
// a text for people when a host cannot hold the main scene or not every part finds min_replication
// hosts (or all hosts, if there are fewer). The parts with most visits come to every host, as far as memory
// allows; of the others, spatial neighbours to the same host until it has its share of the visits (of
// the bytes, where visits are not known). Memory that is left takes more copies. Room is left for
// the build that takes most, whatever is there already when it happens.
Result<std::vector<std::vector<PartId>>> place(const PlacementInput& input);

struct PagedPlacement {
  std::vector<std::vector<PartId>> hold;  // as above
  std::vector<PartId> paged;              // no host's, ascending: whoever needs one loads it for a while
};
// For hosts that together cannot hold one copy. Every host keeps room for one part of any kind that comes and goes;
// what is left of the memory holds one copy of the parts with most visits a byte, where they are already if possible
// (`holds` may move). Fails with a text for people when a host has no room for main scene, largest part and its build.
Result<PagedPlacement> place_paged(const PlacementInput& input);

}  // namespace cloudrenderer
